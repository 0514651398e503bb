"""The case studies of Osipov & Sun: printed numbers, and ours beside them."""

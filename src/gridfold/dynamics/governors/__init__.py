"""Speed governors, one file a model."""

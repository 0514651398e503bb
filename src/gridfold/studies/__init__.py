"""Studies: where the mathematics and the power systems meet."""

"""Single runs: where the mathematics and the power systems meet."""

"""Dynamic equivalents: reduced and linear models, the runs that switch between them, their errors."""

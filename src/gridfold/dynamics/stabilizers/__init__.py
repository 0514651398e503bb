"""Power-system stabilizers, one file a model."""

"""Exciters, one file a model."""

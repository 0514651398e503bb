"""Machines, one file a model."""

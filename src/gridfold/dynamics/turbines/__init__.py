"""Turbines, one file a model."""

"""Converters and what controls them, one file each."""

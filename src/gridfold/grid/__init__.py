"""Grids as pure data: cases, network states, events. Knows no dynamics and no files."""

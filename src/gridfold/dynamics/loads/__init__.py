"""Devices of loads: voltage and frequency dependence, induction motors."""

"""Voltage compensators, between the terminals of a machine and its exciter."""

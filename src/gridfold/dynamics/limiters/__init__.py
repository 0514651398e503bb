"""Limiters of excitation, whose signals an exciter adds to that of its stabilizer."""

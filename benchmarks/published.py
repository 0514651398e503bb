"""Published numbers that gridfold is compared with.

Source: D. Osipov and K. Sun, "Adaptive Nonlinear Model Reduction for Fast Power System Simulation",
Table I.
"""

from __future__ import annotations

SOURCE = "Osipov & Sun, Table I"

#: Critical clearing time in seconds of a three-phase fault at each bus of the study area.
CRITICAL_CLEARING_TIMES = {
    1: 0.13, 2: 0.13, 3: 0.39, 4: 0.12, 5: 0.09, 6: 0.08,
    7: 0.05, 8: 0.05, 9: 0.06, 10: 0.13, 11: 0.19, 12: 0.10,
    13: 0.12, 14: 0.13, 15: 0.07, 16: 0.05, 17: 0.03, 18: 0.04,
    19: 0.03, 20: 0.03, 21: 0.22, 22: 0.19, 23: 0.20, 24: 0.18,
    25: 0.22, 26: 0.03, 27: 0.10, 28: 0.12, 29: 0.06, 30: 0.06,
    31: 0.08, 32: 0.11, 33: 0.11, 34: 0.15, 35: 0.14, 36: 0.21,
}  # fmt: skip

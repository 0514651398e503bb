"""Names of columns in MATPOWER's tables, as ``idx_bus`` and its like give them (manual, app. B)."""

from __future__ import annotations

_BUS = [
    "PQ", "PV", "REF", "NONE", "BUS_I", "BUS_TYPE", "PD", "QD", "GS", "BS", "BUS_AREA", "VM",
    "VA", "BASE_KV", "ZONE", "VMAX", "VMIN", "LAM_P", "LAM_Q", "MU_VMAX", "MU_VMIN",
]  # fmt: skip
_GEN = [
    "GEN_BUS", "PG", "QG", "QMAX", "QMIN", "VG", "MBASE", "GEN_STATUS", "PMAX", "PMIN", "MU_PMAX",
    "MU_PMIN", "MU_QMAX", "MU_QMIN", "PC1", "PC2", "QC1MIN", "QC1MAX", "QC2MIN", "QC2MAX",
    "RAMP_AGC", "RAMP_10", "RAMP_30", "RAMP_Q", "APF",
]  # fmt: skip
_BRANCH = [
    "F_BUS", "T_BUS", "BR_R", "BR_X", "BR_B", "RATE_A", "RATE_B", "RATE_C", "TAP", "SHIFT",
    "BR_STATUS", "PF", "QF", "PT", "QT", "MU_SF", "MU_ST", "ANGMIN", "ANGMAX", "MU_ANGMIN",
    "MU_ANGMAX",
]  # fmt: skip

#: What each function returns, one value after the other: kinds of buses first, then columns from 1.
COLUMN_LISTS: dict[str, tuple[int, ...]] = {
    "idx_bus": (1, 2, 3, 4, *range(1, 18)),
    "idx_gen": (*range(1, 11), *range(22, 26), *range(11, 22)),
    "idx_brch": (*range(1, 12), *range(14, 20), 12, 13, 20, 21),
}
#: The same by the names that ``define_constants`` gives them.
DEFINED_CONSTANTS: dict[str, float] = {
    name: float(column)
    for function, names in (("idx_bus", _BUS), ("idx_gen", _GEN), ("idx_brch", _BRANCH))
    for name, column in zip(names, COLUMN_LISTS[function], strict=True)
}

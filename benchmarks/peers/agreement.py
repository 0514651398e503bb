"""How far gridfold and ANDES agree: rotor angles after faults, and eigenvalues."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from andes_conventions import CONVENTIONS
from both import (
    FAULTS,
    FINE,
    KUNDUR,
    TIGHT,
    TIMED,
    Error,
    Outcome,
    Study,
    andes_eigenvalues,
    build,
    difference,
    run_andes,
    run_gridfold,
)
from report import Table

from gridfold import RungeKutta4, small_signal

#: Seconds that are compared, and the step of ANDES beside the finest.
T_COMPARED, COARSER = 5.0, 0.002


def tables(homes: Mapping[str, Path], fine: Mapping[tuple[str, Study], Outcome]) -> list[Table]:
    """All tables; `homes` are the environments and `fine` the finest runs of ANDES by version."""
    return [agreement(homes, fine), by_convention(list(homes), fine), by_eigenvalue(homes)]


def agreement(homes: Mapping[str, Path], fine: Mapping[tuple[str, Study], Outcome]) -> Table:
    """gridfold as it is against ANDES."""
    rows = []
    for study in FAULTS:
        ours = run_gridfold(study, T_COMPARED, RungeKutta4(FINE))
        for version, home in homes.items():
            coarser = run_andes(home, study, T_COMPARED, COARSER, TIGHT)
            for step, theirs in ((COARSER, coarser), (FINE, fine[version, study])):
                error = difference(theirs, ours, T_COMPARED)
                rows.append((str(study), version, f"{step * 1e3:.0f} ms", *_columns(error)))
    return Table(
        "Rotor angles of ANDES less those of gridfold, which follows PSS/E, over "
        f"{T_COMPARED:g} s, in degrees against the centre of inertia:",
        ("fault", "ANDES", "its step", "at the start", "largest", "RMS", "RMS, worst machine"),
        rows,
    )


def _columns(error: Error) -> tuple[str, ...]:
    return f"{error.start:.1e}", *(f"{x:.3f}" for x in (error.largest, error.rms, error.worst))


def by_convention(versions: list[str], fine: Mapping[tuple[str, Study], Outcome]) -> Table:
    """The same with one convention of ANDES after another."""
    rows = []
    for study in FAULTS:
        for name in conventions(study):
            ours = run_gridfold(study, T_COMPARED, RungeKutta4(FINE), CONVENTIONS[name])
            errors = [difference(fine[version, study], ours, T_COMPARED) for version in versions]
            rows.append((str(study), name, *map(str, errors)))
    return Table(
        "The same at 1 ms with gridfold's devices changed to the conventions of ANDES, one after "
        "another; largest difference / RMS in degrees:",
        ("fault", "as in ANDES", *(f"ANDES {version}" for version in versions)),
        rows,
    )


def conventions(study: Study) -> list[str]:
    """The conventions that matter to the devices of a case."""
    names = list(CONVENTIONS)
    return names if study.case == KUNDUR[0] else names[:2]


def by_eigenvalue(homes: Mapping[str, Path]) -> Table:
    """How far eigenvalues of ANDES are from those of gridfold."""
    rows = []
    for study in TIMED:
        theirs = [andes_eigenvalues(home, study) for home in homes.values()]
        for name in conventions(study):
            ours = small_signal(build(study, CONVENTIONS[name])).eigenvalues
            far = [np.abs(values[:, None] - ours).min(axis=1).max() for values in theirs]
            rows.append((study.case, name, *(f"{value:.1e}" for value in far)))
    return Table(
        "Largest distance of an eigenvalue of ANDES to the nearest one of gridfold, in 1/s:",
        ("case", "as in ANDES", *(f"ANDES {version}" for version in homes)),
        rows,
    )

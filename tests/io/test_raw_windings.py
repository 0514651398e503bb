"""Transformers whose windings' nominal voltages are not the buses' base voltages, in ohms."""

from __future__ import annotations

from itertools import product
from pathlib import Path

import numpy as np
import pytest
from raw_texts import TRANSFORMERS, raw_text

import gridfold as gf

#: Base of the system and of the windings in MVA; base voltages of buses 1, 3 and 5 in kV.
SYSTEM, WINDINGS = 100.0, 50.0
BASES = {1: 18.0, 3: 230.0, 5: 115.0}
#: Impedance in per unit of the winding, voltages of the windings in per unit of their buses.
R, X, FIRST, SECOND = 0.004, 0.06, 1.02, 0.99


def read(folder: Path, *lines: str) -> gf.Case:
    path = folder / "case.raw"
    path.write_text(raw_text({"TRANSFORMER": (*TRANSFORMERS, *lines)}), encoding="utf-8")
    return gf.load_case(path, allow_unsupported_network=True)


def winding(code: int, turns: float, base: float, nominal: float) -> float:
    """WINDV of a winding whose voltage is `turns` of its bus's base voltage."""
    return {1: turns, 2: turns * base, 3: turns * base / (nominal or base)}[code]


def given(code: int, r: float, x: float) -> tuple[float, float]:
    """R and X of a record: in per unit, or load loss in W and magnitude (CZ 3)."""
    return (r * WINDINGS * 1e6, abs(complex(r, x))) if code == 3 else (r, x)


@pytest.mark.parametrize(("cw", "cz"), list(product((1, 2, 3), (1, 2, 3))))
@pytest.mark.parametrize(("first", "second"), list(product((0.0, 18.0, 19.0), (0.0, 230.0, 240.0))))
def test_an_impedance_is_the_same_in_ohms(cw, cz, first, second, tmp_path):
    r, x = given(cz, R, X)
    case = read(
        tmp_path,
        f"1,3,0,'T',{cw},{cz},1,0,0,2,'T',1",
        f"{r!r},{x!r},{WINDINGS}",
        f"{winding(cw, FIRST, BASES[1], first)!r},{first},0",
        f"{winding(cw, SECOND, BASES[3], second)!r},{second}",
    )
    branch = next(b for b in case.branches if b.circuit == "T")
    nominal = first or BASES[1]
    ohms = complex(R, X) * (nominal**2 / WINDINGS if cz != 1 else BASES[1] ** 2 / SYSTEM)
    # The impedance belongs to nominal turns; gridfold's stands behind the second winding's.
    wanted = ohms / (BASES[1] ** 2 / SYSTEM) * SECOND**2
    assert complex(branch.resistance, branch.reactance) == pytest.approx(wanted, rel=1e-9)
    assert branch.ratio == pytest.approx(FIRST / SECOND, rel=1e-9)


@pytest.mark.parametrize(("cm", "nominal"), list(product((1, 2), (0.0, 18.0, 19.0))))
def test_a_magnetizing_branch_is_the_same_in_siemens(cm, nominal, tmp_path):
    """With CM 2 losses in W and exciting current in p.u. at the nominal voltage."""
    losses, current = 60e3, 0.01
    mag = (losses, current) if cm == 2 else (6e-4, -5e-3)
    case = read(
        tmp_path,
        f"1,3,0,'T',1,1,{cm},{mag[0]},{mag[1]},2,'T',1",
        f"{R},{X},{WINDINGS}",
        f"1.0,{nominal},0",
        "1.0,0",
    )
    branch = next(b for b in case.branches if b.circuit == "T")
    found = complex(branch.from_conductance, branch.from_susceptance)
    if cm == 1:
        assert found == pytest.approx(complex(*mag), rel=1e-9)
        return
    kilovolts = nominal or BASES[1]
    conductance = losses / 1e6 / kilovolts**2
    admittance = current * WINDINGS / kilovolts**2
    siemens = complex(conductance, -np.sqrt(admittance**2 - conductance**2))
    assert found == pytest.approx(siemens * BASES[1] ** 2 / SYSTEM, rel=1e-9)


@pytest.mark.parametrize("cz", [1, 2, 3])
@pytest.mark.parametrize("nominal", [(0.0, 0.0, 0.0), (19.0, 240.0, 110.0), (0.0, 225.0, 0.0)])
def test_each_pair_of_three_windings_is_on_its_own(cz, nominal, tmp_path):
    pairs = [(0.004, 0.06), (0.005, 0.08), (0.006, 0.07)]
    records = [f"{r!r},{x!r},{WINDINGS}" for r, x in (given(cz, *pair) for pair in pairs)]
    case = read(
        tmp_path,
        f"1,3,5,'T',1,{cz},1,0,0,2,'T',1",
        ",".join([*records, "1,0"]),
        *(f"1.0,{kilovolts},0" for kilovolts in nominal),
    )
    legs = [complex(leg.resistance, leg.reactance) for leg in case.branches[-3:]]
    for k, (pair, bus) in enumerate(zip(pairs, BASES, strict=True)):
        base = BASES[bus] ** 2 / SYSTEM
        ohms = complex(*pair) * ((nominal[k] or BASES[bus]) ** 2 / WINDINGS if cz != 1 else base)
        assert legs[k] + legs[(k + 1) % 3] == pytest.approx(ohms / base, rel=1e-9)

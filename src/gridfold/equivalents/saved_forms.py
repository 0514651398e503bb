"""What the arrays of a saved reduced model have to be, for one model of the whole system."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from gridfold.dynamics.model import DetailedModel
from gridfold.io.array_files import ArrayForm, Forms
from gridfold.partition import Partition, partition


def reduced_forms(header: Mapping[str, Any], names: tuple[str, ...], model: DetailedModel) -> Forms:
    """Forms of the arrays `names` behind a header.

    Raises
    ------
    OptionError, TypeError, ValueError
        The header does not fit the model.
    """
    whole = {
        "x0": ArrayForm("f", (model.n_states,)),
        "state_names": ArrayForm("U", (model.n_states,)),
    }
    parts = partition(model, header["study_buses"])
    if header["outputs"] == "polar":
        further = _ladder_forms(len(header["areas"]), parts)
    else:
        further = _area_forms(names, parts)
    return Forms({**whole, **further.arrays}, further.ceilings)


def _area_forms(names: tuple[str, ...], parts: Partition) -> Forms:
    """Forms for n external states, m inputs, and as many reduced states r as the file says."""
    n = len(parts.states_of(parts.external_units))
    m = 2 * len(parts.boundary_buses)
    modal = "area_partners" in names
    shapes: dict[str, tuple[int | str, ...]] = {
        "u0": (m,), "drift": (n,), "hankel": ("h",),
        "area_a": (2, "r") if modal else ("r", "r"), "area_b": ("r", m),
        "full_a": (n, n), "full_b": (n, m), "full_c": ("p", n), "full_d": ("p", m),
        "reduced_a": ("r", "r"), "reduced_b": ("r", m), "reduced_c": ("p", "r"),
        "reduced_d": ("p", m),
    }  # fmt: skip
    for name in ("reduction", "area"):
        shapes |= {
            f"{name}_reference": (n,),
            f"{name}_lift": (n, "r"),
            f"{name}_restrict": ("r", n),
        }
    forms = {
        name: ArrayForm("f", shape, optional=name == "hankel") for name, shape in shapes.items()
    }
    if modal:
        forms["area_partners"] = ArrayForm("i", ("r",), below="r")
    ceilings = {"r": n, "h": n, "p": n + m}
    for name in ("full", "reduced"):
        for kind in ("state_names", "input_names", "output_names"):
            length = f"{name}_{kind}"
            forms[length] = ArrayForm("U", (length,))  # as many as there are, or none
            ceilings[length] = n + m
    return Forms(forms, ceilings)


def _ladder_forms(n_areas: int, parts: Partition) -> Forms:
    """Forms for areas of any n states behind p/2 ports, reduced to any r."""
    forms: dict[str, ArrayForm] = {}
    ceilings: dict[str, int] = {}
    for k in range(n_areas):
        n, r, p, q, h = (f"{letter}{k}" for letter in "nrpqh")
        shapes = {"lift": (n, r), "restrict": (r, n), "weights": (p, p), "input_weights": (q, q),
                  "hankel": (h,)}  # fmt: skip
        forms |= {f"area{k}_{name}": ArrayForm("f", shape) for name, shape in shapes.items()}
        states, buses = parts.model.n_states, 2 * len(parts.model.case.buses)
        ceilings |= {n: states, r: states, h: states, p: buses, q: buses}
    return Forms(forms, ceilings)

"""Keep a reduced external area in a file, and take it up again for the same case."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gridfold.dynamics.area_model import BoundaryCoupling, LinearArea
from gridfold.dynamics.model import DetailedModel
from gridfold.dynamics.network import LoadModel
from gridfold.dynamics.unit_limits import limits_touched
from gridfold.equivalents.families import COLUMN_NORM, ReducedExternal
from gridfold.equivalents.ladder import Ladder
from gridfold.equivalents.saved_forms import reduced_forms
from gridfold.equivalents.saved_ladder import build_ladder, ladder_arrays, ladder_header
from gridfold.errors import CaseFileError, GridfoldError, OptionError
from gridfold.io.array_files import Forms
from gridfold.io.reduced_files import ReducedFile, read_reduced, write_reduced
from gridfold.partition import couple, partition
from gridfold.reduction import BalancedTruncation, ModalTruncation, Reducer, Reduction
from gridfold.runs.basis import basis_of
from gridfold.systems.linear import LinearSystem
from gridfold.systems.statemap import StateMap

#: Reducers that can be written to a file and built again from it.
_REDUCERS = {kind.__name__: kind for kind in (BalancedTruncation, ModalTruncation)}
#: What a header that does not fit makes Python and NumPy raise.
_MISFITS = (ArithmeticError, AttributeError, LookupError, TypeError, ValueError)
#: Largest difference of a state (p.u., rad) at which two operating points are the same.
SAME_POINT = 1e-6


class SavedReduction(NamedTuple):
    """A reduced external area, and with the paper's models the column norm (p.u.) of kept machines."""

    family: ReducedExternal | Ladder
    column_norm: float | None


def reducer_record(reducer: Reducer) -> dict[str, Any]:
    """Name and settings of a reducer, ready for JSON.

    Raises
    ------
    OptionError
        It is none of the package's own.
    """
    for name, kind in _REDUCERS.items():
        if type(reducer) is kind:
            return {"name": name, **asdict(reducer)}
    known = " or ".join(_REDUCERS)
    raise OptionError(f"a reducer that is written to a file must be {known}, not {reducer!r}")


def save_reduced(
    path: str | Path, family: ReducedExternal | Ladder, column_norm: float = COLUMN_NORM
) -> None:
    """Write a reduced external area to a file.

    Parameters
    ----------
    path : str or Path
        The file, by custom ``NAME.npz``.
    family : Ladder or ReducedExternal
        A :class:`gridfold.Ladder`, or what :func:`gridfold.reduce` gives.
    column_norm : float
        With the latter, the threshold in p.u. that was given there.

    Raises
    ------
    OptionError
        The threshold does not give the machines that were kept, or the reducer cannot be written.
    OutputError
        The file cannot be written.
    """
    case, reducer = family.parts.model.case, _reducer_of(family)
    header = {
        "case": case.name,
        "fingerprint": case.fingerprint,
        "study_buses": sorted(family.parts.study_buses),
        "reducer": reducer_record(reducer),
        "own_devices": family.parts.model.own_devices,
        **basis_of(family.parts.model).record(),
    }
    if isinstance(family, Ladder):
        content = ReducedFile(header | ladder_header(family), ladder_arrays(family))
    else:
        content = ReducedFile(header | _header(family, column_norm), _arrays(family))
    write_reduced(Path(path), content)


def _reducer_of(family: ReducedExternal | Ladder) -> Reducer:
    return family.areas[0].reducer if isinstance(family, Ladder) else family.reducer


def _header(family: ReducedExternal, column_norm: float) -> dict[str, Any]:
    if family.coupling.kept(column_norm) != family.kept:
        raise OptionError(f"a column norm of {column_norm:g} p.u. keeps other machines")
    return {
        "column_norm": column_norm,
        "bound": family.reduction.bound,
        "kept_exactly": family.reduction.kept_exactly,
        "outputs": "states",
        "coupling": family.boundary.value,
    }


def load_reduced(path: str | Path, model: DetailedModel) -> SavedReduction:
    """Read a reduced external area for `model`; runs with it equal those with the one saved.

    Raises
    ------
    CaseFileError
        The file cannot be read, or is not one of a reduced model.
    OptionError
        It belongs to another case or operating point, or has another version of the format.
    """
    path = Path(path)

    def forms(header: Mapping[str, Any], names: tuple[str, ...]) -> Forms:
        _check_case(header, model, path)
        with _fitting(path):
            return reduced_forms(header, names, model)

    content = read_reduced(path, forms)
    _check_point(content, model, path)
    with _fitting(path):
        return _build(content, model)


@contextmanager
def _fitting(path: Path) -> Iterator[None]:
    """What does not fit together as a :class:`CaseFileError`."""
    try:
        yield
    except CaseFileError:
        raise
    except (GridfoldError, *_MISFITS) as error:
        raise CaseFileError(f"the content does not fit together: {error}", str(path)) from None


def _check_case(header: Mapping[str, Any], model: DetailedModel, path: Path) -> None:
    case = model.case
    if header["fingerprint"] != case.fingerprint:
        raise OptionError(
            f"{path}: the reduced model belongs to case {header['case']} with fingerprint "
            f"{header['fingerprint'][:16]}, not to case {case.name} with {case.fingerprint[:16]}"
        )
    now = model.own_devices
    for name, digest in header.get("own_devices", now).items():
        if now.get(name) != digest:
            raise OptionError(
                f"{path}: the reduced model was made with another device model {name} of your own: "
                f"sha256 {str(digest)[:16]}, here {now.get(name, 'none')[:16]}"
            )
    loads = header.get("load_model", LoadModel().text)
    if loads != model.loads.text:
        raise OptionError(
            f"{path}: the reduced model has loads {loads}, the model of the case {model.loads.text}"
        )


def _check_point(content: ReducedFile, model: DetailedModel, path: Path) -> None:
    names, x0 = content.arrays["state_names"].tolist(), content.arrays["x0"]
    if tuple(names) != model.state_names:
        raise CaseFileError("the states are not those of the case", str(path))
    apart = np.abs(x0 - model.x0)
    if not apart.max(initial=0.0) <= SAME_POINT:
        worst = int(np.argmax(apart))
        raise OptionError(
            f"{path}: the reduced model belongs to another operating point: {names[worst]} is "
            f"{x0[worst]:.6g} there and {model.x0[worst]:.6g} here"
        )


def _arrays(family: ReducedExternal) -> dict[str, NDArray[Any]]:
    area, reduction = family.area, family.reduction
    arrays = {
        "x0": family.origin,
        "u0": area.input_reference,
        "state_names": np.array(family.parts.model.state_names, dtype=np.str_),
        "drift": area.drift,
        "area_a": area.a,
        "area_b": area.b,
    }
    if reduction.hankel_values is not None:
        arrays["hankel"] = reduction.hankel_values
    if area.partners is not None:
        arrays["area_partners"] = area.partners
    for name, states in (("reduction", reduction.state_map), ("area", area.states)):
        arrays[f"{name}_reference"] = states.reference
        arrays[f"{name}_lift"] = states.lift_matrix
        arrays[f"{name}_restrict"] = states.restrict_matrix
    for name, system in (("full", area.full), ("reduced", reduction.system)):
        arrays |= {f"{name}_{matrix}": getattr(system, matrix) for matrix in "abcd"}
        for kind in ("state_names", "input_names", "output_names"):
            arrays[f"{name}_{kind}"] = np.array(getattr(system, kind), dtype=np.str_)
    return arrays


def _build(content: ReducedFile, model: DetailedModel) -> SavedReduction:
    header, arrays = content.header, content.arrays
    settings = dict(header["reducer"])
    reducer = _REDUCERS[settings.pop("name")](**settings)
    if header["outputs"] == "polar":
        return SavedReduction(build_ladder(header, arrays, model, reducer), None)
    parts = partition(model, header["study_buses"])
    coupling = couple(parts)
    reduction = Reduction(
        system=_system("reduced", arrays),
        state_map=_states("reduction", arrays),
        hankel_values=arrays.get("hankel"),
        bound=header["bound"],
        kept_exactly=header["kept_exactly"],
    )
    area = LinearArea(
        index=np.array(parts.states_of(parts.external_units), dtype=np.int64),
        states=_states("area", arrays),
        full=_system("full", arrays),
        a=arrays["area_a"],
        partners=arrays.get("area_partners"),
        b=arrays["area_b"],
        input_reference=arrays["u0"],
        drift=arrays["drift"],
    )
    norm = header["column_norm"]
    family = ReducedExternal(
        parts=parts,
        coupling=coupling,
        kept=coupling.kept(norm),
        reduction=reduction,
        area=area,
        origin=arrays["x0"],
        reducer=reducer,
        boundary=BoundaryCoupling(header.get("coupling", BoundaryCoupling.EXACT.value)),
        at_limits=limits_touched(model, arrays["x0"], parts.external_units),
    )
    return SavedReduction(family, norm)


def _states(name: str, arrays: Mapping[str, NDArray[Any]]) -> StateMap:
    return StateMap(*(arrays[f"{name}_{part}"] for part in ("reference", "lift", "restrict")))


def _system(name: str, arrays: Mapping[str, NDArray[Any]]) -> LinearSystem:
    a, b, c, d = (arrays[f"{name}_{matrix}"] for matrix in "abcd")
    kinds = ("state_names", "input_names", "output_names")
    states, inputs, outputs = (tuple(arrays[f"{name}_{kind}"].tolist()) for kind in kinds)
    return LinearSystem(a, b, c, d, states, inputs, outputs)

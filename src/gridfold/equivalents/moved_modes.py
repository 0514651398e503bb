"""Swing modes of the study area that a reduction has moved.

A reduced model answers small swings with its own eigenvalues. Those of the swings in which machines of
the study area take part are compared with the modes of the whole system, each found from the reduced
one by Rayleigh quotients (G. H. Golub, C. F. Van Loan, Matrix Computations, 4th ed., section 7.6).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gridfold.dynamics.descriptor import grid_descriptor
from gridfold.dynamics.unit_limits import touched_held
from gridfold.equivalents.folded import FoldedArea, WholeCoordinates
from gridfold.errors import OptionError
from gridfold.systems.descriptor import DescriptorSystem
from gridfold.systems.modal import ModalSystem

#: Swings have frequencies in Hz between these.
SLOWEST, FASTEST = 0.1, 3.0
#: A mode counts where study machines take part with this much of what they do in their strongest mode.
_PART = 0.1
#: Most modes that are compared, those with the largest part first.
MOST = 12
#: A mode has moved where its eigenvalue differs by more than this part of its size.
MOVED = 0.01
#: Steps of the iteration, and the change of the eigenvalue, in its own size, that ends it.
_STEPS, _STILL = 12, 1e-8


class ComparedMode(NamedTuple):
    """A swing mode: its eigenvalue (1/s) in the whole linear system and in the reduced one."""

    whole: complex
    reduced: complex

    @property
    def moved(self) -> bool:
        """Whether the reduction has moved it by more than :data:`MOVED`."""
        return abs(self.reduced - self.whole) > MOVED * abs(self.whole)

    def record(self) -> dict[str, float | bool]:
        """The same, ready for JSON."""
        return {
            "hz": self.whole.imag / (2 * np.pi),
            "damping_ratio": -self.whole.real / abs(self.whole),
            "reduced_hz": self.reduced.imag / (2 * np.pi),
            "reduced_damping_ratio": -self.reduced.real / abs(self.reduced),
            "moved": self.moved,
        }

    def __str__(self) -> str:
        return f"{_words(self.whole)} is at {_words(self.reduced)}"


def compared_modes(area: FoldedArea) -> tuple[ComparedMode, ...]:
    """Swing modes of the study area in a folded area that is linear throughout, slowest first.

    Empty where the reduced system has no modal form.
    """
    model = area.parts.model
    small = area.whole(model)
    at = small.coordinates
    if not isinstance(small.system, ModalSystem) or not isinstance(at, WholeCoordinates):
        return ()
    form, (_, lift) = small.system.form, small.affine
    units = tuple(unit for unit in area.study_units if unit in model.machines)
    rows = np.r_[model.slots("rotor_angle", units), model.slots("speed", units)]
    first = np.flatnonzero((form.coupling > 0) & (form.partner > np.arange(len(form.diagonal))))
    values = form.diagonal[first] + 1j * form.coupling[first]
    shapes = lift[first] + 1j * lift[form.partner[first]]
    weights = at.restriction(first) - 1j * at.restriction(form.partner[first])
    part = np.abs(shapes[:, rows] * weights[:, rows]).sum(axis=1)
    swing = (values.imag >= 2 * np.pi * SLOWEST) & (values.imag <= 2 * np.pi * FASTEST)
    strongest = part[swing].max(initial=0.0)
    chosen = np.flatnonzero(swing & (part >= _PART * strongest))
    chosen = chosen[np.argsort(-part[chosen])][:MOST]
    grid = grid_descriptor(touched_held(model, area.origin, model.layout.source_units), area.origin)
    found = [
        ComparedMode(true, complex(values[k]))
        for k in chosen
        if (true := _nearest(grid, complex(values[k]), shapes[k], weights[k])) is not None
    ]
    return tuple(sorted(found, key=lambda mode: mode.whole.imag))


def _nearest(
    grid: DescriptorSystem,
    value: complex,
    shape: NDArray[np.complex128],
    weight: NDArray[np.complex128],
) -> complex | None:
    """The eigenvalue whose vectors are nearest to `shape` and `weight`; None if none is found."""
    right, left = shape[:, None], weight.conj()[:, None]
    for _ in range(_STEPS):
        shift = value * (1 + 1e-9)
        try:
            resolvent = grid.at(shift)
        except OptionError:  # the value itself, to the last digit
            return value
        left = resolvent.solve_adjoint(left)
        solved = resolvent.solve(right)
        step = (left.conj().T @ right) / (left.conj().T @ solved)
        right, left = solved / np.linalg.norm(solved), left / np.linalg.norm(left)
        before, value = value, complex(shift - step[0, 0])
        if abs(value - before) <= _STILL * abs(value):
            return value
    return None


def _words(value: complex) -> str:
    damping = -100 * value.real / abs(value)
    return f"{value.imag / (2 * np.pi):.3g} Hz, damping {damping:.2g} %"

"""External areas of grids as descriptor systems, built from the devices' slopes and the network."""

from __future__ import annotations

import numpy as np
from scipy.sparse import block_array, csc_array
from scipy.sparse.linalg import splu

from gridfold.systems import DescriptorSystem


def external_descriptor(parts):
    """The external area of a partition at the equilibrium, loads being impedances.

    Algebraic unknowns are the voltages of its buses. Inputs are angles and magnitudes of the voltages
    of the boundary buses, outputs the currents that its machines send there (two rows a bus).
    """
    model, equations, case = parts.model, parts.model.equations, parts.model.case
    partials = model.partials(model.x0)
    states = np.array(parts.states_of(parts.external_units))
    row = {int(bus): k for k, bus in enumerate(equations.live)}
    inside = {case.bus_index[bus] for bus in parts.study_buses}
    outside = [k for bus, k in row.items() if bus not in inside]
    at_boundary = [case.bus_index[bus] for bus in parts.boundary_buses]
    boundary = [row[bus] for bus in at_boundary]
    matrix = equations.matrix.tocsr()
    own = real_form(matrix[outside][:, outside])
    injected = scattered(equations.terminals, outside) @ partials.currents[:, states]
    felt = partials.voltages[states] @ scattered(equations.terminals, outside).T
    voltages = model.bus_voltages(model.x0[None])[0][at_boundary]
    polar = np.hstack([np.diag(1j * voltages), np.diag(voltages / np.abs(voltages))])
    b2 = real_form(matrix[outside][:, boundary]) @ np.vstack([polar.real, polar.imag])
    seen = splu(own).solve(real_form(matrix[boundary][:, outside]).T.toarray(), "T").T
    return DescriptorSystem(
        partials.states[states][:, states], felt, -injected, own,
        np.zeros((len(states), b2.shape[1])), b2, -(seen @ injected),
    )  # fmt: skip


def real_form(matrix):
    """Complex linear map on real parts, then imaginary parts."""
    return block_array([[matrix.real, -matrix.imag], [matrix.imag, matrix.real]], format="csc")


def scattered(terminals, outside):
    """From the machines' terminals to the buses `outside`, in real form."""
    place = {k: position for position, k in enumerate(outside)}
    pairs = [(place[int(k)], t) for t, k in enumerate(terminals) if int(k) in place]
    rows, columns = zip(*pairs, strict=True)
    one = csc_array((np.ones(len(pairs)), (rows, columns)), shape=(len(outside), len(terminals)))
    return block_array([[one, None], [None, one]], format="csc")

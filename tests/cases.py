"""Small cases with known answers."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

import gridfold as gf
from gridfold.equivalents.families import Mode

H, X_MACHINE, X_LINE, X_GRID = 3.0, 0.3, 0.4, 0.1
POWER_MW = 80.0
#: Seconds of a step of each rung where every rung is to pay, whatever the machine.
FALLING = {Mode.DETAILED: 4e-5, Mode.RETAINED: 3e-5, Mode.LINEAR: 2e-5, Mode.WHOLE: 1e-5}


def npcc_model_on(backend: gf.NetworkBackend) -> gf.DetailedModel:
    return gf.build_model(gf.load_case("npcc"), backend=backend)


def one_machine_infinite_bus(damping: float = 0.0, base_mva: float = 100.0) -> gf.Case:
    """A classical machine at bus 1, a lossless line, an infinite bus behind X_GRID at bus 2.

    `base_mva` is the machine's own base; the machine is the same whatever it is.
    """
    ratio = base_mva / 100.0
    machine = {
        "inertia": H / ratio,
        "damping": damping / ratio,
        "transient_reactance": X_MACHINE * ratio,
    }
    return gf.Case(
        name="smib",
        buses=(gf.Bus(1, voltage_pu=1.02), gf.Bus(2)),
        branches=(gf.Branch(1, 2, reactance=X_LINE),),
        generators=(
            gf.Generator(1, active_mw=POWER_MW, voltage_pu=1.02, base_mva=base_mva),
            gf.Generator(2, control=gf.Control.SLACK),
        ),
        devices=(
            gf.DeviceRecord("classical", 1, "1", machine),
            gf.DeviceRecord("infinite_bus", 2, "1", {"reactance": X_GRID}),
        ),
    )


def lossless_classical_system() -> gf.Case:
    """Three classical machines on a lossless ring without loads; their powers add up to zero."""
    powers = (60.0, -90.0, 30.0)
    inertias = (4.0, 6.0, 2.5)
    generators = tuple(
        gf.Generator(
            bus,
            active_mw=power,
            voltage_pu=1.0 + 0.01 * bus,
            control=gf.Control.SLACK if bus == 1 else gf.Control.VOLTAGE,
        )
        for bus, power in enumerate(powers, start=1)
    )
    devices = tuple(
        gf.DeviceRecord("classical", bus, "1", {"inertia": h, "transient_reactance": 0.1 * bus})
        for bus, h in enumerate(inertias, start=1)
    )
    return gf.Case(
        name="ring",
        buses=tuple(gf.Bus(bus) for bus in (1, 2, 3)),
        branches=(
            gf.Branch(1, 2, reactance=0.2),
            gf.Branch(2, 3, reactance=0.3),
            gf.Branch(3, 1, reactance=0.25),
        ),
        generators=generators,
        devices=devices,
    )


def internal_admittance(model: gf.DetailedModel, units: Sequence[gf.UnitKey]) -> np.ndarray:
    """Admittance between internal voltages, from the case data by plain Kron reduction.

    Written out here once more, without the package's own network code, as an oracle.
    """
    case, flow = model.case, model.power_flow
    index = {bus.number: k for k, bus in enumerate(case.buses)}
    n, m = len(case.buses), len(units)
    y = np.zeros((n + m, n + m), dtype=complex)
    for branch in case.branches:
        series = 1 / complex(branch.resistance, branch.reactance)
        tap = branch.ratio * np.exp(1j * np.deg2rad(branch.shift_deg))
        i, j = index[branch.from_bus], index[branch.to_bus]
        y[i, i] += (series + 0.5j * branch.susceptance) / abs(tap) ** 2
        y[j, j] += series + 0.5j * branch.susceptance
        y[i, j] -= series / np.conj(tap)
        y[j, i] -= series / tap
    for shunt in case.shunts:
        k = index[shunt.bus]
        y[k, k] += complex(shunt.conductance_mw, shunt.susceptance_mvar) / case.base_mva
    for load in case.loads:
        k = index[load.bus]
        power = complex(load.active_mw, load.reactive_mvar) / case.base_mva
        y[k, k] += np.conj(power) / abs(flow.voltage[k]) ** 2
    machines = {r.key: r.parameters for r in case.devices if r.model == "two_axis"}
    for generator, power in zip(case.generators, flow.unit_power, strict=True):
        if generator.key not in machines:
            k = index[generator.bus]
            y[k, k] -= np.conj(power) / abs(flow.voltage[k]) ** 2
    for position, unit in enumerate(units, start=n):
        record = machines[unit]
        own = 1 / complex(record["resistance"], record["d_transient_reactance"])
        k = index[unit.bus]
        y[k, k] += own
        y[position, position] += own
        y[k, position] -= own
        y[position, k] -= own
    inner = np.linalg.solve(y[:n, :n], y[:n, n:])
    return y[n:, n:] - y[n:, :n] @ inner

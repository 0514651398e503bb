"""One run of ANDES on PSS/E files. Runs in an environment of its own, never beside gridfold.

    python andes_run.py OUT.npz RAW DYR --bus 3 --start 0.1 --duration 0.1 --t-end 5 --step 0.002

A fault through a small reactance, loads of constant impedance. Events that the DYR file brings along
are switched off. All of it goes through ANDES's public interface.
"""

from __future__ import annotations

import argparse
import time
from typing import Any

import andes
import numpy as np

#: Shares of constant power, current and impedance in loads.
CONSTANT_IMPEDANCE = {"p2p": 0, "p2i": 0, "p2z": 1, "q2q": 0, "q2i": 0, "q2z": 1}

#: Models of events that a DYR file may bring along.
EVENTS = ("Toggle", "Toggler", "Alter", "Fault")

WARNINGS = 30


def load(options: argparse.Namespace) -> Any:
    """The system with its power flow solved; the fault is all that will happen."""
    system = andes.load(
        options.raw, addfile=options.dyr, setup=False, no_output=True, default_config=True
    )
    for name in EVENTS:
        model = system.models.get(name)
        for index in list(model.idx.v) if model is not None else ():
            model.set("u", index, "v", 0)
    end = options.start + options.duration
    fault = {"bus": options.bus, "tf": options.start, "tc": end, "xf": options.reactance}
    system.add("Fault", fault)
    system.setup()
    system.PQ.config.update(CONSTANT_IMPEDANCE)
    if not system.PFlow.run():
        raise SystemExit("the power flow of ANDES has not converged")
    return system


def configure(system: Any, options: argparse.Namespace) -> None:
    """Fixed steps to the end, also where machines are more than 180 degrees apart."""
    settings = {"fixt": 1, "tstep": options.step, "tf": options.t_end, "criteria": 0, "no_tqdm": 1}
    if options.tolerance is not None:
        settings["tol"] = options.tolerance
    for name, value in settings.items():
        setattr(system.TDS.config, name, value)


def unit_id(value: Any) -> str:
    """The id of a unit as it stands in the files; ANDES may have read it as a number."""
    return str(value).strip().removesuffix(".0")


def machines(system: Any) -> dict[str, Any]:
    """Name ``BUS:ID`` and inertia (s) of all machines, and where their angles and speeds are."""
    found: dict[str, Any] = {"names": [], "inertia": [], "angle_at": [], "speed_at": []}
    for model in (system.GENCLS, system.GENROU):
        for k in range(model.n):
            found["names"].append(f"{model.bus.v[k]}:{unit_id(model.subidx.v[k])}")
            found["inertia"].append(model.M.v[k] / 2)
            found["angle_at"].append(model.delta.a[k])
            found["speed_at"].append(model.omega.a[k])
    return found


def converters(system: Any) -> dict[str, Any]:
    """Name ``BUS:ID`` of all REGCA1, and where their powers are; in p.u. on the system base."""
    model = system.REGCA1
    ids = system.StaticGen.get("subidx", list(model.gen.v)) if model.n else []
    pairs = zip(model.bus.v if model.n else (), ids, strict=True)
    return {
        "names": [f"{bus}:{unit_id(name)}" for bus, name in pairs],
        "active_at": list(model.Pe.a) if model.n else [],
        "reactive_at": list(model.Qe.a) if model.n else [],
    }


def simulate(options: argparse.Namespace) -> dict[str, Any]:
    """Load, start and simulate; what goes into the archive, with CPU seconds."""
    began = time.process_time()
    system = load(options)
    configure(system, options)
    system.TDS.init()
    ready = time.process_time()
    completed = system.TDS.run(no_summary=True)
    done = time.process_time()
    found, sources = machines(system), converters(system)
    states, outputs = np.asarray(system.dae.ts.x), np.asarray(system.dae.ts.y)
    return {
        "completed": bool(completed),
        "setup_seconds": ready - began,
        "simulation_seconds": done - ready,
        "times": np.asarray(system.dae.ts.t),
        "names": np.array(found["names"]),
        "inertia": np.array(found["inertia"]),
        "angles": states[:, found["angle_at"]],
        "speeds": states[:, found["speed_at"]],
        "converters": np.array(sources["names"], dtype=str),
        "active": outputs[:, sources["active_at"]],
        "reactive": outputs[:, sources["reactive_at"]],
    }


def eigenvalues(options: argparse.Namespace) -> dict[str, Any]:
    """Eigenvalues at the operating point."""
    system = load(options)
    system.EIG.run()
    return {"eigenvalues": np.array(system.EIG.mu).ravel()}


def main() -> None:
    """Read the command line, run, write the archive."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out")
    parser.add_argument("raw")
    parser.add_argument("dyr")
    parser.add_argument("--bus", type=int, required=True)
    parser.add_argument("--start", type=float, default=0.1, help="s; ANDES has no fault at 0")
    parser.add_argument("--duration", type=float, default=0.1)
    parser.add_argument("--reactance", type=float, default=1e-4)
    parser.add_argument("--t-end", type=float, default=5.0)
    parser.add_argument("--step", type=float, default=0.002)
    parser.add_argument(
        "--tolerance", type=float, help="of Newton's method; by default ANDES's own"
    )
    parser.add_argument("--eigenvalues", action="store_true", help="these alone, no simulation")
    options = parser.parse_args()
    andes.config_logger(WARNINGS, file=False)
    result = eigenvalues(options) if options.eigenvalues else simulate(options)
    np.savez(options.out, version=andes.__version__, **result)


if __name__ == "__main__":
    main()

import pytest

import gridfold as gf


@pytest.fixture(scope="session")
def ring():
    """Four buses in a ring with a double circuit 1-2; machines at buses 1 (two units) and 3."""
    return gf.Case(
        name="ring",
        buses=tuple(gf.Bus(number) for number in (1, 2, 3, 4)),
        branches=(
            gf.Branch(1, 2, "1", resistance=0.01, reactance=0.10, susceptance=0.02),
            gf.Branch(1, 2, "2", resistance=0.01, reactance=0.12, susceptance=0.02),
            gf.Branch(2, 3, resistance=0.02, reactance=0.20, ratio=1.05, shift_deg=10.0),
            gf.Branch(4, 3, reactance=0.15),
            gf.Branch(4, 1, reactance=0.25, in_service=False),
        ),
        generators=(
            gf.Generator(1, "1", active_mw=50.0, control=gf.Control.SLACK),
            gf.Generator(1, "2", active_mw=20.0),
            gf.Generator(3, active_mw=30.0, voltage_pu=1.02),
            gf.Generator(3, "9", in_service=False),
        ),
        loads=(gf.Load(2, active_mw=40.0, reactive_mvar=10.0), gf.Load(4, active_mw=60.0)),
        shunts=(gf.Shunt(2, conductance_mw=1.0, susceptance_mvar=15.0),),
        devices=(gf.DeviceRecord("classical", 3, "1", {"inertia": 4.0}),),
    )

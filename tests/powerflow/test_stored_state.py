"""A notice where the unit that balances gives far other than its stored power."""

from dataclasses import replace

import pytest

import gridfold as gf
from gridfold.runs.basis import basis_of
from gridfold.runs.case_info import examine_files

SLACK = gf.Control.SLACK


def lossless(stored_mw, stored_mvar=0.0, load_mw=400.0, base_mva=250.0, **unit):
    """A balancing unit, its load and no losses: the unit gives what the load draws."""
    generator = gf.Generator(
        1, "1", stored_mw, stored_mvar, base_mva=base_mva, control=SLACK, **unit
    )
    return gf.Case(
        "lossless",
        (gf.Bus(1), gf.Bus(2)),
        (gf.Branch(1, 2, reactance=1e-3),),
        (generator,),
        loads=(gf.Load(2, active_mw=load_mw),),
    )


@pytest.mark.parametrize(
    ("case", "told"),
    [
        (lossless(400.0), False),
        (lossless(160.0), False),  # less than the 250 MVA of the unit
        (lossless(140.0), True),
        (lossless(3400.0), True),
        (lossless(-2600.0), True),
        (lossless(0.0), False),  # nothing is stored
        (lossless(0.0, 30.0), True),
        (lossless(0.0, load_mw=1500.0), True),  # beyond 1000 MW
        (lossless(380.0, base_mva=10.0), False),  # less than a tenth of the load
        (lossless(350.0, base_mva=10.0), True),
        (lossless(5000.0, load_mw=6100.0, base_mva=9000.0), True),
        (lossless(5000.0, load_mw=5900.0, base_mva=9000.0), False),
    ],
)
def test_far_is_more_than_the_base_and_a_tenth_of_the_load_or_1000_mw(case, told):
    flow = gf.solve_power_flow(case)
    solved = case.loads[0].active_mw
    assert flow.unit_power[0].real * case.base_mva == pytest.approx(solved)
    expected = (
        f"generator 1:1 balances with {solved:,.1f} MW, stored are "
        f"{case.generators[0].active_mw:,.1f} MW: the stored state is far from the solution"
    )
    assert flow.notices == ((expected,) if told else ())


def test_only_units_in_service_that_balance_are_told():
    case = lossless(400.0)
    out = gf.Generator(1, "2", 9000.0, control=SLACK, in_service=False)
    other = gf.Generator(2, "1", 0.0, 5000.0, control=gf.Control.POWER)
    units = (*case.generators, out, replace(other, reactive_mvar=0.0))
    assert gf.solve_power_flow(replace(case, generators=units)).notices == ()


def test_the_notice_stands_among_those_of_the_case(tmp_path):
    path = tmp_path / "far.m"
    path.write_text(
        "function mpc = far\nmpc.baseMVA = 100;\n"
        "mpc.bus = [1 3 0 0 0 0 1 1 0 230 1 1.1 0.9; 2 1 80 0 0 0 1 1 0 230 1 1.1 0.9];\n"
        "mpc.gen = [1 4080 0 0 0 1 100 1 0 0];\nmpc.branch = [1 2 0 0.1 0 0 0 0 0 0 1 0 0];\n"
    )
    (notice,) = examine_files(path, None, gf.LoadModel()).basis.record()["case_notices"]
    assert notice.startswith("generator 1:1 (far.m:4) balances with 80.0 MW, stored are 4,080.0 MW")
    machine = gf.DeviceRecord("classical", 1, "1", {"inertia": 3.0, "transient_reactance": 0.2})
    model = gf.build_model(replace(gf.load_case(path), devices=(machine,)))
    assert basis_of(model).notices == (notice,)
    assert basis_of(model).validated

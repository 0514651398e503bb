from __future__ import annotations

import gridfold as gf


def test_every_public_name_is_there_and_has_a_docstring():
    for name in gf.__all__:
        item = getattr(gf, name)
        assert name == "__version__" or item.__doc__, name


def test_the_names_that_readme_promises_are_public():
    promised = {
        "load_case", "solve_power_flow", "build_model", "simulate", "critical_clearing_time",
        "small_signal", "BusFault", "BranchFault", "BranchTrip", "BranchReclose", "MachineTrip",
        "LoadStep",
    }  # fmt: skip
    assert promised <= set(gf.__all__)


def test_every_error_has_one_root():
    errors = [getattr(gf, name) for name in gf.__all__ if name.endswith("Error")]
    assert len(errors) >= 8
    assert all(issubclass(error, gf.GridfoldError) for error in errors)

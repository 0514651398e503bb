"""The documentation has a page for every device model, and the page explains all its symbols."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import pytest

from gridfold.dynamics.registry import DEVICES

DOCS = Path(__file__).parent.parent / "docs"

sys.path.insert(0, str(DOCS))
import generate  # noqa: E402


def symbols(formula):
    """Letters of a formula with their primes, subscripts and arguments, such as ``T'_d0``."""
    text = re.sub(r"\\mathrm\{(\w+)\}", r"\1", formula)
    text = re.sub(r"\\(text|operatorname)\{[^}]*\}|\\(?!Delta|theta)[A-Za-z]+", " ", text)
    found = re.findall(r"(\\[A-Za-z]+|[A-Za-z]'*)(_(?:\{\w+\}|\w))?(\(\d+\.\d+\))?", text)
    return {letter + re.sub(r"[{}]", "", index) + argument for letter, index, argument in found}


def formulas(text):
    """All formulas of a page."""
    return "\n".join(re.findall(r"\$\$.+?\$\$|\$.+?\$", text, re.DOTALL))


@pytest.mark.parametrize("model", DEVICES)
def test_page_explains_every_parameter_symbol_and_includes_its_tables(model):
    page = (DOCS / "devices" / f"{model}.md").read_text(encoding="utf-8")
    found = symbols(formulas(page))
    for parameter in DEVICES[model].parameters:
        missing = symbols(generate.symbol(parameter.symbol)) - found
        assert not missing, parameter.name
    assert f"_generated/device-{model}.md" in page
    assert "## Start" in page or "{doc}`dc-commutator`" in page


@pytest.mark.parametrize("model", DEVICES)
def test_list_of_devices_leads_to_the_page(model):
    index = (DOCS / "reference" / "devices.md").read_text(encoding="utf-8")
    assert f"{{doc}}`{model} <../devices/{model}>`" in index
    assert re.search(rf"^\.\./devices/{model}$", index, re.MULTILINE)


def test_a_symbol_is_not_part_of_a_longer_one():
    formula = (
        r"\frac{1 + sT_{10}}{2H}\,T''_{\mathrm{d0}} + [K]_{V_{\mathrm{RMIN}}}\,\Delta V_t + S(1.0)"
    )
    found = symbols(formula)
    assert {"s", "T_10", "H", "T''_d0", "K", "V_RMIN", "V_t", "S(1.0)"} <= found
    assert not {"T_1", "T'_d0", "RMIN", "V", "S"} & found


def test_record_lists_the_numbers_in_the_order_of_psse():
    text = generate.device_tables(DEVICES["sexs"])
    assert "BUS 'SEXS' ID TA/TB TB K TE EMIN EMAX /" in text
    assert "| `exciter_time` | $T_{E}$ | s | ≥ 0 | required | none | 4 |" in text

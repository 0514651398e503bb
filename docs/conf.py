"""Settings of the documentation. Tables of devices, files and events are written from the code."""

import re
import sys
from enum import Enum
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

import gallery
import generate
from docutils.nodes import SkipNode
from latex2mathml.converter import convert as latex_to_mathml

import gridfold
from gridfold.dynamics.model import RESIDUAL_GOOD, RESIDUAL_LIMIT
from gridfold.dynamics.network import SPARSE_FROM

project = "gridfold"
author = "The gridfold developers"
copyright = "the gridfold developers"
release = version = gridfold.__version__

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
html_math_renderer = "mathml"
root_doc = "index"
exclude_patterns = ["_build", "_generated", "generated"]
needs_sphinx = "8.1"

myst_enable_extensions = ["amsmath", "deflist", "dollarmath", "substitution"]
myst_heading_anchors = 3
myst_substitutions = {
    "version": gridfold.__version__,
    "sparse_from": SPARSE_FROM,
    "residual_good": f"{RESIDUAL_GOOD:.0e}".replace("e-0", "e-"),
    "residual_limit": f"{RESIDUAL_LIMIT:.0e}".replace("e-0", "e-"),
}

napoleon_google_docstring = False
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
autodoc_preserve_defaults = True
python_use_unqualified_type_names = True
python_maximum_signature_line_length = 88
add_module_names = False

html_theme = "furo"
html_title = f"gridfold {gridfold.__version__}"
html_show_copyright = False
html_copy_source = False
html_static_path = ["_static"]
html_css_files = ["math.css"]

generate.write_all(Path(__file__).parent)
gallery.draw(Path(__file__).parent / "_generated" / "gallery")


def _readable(app, what, name, obj, options, signature, returns):
    """Shorten array types and default values; contracts and enums are not called."""
    if what == "class" and (issubclass(obj, Enum) or getattr(obj, "_is_protocol", False)):
        return "", None
    texts = []
    for text in (signature, returns):
        text = re.sub(r"~?[\w.]*ndarray\[.*?dtype\[~?([\w.]+)\]\]", r"NDArray[\1]", text or "")
        text = re.sub(r"<(?!class)[^<>]*(<\w+>)?[^<>]*>", "...", text)
        texts.append(text.replace("numpy.", "") or None)
    return tuple(texts)


def _inline_math(visitor, node):
    """Formulas as MathML, which browsers draw by themselves, without a script or the network."""
    visitor.body.append(latex_to_mathml(node.astext()))
    raise SkipNode


def _display_math(visitor, node):
    source = node.astext().replace("{aligned}", "{align*}")  # one name for the same thing
    formula = latex_to_mathml(source, display="block")
    kind = "math aligned" if "{align*}" in source else "math"
    visitor.body.append(f'<div class="{kind}">{formula}</div>')
    raise SkipNode


def setup(app):
    app.connect("autodoc-process-signature", _readable)
    app.add_html_math_renderer("mathml", (_inline_math, None), (_display_math, None))

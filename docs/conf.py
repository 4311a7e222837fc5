"""Sphinx: `python -m sphinx -W docs runs/docs` writes the pages; `pip install -e '.[docs]'`."""

import sys
from pathlib import Path

_HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(_HERE), str(_HERE.parent)]

project = "airrace"
author = "airrace developers"
project_copyright = "2026, airrace developers; BSD-3-Clause"
extensions = [
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx.ext.viewcode",
    "myst_parser",
    "airrace_docs",
    "airrace_reference",
]
exclude_patterns = ["pictures"]
smartquotes = False  # they would make a dash of the two hyphens of an option
html_theme = "furo"
html_title = "airrace"
html_static_path = ["static"]
html_css_files = ["airrace.css"]
myst_heading_anchors = 3
autodoc_member_order = "bysource"
autodoc_default_options = {"members": True, "show-inheritance": True}
autodoc_typehints = "none"  # the docstrings say more: shapes, units, frames
autodoc_class_signature = "mixed"
napoleon_numpy_docstring = False
napoleon_use_ivar = True  # attributes in one list, not each an entry of the index
# What comes before a colon below "Returns:" is a word, not a type.
suppress_warnings = ["ref.python"]

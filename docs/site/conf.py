"""Settings of Sphinx for the documentation site; ``make docs`` builds it."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Any

_FOLDER = Path(__file__).resolve().parent
sys.path.insert(0, str(_FOLDER))
# Commands of notebooks: `flexarm` of this interpreter, with the width of the printed pages.
os.environ["PATH"] = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
os.environ |= {"COLUMNS": "100", "NO_COLOR": "1"}
os.environ.pop("MPLBACKEND", None)  # figures of notebooks go into their pages

from reference import add_fields, skip_foreign  # noqa: E402

import flexarm as fa  # noqa: E402

project = "flexarm"
author = copyright = "The flexarm developers"
version = release = fa.__version__

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "equations",
    "search_excerpts",
]
exclude_patterns = ["notebooks", "files"]
myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 4
myst_dmath_double_inline = True
myst_links_external_new_tab = False

nb_execution_mode = "force"
nb_execution_in_temp = True
nb_execution_timeout = 300
nb_execution_raise_on_error = True
nb_merge_streams = True
nb_output_stderr = "remove"  # notices that kernels are compiled, on a new machine

default_role = "code"
smartquotes = False  # v'' is a derivative
autodoc_typehints = "none"
autodoc_member_order = "bysource"
autodoc_class_signature = "mixed"
# Signatures of functions that take settings are made by a decorator, which autodoc cannot parse.
autodoc_preserve_defaults = False
python_maximum_signature_line_length = 88
napoleon_numpy_docstring = False
add_module_names = False

html_theme = "furo"
html_title = "flexarm"
html_math_renderer = "mathml"
html_static_path = [str(_FOLDER / "static")]
html_css_files = ["site.css", "live.css"]
html_js_files = ["pictures.js"]
html_copy_source = False
html_show_sphinx = False


def setup(app: Any) -> None:
    app.connect("autodoc-process-docstring", add_fields)
    app.connect("autodoc-skip-member", skip_foreign)

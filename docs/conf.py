"""Sphinx configuration; pages of the catalogue, table of equations and pictures are made when a build starts."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))

from making import commands, effects, equations, guide_pictures, notebooks  # noqa: E402

import thermocorr  # noqa: E402

project = "thermocorr"
author = "The thermocorr developers"
copyright = f"2026, {author}"
version = release = thermocorr.__version__

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx.ext.viewcode",
    "sphinx_copybutton",
    "making.mathml",
]
html_math_renderer = "mathml"
source_suffix = {".md": "myst-nb", ".ipynb": "myst-nb"}
exclude_patterns = ["_build", "_made", "making", "jupyter_execute", "**/.ipynb_checkpoints"]
myst_enable_extensions = ["dollarmath", "deflist", "colon_fence", "attrs_block"]
myst_heading_anchors = 3
nb_execution_mode = "off"  # notebooks are executed by notebooks/build.py; their outputs are committed
nb_merge_streams = True

autodoc_member_order = "bysource"
autodoc_typehints = "none"
napoleon_google_docstring = False
napoleon_custom_sections = [("Attributes", "params_style")]  # keeps the underscore of fitted attributes
napoleon_use_param = False
napoleon_use_rtype = False
default_role = "py:obj"

html_theme = "furo"
html_title = "thermocorr"
html_static_path = ["_static"]
html_css_files = ["own.css"]
html_show_sourcelink = False
html_theme_options = {"navigation_with_keys": True}
pygments_style = "tango"


def make(app: Any) -> None:
    """Make what the code knows better than a writer."""
    effects.write_pages(HERE / "effects")
    made = HERE / "_made"
    equations.write_table(Path(thermocorr.__file__).parent, made / "equations.md")
    commands.write_page(made / "commands.md")
    guide_pictures.draw_all(made)
    notebooks.copy(HERE.parent / "notebooks", HERE / "notebooks")


def skip(app: Any, what: str, name: str, thing: Any, skipped: bool, options: Any) -> bool | None:
    """Leave out what scikit-learn adds to every estimator."""
    return True if re.fullmatch(r"set_\w+_request|get_metadata_routing", name) else None


def keep(app: Any, what: str, name: str, thing: Any, options: Any, lines: list[str]) -> None:
    """Remember the sentence of an attribute: napoleon takes what stands before its first colon for a type."""
    if what in ("attribute", "property"):
        app.kept = list(lines)


def restore(app: Any, what: str, name: str, thing: Any, options: Any, lines: list[str]) -> None:
    """Give it back."""
    if what in ("attribute", "property"):
        lines[:] = app.kept


def setup(app: Any) -> None:
    """Connect."""
    app.connect("builder-inited", make)
    app.connect("autodoc-skip-member", skip)
    app.connect("autodoc-process-docstring", keep, priority=100)
    app.connect("autodoc-process-docstring", restore, priority=900)

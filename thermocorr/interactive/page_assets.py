"""The files that the screen is made of: those of the report page, and its own."""

from __future__ import annotations

from functools import cache
from importlib.resources import files

from jinja2 import Environment
from markupsafe import Markup

SHARED = ("uplot.min.js", "charts.js", "uplot.min.css", "colours.css")
"""What the report page has too."""
OWN = ("elements.js", "wire.js", "timeplot.js", "views.js", "panels.js", "workbench.js", "start.js", "workbench.css")
TYPES = {"js": "text/javascript", "css": "text/css"}
ASSETS = {name: TYPES[name.rsplit(".", 1)[1]] for name in (*SHARED, *OWN)}
"""Name -> media type, in the order in which they are loaded."""


@cache
def page() -> str:
    """The page, which is the same for every log."""
    return (
        Environment(autoescape=True, trim_blocks=True, lstrip_blocks=True)
        .from_string(_template("workbench.html"))
        .render(
            body=Markup(_template("body.html")),
            styles=[name for name in ASSETS if name.endswith(".css")],
            scripts=[name for name in ASSETS if name.endswith(".js")],
        )
    )


def _template(name: str) -> str:
    return files(__package__).joinpath("templates", name).read_text(encoding="utf-8")


@cache
def asset_text(name: str) -> str:
    """One of `ASSETS`."""
    package = "thermocorr.pages" if name in SHARED else __package__
    return files(package).joinpath("assets", name).read_text(encoding="utf-8")

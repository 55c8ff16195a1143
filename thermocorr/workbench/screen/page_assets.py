"""The files of the screen."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache
from importlib.resources import files

from jinja2 import Environment
from markupsafe import Markup

from ...output.style import css

SCREEN = ("pictures.js", "panels.js", "workbench.js")
PAGE = ("elements.js", "desk.js", "wire.js", *SCREEN, "start.js", "workbench.css")
"""What the page of the program has, in the order in which it is loaded."""
STATIC = ("elements.js", "desk.js", *SCREEN, "try.js", "workbench.css")
"""What a page without a server has."""
TYPES = {"js": "text/javascript", "css": "text/css"}
ASSETS = {name: TYPES[name.rsplit(".", 1)[1]] for name in PAGE}
"""Name -> media type, in the order in which they are loaded."""


def filled(name: str, body: str, assets: Iterable[str], **given: str) -> str:
    """A page from a template, with styles and scripts."""
    listed = {kind: [asset for asset in assets if asset.endswith(f".{kind}")] for kind in TYPES}
    template_ = Environment(autoescape=True, trim_blocks=True, lstrip_blocks=True).from_string(template(name))
    return template_.render(body=Markup(body), styles=listed["css"], scripts=listed["js"], **given)


@cache
def page() -> str:
    """The page, which is the same for every log."""
    return filled("workbench.html", template("body.html"), ASSETS)


@cache
def body() -> str:
    """The workbench's element, in a notebook or page."""
    lines = template("body.html").splitlines(keepends=True)
    return "".join(line for line in lines if not any(f'data-part="{part}"' in line for part in ("open", "cancel")))


@cache
def module() -> str:
    """All scripts as one module that a notebook's widget renders with."""
    scripts = [asset_text(name) for name in ("elements.js", "desk.js", *SCREEN, "notebook.js")]
    return "\n".join([*scripts, "export default { render: globalThis.thermocorr.render };\n"])


@cache
def style() -> str:
    """All styles, none of which reaches out of the workbench's element."""
    lines = [line for line in asset_text("workbench.css").splitlines() if not line.startswith(("*{", "body"))]
    return "\n".join(lines).replace(":root", ".workbench").replace(".picture", ".workbench .picture")


def template(name: str) -> str:
    """Text of a template."""
    return files(__package__).joinpath("templates", name).read_text(encoding="utf-8")


@cache
def asset_text(name: str) -> str:
    """Text of an asset; a style sheet begins with the palette."""
    text = files(__package__).joinpath("assets", name).read_text(encoding="utf-8")
    return css() + text if name.endswith(".css") else text

"""Pieces of HTML: numbers with all digits, templates.

Column and file names are their writers', so all text is escaped here, and nowhere else: every expression of a template
is, unless it is `Markup`.
"""

from __future__ import annotations

from functools import cache
from importlib.resources import files
from typing import Any

import numpy as np
from markupsafe import Markup

from ..records.errors import printable
from ..records.numbers import Scale, scale_of, span_text, unit_text
from .axes import labelled
from .words import aspect_text, better_text, effect_text, interval_text, place_text, plain


def rendered(template: str, **given: Any) -> str:
    """A template filled in."""
    return str(_environment().get_template(f"{template}.html").render(given))


@cache
def _environment() -> Any:
    """All templates, with what they need to say numbers and effects."""
    from jinja2 import Environment, FunctionLoader, StrictUndefined

    environment = Environment(
        loader=FunctionLoader(asset),
        autoescape=True,
        finalize=_shown,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    said = (
        aspect_text, better_text, decibels, effect_text, interval_text, labelled, number, percent, place_text,
        probability, span_text, unit_text,
    )  # fmt: skip
    environment.filters.update({function.__name__: function for function in said})
    return environment


def asset(name: str) -> str:
    """A file of ``templates``."""
    return files(__package__).joinpath("templates", name).read_text(encoding="utf-8")


def _shown(value: Any) -> Any:
    """Text of a value in a page."""
    return value if isinstance(value, Markup) else printable(value, "\n")


def number(
    value: float, unit: str = "", digits: int = 4, shown: str | None = None, scale: Scale | None = None
) -> Markup:
    """A number with its unit, and all digits as attribute.

    Its every digit stands in the attribute ``value``, in the unit of the record, for who reads the page by machine.
    """
    if unit:
        shown = quantity(value, digits, scale or scale_of([value], unit))
    elif shown is None:
        shown = plain(float(value) * (1.0 if scale is None else scale.factor), digits)
    return Markup('<data value="{}" class="n">{}</data>').format(repr(float(value)), printable(shown))


def quantity(value: float, digits: int, scale: Scale) -> str:
    """A number and its unit with the signs of print."""
    shown = plain(float(value) * scale.factor, digits)
    return f"{shown}\u00a0{unit_text(scale.unit)}" if scale.unit else shown


def percent(value: float) -> Markup:
    """A share as `percent_text` says it."""
    return number(value, shown=percent_text(value))


def percent_text(value: float) -> str:
    """A share; small ones keep a digit."""
    shown = f"{100 * value:.0f} %" if abs(value) >= 0.095 or value == 0 else f"{100 * value:.1f} %"
    return shown.replace("-", "\u2212")


def decibels(value: float) -> Markup:
    """Decibels with sign."""
    if not np.isfinite(value):
        return Markup("")
    return number(value, shown=f"{value:+.1f} dB".replace("-", "\u2212"))


def probability(value: float) -> Markup:
    """A p-value; below 1e-12 its size means nothing."""
    return number(value, shown="< 10⁻¹²" if value < 1e-12 else plain(value, 2))

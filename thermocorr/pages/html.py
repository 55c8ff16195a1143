"""Pieces of HTML: numbers, names, what is shown in a notebook.

Column and file names are their writers', so all text is escaped here, and nowhere else: every expression of a template
is, unless it is `Markup`.
"""

from __future__ import annotations

import json
import re
from functools import cache
from importlib.resources import files
from typing import Any, NamedTuple

import numpy as np
from markupsafe import Markup

from ..displays.words import MINUS, aspect_text, better_text, effect_text, interval_text, place_text
from ..records.errors import printable
from ..records.numbers import SUPERSCRIPTS, Scale, prefixed, scale_of, span_text, unit_text
from ..records.units import without_unit

_QUANTITY = re.compile(r"(?:(?<=\d )|(?<=\[))[A-Za-z]+(?:/[A-Za-z]+(?:\^\d)?)?")
"""A unit behind a number, or in brackets."""
DASH, TIMES = "\u2013", "\u00d7"


class Section(NamedTuple):
    """A section of the page, known by its name and heading."""

    identity: str
    heading: str
    body: Markup


def section(identity: str, heading: str, template: str = "", **given: Any) -> Section:
    """A section made of the template of its name, or of another one."""
    return Section(identity, heading, rendered(template or identity, **given))


def rendered(template: str, **given: Any) -> Markup:
    """A template filled in."""
    return Markup(_environment().get_template(f"{template}.html").render(given))


@cache
def _environment() -> Any:
    """All templates, with what they need to say numbers and effects."""
    from jinja2 import Environment, FunctionLoader, StrictUndefined

    environment = Environment(
        loader=FunctionLoader(lambda name: asset(name, "templates")),
        autoescape=True,
        finalize=_shown,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    said = (
        better_text, condition_text, decibels, effect_text, failing_text, interval_text, number, percent, probability,
        span_text, unit_text, width, with_unit,
    )  # fmt: skip
    environment.filters.update({function.__name__: function for function in said})
    environment.globals.update(dash=DASH)
    return environment


def asset(name: str, folder: str = "assets") -> str:
    """A file of ``assets``, or of another folder."""
    return files(__package__).joinpath(folder, name).read_text(encoding="utf-8")


def _shown(value: Any) -> Any:
    """Text of a value in a page: invisible characters are written out."""
    return value if isinstance(value, Markup) else printable(value, "\n")


def plain(value: float, digits: int = 4) -> str:
    """A number as a person writes it: 0.1040, 6.199 x 10^-5 with real superscripts, a real minus."""
    if not np.isfinite(value):
        return DASH if np.isnan(value) else ("∞" if value > 0 else f"{MINUS}∞")
    if value != 0 and not 1e-3 <= abs(value) < 10 ** max(digits + 2, 6):
        mantissa, exponent = f"{value:.{digits - 1}e}".split("e")
        return f"{mantissa} {TIMES} 10{str(int(exponent)).translate(SUPERSCRIPTS)}".replace("-", MINUS, 1)
    shown = f"{value:#.{digits}g}".removesuffix(".") if abs(value) < 10**digits else f"{value:.0f}"
    return shown.replace("-", MINUS) if value else "0"


def number(
    value: float, unit: str = "", digits: int = 4, shown: str | None = None, scale: Scale | None = None
) -> Markup:
    """A number with its unit, in the prefix that suits it or that of `scale`; without a unit for a column that has one.

    Its every digit stands in the attribute ``value``, in the unit of the record, for who reads the page by machine.
    """
    if unit:
        shown = quantity(value, unit, digits, scale)
    elif shown is None:
        shown = plain(float(value) * (1.0 if scale is None else scale.factor), digits)
    return Markup('<data value="{}" class="n">{}</data>').format(repr(float(value)), printable(shown))


def quantity(value: float, unit: str = "", digits: int = 4, scale: Scale | None = None) -> str:
    """A number and its unit with the signs of print, in the prefix that suits it or in that of `scale`."""
    scale = scale_of([value], unit) if scale is None else scale
    shown = plain(float(value) * scale.factor, digits)
    return f"{shown}\u00a0{unit_text(scale.unit)}" if scale.unit else shown


def with_signs(text: str) -> str:
    """A sentence as a terminal has it, its quantities with the signs of print: 73 µΩ, not 73 uohm.

    Examples
    --------
    >>> with_signs("It leaves 73 uohm (0.2 uohm/degF^2) in 5 min.")
    'It leaves 73 µΩ (0.2 µΩ/°F²) in 5 min.'
    """
    return _QUANTITY.sub(lambda found: unit_text(found[0]), text)


def condition_text(row: Any) -> str:
    """Name of a condition with its unit in print; names of columns stay as they are."""
    return aspect_text(row) if isinstance(row.column, str) else with_signs(aspect_text(row))


def failing_text(row: Any) -> str:
    """A place where a model fails as part of a sentence, its unit in the signs of print."""
    return place_text(row) if isinstance(row.column, str) else with_signs(place_text(row))


def with_unit(name: str, unit: str) -> str:
    """A name with its unit in brackets: rms [mV]; a unit at the end of the name is not said twice."""
    return f"{without_unit(name, unit)} [{unit_text(unit)}]" if unit else name


def units_of_axis(unit: str) -> list[list[Any]]:
    """Units that an axis may be written in, as the script takes them: power of ten, unit in print, least number."""
    return [[step.power, unit_text(step.unit), step.least] for step in prefixed(unit)]


def percent(value: float) -> Markup:
    """A share as `percent_text` says it."""
    return number(value, shown=percent_text(value))


def percent_text(value: float) -> str:
    """A share; small ones keep a digit."""
    shown = f"{100 * value:.0f} %" if abs(value) >= 0.095 or value == 0 else f"{100 * value:.1f} %"
    return shown.replace("-", MINUS)


def decibels(value: float) -> Markup:
    """Decibels with sign."""
    if not np.isfinite(value):
        return Markup("")
    return number(value, shown=f"{value:+.1f} dB".replace("-", MINUS))


def probability(value: float) -> Markup:
    """An p-value; below 1e-12 its size means nothing."""
    return number(value, shown="< 10⁻¹²" if value < 1e-12 else plain(value, 2))


def width(share: float) -> str:
    """Length of a bar for a share 0..1, as a style sheet writes it."""
    return f"{100 * float(np.clip(np.nan_to_num(share), 0, 1)):.4g}%"


def script_data(data: Any) -> Markup:
    """Data for the page's script: JSON in which no end of a script, comment or entity can stand."""
    written = json.dumps(data, allow_nan=False, ensure_ascii=True, separators=(",", ":"))
    for sign in "<>&":
        written = written.replace(sign, f"\\u{ord(sign):04x}")
    return Markup(written)

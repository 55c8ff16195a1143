"""Small pieces of HTML: text made safe, numbers, tables, bars.

Column and file names are their writers', so all text is escaped here, and nowhere else.
"""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from html import escape
from typing import Any

import numpy as np

from ..pictures.words import MINUS
from ..records.text import printable

_UNITS = {"degC": "°C", "degF": "°F", "ohm": "Ω", "kohm": "kΩ", "uV": "µV", "uA": "µA", "um": "µm", "urad": "µrad"}
DASH, TIMES = "\u2013", "\u00d7"
_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


class Safe(str):
    """A string that is HTML already."""


class Section(Safe):
    """A section of the page, known by its name and title."""

    identity: str
    heading: str


def text(value: Any) -> Safe:
    """A value as HTML text, markup in it made harmless."""
    return value if isinstance(value, Safe) else Safe(escape(printable(value, "\n"), quote=True))


def tag(name: str, *children: Any, **attributes: Any) -> Safe:
    """An element. Underscores in attributes become hyphens, one at the end goes; None leaves an attribute out."""
    given = "".join(
        f' {key.rstrip("_").replace("_", "-")}="{text(value)}"'
        for key, value in attributes.items()
        if value is not None
    )
    return Safe(f"<{name}{given}>{join(children)}</{name}>")


def join(parts: Sequence[Any]) -> Safe:
    """Parts one after the other."""
    return Safe("".join(text(part) for part in parts))


def plain(value: float, digits: int = 4) -> str:
    """A number as a person writes it: 0.1040, 6.199 x 10^-5 with real superscripts, a real minus."""
    if not np.isfinite(value):
        return DASH if np.isnan(value) else ("∞" if value > 0 else f"{MINUS}∞")
    if value != 0 and not 1e-3 <= abs(value) < 10 ** max(digits + 2, 6):
        mantissa, exponent = f"{value:.{digits - 1}e}".split("e")
        return f"{mantissa} {TIMES} 10{str(int(exponent)).translate(_SUPERSCRIPTS)}".replace("-", MINUS, 1)
    shown = f"{value:#.{digits}g}".removesuffix(".") if abs(value) < 10**digits else f"{value:.0f}"
    return shown.replace("-", MINUS) if value else "0"


def number(value: float, unit: str = "", digits: int = 4, shown: str | None = None) -> Safe:
    """A number with its unit; its every digit stands in the attribute ``value`` for who reads the page by machine."""
    shown = plain(float(value), digits) if shown is None else shown
    label = f"{shown}\u00a0{unit_text(unit)}" if unit else shown
    return tag("data", label, value=repr(float(value)), class_="n")


def unit_text(unit: str) -> str:
    """A unit with the signs of print: °C, Ω, µV; K^2 as K²."""
    words = re.split(r"([ /()])", unit)
    return "".join(_UNITS.get(word, _raised(word)) for word in words)


def with_unit(name: str, unit: str) -> str:
    """A name with its unit in brackets: rms [mV]."""
    return f"{name} [{unit_text(unit)}]" if unit else name


def _raised(word: str) -> str:
    return re.sub(r"\^(-?\d+)", lambda power: power[1].translate(_SUPERSCRIPTS), word)


def percent(value: float) -> Safe:
    """A share; small ones keep a digit."""
    shown = f"{100 * value:.0f} %" if abs(value) >= 0.095 or value == 0 else f"{100 * value:.1f} %"
    return number(value, shown=shown.replace("-", MINUS))


def decibels(value: float) -> Safe:
    """Decibels with sign."""
    if not np.isfinite(value):
        return Safe("")
    return number(value, shown=f"{value:+.1f} dB".replace("-", MINUS))


def probability(value: float) -> Safe:
    """An error probability; below 1e-12 its size means nothing."""
    return number(value, shown="< 10⁻¹²" if value < 1e-12 else plain(value, 2))


def bar(share: float, mark: float | None = None) -> Safe:
    """A horizontal bar of a share 0..1, with a mark to compare it with."""
    width = float(np.clip(np.nan_to_num(share), 0, 1))
    parts = [tag("i", style=f"width:{100 * width:.4g}%")]
    if mark is not None:
        parts.append(tag("b", style=f"left:{100 * float(np.clip(mark, 0, 1)):.4g}%"))
    return tag("span", *parts, class_="bar")


def table(head: Sequence[Any], rows: Sequence[Sequence[Any]], sides: str, class_: str = "") -> Safe:
    """A table that scrolls in its own box; `sides` has a letter per column: l for words, r for numbers."""
    top = tag("tr", *(tag("th", cell, class_=side, scope="col") for cell, side in zip(head, sides, strict=True)))
    body = [tag("tr", *(tag("td", cell, class_=side) for cell, side in zip(row, sides, strict=True))) for row in rows]
    return tag(
        "div",
        tag("table", tag("thead", top), tag("tbody", *body), class_=class_ or None),
        class_="scroll",
        tabindex=0,
        role="region",
        aria_label="table",
    )


def script_data(identity: str, data: Any) -> Safe:
    """Data for the page's script: JSON in which no end of a script, comment or entity can stand."""
    written = json.dumps(data, allow_nan=False, ensure_ascii=True, separators=(",", ":"))
    for sign in "<>&":
        written = written.replace(sign, f"\\u{ord(sign):04x}")
    return Safe(f'<script type="application/json" id="{text(identity)}">{written}</script>')

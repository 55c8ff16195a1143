"""Lines that are no table: words that stay, and numbers that change."""

from __future__ import annotations

import re
from collections import Counter

import pandas as pd

STAMPED = re.compile(r"(?m)^(\d\d:\d\d:\d\d(?:[.,]\d+)?) -> ?")
"""A time of day and an arrow, which a serial monitor writes before each line."""
_COLOUR = re.compile("\x1b\\[[\\d;]*m")
_STAMP = r"\d{4}-\d\d-\d\d[T ]\d\d:\d\d:\d\d(?:[.,]\d+)?Z?|\d+:\d\d:\d\d(?:[.,]\d+)?|\d{16,19}"
_FLOAT = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?|nan|NaN"
_PART = re.compile(rf"(?P<time>(?<![\w.])(?:{_STAMP}))|(?P<number>(?<![\w.])(?:{_FLOAT})(?![\w.]*\w))")
TIME, NUMBER = "\0", "\1"
"""What stands in a shape of a line for a time and for a number."""
Template = tuple[str, list[str]]
"""The shape of a line, and a name for each of its times and numbers; "" for one that is passed over."""


def rows_of(text: str, templates: list[Template]) -> pd.DataFrame:
    """The lines of some shapes as rows of text; with several shapes, as columns of times, names and values."""
    lines = pd.Series(text.splitlines(), dtype=object).str.replace(_COLOUR, "", regex=True)
    parts = []
    for shape, names in templates:
        part = lines.str.extract(_pattern(shape, names)).set_axis([name for name in names if name], axis=1)
        part = part.dropna(how="all")
        several = len(templates) > 1 and "time" in part
        parts.append(part.melt("time", var_name="name", ignore_index=False) if several else part)
    return pd.concat(parts).sort_index(kind="stable")


def _pattern(shape: str, names: list[str]) -> str:
    pieces, at = [], iter(names)
    for piece in re.split(f"([{TIME}{NUMBER}])", shape):
        if piece in (TIME, NUMBER):
            pieces.append(("(" if next(at) else "(?:") + (_STAMP if piece == TIME else _FLOAT) + ")")
        else:
            pieces.append(re.escape(piece))
    return f"^{''.join(pieces)}\\s*$"


def find_templates(text: str) -> tuple[list[Template], dict[str, str]]:
    """Usual shapes of the lines, and units; empty without such shapes. A number is called by what stands before it."""
    lines = [_COLOUR.sub("", line).strip() for line in text.splitlines()[:400] if line.strip()]
    shapes = Counter(_PART.sub(lambda m: TIME if m["time"] else NUMBER, line) for line in lines)
    usual = [shape for shape, n in shapes.items() if n > 0.03 * len(lines) and NUMBER in shape]
    templates: list[Template] = []
    units: dict[str, str] = {}
    if not 0 < len(usual) <= 40 or sum(shapes[shape] for shape in usual) < 0.8 * len(lines):
        return templates, units
    for shape in usual:
        pieces = re.split(f"([{TIME}{NUMBER}])", shape)
        count = len(pieces) // 2
        pattern = _pattern(shape, ["x"] * count)
        caught = [found.groups() for line in lines if (found := re.fullmatch(pattern, line))]
        names: list[str] = []
        for k in range(count):
            before, sign, behind = pieces[2 * k : 2 * k + 3]
            name = "time" if sign == TIME else _name(before)
            told_apart = re.search(r"[:=] *$", before) and not before.endswith("sensor:")
            stays = len({row[k] for row in caught}) == 1 and not told_apart  # such as a line of the program
            names.append("" if sign == NUMBER and (stays or name in names) else name)
            unit = re.match(r" ?([°%µμ℃Ω\w/]{1,8})(?=[ ,;]|$)", behind)
            if names[-1] and sign == NUMBER and unit:
                units[name] = unit[1]
        told = [name for name in names if name]
        if set(told) - {"time"} and len(set(told)) == len(told) and (len(usual) == 1 or "time" in told):
            templates.append((shape, names))
    return templates, units


def _name(before: str) -> str:
    """The name of a number by the words before it, the last of them in quotes or before a sign."""
    quoted = re.findall(r"'([^']+)'|\"([^\"]+)\"", before)
    words = re.findall(r"[^\W\d][\w .°/%]*(?=\s*[:=>])", before)
    return "".join(quoted[-1]) if quoted else words[-1].strip() if words else ""

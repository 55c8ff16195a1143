"""Output of a board with names before the values: ``12:34:56.789 -> T: 23.1 weight: 1000.5``.

The time and the arrow are those of Arduino's serial monitor; without them the rows have no times.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence

import pandas as pd

from ..values import first_cell, is_moment

_STAMP = re.compile(r"(?P<time>\d\d:\d\d:\d\d(?:[.,]\d+)?) -> ?(?P<rest>.*)")
_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_PAIR = re.compile(
    rf"(?P<name>[^\W\d][\w .°/%()]{{0,40}}?)\s?[:=]\s{{0,3}}(?P<value>{_NUMBER}|nan)"
    r"(?P<unit>\s?[^\s\d,;:=]+(?=[,;\t]|$))?"
)
PLACE = 4.0


def recognises(lines: Sequence[str]) -> bool:
    """True if nearly all lines hold the same names, each with a number behind it, and nothing else."""
    pairs = [_pairs(line)[1] for line in lines[:100]]
    usual = Counter(tuple(name for name, _ in row) for row in pairs if row).most_common(1)
    stamped = all(_STAMP.fullmatch(line.strip()) for line in lines[:5])
    # Share of the lines, at most, that are something else: a board says hello when it starts
    return stamped or (bool(usual) and usual[0][1] >= (1 - 0.1) * len(pairs) and len(usual[0][0]) > 0)


def read(lines: Sequence[str], reading: str | None) -> tuple[pd.DataFrame, str]:
    """A column for each name, and one for the times."""
    rows = [(stamp, dict(row)) for stamp, row in map(_pairs, lines) if row]
    if not rows:  # values without names: a table behind the arrows
        return _table(lines)
    frame = pd.DataFrame([values for _, values in rows])
    if is_moment(first_cell([rows[0][0]])):
        frame.insert(0, "time", [stamp for stamp, _ in rows])
    return frame, "lines of a board"


def _pairs(line: str) -> tuple[str, list[tuple[str, float]]]:
    """The time of a line, and its names with their values; no values where anything else stands in the line."""
    stamped = _STAMP.fullmatch(line.strip())
    rest = stamped["rest"] if stamped else line.strip()
    if _PAIR.sub("", rest).strip(" ,;\t|"):
        return "", []
    return stamped["time"] if stamped else "", [
        (found["name"].strip(), float(found["value"])) for found in _PAIR.finditer(rest)
    ]


def _table(lines: Sequence[str]) -> tuple[pd.DataFrame, str]:
    """Rows of values behind times and arrows; the first line that is no row has the names."""
    found = [stamped for line in lines if (stamped := _STAMP.fullmatch(line.strip()))]
    cells = [re.split(r"[,;\t ]+", stamped["rest"].strip()) for stamped in found]
    width = Counter(map(len, cells)).most_common(1)[0][0]
    full = [(one["time"], row) for one, row in zip(found, cells, strict=True) if len(row) == width]
    is_row = [all(re.fullmatch(_NUMBER, cell) for cell in row) for _, row in full]
    head = next((row for (_, row), good in zip(full, is_row, strict=True) if not good), None)
    names = [str(k + 2) for k in range(width)] if head is None else head
    rows = [row for row, good in zip(full, is_row, strict=True) if good]
    frame = pd.DataFrame([list(map(float, row)) for _, row in rows], columns=names)
    frame.insert(0, "1" if head is None else "time", [stamp for stamp, _ in rows])
    return frame, "lines of a serial monitor"

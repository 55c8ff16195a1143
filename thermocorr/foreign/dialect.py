"""How a file writes its table: separator, decimal sign, where its header stands; and the same table in plain CSV."""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass, field

import numpy as np

from ..records import RecordError
from ..records.csvlines import is_comment
from .values import plain_cell

BLANKS = " "
"""The separator of columns that stand apart by blanks, any number of them."""
SEPARATORS = {",": "comma", ";": "semicolon", "\t": "tab", "|": "bar", BLANKS: "blanks"}
"""Separator -> its name. The first is taken where several fit alike."""


@dataclass(frozen=True, kw_only=True)
class Dialect:
    """How a table is written; lines count from 0."""

    separator: str = ","
    decimal: str = "."
    names: tuple[str, ...] = ()
    units: dict[str, str] = field(default_factory=dict)
    """Column -> unit, from a row below the header."""
    header: int = 0
    first: int = 1
    """The first line with a row."""
    comments: bool = False
    """Whether lines that begin with # are none of the table."""
    spare: int = 0
    """Empty columns without a name behind the others."""
    dated: tuple[int, ...] = ()
    """Columns of dates or times of day, which may have points of their own."""
    grouped: bool = False
    """Whether there are signs between thousands."""
    remarks: bool = False
    """Whether a row may have a remark behind its cells, which is left out."""

    @property
    def is_plain(self) -> bool:
        """Whether the file is CSV as this package writes it; there may be comments between its rows."""
        return (self.separator, self.decimal, self.header, self.first, self.grouped) == (",", ".", 0, 1, False)

    def said(self) -> list[str]:
        """What is unusual, in words."""
        words = [] if self.separator == "," else [f"separated by {SEPARATORS[self.separator].removesuffix('s')}s"]
        if self.decimal == ",":
            words.append("decimal comma")
        if self.header:
            words.append(f"{self.header} line{'' if self.header == 1 else 's'} before the header")
        if self.units:
            words.append("units below the header")
        return words

    def fields(self, line: str) -> list[str]:
        """The cells of a line."""
        if self.separator == BLANKS:
            return line.split()
        if '"' not in line:
            return line.split(self.separator)
        try:
            return next(csv.reader([line], delimiter=self.separator, strict=True), [])
        except csv.Error:
            return []

    def plain(self, text: str) -> str:
        """The rows of a file as plain CSV, each on the line on which it stood; what is no row is an empty line.

        Raises RecordError for a number that may be a thousandfold of another one.
        """
        rows = text.split("\n", self.first)[-1] if self.first else text
        if self._replaceable(rows):
            rows = rows if self.decimal == "." else rows.replace(",", ".")
            return rows.replace(self.separator, ",").replace("\r", "")
        out = io.StringIO()
        written = csv.writer(out, lineterminator="\n")
        for number, line in enumerate(rows.split("\n"), self.first + 1):
            try:
                cells = self.row(line.removesuffix("\r"))
            except ValueError as error:
                raise RecordError(f"line {number}: {error}") from None
            if cells is None:
                out.write("\n")
            else:
                written.writerow(cells)
        return out.getvalue().removesuffix("\n")

    def row(self, line: str) -> list[str] | None:
        """The cells of a row with decimal points; None for an empty line, a comment, and the header once more.

        Raises ValueError for an open quote, and for a number that may be a thousandfold of another one.
        """
        cells = self.fields(line) if line.strip() else []
        if line.strip() and not cells:
            raise ValueError("it is no CSV: a quoted field is not closed, or goes on behind its quote")
        remark = is_comment(line, len(cells), len(self.names)) or (self.comments and line.startswith("#"))
        if remark or not any(map(str.strip, cells)):
            return None
        behind = cells[len(self.names) :]
        if not any(behind) or (self.remarks and len(behind) == 1):
            cells = cells[: len(self.names)] if self.spare or self.remarks else cells
        if [cell.strip() for cell in cells] == list(self.names):  # the logger began anew
            return None
        return [self._plain_cell(cell, place) for place, cell in enumerate(cells)]

    def _plain_cell(self, cell: str, place: int) -> str:
        try:
            return plain_cell(cell, self.decimal)
        except ValueError:
            name = self.names[place] if place < len(self.names) else f"field {place + 1}"
            raise ValueError(
                f"{cell.strip()!r} in {name!r} may be thousands or a fraction. Write numbers without signs between "
                "their thousands, and all with the same decimal sign (--decimal)."
            ) from None

    def _replaceable(self, rows: str) -> bool:
        """Whether replacing characters is enough: no quotes, comments or blanks, no comma but in numbers."""
        if self.comments or self.spare or self.remarks or self.separator == BLANKS or '"' in rows:
            return False
        nothing = self.separator * (len(self.names) - 1)
        if self.names[0] in rows or self.grouped or f"\n{nothing}\n" in rows or f"\n{nothing}\r" in rows:
            return False
        if self.decimal == ".":
            return "," not in rows
        text = np.frombuffer(rows.encode(), np.uint8)
        marks = np.flatnonzero((text == ord(self.separator)) | (text == ord("\n")))
        commas = np.flatnonzero(text == ord(","))
        cells = np.searchsorted(marks, commas)
        digit = (text >= ord("0")) & (text <= ord("9"))
        between = digit[commas - 1] & digit[np.minimum(commas + 1, len(text) - 1)]
        if not (between.all() and (np.diff(cells) > 0).all()):
            return False
        points = np.flatnonzero(text == ord("."))
        ends = np.flatnonzero(text[marks] == ord("\n"))  # of lines, among the marks
        cell = np.searchsorted(marks, points)
        line = np.searchsorted(ends, cell)
        column = cell - np.concatenate(([0], ends + 1))[line]
        return bool(np.isin(column, self.dated).all())

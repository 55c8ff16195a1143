"""Dialect and encoding of a text file, found from its first lines."""

from __future__ import annotations

import codecs
import csv
import io
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from ..records import RecordError
from ..records.errors import listing
from ..records.files import RowError, is_comment
from ..records.grammar import is_missing
from ..records.units import unit_of_text
from .values import GROUPED, IN_DOUBT, is_moment, is_number, is_unit, is_value, plain_cell

_MARKS = (
    (codecs.BOM_UTF8, "utf-8-sig", "UTF-8"),
    (codecs.BOM_UTF32_LE, "utf-32", "UTF-32"),
    (codecs.BOM_UTF16_LE, "utf-16", "UTF-16"),
    (codecs.BOM_UTF16_BE, "utf-16", "UTF-16"),
)
"""What a file may begin with, the codec that reads it, and its name."""


class Decoded(NamedTuple):
    """Text of a file."""

    text: str
    name: str
    """Name of its encoding, for people."""
    doubt: int | None = None
    """The first character that the encoding was guessed from; None where nothing had to be guessed."""


def decoded(content: bytes, named: str | None = None) -> Decoded | None:
    """The text of a file, in an encoding that is named, marked, or fits; None for one that is damaged UTF-8.

    Without a mark it is UTF-8; UTF-16 where every other byte of the beginning is zero; else Windows-1252 (Latin-1)
    where no byte is a control character of it. Then `doubt` says where that began: if it is no header that has degrees
    and accents, the file is more likely damaged.

    Raises RecordError for an encoding that is not known, or does not fit.
    """
    if named is not None:
        try:
            return Decoded(content.decode(named).removeprefix("\ufeff"), named)
        except LookupError:
            raise RecordError(
                f"--encoding {named!r} is not known. Python's names are such as utf-8, latin-1."
            ) from None
        except UnicodeDecodeError as error:
            raise RecordError(f"byte {error.start + 1} does not fit the encoding {named}") from None
        except ValueError as error:
            raise RecordError(f"--encoding {named!r} cannot be used: {error}") from None
    codec, name = next(((codec, name) for mark, codec, name in _MARKS if content.startswith(mark)), ("", ""))
    if not codec and (wide := _without_mark(content)):
        codec, name = wide, "UTF-16"
    try:
        return Decoded(content.decode(codec or "utf-8"), name or "UTF-8")
    except UnicodeDecodeError as error:
        if codec:
            raise RecordError(f"byte {error.start + 1} does not fit its encoding, {name}") from None
        beyond = np.frombuffer(content, np.uint8)
        # From here on, bytes of Latin-1 are characters that are printed: letters with accents, degrees, micro
        if ((beyond >= 0xA0) | (beyond < 128)).all():
            return Decoded(content.decode("cp1252"), "Windows-1252", error.start)
        return None


def _without_mark(content: bytes) -> str:
    """UTF-16 whose mark is missing: text of Latin letters has a zero in every other byte."""
    head = content[:4000]
    half = len(head) // 2
    if half < 4:
        return ""
    even, odd = (sum(byte == 0 for byte in head[first::2]) for first in (0, 1))
    if odd > 0.7 * half and not even:
        return "utf-16-le"
    return "utf-16-be" if even > 0.7 * half and not odd else ""


BLANKS = " "
"""The separator of columns that stand apart by blanks, any number of them."""
SEPARATORS = {",": "comma", ";": "semicolon", "\t": "tab", "|": "bar", BLANKS: "blanks"}
"""Separator -> its name. The first is taken where several fit alike."""


@dataclass(frozen=True, kw_only=True)
class Dialect:
    """Dialect of a table; lines count from 0."""

    separator: str = ","
    decimal: str = "."
    names: tuple[str, ...] = ()
    units: dict[str, str] = field(default_factory=dict)
    """Column -> unit, from a row below the header."""
    header: int = 0
    first: int = 1
    """The first line with a row."""
    comments: bool = False
    """True if lines that begin with # do not belong to the table."""
    headless: bool = False
    """True if there is no line of names: the user gave them, or they are numbers from 1 on."""
    spare: int = 0
    """Empty columns without a name behind the others."""
    dated: tuple[int, ...] = ()
    """Columns of dates or times of day, which may have points of their own."""
    valued: tuple[int, ...] = ()
    """Columns of numbers or dates."""
    grouped: bool = False
    """True if there are signs between thousands."""
    remarks: bool = False
    """True if a row may have a remark behind its cells, which is left out."""

    @property
    def is_plain(self) -> bool:
        """True if the file is CSV as this package writes it; there may be comments between its rows."""
        read = (self.separator, self.decimal, self.header, self.first, self.grouped, self.spare)
        return read == (",", ".", 0, 1, False, 0)

    def oddities(self) -> list[str]:
        """Unusual properties, in words."""
        words = [] if self.separator == "," else [f"separated by {SEPARATORS[self.separator].removesuffix('s')}s"]
        if self.headless:
            words.append("no header: columns are 1, 2, ..." if self.names[0] == "1" else "no header")
        if self.decimal == ",":
            words.append("decimal comma")
        if self.header and not self.headless:
            words.append(f"{self.header} line{'' if self.header == 1 else 's'} before the header")
        if self.units:
            words.append("units below the header")
        return words

    def fields(self, line: str) -> list[str]:
        """The cells of a line."""
        if self.separator == BLANKS and '"' not in line:
            return line.split()
        if '"' not in line:
            return line.split(self.separator)
        try:
            return next(csv.reader([self._bare(line)], delimiter=self.separator, strict=True), [])
        except csv.Error:
            return []

    def _bare(self, line: str) -> str:
        """A line with one blank where several part its cells."""
        return " ".join(line.split()) if self.separator == BLANKS else line

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
                raise RowError(f"line {number}: {error}") from None
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
        if cells[0].strip().lower() in TOTALS and 0 in self.valued:
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
        """True if replacing characters is enough: no quotes, comments or blanks, no comma but in numbers."""
        if self.comments or self.spare or self.remarks or self.separator == BLANKS or '"' in rows:
            return False
        if any(f"\n{word}" in rows[-2000:].lower() for word in TOTALS):
            return False
        nothing = self.separator * (len(self.names) - 1)
        if (
            (self.names[0] and self.names[0] in rows)
            or self.grouped
            or f"\n{nothing}\n" in rows
            or f"\n{nothing}\r" in rows
        ):
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


SAMPLE = 400
"""Lines that are looked at."""
TYPED = 0.8
"""Share of the cells of a column, or of the columns of values in a row, that hold a value."""


TOTALS = (
    "total", "totals", "sum", "sums", "average", "avg", "mean", "min", "minimum", "max", "maximum", "std", "stdev",
    "count", "summe", "mittelwert", "mittel", "gesamt", "moyenne", "somme", "promedio", "suma",
)  # fmt: skip
"""First cells, in small letters, of what programs write below the rows."""


class Looked(NamedTuple):
    """The sample under one separator."""

    dialect: Dialect
    rows: list[list[str]]
    """Cells of each line; none for a comment and an empty line."""
    width: int
    values: list[bool]
    """Which columns hold values."""
    score: float


def sniff(
    lines: Sequence[str], separator: str | None = None, decimal: str | None = None, names: Sequence[str] = ()
) -> Dialect | None:
    """The dialect of a file; None where its lines are no table.

    `lines` (sequence of str): The first lines, `SAMPLE` of them or all. `separator`, `decimal` (str, optional),
    `names` (sequence of str): Where the user says them. Raises RecordError where numbers have decimal points and
    decimal commas, and for another number of names than of columns.
    """
    # Characters of a line at most: a longer one is no row of a log
    if max(map(len, lines), default=0) > 20_000:
        return None
    choices = list(SEPARATORS) if separator is None else [separator]
    looks = [look for mark in choices if (look := _looked_at(lines, mark, decimal, forced=separator is not None))]
    if not looks:
        return None
    looks.sort(key=lambda look: -look.score)  # the first of those that fit alike
    headed = ((look, _with_header(lines, look)) for look in looks)
    best, found = next(((look, dialect) for look, dialect in headed if dialect is not None), (looks[0], None))
    if names or (found is None and best.score > TYPED):
        found = _without_header(best, names, any(line.lstrip().startswith("#") for line in lines)) or found
    if found is None:
        return None
    rows = [row for row in best.rows[found.first :] if len(row) == best.width]
    sign = decimal or _decimal(found, rows)
    grouped = any(GROUPED[sign].fullmatch(cell.strip()) for row in rows for cell in row)
    dated = tuple(j for j in range(best.width) if sum(is_moment(row[j]) for row in rows) >= TYPED * max(len(rows), 1))
    valued = tuple(j for j, is_one in enumerate(best.values) if is_one)
    return replace(found, decimal=sign, grouped=grouped, dated=dated, valued=valued)


def _without_header(look: Looked, names: Sequence[str], comments: bool) -> Dialect | None:
    """The dialect of rows without a line of names above them; None where the first line is no row."""
    first = next((k for k, row in enumerate(look.rows) if row), None)
    if first is None or not (_is_row(look.rows[first], look) or names):
        return None
    while names and first < len(look.rows) - 1 and not _is_row(look.rows[first], look):  # what the names replace
        first += 1
    if names and len(names) != look.width:
        raise RecordError(f"--names has {len(names)} names ({listing(names)}), and the rows have {look.width} fields")
    named = tuple(names) or tuple(str(k) for k in range(1, look.width + 1))
    return replace(look.dialect, names=named, header=first, first=first, headless=True, comments=comments)


def _looked_at(lines: Sequence[str], mark: str, decimal: str | None, forced: bool) -> Looked | None:
    dialect = Dialect(separator=mark)
    rows = [[] if not line.strip() or line.lstrip().startswith("#") else dialect.fields(line) for line in lines]
    filled = [row for row in rows if row]
    tail = filled[-max(1, 2 * len(filled) // 3) :]
    widths = Counter(map(len, tail))
    if not widths:
        return None
    width = max(widths, key=lambda n: (widths[n], n))
    if width < 2 and not forced:
        return None
    full = [row for row in tail if len(row) == width]
    signs = [decimal] if decimal else [".", ","] if mark != "," or any('"' in line for line in lines) else ["."]
    cells = [[any(is_value(row[j], sign) for sign in signs) for row in full] for j in range(width)]
    known = [[not is_missing(row[j]) for row in full] for j in range(width)]
    values = [any(held) and sum(held) >= TYPED * max(sum(there), 1) for held, there in zip(cells, known, strict=True)]
    share = sum(map(sum, cells)) / max(sum(map(sum, known)), 1)
    return Looked(dialect, rows, width, values, share * len(full) / len(tail)) if any(values) else None


def _with_header(lines: Sequence[str], look: Looked) -> Dialect | None:
    """The dialect with the place of its header: the line of names that the least number of lines speaks against.

    Against it are lines behind it that are no rows, and rows before it.
    """
    data = [_is_row(row, look) for row in look.rows]
    look = look._replace(rows=[_widened(row, k, data, look) for k, row in enumerate(look.rows)])
    filled = [bool(row) for row in look.rows]
    candidates = []
    for k, row in enumerate(look.rows):
        behind = next((i for i in range(k + 1, len(data)) if filled[i]), None)
        if data[k] or behind is None or not _is_header(row, look) or are_units(row):
            continue
        units = behind if not data[behind] and are_units(look.rows[behind]) else None
        first = k + 1 if units is None else units + 1
        if not any(data[first:]):
            continue
        if units is not None:  # a row of kinds (Avg, Smp) below the units
            first += next(i for i in range(len(data)) if data[first + i] or i == 2)
        rest = range(first, len(data))
        against = sum(filled[i] and not data[i] and look.rows[i] != row for i in rest) + sum(data[:k])
        empty = sum(not cell.strip() for cell in row)  # fewer names are a preamble, or what is below the units
        candidates.append((against, empty, -k, first, units))
    comments = any(line.lstrip().startswith("#") for line in lines)
    if not candidates:
        return _with_commented_header(lines, look, data)
    _, _, place, first, units = min(candidates)
    above = next((k for k in range(-place) if data[k]), None)
    if above is not None:
        raise RecordError(
            f"line {above + 1} is a row, and the columns' names stand below it, in line {-place + 1}. Does the log "
            "begin anew there? Split it, or put the header into its first line"
        )
    names = [cell.strip() for cell in look.rows[-place]]
    remarks = len(names) > look.width
    names = names[: look.width]
    spare = _spare(names, [row for row, is_row in zip(look.rows, data, strict=True) if is_row])
    names = names[: len(names) - spare]
    return replace(
        look.dialect,
        names=tuple(names),
        units={} if units is None else units_below(names, look.rows[units]),
        header=-place,
        first=first,
        comments=comments,
        spare=spare,
        remarks=remarks,
    )


def _widened(row: list[str], k: int, data: Sequence[bool], look: Looked) -> list[str]:
    """A line of names with one more, where each row has a cell more: an empty one behind, or its number in front."""
    if data[k] or len(row) != look.width - 1 or not row or any(is_value(cell) for cell in row if cell.strip()):
        return row
    rows = [one for one, is_row in zip(look.rows, data, strict=True) if is_row]
    if not any(one[-1].strip() for one in rows):
        return [*row, ""]
    first = [one[0].strip().strip('"') for one in rows]
    numbered = all(cell.isdigit() for cell in first) and np.diff([int(cell) for cell in first] or [0, 1]).all()
    return ["", *row] if numbered else row


def _with_commented_header(lines: Sequence[str], look: Looked, data: Sequence[bool]) -> Dialect | None:
    """Names that stand in the last comment before the rows: ``# time temperature reading``."""
    if True not in data:
        return None
    first = data.index(True)
    above = next((k for k in range(first - 1, -1, -1) if lines[k].strip()), None)
    if above is None or not lines[above].lstrip().startswith("#"):
        return None
    names = look.dialect.fields(lines[above].lstrip().lstrip("#").strip())
    if len(names) != look.width or not _is_header(names, look):
        return None
    return replace(
        look.dialect, names=tuple(name.strip() for name in names), header=above, first=above + 1, comments=True
    )


def _is_row(row: list[str], look: Looked) -> bool:
    if len(row) != look.width:
        return False
    held = [cell for cell, is_one in zip(row, look.values, strict=True) if is_one]
    good = sum(is_missing(cell) or is_value(cell, ".") or is_value(cell, ",") for cell in held)
    return good >= TYPED * len(held) and any(not is_missing(cell) for cell in row)


def _is_header(row: list[str], look: Looked) -> bool:
    # Names of a last column that rows need not have: LabVIEW's measurement files are written so
    if len(row) == look.width + 1 and row[-1].strip().lower() in ("comment", "comments", "remark", "kommentar"):
        row = row[:-1]
    if len(row) != look.width or sum(map(bool, map(str.strip, row))) < len(row) / 2:
        return False
    held = [cell.strip() for cell, is_one in zip(row, look.values, strict=True) if is_one]
    return any(cell and not is_number(cell) for cell in held) and not any(is_value(cell) for cell in held if cell)


def are_units(row: Sequence[str]) -> bool:
    """True if the cells of a row are units, such as stand below the names of columns."""
    cells = [cell for cell in row if cell.strip()]
    return bool(cells) and sum(map(is_unit, cells)) >= len(cells) / 2


def units_below(names: Sequence[str], row: Sequence[str]) -> dict[str, str]:
    """Unit of each column that has one in the row of units below the names."""
    texts = [cell.strip() for cell in row]
    units = [unit_of_text(text.strip("[]()<>")) or text for text in texts]
    return {name: unit for name, unit in zip(names, units, strict=False) if unit}


def _spare(names: list[str], rows: list[list[str]]) -> int:
    """Columns at the end without a name and without a cell."""
    spare = 0
    while spare < len(names) - 1 and not names[-1 - spare] and not any(row[-1 - spare].strip() for row in rows):
        spare += 1
    return spare


def _falling(rows: list[list[str]], sign: str) -> str | None:
    """A number that may be thousands: its column has whole numbers of three digits too, and none of other fractions."""
    for column in zip(*rows, strict=True):
        cells = [cell.strip() for cell in column]
        signed = [cell for cell in cells if sign in cell and is_number(cell, sign)]
        whole = any(re.fullmatch(r"[+-]?\d{3}", cell) for cell in cells)
        other = "," if sign == "." else "."
        if signed and whole and all(IN_DOUBT[other].fullmatch(cell) for cell in signed):
            return str(signed[0])
    return None


def _decimal(dialect: Dialect, rows: list[list[str]]) -> str:
    """The decimal sign of the numbers."""
    cells = [cell.strip() for row in rows for cell in row]
    points = [cell for cell in cells if "." in cell and is_number(cell, ".")]
    commas = [cell for cell in cells if "," in cell and is_number(cell, ",")]
    if dialect.separator == "," and points:
        return "."  # a quoted 1,234 is refused where it is read
    if commas and dialect.separator == "," and all(IN_DOUBT["."].fullmatch(cell) for cell in commas):
        raise RecordError(f"Is {commas[0]!r} a thousandfold, or a fraction? Say it with --decimal , or --decimal .")
    for sign, found in ((".", points), (",", commas)):
        column = _falling(rows, sign) if found else None
        if column is not None:
            raise RecordError(
                f"Is {column!r} a thousandfold, or a fraction? Whole numbers of three digits stand beside it. Write "
                "numbers without signs between their thousands"
            )
    if points and commas:
        raise RecordError(
            f"Some numbers have a decimal point ({points[0]!r}), others a decimal comma ({commas[0]!r}). Say which it "
            "is with --decimal."
        )
    return "," if commas else "."

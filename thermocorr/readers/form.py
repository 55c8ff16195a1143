"""How a log is written, to read more of it."""

from __future__ import annotations

import codecs
import contextlib
import io
import json
import warnings
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pandas as pd

from ..records import RecordError
from ..records.errors import listing, option, quoted, times_word
from .cells import COMMENTS, NO_VALUE, SEPARATORS, as_numbers, is_number, says_something, split
from .clocks import LOCAL, Clock
from .text import STAMPED, Template, rows_of

_DIGITS: Any = {"float_precision": "round_trip"} if tuple(map(int, pd.__version__.split(".")[:2])) < (3, 1) else {}
"""How pandas must read numbers as they were written: a matter of course from 3.1 on."""
JSON = "{"
"""What stands for a separator where each line is an object of JSON."""


def header_of(line: str) -> str:
    """The beginning of a header line."""
    return line.strip()[:5000]


@dataclass
class Form:
    """How a log is written, in plain values."""

    encoding: str = "utf-8"
    separator: str = ","
    """Between cells; `JSON`; or "" for lines of words and numbers, which `templates` describe."""
    decimal: str = "."
    names: list[str] = field(default_factory=list)
    units: dict[str, str] = field(default_factory=dict)
    behind: dict[str, str] = field(default_factory=dict)
    """Units that stand behind the numbers of a column, in each of its cells."""
    header: str = ""
    """Beginning of the line of names, which a logger repeats when it restarts; "" without a header."""
    below: int = 0
    """Lines from the header to the first row; without a header, lines above the first row."""
    templates: list[Template] = field(default_factory=list)
    stamped: bool = False
    """A monitor has written a time of day and an arrow before each line."""
    columns: list[str] = field(default_factory=list)
    """Columns that are kept, without the times and without empty ones."""
    numbers: list[str] = field(default_factory=list)
    """Columns of numbers."""
    missing: list[str] = field(default_factory=list)
    """Words and numbers for no value, besides `NO_VALUE`."""
    long: list[str] = field(default_factory=list)
    """Columns of names and of values, where each line holds one value."""
    clock: Clock | None = None

    def cells(self, text: str, line: int, skip: bool, most: float = 0.5) -> tuple[pd.DataFrame, list[str]]:
        """Whole lines as a frame, and notes.

        `line` (int): Number of the first of them in the file. `skip` (bool): Leave out damaged lines. `most`
        (float): Share of lines that may be none. Raises RecordError for the first such line, and for too many.
        """
        if self.separator == JSON:
            try:
                whole = text.lstrip().startswith("[")
                return pd.json_normalize(
                    json.loads(text) if whole else list(map(json.loads, filter(str.strip, text.split("\n"))))
                ), []
            except ValueError as error:
                raise RecordError(f"A line is no JSON: {error}.") from None
        text = STAMPED.sub(r"\1,", text) if self.stamped else text
        if self.templates:
            rows = rows_of(text, self.templates)
            return rows.set_axis(rows.index + line), []
        text = text if text.endswith("\n") else text + "\n"
        content = text.encode()
        frame = self._parsed(content) if self._is_plain(text, content) else None
        if frame is not None and not self._has_other_lines(frame, text):
            return frame.set_axis(pd.RangeIndex(line, line + len(frame))), []
        content, notes, numbers = self._rows(text, line, skip, most)
        return self._parsed(content).set_axis(pd.Index(numbers)), notes

    def _parsed(self, content: bytes) -> pd.DataFrame:
        """Rows as a frame, single columns of dates parsed."""
        first = content[: content.find(b"\n")].decode()
        given: dict[str, Any] = {
            "sep": r"\s+" if self.separator == " " else self.separator, "decimal": self.decimal, "header": None,
            "names": self.names, "index_col": False, "skipinitialspace": f"{self.separator} " in first, **_DIGITS,
            "na_values": [*NO_VALUE, *self.missing], "low_memory": False,
        }  # fmt: skip
        dates = [
            n
            for n, cell in zip(self.names, split(first, self.separator), strict=False)
            if ":" in cell and LOCAL.fullmatch(cell)
        ]
        if len(dates) == 1:
            with warnings.catch_warnings(), contextlib.suppress(Warning, ValueError, TypeError):
                warnings.simplefilter("error")  # dates of several kinds, which the slower way tells apart
                dated: pd.DataFrame = pd.read_csv(
                    io.BytesIO(content), parse_dates=dates, date_format="ISO8601", **given
                )
                now = pd.Timestamp.now()  # pandas takes words such as "today" for it
                if not dated[dates[0]].between(now - pd.Timedelta("2D"), now + pd.Timedelta("2D")).any():
                    return dated
        table: pd.DataFrame = pd.read_csv(io.BytesIO(content), **given)
        return table

    def _is_plain(self, text: str, content: bytes) -> bool:
        """True if all lines are plain rows of one width."""
        comments = any(mark[0] in text and f"\n{mark}" in text for mark in COMMENTS) or text.startswith(COMMENTS)
        if self.separator == " " or len(self.names) < 2 or '"' in text or comments:
            return False
        row = self.separator.encode() * (len(self.names) - 1) + b"\n"
        marks = content.translate(None, bytes(set(range(256)) - set(row)))
        return marks == row * (len(marks) // len(row))

    def _has_other_lines(self, frame: pd.DataFrame, text: str) -> bool:
        """True if some lines are empty or repeat the header."""
        words = any(dtype.kind not in "biufmM" for dtype in frame.dtypes)
        return (words and bool(self.header) and self.header in text) or bool(frame.isna().all(axis=1).any())

    def _rows(self, text: str, line: int, skip: bool, most: float) -> tuple[bytes, list[str], list[int]]:
        """Lines that are rows, notes, and their numbers."""
        lines, kept, bad, wanted = text.split("\n")[:-1], list[int](), [], len(self.names)
        blanks = self.separator + " \t"
        for k, one in enumerate(lines):
            bare = one.strip(blanks)
            if not bare or one.startswith(COMMENTS) or self.is_header(one):
                continue
            if '"' not in one and self.separator != " ":
                width = one.count(self.separator) + 1
            else:
                width = 0 if one.count('"') % 2 else len(split(one, self.separator))
            if width == wanted:
                kept.append(k)
            else:
                bad.append((k, width))
        content = ("\n".join(lines[k] for k in kept) + "\n").encode()
        numbers = [line + k for k in kept]
        if not bad:
            return content, [], numbers
        k, width = bad[0]
        found = f"it has {times_word(width, 'field')} where the header has {wanted}"
        found = f"line {line + k}: {found if width else 'a quoted field is not closed on its line'}"
        if len(bad) > most * len(lines):
            raise RecordError(
                f"{len(bad)} of {times_word(len(lines), 'line')} are not rows, such as {found}. Say the names of all "
                f"columns with {option('names')}."
            )
        if not skip:
            raise RecordError(
                f"It cannot be read as a table: {found}: {quoted(lines[k])}. Correct it, or pass over such lines with "
                f"{option('skip_bad_rows', 'True')}."
            )
        return content, [f"{times_word(len(bad), 'line')} left out, no rows, the first is {found}"], numbers

    def later(self, text: str, line: int) -> tuple[pd.DataFrame, list[str]]:
        """Later lines, indexed by their times; faults are noted.

        Raises RecordError for a header of other columns.
        """
        frame, notes = self.cells(text, line, skip=True, most=1.0)
        for name in self.numbers:
            if name not in frame:
                frame[name] = np.nan
            if is_number(frame[name]):
                continue
            read = as_numbers(frame[name], self.decimal, self.behind.get(name, ""))
            values = pd.Series(np.nan, frame.index) if read is None else read[0]
            odd = frame[name][values.isna() & says_something(frame[name])]
            notes += [f"line {line}: {quoted(cell)} in {quoted(name)} is no number" for line, cell in odd.items()]
            frame[name] = values
        frame = frame.replace([np.inf, -np.inf], np.nan)
        if self.clock is None:
            return frame[self.columns].reset_index(drop=True), notes
        index = self.clock.times(frame)
        kept = np.asarray(pd.notna(index))
        self.refuse_header(frame[~kept])
        if not kept.all():
            cells = frame[self.clock.columns[0]][~kept]
            notes += [f"line {line} is left out: {quoted(str(cell))} is no time" for line, cell in cells.items()]
        return frame[self.columns].set_axis(index)[kept], notes

    def place(self, number: object) -> str:
        """A row in words: its line, for a text."""
        return f"line {number}" if self.names or self.separator == JSON else f"row {number}"

    def is_header(self, line: str) -> bool:
        """True if a line is that of the names."""
        return bool(self.header) and header_of(line) == self.header

    def is_sound(self) -> bool:
        """True if its parts belong together; a forged file's may not."""
        clock, known = self.clock, set(self.names)
        try:
            codecs.lookup(self.encoding)
            pd.Timestamp(0, tz=clock.zone if clock is not None and clock.zone else None)
        except (LookupError, ValueError):
            return False
        used = [
            *self.columns,
            *self.numbers,
            *self.long,
            *([] if clock is None else [*clock.columns, *filter(None, [clock.fraction])]),
        ]
        marks = (*SEPARATORS.values(), JSON, "")
        return (
            self.separator in marks
            and self.decimal in (".", ",")
            and len(known) == len(self.names)
            and known >= set(used)
        )

    def refuse_header(self, rows: pd.DataFrame) -> None:
        """Raise RecordError for the header of another table."""
        for row in rows.to_numpy():
            cells = [str(cell).strip() for cell in row]
            if set(self.names) & set(cells):
                raise RecordError(
                    f"A header comes again with other names ({listing(cells)}; before: {listing(self.names)}). Give "
                    "what stands below it as a file of its own."
                )

"""The table in a text: separator, decimal sign, first row, names."""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import replace

from ..records import RecordError
from ..records.errors import option, quoted, times_word
from ..records.units import unit_of_text
from .cells import COMMENTS, MOMENT, NUMBER, SAID_EMPTY, Options, is_typed, split
from .clocks import COUNTERS, SPANS
from .form import Form, header_of

HEAD = 400_000
"""Characters of a text in which its form is looked for."""


def find_table(text: str, said: Options) -> Form | None:
    """Separator and decimal sign under which most cells are typed.

    The later half of the first lines is asked: there is no preamble there. None where nothing separates.
    """
    lines = text[:HEAD].split("\n")[:3000]
    filled = [line for line in lines if line.strip() and not line.startswith(COMMENTS)]
    sample = filled[len(filled) // 2 :][:40]
    best, found, typed_at = (0.4, 0.0), None, list[int]()
    for separator in (said.sep,) if said.sep else ",;\t| ":
        rows = [split(line, separator) for line in sample if separator != " " or "\t" not in line]
        width, n = Counter(map(len, rows)).most_common(1)[0] if rows else (0, 0)
        of_width = (row for row in rows if len(row) == width)
        columns = [[c for c in column if c.lower() not in SAID_EMPTY] for column in zip(*of_width, strict=True)]
        if width < 2 or n < 0.5 * len(rows) or not any(columns):
            continue
        fits = {mark: [sum(is_typed(c, mark) for c in column) for column in columns] for mark in ".,"}
        points, commas = sum(fits["."]), sum(fits[","])
        cells = (cell for column in columns for cell in column if not MOMENT.fullmatch(cell))
        numbers = [cell for cell in cells if re.fullmatch(NUMBER[","], cell)]
        bare = any("," in cell for cell in numbers) and not any("." in cell for cell in numbers)
        mark = said.decimal or ("," if commas > points or (commas == points and bare) else ".")
        share = sum(fits[mark]) / sum(map(len, columns))
        if (score := (round(share * n / len(rows), 2), share * width)) > best:
            best, found = score, Form(separator=separator, decimal=mark, names=[str(k + 1) for k in range(width)])
            typed_at = [j for j in range(width) if columns[j] and fits[mark][j] >= 0.8 * len(columns[j])]
    return None if found is None else _with_names(found, lines, typed_at, said)


def _with_names(form: Form, lines: list[str], typed_at: list[int], said: Options) -> Form:
    """The form with first row, names and units."""
    width, separator = len(form.names), form.separator

    def typed(k: int) -> float:
        """Share of a line's cells typed as rows are."""
        cells = split(lines[k], separator)
        some = [cells[j] for j in typed_at if cells[j].lower() not in SAID_EMPTY] if len(cells) == width else []
        fits = [is_typed(cell, form.decimal) for cell in some] or [False]
        return fits[0] * sum(fits) / len(fits)

    real = [k for k, line in enumerate(lines) if line.strip(separator + " \t") and not line.startswith(COMMENTS)]
    top, counts = split(lines[real[0]], separator), [str(j) for j in range(width)]
    counted = top == ["", *counts[:-1]] or (top == counts and width > 3)  # pandas' names of columns that have none
    rows = real[1:] if counted else real
    first = next(
        (a for a, b in zip(rows, [*rows[1:], *rows[-1:]], strict=True) if typed(a) > 0.5 and typed(b) > 0.5), None
    )
    if first is None:
        raise RecordError(
            f"No two lines that follow on one another are rows. Say {option('sep')} or {option('decimal')}."
        )
    heads: list[tuple[int, list[str]]] = []
    for k in range(first - 1, -1, -1):
        cells = split(lines[k] if k in real else lines[k].lstrip("#%/ "), separator)
        filled = len(cells) - next((j for j, cell in enumerate(reversed(cells)) if cell), 0)
        words = not any(re.fullmatch(NUMBER[form.decimal], cell) for cell in cells if cell)
        if (words or (counted and k == real[0])) and (
            len(cells) == width or (filled in (width - 1, width, width + 1) and filled > 1)
        ):
            heads.insert(0, (k, cells))
        elif k in real and not (heads and len(cells) == len(heads[0][1])):
            break
    early = next((k for k in rows if k < first and all(split(lines[k], separator)) and typed(k) == 1.0), None)
    if early is not None and not heads:
        first = early
    elif early is not None:
        raise RecordError(
            f"Line {early + 1} is a row, and the columns' names stand below it. Is it a log that was put together? "
            "Give each part as a file."
        )
    if said.names:
        if len(said.names) != width:
            raise RecordError(
                f"{option('names')} has {times_word(len(said.names), 'name')}, and rows have {width} fields, such as "
                f"{quoted(lines[first][:60])}."
            )
        return replace(form, names=list(said.names), below=first)
    if not heads:
        return replace(form, below=first)
    most = max(len(set(cells) - {""}) for _, cells in heads)
    likely = [j for j, (_, cells) in enumerate(heads) if len(set(cells) - {""}) == most]
    place = next((j for j in reversed(likely) if not _are_units(heads[j][1])), likely[0])
    at, names = heads[place]
    if (
        len(names) > width
        and names[width]
        and not re.match(r"comment|note|remark|bemerk|kommentar", names[width], re.I)
    ):
        raise RecordError(
            f"Every row has one field less than the header, {quoted(lines[at])}. Say the names of all {width} columns "
            f"with {option('names')}."
        )
    below = [cells + [""] * width for _, cells in heads[place + 1 :]]
    if below and len(set(names) - {""}) < len([name for name in names if name]):  # groups above their members
        names, below = [f"{a} {b}".strip() for a, b in zip(names, below[0], strict=False)], below[1:]
    names = _as_wide(
        names[:width], [split(lines[k], separator) for k in [k for k in real if k >= first][:2]], lines[at]
    )
    units = {
        n: u.strip("[]()<> ") for n, u in zip(names, below[0] if below else [], strict=False) if u.strip("[]()<> ")
    }
    return replace(form, names=names, units=units, below=first - at, header=header_of(lines[at]))


def _are_units(cells: list[str]) -> bool:
    """True if half of a line's cells are units."""
    words = [cell for cell in cells if cell]
    units = [word for word in words if word[0] in "[(" or unit_of_text(word) or word.lower() in SPANS]
    return len(units) >= 0.5 * len(words)


def _as_wide(names: list[str], rows: list[list[str]], header: str) -> list[str]:
    """Distinct names for all fields of the rows.

    Rows may have an empty cell more at their end, or their number in front. Raises RecordError for another field more.
    """
    width, row = len(rows[0]), rows[0]
    if len(names) == width - 1:
        counted = row[0].isdigit() and (len(rows) == 1 or rows[1][0] == str(int(row[0]) + 1))
        if row[-1] and (not counted or not names[0] or COUNTERS.match(names[0])):
            raise RecordError(
                f"Every row has one field more than the header, {quoted(header)}. Say the names of all {width} columns "
                f"with {option('names')}."
            )
        names = ["row", *names] if row[-1] else [*names, ""]
    names = [n or ("time" if k == 0 and ":" in row[0] else f"column {k + 1}") for k, n in enumerate(names)]
    count = Counter(names)
    return [n if count[n] == 1 else f"{n} (column {k + 1})" for k, n in enumerate(names)]

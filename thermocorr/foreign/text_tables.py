"""From the bytes of a file of text to a table: plain CSV as it stands, any other dialect translated to it."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import pandas as pd

from ..records import RecordError
from ..records.errors import quoted, times_word
from ..records.files import LONGEST, RowError, csv_table
from ..records.grammar import is_missing
from .how import ForeignTable, HowToRead
from .long_form import whole_dates, widened, without_units
from .sniffing import SAMPLE, Decoded, Dialect, decoded, sniff
from .values import is_value

HEAD = 1 << 16
"""Bytes of a file from which is told whether it is plain."""


def is_plain(head: bytes, how: HowToRead) -> bool:
    """True if a file is CSV as this package writes it, as far as the first lines tell; comments may stand in it."""
    if how.says_something():
        return False
    try:
        text, found = head_dialect(head, how)
    except RecordError:  # numbers with points and with commas
        return False
    return text is None or (text.name == "UTF-8" and (found is None or found.is_plain) and b"\n" in head)


def first_lines(content: bytes) -> bytes:
    """The first lines of a file, whole ones; all of a short one."""
    head = content[:HEAD]
    wide = b"\0" in head[:100]
    return head if wide or len(head) < HEAD else head[: head.rfind(b"\n") + 1] or head


MOST_COLUMNS = 10_000
"""Columns from which a file is no log: to look at a million of them takes a minute."""


def text_table(content: bytes, path: Path, how: HowToRead, said: tuple[str, ...] = ()) -> ForeignTable:
    """The table in the content of a file.

    `content` (bytes). `path` (Path): What it is called in messages. `how` (HowToRead). `said` (tuple of str): What
    was understood before. Raises RecordError for what is no table.
    """
    header = content[: content.find(b"\n") + 1 or len(content)]
    columns = max(header.count(mark) for mark in (b",", b";", b"\t", b"|"))
    if columns >= MOST_COLUMNS and len(header) <= LONGEST:  # a longer one is refused by the reader of plain CSV
        raise RecordError(f"{path} has more than {MOST_COLUMNS} columns in its first line. Is it a log?")
    try:
        return _table(content, path, how, said)
    except RowError as error:
        raise RecordError(
            f"{str(error).removesuffix('.')}. Mend it, or pass over such lines with --skip-bad-rows."
        ) from None


def _table(content: bytes, path: Path, how: HowToRead, said: tuple[str, ...]) -> ForeignTable:
    head = first_lines(content)
    if is_plain(head, how) and not _is_broken_up(content):
        frame = csv_table(content, path)
        line = _first_line(frame, content.count(b"\n"), 1)
        return _arranged(ForeignTable(frame=frame, said=said, first_line=line), how.reading)
    try:
        text, found = head_dialect(content, how)
    except RecordError as error:
        raise RecordError(f"{path} cannot be read as a table: {error}") from None
    if text is None or found is None:  # the reader of plain CSV says what is wrong
        return _arranged(
            ForeignTable(frame=csv_table(content if text is None else text.text.encode(), path), said=said), None
        )
    if text.name != "UTF-8" or how.encoding is not None:
        said = (*said, f"{text.name}{'' if text.doubt is None else ', as far as one can tell'}")
    rows, words = _good_rows(text.text, found) if how.skip_bad_rows else (text.text, "")
    return _translated(rows, found, path, (*said, *filter(None, [words])), how.reading)


NAMED = 3
"""Lines that are passed over and named; others are counted."""


def _good_rows(text: str, found: Dialect) -> tuple[str, str]:
    """The text with an empty line in place of each that is no row, and in words which these are."""
    lines = text.split("\n")
    bad = [k for k in range(found.first, len(lines)) if not _is_good(lines[k].removesuffix("\r"), found)]
    for k in bad:
        cells = [cell.strip() for cell in found.fields(lines[k].removesuffix("\r"))]
        if len(cells) == len(found.names) and not any(is_missing(one) or is_value(one) for one in cells):
            raise RecordError(f"line {k + 1} is another header ({quoted(lines[k])}): split the file there.")
    if not bad:
        return text, ""
    shown = ", ".join(f"{k + 1} ({quoted(lines[k])})" for k in bad[:NAMED])
    for k in bad:
        lines[k] = ""
    more = f" and {len(bad) - NAMED} more" if len(bad) > NAMED else ""
    return "\n".join(lines), f"{times_word(len(bad), 'line')} passed over: line{'s' * (len(bad) > 1)} {shown}{more}"


def _is_good(line: str, found: Dialect) -> bool:
    """True if a line is a row, a comment or empty: as many cells as columns, and values where others have values."""
    try:
        cells = found.row(line)
    except ValueError:
        return False
    if cells is None:
        return True
    held = [cells[j] for j in found.valued if j < len(cells)]
    whole = len(cells) == len(found.names) and not _DAMAGED.search(line)
    return whole and all(is_missing(cell) or is_value(cell, ".") for cell in held)


_DAMAGED = re.compile("[\x00-\x08\x0b-\x1f\ufffd]")
"""Control characters, and what stands for bytes that are no text."""


def _is_broken_up(content: bytes) -> bool:
    """True if there are comments between the rows, or the header once more: the logger was started anew.

    Single bytes are looked for first, which takes a tenth of the time: most logs lack one.
    """
    start = content.find(b"\n") + 1
    header = content[:start].removeprefix(b"\xef\xbb\xbf")
    if b"#" in content and b"\n#" in content:
        return True
    anew = len(header) > 2 and all(content.find(byte, start) >= 0 for byte in set(header))
    return anew and b"\n" + header in content


def head_dialect(content: bytes, how: HowToRead) -> tuple[Decoded | None, Dialect | None]:
    """The text of a file and its dialect; no text for one that is damaged UTF-8."""
    text = decoded(content, how.encoding)
    if how.skip_bad_rows and (text is None or text.doubt is not None):
        text = Decoded(content.decode("utf-8", "replace"), "UTF-8")
    if text is None:
        return None, None
    if "\n" not in text.text:
        text = text._replace(text=text.text.replace("\r", "\n"))
    found = sniff(_lines(text.text)[:SAMPLE], how.separator, how.decimal, how.names)
    if text.doubt is not None:
        header = 0 if found is None else found.first
        if text.text.count("\n", 0, text.doubt) >= header:  # a byte in a row, and none in the header: it is damaged
            return None, None
    return text, found


def _lines(text: str) -> list[str]:
    """The first lines of a text, one more than are looked at."""
    head = text[: HEAD * 16]
    lines = head.split("\n", SAMPLE + 1)
    cut = lines[:-1] if len(lines) > 1 and (len(lines) > SAMPLE or len(head) < len(text)) else lines
    return [line.removesuffix("\r") for line in cut]


def _translated(text: str, found: Dialect, path: Path, said: tuple[str, ...], reading: str | None) -> ForeignTable:
    """The table of a text, by the way of plain CSV: one strict reader for every file."""
    try:
        rows = replace(found, comments=found.comments or "\n#" in text).plain(text)
    except RecordError as error:
        raise type(error)(f"{path} cannot be read as a table: {error}") from None
    frame = csv_table(rows.encode(), path, list(found.names), found.first + 1)
    if found.units:
        frame.attrs["units"] = dict(found.units)
    line = _first_line(frame, text.count("\n"), found.first)
    return _arranged(ForeignTable(frame=frame, said=(*said, *found.oddities()), first_line=line), reading)


def _first_line(frame: pd.DataFrame, n_lines: int, before: int) -> int | None:
    """The line with the first row; None where rows and lines are not as many: empty lines, comments, broken cells."""
    return before + 1 if len(frame) in (n_lines - before, n_lines - before + 1) else None


def _arranged(table: ForeignTable, reading: str | None) -> ForeignTable:
    """One column for each quantity, of numbers without their units."""
    whole, words = whole_dates(table.frame)
    table = replace(table.with_said(whole, words), first_line=None) if words else table
    wide, words = widened(table.frame, reading)
    table = replace(table.with_said(wide, words), first_line=None) if words else table
    bare, units = without_units(table.frame)
    if units:
        table = table.with_said(bare, "units in the cells")
        table.frame.attrs["units"] = {**table.frame.attrs.get("units", {}), **units}
    return table

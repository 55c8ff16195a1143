"""Ways to spoil a log: a cell, a row, a line, the bytes of the file."""

import random
from collections.abc import Callable

from .subjects import HEADER, line_of

Cells = list[list[str]]

NUMBERS = [
    "1_000", "1__0", "_1", "0x10", "0x1p3", "1e400", "-1e400", "1e160", "-1e308", "1e308", "1e40", "1.0000001e40",
    "9" * 40, "9" * 41, "1" + "0" * 400, "inf", "-inf", "Infinity", "+nan", "1e-400", "5e-324", "-0", "+.5", "5.", ".",
    "-", "+", "e5", "1e", "1e+", "1e5", "1E5", "1d5", "1,5", "1.2.3", "1 000", "1\u00a0000", "--1", "+-1", "1-",
    "\uff12\uff13.\uff15", "\u0662\u0663", "\u0967\u0968", "2\uff13", "\u00b2", "\u00bd", "\u2212" "5", "\x1d3.1",
    "3.1\x1d", "\x0b3.1", "\u20093.1", " 3.1 ", "\t3.1", "3.1\t ", " ", "\t", "True", "true", "FALSE", "yes", "0.1f",
    "1j", "(5)", "5%", "$5", "23 C", "N/A", "n/a", "#N/A", "#N/A N/A", "#NA", "<NA>", "NULL", "null", "None", "NaN",
    "nan", "-nan", "NA", "Nan", "NAN", "none", "NONE", " NA ", "nil", "-", "?", "1.#IND", "-1.#IND", "1.#QNAN",
    "1.#INF", "-1.#INF", "0.1000000000000000055511151231257827", "123456789012345678901234567890",
    "18446744073709551615", "18446744073709551616", "9223372036854775808", "9007199254740993",
    "2.2250738585072012e-308", "007", "0b1", "0o7", "1e0000000000000000000000000005", "1" * 400 + "e-390",
    "0." + "0" * 400 + "1", "'5'", "=5", "\ufeff5", "5\u200b",
]  # fmt: skip
TIMES = [
    "8024-03-04T00:40:00", "2094-03-04T00:40:00", "1677-01-01T00:00:00", "1677-09-21T00:12:43", "2262-04-11T23:47:16",
    "2262-04-12T00:00:00", "2300-01-01T00:00:00", "0001-01-01T00:00:00", "9999-12-31T23:59:59", "10000-01-01T00:00:00",
    "2024-03-04T24:00:00", "2024-03-04T23:59:60", "2024-03-04T25:00:00", "2024-02-30T00:00:00", "2024-13-01T00:00:00",
    "now", "today", "NaT", "2024", "2024-03", "2024-03-04", "20240304", "20240304T004000", "2024-W10-1", "2024-064",
    "2024-03-04T00:40", "2024-03-04T00", "2024-3-4T00:40:00", "2024-3-4 0:40:00", "04.03.2024 00:40",
    "03/04/2024 00:40", "2024-03-04T00:40:00Z", "2024-03-04T00:40:00+01:00", "2024-03-04 00:40:00+02:00",
    "2024-03-04T00:40:00-0530", "2024-03-04 00:40:00 +02:00", "2024-03-04T00:40:00+02", "2024-03-04T00:40:00+25:00",
    "2024-03-04T00:40:00+02:00:30", "2024-03-04T00:40:00 UTC", "2024-03-04T00:40:00 Europe/Paris",
    "2024-03-04T00:40:00.5", "2024-03-04T00:40:00,5", "2024-03-04T00:40:00.123456789", "2024-03-04T00:40:00.1234567891",
    "2024-03-04t00:40:00", "2024-03-04_00:40:00", "2024-03-04T00:40:00.", "2024-03-04T00.40.00",
    " 2024-03-04T00:40:00 ", "2024-03-04  00:40:00", "1709512800", "40", "1709512800000", "1e9", "-5", "nan",
    "\uff12\uff10\uff12\uff14-03-04T00:40:00", "2024-03-04T00:4\u0660:00", "-2024-03-04", "+2024-03-04T00:40:00",
    "00:40:00", "0 days 00:40:00", "2024-03-31T02:30:00", "2024-10-27T02:30:00", "2024-10-27T02:30:00+02:00",
    "2024-10-27T02:30:00+01:00", "2024-03-04T00:40:00\x00", "2024-03-04T00:40:00\x1d", "Mon Mar 4 00:40:00 2024",
    "2024-03-04T00:40:00+00:00", "2024-03-04T00:40:00-00:00", "P1D", "1e400", "inf",
]  # fmt: skip
TEXTS = [
    "", "x", "a,b", '"', '""', 'a"b', "a\nb", "a\rb", "a\r\nb", "NA", "1", "\ud800", "\u2028", "\x85", "\x0c", "🙂",
    "'",
]  # fmt: skip


SPOILED = [*[(["temperature", "reading", "humidity"], NUMBERS)] * 15, *[(["time"], TIMES)] * 8, (["time"], NUMBERS)]
SPOILED += [(["note", "run"], TEXTS), (["note", "run"], NUMBERS)] * 2


def a_cell(cells: Cells, rng: random.Random) -> None:
    columns, choices = rng.choice(SPOILED)
    row, at = rng.choice(cells), HEADER.index(rng.choice(columns))
    row[at : at + 1] = [rng.choice(choices)] if at < len(row) else []


def a_whole_column(cells: Cells, rng: random.Random) -> None:
    """One thing in many rows: a reader may take the column for another type."""
    column = rng.choice(["temperature", "reading", "humidity", "run"])
    value, share = rng.choice(NUMBERS), rng.choice([0.1, 0.5, 1.0])
    for row in cells:
        if rng.random() < share and HEADER.index(column) < len(row):
            row[HEADER.index(column)] = value


def another_zone(cells: Cells, rng: random.Random) -> None:
    """A part of the times in another zone, or without any."""
    zone, start = rng.choice(["", "Z", "+01:00", "+02:00", "-11:30"]), rng.randrange(len(cells))
    for row in [row for row in cells[start : start + rng.choice([1, 3, 1000])] if row]:
        row[0] = row[0].split("+")[0] + zone


def a_step(cells: Cells, rng: random.Random) -> None:
    """Rows from one on come later or earlier by hours or years."""
    start = rng.randrange(len(cells))
    for row in [row for row in cells[start : start + rng.choice([1, 2, 1000])] if row]:
        row[0] = row[0].replace("2024", rng.choice(["2025", "2094", "2023", "1999"])).replace("T00:", "T05:")


def more_digits(cells: Cells, rng: random.Random) -> None:
    """Numbers with more digits than a float has."""
    for row in cells:
        if len(row) > 1 and row[1].replace(".", "").isdigit():
            row[1] += "".join(rng.choice("0123456789") for _ in range(rng.choice([3, 14, 30])))


def a_field_more(cells: Cells, rng: random.Random) -> None:
    rng.choice(cells).insert(rng.randrange(len(HEADER) + 1), rng.choice(["", "1.0", "x", "2024"]))


def fields_more(cells: Cells, rng: random.Random) -> None:
    """Every row, or all but a few, with one field more or less: an index in front?"""
    at, less = rng.randrange(len(HEADER)), rng.random() < 0.4
    for row in cells[rng.choice([0, 0, 1]) :]:
        row[at : at + less] = [] if less else ["7"]


def a_field_less(cells: Cells, rng: random.Random) -> None:
    row = rng.choice(cells)
    del row[rng.randrange(len(row) + 1) :]


def swapped(cells: Cells, rng: random.Random) -> None:
    """Two rows, or two cells of one."""
    items = rng.choice([cells, rng.choice(cells) or cells])
    a, b = rng.randrange(len(items)), rng.randrange(len(items))
    items[a], items[b] = items[b], items[a]


def dropped_rows(cells: Cells, rng: random.Random) -> None:
    start = rng.randrange(len(cells))
    del cells[start : start + rng.choice([1, 1, 20])]
    cells[:] = cells or [["0"]]


def repeated_rows(cells: Cells, rng: random.Random) -> None:
    start = rng.randrange(len(cells))
    at = rng.choice([start, len(cells), 0])
    cells[at:at] = [list(row) for row in cells[start : start + rng.choice([1, 1, 10])]]


CELLS: list[Callable[[Cells, random.Random], None]] = [
    a_cell, a_cell, a_cell, a_cell, a_cell, a_cell, a_whole_column, another_zone, a_step, more_digits,
    a_field_more, fields_more, a_field_less, swapped, swapped, dropped_rows, repeated_rows,
]  # fmt: skip


def a_header(header: list[str], rng: random.Random) -> None:
    """Names that stand twice, are empty, have blanks, change places, or are those of other columns."""
    at, kind = rng.randrange(len(header)), rng.randrange(7)
    if kind == 0:
        header[at] = rng.choice(header)
    elif kind == 1:
        header[at] = rng.choice(["", " " + header[at], header[at] + " ", header[at].upper(), "1", "Unnamed: 3"])
    elif kind == 2:
        rng.shuffle(header)
    elif kind == 3:
        header.append(rng.choice(["more", "time.1", "temperature", ""]))
    elif kind == 4:
        del header[at]
    elif kind == 5:
        header[3] = rng.choice(["corrected", "flag", "bias", "timestamp", "date", "time_s", "model", "residual"])
    else:
        header[3], header[5] = "", rng.choice(["", "Unnamed: 3", "Unnamed: 5"])


JUNK = [
    b"", b" ", b"\t", b",", b",,,,,", b",,,,,,", b";;;;;", b'"', b'"open', b'a,b,"c', b"# comment", b"\x00",
    b"\xff\xfe", b"\xef\xbb\xbf", b"one,two", b'"a\nb",1,2,3,4,5', b"\r", b"x" * 70_000,
    b'"' + b"y" * 140_000 + b'",1,2,3,4,5', b"\x1a", b"\xc3", "\u2028".encode(), b"\x0c", b"NA,NA,NA,NA,NA,NA",
]  # fmt: skip


def of_lines(lines: list[bytes], rng: random.Random) -> None:
    """Spoil lines as they stand in a file; every one of `lines` ends with its line end."""
    at, kind = rng.randrange(len(lines)), rng.randrange(9)
    if kind == 0:
        lines.insert(at, rng.choice(JUNK) + b"\n")
    elif kind == 1:
        lines.insert(at, lines[0])
    elif kind == 2:
        lines[at] = lines[at].replace(b"\n", rng.choice([b"\r\n", b"\r", b"\n\r", b"\n\n", b"\x00\n", b" \n", b",\n"]))
    elif kind == 3:
        ending = rng.choice([b"\r\n", b"\r", b"\n\n", b"\r\r\n"])
        lines[:] = [line.replace(b"\n", ending) for line in lines]
    elif kind == 4:
        lines[at] = lines[at].replace(b",", rng.choice([b";", b"\t", b", ", b",,", b'","', b'",']), rng.choice([1, 9]))
    elif kind == 5:
        lines[:] = [line.replace(b",", rng.choice([b";", b"\t"])) for line in lines]
    elif kind == 6:
        lines[at] = b",".join(b'"' + part + b'"' for part in lines[at].rstrip(b"\n").split(b",")) + b"\n"
    elif kind == 7:
        del lines[at]
    else:
        cut = rng.randrange(len(lines[at]))
        lines[at] = lines[at][:cut] + rng.choice([b'"', b"\x00", b"\r", b"\n", b"\xe9", b","]) + lines[at][cut:]


def of_bytes(content: bytes, rng: random.Random) -> bytes:
    """Spoil the file as a whole: encodings (others are foreign logs, of which the tests have many), cuts, bytes."""
    at = rng.randrange(len(content) + 1)
    text, before, behind = content.decode("utf-8", "replace"), content[:at], content[at:]
    ends = [b"\n", b"\n\n\n", b"\x1a", b"\x00", b" ", b"2024", b'"', content]
    whole = [b"", b"\n", b" \n \n", b"\xef\xbb\xbf", b"\xef\xbb\xbf" + content, content.splitlines(True)[:1][0]]
    choices = [
        text.encode("latin-1", "replace"),
        before,
        before,
        behind,
        before + bytes([rng.randrange(256)]) + behind[1:],
    ]
    choices += [before + behind[rng.randrange(1, 90) :], content + rng.choice(ends), rng.choice(whole)]
    return rng.choice(choices)


def spoiled(cells: Cells, rng: random.Random) -> bytes:
    """A log with one to four things wrong; now and then with none."""
    cells, header = [list(row) for row in cells], list(HEADER)
    for _ in range(rng.choice([0, 1, 1, 1, 2, 3])):
        rng.choice(CELLS)(cells, rng)
    if rng.random() < 0.08:
        a_header(header, rng)
    lines = [line_of(row) + b"\n" for row in [header, *cells]]
    for _ in range(rng.choice([0, 0, 0, 1, 1, 2])):
        of_lines(lines, rng)
        lines = lines or [b"\n"]
    content = b"".join(lines)
    for _ in range(rng.choice([0, 0, 0, 0, 1])):
        content = of_bytes(content, rng)
    return content

"""The text of a file, unpacked and decoded, and its lines."""

from __future__ import annotations

import gzip
import io
import re
import zipfile
import zlib
from collections import Counter
from pathlib import Path
from typing import IO

import numpy as np
import pandas as pd

from ..records import RecordError
from ..records.errors import listing, option

MOST = 1 << 31
"""Bytes that a packed file may become."""
_MARKS = {b"\xef\xbb\xbf": "utf-8-sig", b"\xff\xfe\0\0": "utf-32", b"\xff\xfe": "utf-16", b"\xfe\xff": "utf-16"}
_OTHERS = {
    b"\xd0\xcf\x11\xe0": "a document in the old format of Excel", b"%PDF": "a PDF", b"\x89HDF": "HDF5",
    b"PAR1": "Parquet", b"ARROW1": "Feather", b"SQLite format 3": "a database", b"TDSm": "a file of LabVIEW",
    b"BZh": "packed by bzip2", b"\xfd7zXZ": "packed by xz", b"\x28\xb5\x2f\xfd": "packed by zstd",
    b"MATLAB 5": "a file of Matlab", b"7z\xbc\xaf": "packed by 7-Zip", b"\x93NUMPY": "an array of numpy",
}  # fmt: skip
"""How files begin that are no text, whatever they are called."""


def unpacked(content: bytes, path: Path) -> bytes:
    """Content of a .gz, or a .zip of one file."""
    try:
        if content.startswith(b"\x1f\x8b"):
            content = _bounded(gzip.GzipFile(fileobj=io.BytesIO(content)), path)
        elif content.startswith(b"PK\3\4"):
            with zipfile.ZipFile(io.BytesIO(content)) as archive:
                names = [name for name in archive.namelist() if not name.endswith("/") and "__MACOSX" not in name]
                if any(name.endswith(".xml") for name in names):
                    raise RecordError(f"{path} is a document of Office, which is not read as {path.suffix}. {_SAVE}")
                if len(names) != 1:
                    raise RecordError(f"{path} holds {len(names)} files ({listing(names)}). Unpack the log.")
                content = _bounded(archive.open(names[0]), path)
    except RecordError:
        raise
    except (OSError, EOFError, ValueError, zlib.error, zipfile.BadZipFile, NotImplementedError, RuntimeError) as error:
        raise RecordError(f"{path} cannot be unpacked: {error}. Was it cut while it was copied?") from None
    found = next((what for mark, what in _OTHERS.items() if content.startswith(mark)), None)
    if found is not None:
        raise RecordError(f"{path} is {found}, not text. {_SAVE}")
    return content


_SAVE = "Save it as CSV, .xlsx or .parquet, with that ending."


def _bounded(packed: IO[bytes] | gzip.GzipFile, path: Path) -> bytes:
    content: bytes = packed.read(MOST + 1)
    if len(content) > MOST:
        raise RecordError(f"{path} becomes larger than {MOST >> 30} GiB. Unpack it, and give the log itself.")
    return content


def decoded(content: bytes, encoding: str | None, path: Path) -> tuple[str, str]:
    """The text with plain line ends, and its encoding.

    UTF-16 without its mark is recognised by its zeros. Windows-1252 is accepted around the rows: in a
    row it is damage. Raises RecordError for bytes that fit no encoding, with their line.
    """
    found = encoding or next((name for mark, name in _MARKS.items() if content.startswith(mark)), None)
    pairs = np.frombuffer(content[: min(4000, len(content) // 2 * 2)], np.uint8).reshape(-1, 2) == 0
    if found is None and len(pairs) and pairs.any(axis=1).mean() > 0.7:
        found = "utf-16-le" if pairs[:, 1].any() else "utf-16-be"
    found = found or "utf-8"
    try:
        text = content.decode(found).removeprefix("\ufeff")
    except LookupError:
        raise RecordError(f"{option('encoding', repr(found))} is no encoding that Python knows.") from None
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start)
        damaged = re.match(rb"[\s\"]*[\d-]", content.split(b"\n", line + 1)[line])
        if found != "utf-8" or encoding or damaged or re.search(rb"[\x80-\x9f]", content):
            raise RecordError(
                f"{path} cannot be read: line {line + 1}: byte {error.start + 1} does not fit {found}. Correct it, or "
                "save the file in UTF-8."
            ) from None
        text, found = content.decode("cp1252"), "cp1252"
    if "\0" in text:
        line = text.count("\n", 0, text.index("\0")) + 1
        raise RecordError(f"{path} cannot be read: line {line} holds a zero byte. Is it text?")
    return text.replace("\r\n", "\n").replace("\r", "\n") if "\r" in text else text, found


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
    """Lines of some shapes as rows of text."""
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
    """Usual shapes of the lines, and units; empty for none."""
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
        named = [name for name in names if name]
        if set(named) - {"time"} and len(set(named)) == len(named) and (len(usual) == 1 or "time" in named):
            templates.append((shape, names))
    return templates, units


def _name(before: str) -> str:
    """The name of a number, by the words before it."""
    quoted = re.findall(r"'([^']+)'|\"([^\"]+)\"", before)
    words = re.findall(r"[^\W\d][\w .°/%]*(?=\s*[:=>])", before)
    return "".join(quoted[-1]) if quoted else words[-1].strip() if words else ""

"""Files in files: gz and zip around a log, and tables of other programs (spreadsheet, Feather)."""

from __future__ import annotations

import gzip
import io
import zipfile
import zlib
from pathlib import Path
from typing import Any

import pandas as pd

from ..records import RecordError
from ..records.errors import listing
from ..records.files import format_of

SHEETS = (".xlsx", ".xlsm")
FEATHER = (".feather", ".arrow")
PACKED = (".gz", ".zip")
UNREAD = {
    ".xls": "a spreadsheet in the old format of Excel", ".xlsb": "a binary spreadsheet",
    ".ods": "a spreadsheet of OpenDocument", ".numbers": "a spreadsheet of Numbers", ".mat": "a file of Matlab",
    ".tdms": "a file of LabVIEW", ".h5": "HDF5", ".hdf5": "HDF5", ".nc": "NetCDF", ".pkl": "a pickle",
    ".npy": "an array of numpy", ".npz": "arrays of numpy", ".db": "a database", ".sqlite": "a database",
    ".json": "JSON", ".pdf": "a PDF", ".7z": "packed by 7-Zip", ".rar": "packed by RAR", ".bz2": "packed by bzip2",
    ".xz": "packed by xz", ".zst": "packed by zstd", ".tar": "an archive", ".tgz": "an archive",
}  # fmt: skip
"""Endings of files that are not read, and what they are."""
BEGINNINGS = {
    b"\xd0\xcf\x11\xe0": "a document of old Office", b"PK\x03\x04": "packed as zip, or a document of Office",
    b"\x1f\x8b": "packed as gz", b"%PDF": "a PDF", b"\x89HDF": "HDF5", b"PAR1": "Parquet", b"ARROW1": "Feather",
    b"SQLite format 3": "a database", b"TDSm": "a file of LabVIEW",
}  # fmt: skip
"""How files begin that are no text, whatever their names say."""
MOST_UNPACKED = 1 << 31
"""Bytes that a packed file may become."""


def refuse_unread(path: Path) -> None:
    """RecordError for a file that is no table of a kind that is read; it says what to do."""
    ending = path.suffix.lower()
    if ending in UNREAD and format_of(path) is None:
        raise RecordError(f"{path} is {UNREAD[ending]}, which is not read. Save it as CSV, .xlsx or .parquet.")
    if ending in (*SHEETS, *FEATHER, *PACKED) or format_of(path) is not None or not path.is_file():
        return
    with path.open("rb") as file:
        start = file.read(16)
    found = next((what for mark, what in BEGINNINGS.items() if start.startswith(mark)), None)
    if found is not None:
        raise RecordError(
            f"{path} is no text but looks like {found}. Give it the ending that says so (.xlsx, .parquet, .feather, "
            ".gz, .zip), or save it as CSV."
        )


def unpacked(path: Path) -> tuple[bytes, str]:
    """The content of a file, unpacked where its ending says gz or zip, and the name of what is in it."""
    content = path.read_bytes()
    ending = path.suffix.lower()
    try:
        if ending == ".gz":
            with gzip.GzipFile(fileobj=io.BytesIO(content)) as packed:
                return _bounded(packed, path), path.stem
        if ending == ".zip":
            with zipfile.ZipFile(io.BytesIO(content)) as archive:
                names = [info.filename for info in archive.infolist() if not info.is_dir()]
                names = [name for name in names if not name.startswith("__MACOSX/")]
                if len(names) != 1:
                    raise RecordError(f"{path} holds {len(names)} files ({listing(names)}). Unpack the log.")
                with archive.open(names[0]) as member:
                    return _bounded(member, path), names[0]
    except (OSError, EOFError, ValueError, zlib.error, zipfile.BadZipFile, NotImplementedError, RuntimeError) as error:
        if isinstance(error, RecordError):
            raise
        raise RecordError(f"{path} cannot be unpacked: {error}. Was it cut while it was copied?") from None
    return content, path.name


def _bounded(packed: Any, path: Path) -> bytes:
    """All that a packed file holds, as long as that is a log."""
    parts, size = [], 0
    while part := packed.read(1 << 22):
        size += len(part)
        if size > MOST_UNPACKED:
            raise RecordError(
                f"{path} becomes larger than {MOST_UNPACKED >> 30} GiB. Unpack it, and give the log itself."
            )
        parts.append(part)
    return b"".join(parts)


def spreadsheet(path: Path, sheet: str | None) -> pd.DataFrame:
    """A sheet of a spreadsheet as cells, the first one by default; its header is looked for as in a file of text."""
    try:
        import openpyxl  # type: ignore[import-untyped]  # it has no types
    except ImportError:
        raise RecordError(
            f"{path} is a spreadsheet, and openpyxl is needed to read it: pip install openpyxl."
        ) from None
    try:
        with zipfile.ZipFile(path) as packed:
            size = sum(info.file_size for info in packed.infolist())
    except (OSError, zipfile.BadZipFile) as error:
        raise RecordError(f"{path} cannot be read as a spreadsheet: {error}.") from None
    if size > MOST_UNPACKED:
        raise RecordError(f"{path} becomes larger than {MOST_UNPACKED >> 30} GiB. Save the sheet as CSV.")
    try:
        book = openpyxl.load_workbook(path, read_only=True, data_only=True)
    except Exception as error:  # openpyxl raises whatever its parsers do
        raise RecordError(f"{path} cannot be read as a spreadsheet: {' '.join(str(error).split())}.") from None
    try:
        if sheet is not None and sheet not in book.sheetnames:
            raise RecordError(f"{path} has no sheet {sheet!r}; it has {listing(book.sheetnames)}.")
        if sheet is None and len(book.sheetnames) > 1:
            filled = [name for name in book.sheetnames if book[name].max_row and book[name].max_row > 1]
            if len(filled) > 1:
                raise RecordError(
                    f"{path} has several sheets: {listing(filled)}. Save the right one as a file of its own."
                )
            sheet = filled[0] if filled else None
        chosen = book[sheet or book.sheetnames[0]]
        chosen.reset_dimensions()  # what the file says of them may be old
        rows = [list(row) for row in chosen.iter_rows(values_only=True)]
        rows = [row for row in rows if any(cell is not None for cell in row)]
        width = max(map(len, rows), default=0)
        rows = [[*row, *[None] * (width - len(row))] for row in rows]
    finally:
        book.close()
    return pd.DataFrame(rows, dtype=object)


def feather(path: Path) -> pd.DataFrame:
    """A file of Feather (Arrow IPC)."""
    try:
        from pyarrow import feather as format_
    except ImportError:
        raise RecordError(f"{path} is Feather. Install pyarrow: pip install pyarrow.") from None
    try:
        frame: Any = format_.read_feather(path)
    except (ValueError, OSError) as error:
        raise RecordError(f"{path} cannot be read as Feather: {' '.join(str(error).split())}.") from None
    result: pd.DataFrame = frame
    return result

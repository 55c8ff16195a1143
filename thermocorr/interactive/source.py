"""A log on the workbench: where it came from, how it was understood, and its fingerprint."""

from __future__ import annotations

import hashlib
import warnings
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import pandas as pd

from ..foreign import ForeignTable, HowToRead, read_logs, with_times
from ..records import RecordError, RecordWarning
from ..records.paths import existing_file
from ..records.times import dates_once
from .trial_records import FIRST, SAMPLES

CHUNK = 1 << 20


@dataclass(frozen=True, kw_only=True)
class ReadLog:
    """A log, read."""

    table: ForeignTable
    name: str
    """What it is called on the screen."""
    files: tuple[str, ...] = ()
    """Where it stands; none for the built-in record and for a frame."""
    how: HowToRead = field(default_factory=HowToRead)
    join: bool = False
    digest: str = ""
    """SHA-256 of all files, one after the other."""

    @property
    def frame(self) -> pd.DataFrame:
        """The log as it was read, its times as they came."""
        return self.table.frame

    def timed(self, time: str | None) -> tuple[pd.DataFrame, tuple[str, ...]]:
        """The log with its times understood, and in words how.

        Raises RecordError for times that can be read in two ways, or not at all.
        """
        table = self.table
        if len(self.files) == 1:
            table = with_times(table, time, self.how)
        frame = table.frame
        if time is not None:
            frame = frame.assign(**{time: dates_once(frame[time])})
            frame.attrs = dict(self.frame.attrs)
        return frame, table.said

    def node(self) -> dict[str, Any]:
        """The log as a session file names it."""
        if not self.files:
            return {"built_in": self.name}
        given = {**asdict(self.how), "no_times": list(self.how.no_times)}
        said = {key: value for key, value in given.items() if value not in (None, False, [])}
        return {"files": list(self.files), "how": said, "join": self.join, "sha256": self.digest}


def built_in(name: str = "") -> ReadLog:
    """A record of `SAMPLES`, the first one by default; ValueError for a name that is none of theirs."""
    name = name or FIRST
    if name not in SAMPLES:
        raise ValueError(f"There is no built-in record {name!r}. There are: {', '.join(SAMPLES)}.")
    return ReadLog(table=ForeignTable(frame=SAMPLES[name].make()), name=name)


def opened(
    paths: Sequence[str | Path], how: HowToRead | None = None, *, join: bool = False, names: Sequence[str] = ()
) -> ReadLog:
    """Read a log.

    `paths` (sequence of paths). `how` (HowToRead, optional). `join` (bool): Join several files by their times.
    `names` (sequence of str): What the files are called where they came from, if that is not here. Raises RecordError
    for files that cannot be read.
    """
    how, digest = how or HowToRead(), fingerprint(paths)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", RecordWarning)
        table = read_logs(paths, how, join=join)
    notes = [str(w.message) for w in caught if issubclass(w.category, RecordWarning)]
    table = table.with_said(table.frame, *notes)
    if not all(isinstance(column, str) for column in table.frame.columns):
        table = table.with_said(table.frame.rename(columns=str))
    return ReadLog(
        table=table,
        name=", ".join(Path(path).name for path in names or paths),
        files=tuple(names) or tuple(str(Path(path).resolve()) for path in paths),
        how=how,
        join=join,
        digest=digest,
    )


def fingerprint(paths: Sequence[str | Path]) -> str:
    """SHA-256 of the content of files, one after the other."""
    digest = hashlib.sha256()
    for path in paths:
        if not existing_file(path).is_file():
            raise RecordError(f"{path} is no regular file. Name the log's file.")
        try:
            with Path(path).open("rb") as file:
                while chunk := file.read(CHUNK):
                    digest.update(chunk)
        except OSError as error:
            raise RecordError(f"{path} cannot be read: {error.strerror or error}.") from None
    return digest.hexdigest()

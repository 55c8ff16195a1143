"""Options for reading a log, and the log that was read: a frame, and in words how it was understood."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import pandas as pd

from ..records import RecordError
from .sniffing import SEPARATORS

_SAID_SEPARATORS = {"tab": "\t", "\\t": "\t", "comma": ",", "semicolon": ";", "bar": "|", "blanks": " ", "space": " "}


@dataclass(frozen=True, kw_only=True)
class HowToRead:
    """Options for reading a file; None where the file tells it."""

    separator: str | None = None
    decimal: str | None = None
    encoding: str | None = None
    time_format: str | None = None
    timezone: str | None = None
    sheet: str | None = None
    sort: bool = False
    names: tuple[str, ...] = ()
    """Names of the columns of a file without a header."""
    missing: tuple[str, ...] = ()
    """Words and numbers that say that there is no value."""
    skip_bad_rows: bool = False
    drop_duplicates: bool = False
    """Keep the first of rows with the same time."""
    reading: str | None = None
    """The column that keeps its own times, where several are brought on the same: what the instrument shows."""
    run: str | None = None
    """The column of labels of runs: the times of two may be the same."""
    no_times: tuple[str, ...] = ()
    """Columns that the user names as something else: none of them has the times, whatever it is called."""

    def says_something(self) -> bool:
        """True if the user says anything of the file, and not only what its columns are."""
        return replace(self, reading=None, run=None, no_times=()) != HowToRead()

    def names_times(self) -> bool:
        """True if the file alone says what its times are."""
        return self.time_format is None and self.timezone is None

    def __post_init__(self) -> None:
        for name in ("no_times", "names", "missing"):
            object.__setattr__(self, name, tuple(getattr(self, name)))
        mark = self.separator
        if mark is not None:
            object.__setattr__(self, "separator", _SAID_SEPARATORS.get(mark.lower(), mark))
        if self.separator is not None and self.separator not in SEPARATORS:
            raise RecordError(f"--sep {mark!r} is none of: {', '.join(SEPARATORS.values())}.")
        if self.decimal not in (None, ".", ","):
            raise RecordError(f"--decimal {self.decimal!r} is neither . nor a comma.")


@dataclass(frozen=True, kw_only=True)
class ForeignTable:
    """A log, read."""

    frame: pd.DataFrame
    """``attrs["units"]`` has the units that the file names."""
    said: tuple[str, ...] = ()
    """How it was understood, where that was not a matter of course."""
    first_line: int | None = None
    """The line of a text that holds the first row, where each row is a line of its own."""
    as_came: pd.Series[Any] | None = None
    """The column of times as the file has it, where `frame` has other ones that its name or cells do not say."""

    def as_it_came(self) -> pd.DataFrame:
        """The frame with its times as the file has them: what is written of it is read in the same way again."""
        return self.frame if self.as_came is None else self.frame.assign(**{str(self.as_came.name): self.as_came})

    def with_said(self, frame: pd.DataFrame, *words: str) -> ForeignTable:
        """The log with another frame, and more to be said."""
        frame.attrs = {**self.frame.attrs, **frame.attrs}
        return replace(self, frame=frame, said=(*self.said, *filter(None, words)))

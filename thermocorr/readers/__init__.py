"""Logs as programs write them, as frames."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import pandas as pd

from ..records import RecordError
from ..records.errors import listing
from .cells import Options
from .form import Form
from .growing import gathered
from .log import as_runs, joined, read_one, refuse_other_clocks
from .roles import RUN, Roles, guess, is_counter

__all__ = ["RUN", "Form", "Options", "Roles", "guess", "is_counter", "read_log", "read_logs"]


def read_log(
    paths: str | Path | Sequence[str | Path] | Iterator[pd.DataFrame],
    *,
    sep: str | None = None,
    decimal: str | None = None,
    encoding: str | None = None,
    names: Sequence[str] = (),
    na: Sequence[str] = (),
    sheet: str | None = None,
    skip_bad_rows: bool = False,
    time: str | None = None,
    time_format: str | None = None,
    timezone: str | None = None,
    reading: str | None = None,
    run: str | None = None,
) -> pd.DataFrame:
    r"""Read a log in one file or several.

    Text of any separator, decimal sign, way to write dates, and preamble; gz and zip around it; lines of words and
    numbers; JSON by lines; spreadsheets, Parquet and Feather. What can be read in two ways is asked, not guessed.

    Parameters
    ----------
    paths : path, sequence of paths, or iterator of DataFrames
        Files of the same columns are one log where they follow on one another, else runs, distinguished by a column
        "file". Others are joined by their times, on the rows of the one with the reading. Frames are parts of a log
        that is larger than memory, such as `pandas.read_csv(..., chunksize=100_000)`: their numbers are kept in
        temporary files, and mapped into memory where they are used.
    sep, decimal, encoding : str, optional
        Of a text, where it does not tell them.
    names : sequence of str
        Names of all columns, for a file without a header, or with one that is too short.
    na : sequence of str
        Words and numbers that stand for a missing value, in addition to the usual ones.
    sheet : str, optional
        Of a spreadsheet.
    skip_bad_rows : bool, default False
        Leave out damaged lines, rows without a time, cells that are words among numbers, and rows with a
        time for the second time; sort by time. All is counted in the notes.
    time : str, optional
        Column of times.
    time_format : str, optional
        As for `strptime`; or excel, matlab, mjd, jd, labview, unix, "unix ms", "unix us", "unix ns", hhmm, seconds.
    timezone : str, optional
        Of local times, such as Europe/Berlin. Of several files it is for those that have none.
    reading, run : str, optional
        Columns of the readings and of labels of runs.

    Returns
    -------
    DataFrame of shape (n_rows, n_columns)
        Its index holds the times: dates, in UTC where they have a zone, or spans of time; a range where the log has
        none. `attrs` has "units" (of columns), "notes" (how it was understood), and "form" (how later lines are read).

    Raises
    ------
    RecordError
        For a file that is missing, is not a log, or can be read in two ways (it names the option that settles it); for
        anything else than paths or frames; for options given with frames.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> path = pathlib.Path(tempfile.mkdtemp()) / "log.csv"
    >>> _ = path.write_text("Datum;T [°C];R [Ohm]\n17.05.2024 12:00;20,5;1000,12\n17.05.2024 12:01;20,6;1000,15\n")
    >>> log = read_log(path)
    >>> log["R [Ohm]"].tolist(), log.index[0], log.attrs["notes"][:2]
    ([1000.12, 1000.15], Timestamp('2024-05-17 12:00:00'), ['separated by semicolons', 'decimal comma'])
    """
    said = Options(
        sep=sep, decimal=decimal, encoding=encoding, names=names, na=na, sheet=sheet, reading=reading, run=run,
        skip_bad_rows=skip_bad_rows, time=time, time_format=time_format, timezone=timezone,
    )  # fmt: skip
    if isinstance(paths, Iterator):
        if said.given():
            raise RecordError(f"Frames are taken as they are: say {listing(said.given())} where these are read.")
        return gathered(paths)
    files = [paths] if isinstance(paths, str | Path) else list(paths)
    if not files or not all(isinstance(path, str | Path) for path in files) or isinstance(paths, pd.DataFrame):
        raise RecordError(f"read_log needs paths of files, or an iterator of frames; it got {type(paths).__name__}.")
    return read_logs(files, said)


def read_logs(paths: Sequence[str | Path], said: Options, form: Form | None = None) -> pd.DataFrame:
    """Read files with options; see `read_log`."""
    tables = [read_one(path, said, form) for path in paths]
    if len(tables) == 1:
        return tables[0]
    places = list(map(str, paths))
    refuse_other_clocks(tables, places)
    alike = all(set(table.columns) == set(tables[0].columns) for table in tables)
    return (as_runs if alike else joined)(tables, places, said)

"""Logs in files: times, units and notes included."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from ..records import RecordError
from ..records.errors import existing_file, listing, option, quoted, times_word
from ..records.units import TEMPERATURES, unit_of, unit_of_text
from .cells import MOMENT, Options, as_numbers, is_number, refuse_thousands, says_something, split, varies
from .clocks import FRACTIONS, Clock, as_seconds, find_clock, refuse_two_hours, unwrapped
from .form import JSON, Form
from .roles import RUN, called_readings, refuse_words, run_among
from .table import HEAD, find_table
from .text import STAMPED, decoded, find_templates, unpacked

FRAMES = (".parquet", ".pq", ".feather", ".arrow", ".xlsx", ".xlsm", ".ods", ".xls")
"""Endings of files that pandas reads."""
_SAID = {
    ",": "separated by commas", ";": "separated by semicolons", "\t": "separated by tabs", "|": "separated by bars",
    " ": "separated by blanks", JSON: "lines of JSON", "": "lines of words and numbers",
}  # fmt: skip
_TOTALS = r"average|mean|total|sum|summe|max|min|maximum|minimum|mittelwert|std|stdev"


def read_one(path: str | Path, said: Options, form: Form | None = None) -> pd.DataFrame:
    """Read one file, by `form` where it fits; see `read_log`."""
    path = existing_file(path)
    with _named(path):
        if path.suffix.lower() in FRAMES:
            return _of_pandas(path, said)
        text, encoding = decoded(unpacked(path.read_bytes(), path), said.encoding, path)
        return of_text(text, encoding, said, form)


@contextlib.contextmanager
def _named(path: Path) -> Iterator[None]:
    """Errors say in which file."""
    try:
        yield
    except RecordError as error:
        raise error if str(path) in str(error) else type(error)(f"{path}: {error}") from None
    except OSError as error:
        raise RecordError(f"{path} cannot be read: {error.strerror or error}.") from None


def _of_pandas(path: Path, said: Options) -> pd.DataFrame:
    """A spreadsheet, Parquet or Feather."""
    sheet = path.suffix.lower() in FRAMES[4:]
    try:
        if not sheet:
            read = pd.read_feather if path.suffix.lower() in FRAMES[2:4] else pd.read_parquet
            frame: Any = read(path)
            frame = frame if isinstance(frame.index, pd.RangeIndex) else frame.reset_index()
            return _finished(frame.set_axis(list(map(str, frame)), axis=1), Form(), said, [])
        sheets = pd.read_excel(path, sheet_name=None, header=None, dtype=object)
    except ImportError as error:
        raise RecordError(f"{path} needs another package: {error} Or save it as CSV, .xlsx or .parquet.") from None
    except RecordError:
        raise
    except Exception as error:  # whatever these parsers raise
        raise RecordError(f"{path} cannot be read as {path.suffix}: {' '.join(str(error).split())}.") from None
    filled = {name: cells for name, cells in sheets.items() if len(cells) > 1}
    if said.sheet is not None and said.sheet not in sheets:
        raise RecordError(f"There is no sheet {said.sheet!r}; there are {listing(sheets)}.")
    if said.sheet is None and len(filled) != 1:
        raise RecordError(
            f"There are {len(filled)} sheets with rows: {listing(filled)}. Save the right one as a file of its own."
        )
    cells = sheets[said.sheet] if said.sheet is not None else next(iter(filled.values()))
    return of_text(cells.to_csv(index=False, header=False), "utf-8", replace(said, sep=",", decimal="."))


def of_text(text: str, encoding: str, said: Options, form: Form | None = None) -> pd.DataFrame:
    """Read a text; RecordError where it is no log."""
    known = form is not None and start_of(text, form) is not None
    text = text[6:] if text[:4].lower() == "sep=" and text[5:6] == "\n" and not known else text
    text, cut = _whole_lines(text)
    form = replace(form) if form is not None and known else _form_of(text, encoding, said)
    at = start_of(text, form) or 0
    above = text.count("\n", 0, at)
    frame, notes = form.cells(text[at:], above + 1, said.skip_bad_rows)
    form.names = form.names or list(map(str, frame))
    if not len(frame):
        raise RecordError(f"It has a header ({listing(form.names)}) but no rows.")
    notes += [] if known else _described(form, above, said)
    return _finished(frame, form, said, cut + notes, known)


def _form_of(text: str, encoding: str, said: Options) -> Form:
    """How the rows of a text are written; RecordError without rows."""
    if not text or text.isspace():
        raise RecordError("The file is empty: a header line with the columns' names is needed, then a line per sample.")
    head = text[:HEAD]
    stamped = len(STAMPED.findall(head)) > 0.8 * (head.count("\n") + 1)
    shown = STAMPED.sub(r"\1,", head) if stamped else head
    found = Form(separator=JSON, header=JSON) if head.lstrip().startswith(("{", "[{")) else find_table(shown, said)
    blanks = found is not None and found.separator == " "
    wordy = re.search(r"[^\W\d]\w* ?[:=]", shown.rstrip().rpartition("\n")[2]) is not None
    bare = found is not None and not found.header and (blanks or stamped or wordy)
    if found is None or (not said.names and (bare or (blanks and wordy))):
        templates, units = find_templates(shown)
        names = list(dict.fromkeys(name for _, names in templates for name in names if name))
        found = Form(separator="", templates=templates, units=units, names=names) if templates else found
    if found is None and head.strip().count("\n") == 0:
        raise RecordError(f"It has a header ({quoted(head.strip())}) but no rows.")
    if found is None:
        raise RecordError(
            f"It holds no rows of numbers and times (line 1: {quoted(head.strip().splitlines()[0][:60])}). If it is a "
            f"log, say {option('sep')}."
        )
    return replace(found, encoding=encoding, missing=list(said.na), stamped=stamped)


def _described(form: Form, above: int, said: Options) -> list[str]:
    """Notes on a text that is no plain CSV."""
    preamble = above - form.below if form.header else 0
    headless = not form.header and not said.names and not form.templates
    found = {
        "probably in Windows-1252": form.encoding == "cp1252",
        _SAID[form.separator]: form.separator != ",",
        "decimal comma": form.decimal == ",",
        f"{times_word(preamble, 'line')} above the header": preamble > 0,
        f"no header: columns are called 1, 2, ...; {option('names')} calls them otherwise": headless,
    }
    return [note for note, is_so in found.items() if is_so]


def _whole_lines(text: str) -> tuple[str, list[str]]:
    """The text without a last line that may be cut."""
    end = text.rfind("\n") + 1
    if end == len(text) or not text[end:].strip() or end == 0 or text.lstrip().startswith("[{"):
        return text, []
    return text[:end], ["the last line is left out: it has no line end, and may have been cut while it was written"]


def start_of(text: str, form: Form) -> int | None:
    """Position of the first row in this form, or None."""
    if form.separator == JSON:
        return 0 if text[:HEAD].lstrip().startswith(("{", "[{")) else None
    if form.templates:
        some = [line for line in text[:HEAD].split("\n")[:100] if line.strip()]
        rows = form.cells("\n".join(some), 1, True, 1.0)[0] if some else ()
        return 0 if len(rows) > 0.5 * len(some) else None
    lines = text[:HEAD].split("\n")
    headers = (k for k, line in enumerate(lines) if form.is_header(line))
    at = next(headers, None) if form.header else 0
    if at is None or len(lines) <= at + form.below:
        return None
    if not form.header and len(split(lines[form.below], form.separator)) != len(form.names):
        return None
    return begin_of(at + form.below, lines)


def begin_of(k: int, lines: list[str]) -> int:
    """Where line k of a text begins."""
    return sum(len(line) + 1 for line in lines[:k])


def _finished(frame: pd.DataFrame, form: Form, said: Options, notes: list[str], known: bool = False) -> pd.DataFrame:
    """Columns of numbers, indexed by their times."""
    notes, words = list(notes), dict[str, str]()
    if not known:
        frame = _without_totals(frame, notes)
    for name in map(str, frame):
        _make_numbers(frame, name, form, said, notes, words, known)
    nameless = [name for name in map(str, frame) if re.fullmatch(r"column \d+|\d+", name) and frame[name].isna().all()]
    frame = frame.drop(columns=nameless)  # such as what a separator at the end of the rows makes
    if not known:
        frame.attrs["words"] = words
        for name in filter(FRACTIONS.fullmatch, words):  # parts of a second belong to the times
            refuse_words(frame, name)
        form = replace(
            form, numbers=[name for name in map(str, frame) if is_number(frame[name])], long=_long(frame, said)
        )
        series = frame if not form.long else frame[frame[form.long[0]] == frame[form.long[0]].iloc[0]]
        form.clock = find_clock(series, form.units, said)
    frame = _indexed(frame, form, said, notes)
    form.columns = list(map(str, frame))
    if form.long:
        frame = _widened(frame, form, said, notes)
    frame = _in_order(frame, said, notes) if said.skip_bad_rows and form.clock is not None else frame
    units = {name: unit_of_text(unit) for name, unit in form.units.items()}
    frame.attrs = {
        "units": {name: unit for name, unit in units.items() if unit and name in frame},
        "notes": notes, "words": words, "form": form,
    }  # fmt: skip
    return frame


def timed(frame: pd.DataFrame, said: Options) -> pd.DataFrame:
    """A log indexed by the times of a named column."""
    form, notes = frame.attrs.get("form") or Form(), list(frame.attrs["notes"])
    found = find_clock(frame, form.units, said)
    form = replace(form, clock=found)
    indexed = _indexed(frame, form, said, notes)
    form.columns = list(map(str, indexed))
    indexed.attrs = {**frame.attrs, "notes": notes, "form": form}
    return indexed


def _indexed(frame: pd.DataFrame, form: Form, said: Options, notes: list[str]) -> pd.DataFrame:
    """The frame indexed by its times."""
    frame, index = _with_times(frame, form, said, notes)
    if form.clock is None:
        notes.append("no column of times found")
        return frame.reset_index(drop=True)
    if not form.clock.format.startswith(("iso", "dates", "seconds")):
        notes.append(f"times from {' and '.join(map(quoted, form.clock.columns))} as {form.clock.format}")
    gone = {*form.clock.columns, form.clock.fraction}
    return frame.drop(columns=[name for name in frame if name in gone]).set_axis(index)


def _without_totals(frame: pd.DataFrame, notes: list[str]) -> pd.DataFrame:
    """The rows without totals that a program wrote below them."""
    last = frame.iloc[-10:, 0].astype(str).str.strip().str.lower().str.fullmatch(_TOTALS).to_numpy()
    if not last.any() or not last[np.argmax(last) :].all() or last.all():
        return frame
    notes.append(f"without {times_word(int(last.sum()), 'row')} of totals below")
    return frame.iloc[: -int(last.sum())].infer_objects()


def _make_numbers(
    frame: pd.DataFrame, name: str, form: Form, said: Options, notes: list[str], words: dict[str, str], known: bool
) -> None:
    """Turn a column into numbers where possible; note other words."""
    column = frame[name]
    if column.dtype.kind in "mMb" or isinstance(column.dtype, pd.DatetimeTZDtype):
        return
    if is_number(column):
        refuse_thousands(column, name)
        if np.isinf(column.to_numpy(float)).any():
            frame[name] = column.replace([np.inf, -np.inf], np.nan)
            notes.append(f"infinities in {quoted(name)} taken as no value")
        return
    found = as_numbers(column, form.decimal, form.behind.get(name, "") if known else None)
    if found is None:
        return
    values, unit = found
    odd = column[values.isna() & says_something(column)]
    if len(odd) and not said.skip_bad_rows:
        words[name] = str(odd.iloc[0])
        return
    frame[name] = values
    if len(odd):
        said_of = f"such as {quoted(odd.iloc[0])} in {form.place(odd.index[0])}"
        notes.append(f"{times_word(len(odd), 'cell')} of {quoted(name)} left out, {said_of}")
    if unit:
        form.behind[name] = form.units[name] = unit


def _with_times(frame: pd.DataFrame, form: Form, said: Options, notes: list[str]) -> tuple[pd.DataFrame, pd.Index]:
    """Rows with times, and these: dates, or time since a start."""
    clock = form.clock
    if clock is None:
        if said.time is not None:
            raise RecordError(
                f"The times in {quoted(said.time)}, such as {quoted(str(frame[said.time].iloc[0]))}, cannot be read. "
                f"Say their form with {option('time_format')}, as for strptime."
            )
        return frame, frame.index
    times = unwrapped(clock.times(frame), clock)
    lost = np.asarray(pd.isna(times))
    if lost.any():
        form.refuse_header(frame[lost])
        row, known = int(np.argmax(lost)), int((~lost).sum())
        below = bool(lost[known:].all()) and len(lost) - known <= 5 and known > 0
        first, column = form.place(frame.index[row]), quoted(clock.columns[0])
        if not said.skip_bad_rows and not below:
            raise RecordError(
                f"{str(clock.text(frame).iloc[row])!r} in {column}, {first}, is no date or time as the others are "
                f"({clock.format}). Correct it, say {option('time_format')}, or pass over such rows with "
                f"{option('skip_bad_rows', 'True')}."
            )
        notes.append(f"{times_word(int(lost.sum()), 'row')} without a time left out, the first is {first}")
        frame, times = frame[~lost], times[~lost]
    if said.timezone and not isinstance(times, pd.DatetimeIndex):
        raise RecordError(
            f"{option('timezone')} is for dates, and {quoted(clock.columns[0])} holds times since a start."
        )
    if isinstance(times, pd.DatetimeIndex):
        return frame, _in_utc(times, clock, said, notes).rename("time")
    return frame, pd.to_timedelta(np.round(times.to_numpy(float), 9), unit="s").rename("time")


def _in_utc(times: pd.DatetimeIndex, clock: Clock, said: Options, notes: list[str]) -> pd.Index:
    """Dates in UTC, where they have a zone or one is given."""
    if times.tz is not None:
        notes += [f"times have a zone of their own: {option('timezone')} is not used"] if said.timezone else []
        return times.tz_convert("UTC")
    try:
        local = clock.in_zone(times)
    except RecordError:
        raise
    except (KeyError, ValueError):
        raise RecordError(
            f"{option('timezone', repr(clock.zone))} is not known. Say one such as Europe/Berlin."
        ) from None
    notes += [f"local time of {clock.zone}"] if clock.zone else []
    return local


def _in_order(frame: pd.DataFrame, said: Options, notes: list[str]) -> pd.DataFrame:
    """Rows sorted by time, the first of equals, per run."""
    run = said.run or run_among(list(map(str, frame)))
    if run not in frame:
        refuse_two_hours(frame.index)
    keys = pd.DataFrame({"run": frame.get(run, 0), "time": frame.index}, frame.index)
    again = keys.duplicated().to_numpy()
    if again.any():
        notes.append(f"{times_word(int(again.sum()), 'row')} with a repeated time left out")
        frame = frame[~again]
    if run not in frame and not frame.index.is_monotonic_increasing:
        order = np.argsort(frame.index, kind="stable")
        notes.append(f"sorted by time: {times_word(int((order != np.arange(len(order))).sum()), 'row')} moved")
        frame = frame.iloc[order]
    return frame


def _long(frame: pd.DataFrame, said: Options) -> list[str]:
    """Columns of names and values, in a log of one value a line."""
    texts = [name for name in map(str, frame) if frame[name].dtype.kind not in "mMb" and not is_number(frame[name])]
    texts = [n for n in texts if not MOMENT.fullmatch(str(next(iter(frame[n].dropna()), "")).strip()) and n != said.run]
    if not texts:
        return []
    moving = [name for name in map(str, frame) if varies(frame[name]) and name != said.run]
    texts = [name for name in texts if name in moving]
    values = [name for name in moving if name in ("_value", "state", "value")]
    values = values or [name for name in moving if is_number(frame[name])]
    names = [name for name in texts if name not in values and frame[name].nunique() <= min(100, 0.4 * len(frame))]
    return [names[0], values[0]] if len(values) == 1 and names and len(moving) <= 4 else []


def _widened(frame: pd.DataFrame, form: Form, said: Options, notes: list[str]) -> pd.DataFrame:
    """A column for each name, on the reading's times.

    Between two of its values a column is a straight line; next to a cell that is not a number it has no value.
    """
    by, value = form.long
    series: dict[str, pd.Series] = {}
    for name, cells in frame.groupby(by, sort=False)[value]:
        values = pd.to_numeric(cells, errors="coerce").sort_index()
        if values.notna().any():
            series[str(name).removeprefix("sensor.")] = values
        if values.index.duplicated().any():
            if not said.skip_bad_rows:
                raise RecordError(
                    f"Several series are called {quoted(name)}: they have values at the same times. Export one."
                )
            series[str(name).removeprefix("sensor.")] = values[~values.index.duplicated()]
    most = max(values.count() for values in series.values())
    others = [name for name in series if not TEMPERATURES.search(name) and series[name].count() > 0.01 * most]
    named = [*filter(None, [said.reading]), *(some[0] for some in (called_readings(others), others) if len(some) == 1)]
    lead = next((name for name in named if name in series), max(series, key=lambda name: series[name].count()))
    index = series[lead].dropna().index
    notes.append(f"one value a line: {len(series)} columns on the times of {lead!r}")
    return pd.DataFrame({name: on_times(values, index) for name, values in series.items()}, index=index)


def on_times(values: pd.Series, index: pd.Index) -> np.ndarray:
    """Values at other times, interpolated; NaN outside."""
    lines = np.interp(as_seconds(index), as_seconds(values.index), values.to_numpy(float), left=np.nan, right=np.nan)
    return np.where(index.isin(values.index), values.reindex(index), lines)


def joined(tables: list[pd.DataFrame], paths: list[str], said: Options) -> pd.DataFrame:
    """Files of one stretch of time, on the reading's rows.

    A column is a straight line between two of its values, and has none before the first and behind the last.
    """
    main = _with_reading(tables, said)
    for path, table in zip(paths, tables, strict=True):
        if isinstance(table.index, pd.RangeIndex):
            raise RecordError(f"{path} has no times, and files are joined by their times.")
    frame, left = tables[main], list[str]()
    for path, table in zip(paths, tables, strict=True):
        if table is tables[main]:
            continue
        source = table[~table.index.duplicated(keep="last")].sort_index()
        for name in source.columns:
            known = source[name].dropna()
            if not is_number(known) and known.dtype != bool:
                left.append(name)
                continue
            label = name if name not in frame.columns else f"{name} ({Path(path).stem})"
            if label in frame.columns:
                raise RecordError(f"Several files have a column {quoted(name)}: name the columns, or the files, apart.")
            values = on_times(known.astype(float), frame.index)
            if not np.isfinite(values).any():
                raise RecordError(f"{path} has no {quoted(name)} at any time of {paths[main]}. Is its clock right?")
            frame = frame.assign(
                **{label: values if is_number(known) else np.where(np.isnan(values), np.nan, values >= 0.5)}
            )
    words = f"{len(paths)} files joined on the times of {Path(paths[main]).name}"
    return _of_several(frame, tables, None, words + (f", without {listing(left)} (no numbers)" if left else ""))


def _with_reading(tables: list[pd.DataFrame], said: Options) -> int:
    """The number of the file that holds the reading."""
    numbers = [[str(name) for name in table if is_number(table[name])] for table in tables]
    for has in (
        [said.reading in table.columns for table in tables],
        ["reading" in table.columns for table in tables],
        [bool(called_readings(names)) for names in numbers],
        [len(names) == 1 and not TEMPERATURES.search(names[0]) for names in numbers],
    ):
        if sum(has) == 1:
            return has.index(True)
    raise RecordError(f"In which file is the reading? Name its column with {option('reading')}.")


def as_runs(tables: list[pd.DataFrame], paths: list[str], said: Options) -> pd.DataFrame:
    """Files of the same columns: one log, or a run each."""
    first = tables[0]
    for path, table in zip(paths, tables, strict=True):
        for name in first.columns:
            one, other = unit_of(name, first), unit_of(name, table)
            if one != other:
                raise RecordError(
                    f"{quoted(name)} is in {other or 'no unit'} in {path}, in {one or 'no unit'} in {paths[0]}."
                )
    if RUN in first.columns:
        raise RecordError(
            f"There is a column {quoted(RUN)} already: name the runs yourself, in one file, with {option('run')}."
        )
    order = sorted(tables, key=lambda table: table.index[0])
    steps = np.concatenate([np.diff(as_seconds(table.index)) for table in tables])
    ends = np.array([as_seconds(b.index[:1])[0] - as_seconds(a.index[-1:])[0] for a, b in pairwise(order)])
    timed = not any(isinstance(table.index, pd.RangeIndex) for table in tables)
    # The next file of the same logger begins within ten steps of a log.
    if timed and said.run != RUN and len(steps) and (ends > 0).all() and (ends <= 10.0 * np.median(steps)).all():
        words = f"{len(tables)} files that follow on one another, one log"
        return _of_several(pd.concat(order), tables, first.attrs["form"], words)
    names = [Path(path).name for path in paths]
    names = names if len(set(names)) == len(names) else paths
    parts = [table.assign(**{RUN: name}) for name, table in zip(names, tables, strict=True)]
    return _of_several(
        pd.concat(parts, ignore_index=not timed), tables, first.attrs["form"], f"{len(tables)} files, a run each"
    )


def _of_several(frame: pd.DataFrame, tables: list[pd.DataFrame], form: Form | None, words: str) -> pd.DataFrame:
    every = [table.attrs for table in reversed(tables)]
    notes = dict.fromkeys(note for attrs in reversed(every) for note in attrs["notes"])
    frame.attrs = {key: {k: v for attrs in every for k, v in attrs[key].items()} for key in ("units", "words")}
    frame.attrs |= {"notes": [*notes, words], "form": form}
    return frame


def refuse_other_clocks(tables: list[pd.DataFrame], paths: list[str]) -> None:
    """Refuse files whose times cannot be compared."""
    kinds = []
    for table in tables:
        dates = isinstance(table.index, pd.DatetimeIndex)
        zoned = dates and table.index.tz is not None  # type: ignore[attr-defined]
        kinds.append("dates with a zone" if zoned else "dates without a zone" if dates else "no dates")
    other = next((k for k, kind in enumerate(kinds) if kind != kinds[0]), None)
    if other is not None:
        raise RecordError(
            f"The times of {paths[0]} are {kinds[0]}, those of {paths[other]} {kinds[other]}: they cannot be put "
            f"together. If those without a zone are local times, say {option('timezone')}: it is for them alone."
        )

"""Cells to columns of numbers: logs with one line for each value, and numbers with their unit behind."""

from __future__ import annotations

import re
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from ..records import RecordError
from ..records.types import kind_of
from ..records.units import unit_of_text
from .roles import reading_among
from .values import IN_DOUBT, first_cell, is_moment, is_number, plain_cell

_WITH_UNIT = re.compile(r"(?P<number>[-+0-9.,eE]+)\s*(?P<unit>[^\d\s.,+-].*)")


class LongShape(NamedTuple):
    """Columns of a log in which every line holds one value."""

    time: str
    name: str
    value: str


SHAPES = (
    LongShape("_time", "_field", "_value"),  # InfluxDB
    LongShape("last_changed", "entity_id", "state"),  # Home Assistant
    LongShape("last_updated", "entity_id", "state"),
)


def widened(frame: pd.DataFrame, reading: str | None = None) -> tuple[pd.DataFrame, str]:
    """A frame with a column for each name, and what was done; as it came where it is not in such a form.

    It has the times of the `reading`, or of the column with most values. Values of other columns are taken as a
    straight line in time between their own, as the temperature is; none between a value and a state that is no number.
    """
    shape = next((shape for shape in SHAPES if set(shape) <= set(frame.columns)), None) or _of_three(frame)
    if shape is None:
        return frame, ""
    by = "entity_id" if "entity_id" in frame.columns else shape.name
    names = frame[by].astype(str)
    names = names.where(~names.str.startswith("sensor."), names.str.removeprefix("sensor."))
    times = pd.to_datetime(frame[shape.time], format="ISO8601", errors="coerce", utc=True)
    values = pd.to_numeric(frame[shape.value], errors="coerce")  # "unavailable" is no number
    if times.isna().any():
        row = int(times.isna().to_numpy().argmax())
        raise RecordError(f"{frame[shape.time].iloc[row]!r} in {shape.time!r}, row {row}, is no date of ISO 8601.")
    if not (times.notna() & values.notna()).any():
        return frame, ""
    result, lead = wide(times, names, values, reading)
    return result, f"one line for each value: {len(result.columns) - 1} columns, on the times of {lead!r}"


def _of_three(frame: pd.DataFrame) -> LongShape | None:
    """A time, a name and a value in three columns, the same names again and again; None for any others."""
    kinds = {str(name): kind_of(frame[name]) for name in frame.columns}
    texts, numbers = ([name for name, kind in kinds.items() if kind == one] for one in ("text", "number"))
    times = [name for name in texts if is_moment(first_cell(frame[name]))]
    names = [name for name in texts if name not in times]
    if len(kinds) != 3 or not len(times) == len(names) == len(numbers) == 1:
        return None
    count = frame[names[0]].nunique()
    again = frame[times[0]].duplicated().any() or count == 2
    # Names of a log with one line for each value, at most
    return LongShape(times[0], names[0], numbers[0]) if 2 <= count <= 100 and again else None


PARTS = ("year", "month", "day", "hour", "minute", "second")


def whole_dates(frame: pd.DataFrame) -> tuple[pd.DataFrame, str]:
    """Year, month, day, hour, minute and second of columns of their own as one column of times; what was done."""
    found = {str(name).strip().lower(): name for name in frame.columns}
    parts = [found[part] for part in PARTS if part in found]
    if len(parts) < 4 or [str(part).strip().lower() for part in parts] != list(PARTS[: len(parts)]):
        return frame, ""
    if any(kind_of(frame[part]) != "number" for part in parts):
        return frame, ""
    times = pd.to_datetime(frame[parts].set_axis(list(PARTS[: len(parts)]), axis=1), errors="coerce")
    if times.isna().any():
        return frame, ""
    rest = frame.drop(columns=parts)
    rest.insert(0, "time" if "time" not in rest.columns else "time of the parts", times)
    return rest, f"{', '.join(map(str, parts))} joined"


def wide(
    times: pd.Series[Any], names: pd.Series[Any], values: pd.Series[Any], reading: str | None
) -> tuple[pd.DataFrame, str]:
    """A column for each name, and which of them has kept its own times; see `widened`.

    `times` (Series of dates or spans), `names` (Series of str), `values` (Series of float): A row for each value.
    `reading` (str, optional). Raises RecordError for two values of one name at one time.
    """
    known = times.notna() & values.notna()
    twice = pd.DataFrame({"name": names, "time": times})[known].duplicated()
    if twice.any():
        name = names[known][twice].iloc[0]
        raise RecordError(
            f"Several series are called {name!r}: they have values at the same times. Export one of them."
        )
    columns = {name: _series(times[names == name], values) for name in names[known].unique()}
    wanted = (reading, "reading", reading_among(list(columns)))
    own = next((name for name in wanted if name in columns), None)
    lead = own or max(columns, key=lambda name: int(columns[name].count()))
    index: Any = columns[lead].dropna().index
    result = pd.DataFrame({"time": index, **{name: on_times(series, index) for name, series in columns.items()}})
    return result.reset_index(drop=True), str(lead)


def _series(times: pd.Series[Any], values: pd.Series[Any]) -> pd.Series[Any]:
    series = pd.Series(values[times.index].to_numpy(float), index=pd.Index(times))
    series = series[~series.index.duplicated(keep="last")]
    return series.sort_index()


def on_times(series: pd.Series[Any], index: Any) -> np.ndarray:
    """Values at other times: a straight line between neighbours, nothing beyond the first and the last.

    Both indices hold dates (of one zone or none), spans, or seconds.
    """
    given, at, values = _numbers(series.index), _numbers(index), series.to_numpy(float)
    inside = np.interp(at - given[0], given - given[0], values)  # NaN beside a NaN, at given times too
    place = np.minimum(np.searchsorted(given, at), len(given) - 1)
    inside = np.where(given[place] == at, values[place], inside)
    return np.where((at >= given[0]) & (at <= given[-1]), inside, np.nan)


def _numbers(index: Any) -> np.ndarray:
    """Nanoseconds of dates and spans; seconds as they are."""
    if isinstance(index, pd.DatetimeIndex):
        index = (index if index.tz is None else index.tz_convert("UTC")).tz_localize(None)
    if isinstance(index, pd.DatetimeIndex | pd.TimedeltaIndex):
        return np.asarray(index.as_unit("ns").asi8)
    return np.asarray(index, float)


def without_units(frame: pd.DataFrame) -> tuple[pd.DataFrame, dict[str, str]]:
    """The frame with numbers in place of columns like ``23.5 °C``, all of one unit; and these units."""
    columns, units = {}, {}
    for name in frame.columns:
        if kind_of(frame[name]) == "text" and (found := _numbers_of(frame[name])) is not None:
            columns[name], units[str(name)] = found
    return frame.assign(**columns) if columns else frame, units


def _numbers_of(cells: pd.Series[Any]) -> tuple[np.ndarray, str] | None:
    numbers, units, signs = np.full(len(cells), np.nan), set(), set()
    for row, cell in enumerate(cells):
        if not isinstance(cell, str):
            continue
        found = _WITH_UNIT.fullmatch(cell.strip())
        decimal = "," if found and "," in found["number"] else "."
        if not found or not is_number(found["number"], decimal) or not unit_of_text(found["unit"]):
            return None
        signs.add(decimal if {",", "."} & set(found["number"]) else "")
        if len(signs - {""}) > 1 or (decimal == "," and IN_DOUBT["."].fullmatch(found["number"])):
            return None
        try:
            numbers[row] = float(plain_cell(found["number"], decimal))
        except ValueError:
            return None
        units.add(unit_of_text(found["unit"]))
        if len(units) > 1:
            return None
    return (numbers, units.pop()) if units else None

"""Local times to UTC: the hour that summer time repeats in autumn, and the one that it leaves out in spring."""

from __future__ import annotations

from typing import Any
from zoneinfo import ZoneInfo, ZoneInfoNotFoundError

import numpy as np
import pandas as pd

from ..records import RecordError
from ..records.times import dates_once
from ..records.types import kind_of

PUT_BACK = 15 * 60 * 10**9
"""Least step back where clocks are put back [ns]; a smaller one is a correction of the clock."""


def in_zone(times: pd.Series[Any], zone: str) -> pd.Series[Any]:
    """Local times as UTC; the hour that comes twice is told apart by the order of the rows.

    Raises RecordError for a zone that is not known, times with a zone of their own, and times that no clock showed.
    """
    try:
        ZoneInfo(zone)
    except (ZoneInfoNotFoundError, ValueError, OSError):
        raise RecordError(
            f"--timezone {zone!r} is not known. Zones are called Europe/Berlin, America/New_York, UTC."
        ) from None
    if not pd.api.types.is_datetime64_any_dtype(times.dtype):
        times = _dates(times, zone)
    if isinstance(times.dtype, pd.DatetimeTZDtype):
        raise RecordError(f"The times have a zone of their own already: leave out --timezone {zone}.")
    again = _second_time(times, zone)
    try:
        local = times.dt.tz_localize(zone, ambiguous=again, nonexistent="NaT")
    except ValueError as error:  # pragma: no cover - what pandas may find beyond
        raise RecordError(f"--timezone {zone}: {' '.join(str(error).split())}.") from None
    bad = local.isna().to_numpy() & times.notna().to_numpy()
    if bad.any():
        row = int(bad.argmax())
        raise RecordError(
            f"No clock in {zone} showed {times.iloc[row]} (row {row}): summer time began then, and an hour is left "
            "out. Is the logger set to another zone, or to winter time all the year?"
        )
    result: pd.Series[Any] = local.dt.tz_convert("UTC")
    return result


def _dates(times: pd.Series[Any], zone: str) -> pd.Series[Any]:
    read = dates_once(times)
    if kind_of(read) != "date":
        raise RecordError(f"--timezone {zone} is for dates: these times are none, or not all of them.")
    return read


def _second_time(times: pd.Series[Any], zone: str) -> np.ndarray:
    """Whether each time is the first that the clock showed it (summer time), shape (n,).

    Within the hour that comes twice, rows before a step back are the first time, rows behind it the second. A record
    that begins within the hour and goes on behind it began the second time, one that ends within it the first.
    """
    values = times.to_numpy(dtype="datetime64[ns]").astype(np.int64)
    early, late = (
        times.dt.tz_localize(zone, ambiguous=np.full(len(times), first), nonexistent="shift_forward")
        for first in (True, False)
    )
    doubtful = (early != late).to_numpy()
    summer = np.ones(len(times), bool)
    edges = np.flatnonzero(np.diff(np.concatenate(([False], doubtful, [False])).astype(int)))
    for start, stop in edges.reshape(-1, 2).tolist():
        steps = np.diff(values[start:stop])
        sparse = np.median(np.abs(np.diff(values))) >= PUT_BACK
        back = np.flatnonzero(steps <= (0 if sparse else -PUT_BACK))
        if len(back):
            summer[start + back[0] + 1 : stop] = False
        elif start == 0 and stop < len(times):
            summer[start:stop] = False
        elif start and stop < len(times):
            raise RecordError(
                f"The clock in {zone} showed {times.iloc[start]} (row {start}) twice, when summer time ended, and the "
                "rows around it do not tell which it was: none steps back. Log in UTC, or leave these rows out."
            )
    return summer

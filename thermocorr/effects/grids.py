"""Grids of candidate times and moments."""

from __future__ import annotations

from numbers import Real
from typing import Any

import numpy as np
import pandas as pd
from sklearn.utils._param_validation import Interval

from ..readers.clocks import one_date
from ..records import Record
from ..records.times import date_of, span_of

MOMENT: list[Any] = [Interval(Real, None, None, closed="neither"), str, pd.Timestamp, pd.Timedelta, np.datetime64]
"""What a moment may be, in scikit-learn's words."""


def since_start(time: Any, record: Record, name: str = "time", effect: str = "Step") -> float:
    """A moment, in any form, as seconds since the start.

    Raises ValueError for what is no moment of this record, and RecordError for a date that has two readings.
    """
    if isinstance(time, Real):
        return float(time)
    date = one_date(time) if isinstance(time, str) else None  # before spans: pandas takes 05.03.2024 10:00 for one
    if date is None:
        try:
            return float(span_of(time).total_seconds())
        except (ValueError, TypeError):
            date = date_of(time)
    kind = record.times.kind
    since = record.since_1970()
    if since is None or date is pd.NaT:
        raise ValueError(
            f"The {name!r} parameter of {effect} must be seconds since the record began, a span such as '3 days', or a "
            f"date where the record has dates (this one has {kind}). Got {time!r} instead."
        )
    zoned = kind == "datetime with time zone"
    if (date.tzinfo is not None) != zoned:
        raise ValueError(
            f"The {name!r} parameter of {effect} must be a date {'with' if zoned else 'without'} a time zone, as the "
            f"record's times are. Got {time!r} instead."
        )
    date = date.tz_convert("UTC").tz_localize(None) if zoned else date
    if kind == "seconds":  # Unix times
        return float(date.timestamp() - since)
    return record.times.between(date.as_unit("ns").value, record.first_stamp())


def moment_text(seconds: float, record: Record) -> str:
    """A moment in a column's name: a date, or seconds."""
    since = record.since_1970()
    if since is not None:
        zero = record.first_stamp() if record.times.kind != "seconds" else round(since) * 10**9
        part = seconds if record.times.kind != "seconds" else seconds + since - round(since)
        return str(pd.Timestamp(int(zero)) + pd.Timedelta(part, unit="s"))
    return f"{seconds:.10g} s"


def shown(moment: Any) -> str:
    """A moment as given, numbers to ten digits."""
    return f"{float(moment):.10g} s" if isinstance(moment, Real) else str(moment)


_SAMPLE = 20_000
"""Rows that are enough for quantiles."""


def time_grid(record: Record, steps: float, share: float, ratio: float = 2.0, limit: float = np.inf) -> list[float]:
    """Times from `steps` steps to a share of a segment [s]."""
    low = steps * record.usual_step()
    high = min(share * record.longest_read(), limit)
    if high < low:
        return []
    count = int(np.log(high / low) / np.log(ratio) + 1e-9) + 1
    return [float(f"{low * ratio**k:.3g}") for k in range(count)]


def temperature_quantiles(record: Record, shares: Any) -> np.ndarray:
    """Quantiles of the temperature."""
    stride = max(1, record.n_used // _SAMPLE)
    return np.asarray(np.quantile(np.concatenate([block.temperature[::stride] for block in record.blocks()]), shares))


def time_quantiles(record: Record, shares: Any) -> np.ndarray:
    """Quantiles of the rows' times [s since the start]."""
    stride = max(1, record.n_used // _SAMPLE)
    seconds = np.concatenate([block.seconds[::stride] for block in record.blocks()])
    return np.asarray(np.quantile(seconds, shares, method="nearest"))


def mean_seconds(record: Record) -> float:
    """Mean time of the rows since the record began [s]."""
    return sum(float(block.seconds.sum()) for block in record.blocks()) / record.n_used

"""Time axes of pictures, from milliseconds to years."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from ..model.tables import VERDICTS
from ..records import Record
from ..records.numbers import SPANS, is_frame, span_unit
from .style import PALE, SOFT

EMPTY = 0.5
"""Share of the span without rows, above which long gaps are left out of the axis."""
LONG_GAP = 0.05
"""Gaps longer than this share of the recorded time are then cut to a fifth of it."""


@dataclass(frozen=True, kw_only=True)
class TimeLine:
    """Times of a record's segments, and their places on an axis.

    Seconds count from the first row. Places are seconds too: those of the times, unless runs overlap or the record is
    mostly gaps; then segments stand one after the other.
    """

    first: float
    """Stamp of the first row: nanoseconds for dates."""
    dates: bool
    """True if the record has dates."""
    zone: Any
    """Time zone of the dates, or None."""
    samples: bool
    """True if rows have no times at all, so that only their number is known."""
    shifts: np.ndarray
    """Place less seconds of each segment [s]."""
    starts: np.ndarray
    """Place of the start of each segment [s]."""
    runs: tuple[object, ...]
    span: float
    """Length of the axis [s]."""
    usual_step: float
    in_order: bool
    """True if places are the times themselves."""
    overlapping: bool
    """True if a segment begins before the one before has ended, so that a time has several places."""

    @classmethod
    def of(cls, record: Record, zone: Any = None, samples: bool = False) -> TimeLine:
        """Lay out the segments of a record."""
        times, zero, since = record.times, record.first_stamp(), record.since_1970()
        start = np.array([times.between(record.stamp(s.start), zero) for s in record.segments])
        stop = np.array([times.between(record.stamp(s.stop - 1), zero) for s in record.segments])
        recorded, places = float(np.sum(stop - start)), start
        gaps = start[1:] - stop[:-1]
        if (gaps <= 0).any():
            places = np.concatenate(([0.0], np.cumsum(stop[:-1] - start[:-1] + _small(recorded))))
        elif gaps.sum() > EMPTY * (stop[-1] - start[0]):
            gaps = np.where(gaps > LONG_GAP * recorded, _small(recorded), gaps)
            places = np.concatenate(([0.0], np.cumsum(stop[:-1] - start[:-1] + gaps)))
        return cls(
            first=zero if since is None or times.kind != "seconds" else since * 1e9,
            dates=since is not None,
            zone=zone,
            samples=samples,
            shifts=places - start,
            starts=places,
            runs=tuple(segment.run for segment in record.segments),
            span=float(np.max(places + stop - start)),
            usual_step=record.usual_step(),
            in_order=places is start,
            overlapping=bool((stop[:-1] >= start[1:]).any()),
        )

    def times(self, seconds: np.ndarray) -> Any:
        """Dates, seconds since the first row, or row numbers."""
        if not self.dates:
            return seconds
        nanoseconds = int(self.first) + np.round(np.asarray(seconds) * 1e9).astype("i8")
        stamps = pd.DatetimeIndex(nanoseconds.view("M8[ns]"))
        return stamps if self.zone is None else stamps.tz_localize("UTC").tz_convert(self.zone)

    @property
    def zero(self) -> float:
        """Origin of times as numbers [s]."""
        return self.first / 1e9 if self.dates else 0.0

    def interval(self, low: float, high: float) -> tuple[float, float]:
        """Places of the ends of a ``time`` interval of `Diagnosis.where` [s]."""
        seconds = np.array((low, high)) - self.zero
        begins = self.starts - self.shifts  # seconds at which each segment begins
        segment = np.clip(np.searchsorted(begins, seconds, side="right") - 1, 0, None)
        first, last = seconds + self.shifts[segment]
        return float(first), float(last)

    def on_axis(self, places: np.ndarray) -> np.ndarray:
        """Positions for matplotlib: days, or the axis unit."""
        if self._shows_dates:
            from matplotlib import dates

            first = dates.date2num(np.datetime64(int(self.first), "ns"))
            return np.asarray(first + np.asarray(places) / 86_400.0)
        return np.asarray(places) / (1.0 if self.samples else SPANS[span_unit(self.span)])

    @property
    def _shows_dates(self) -> bool:
        return self.dates and self.in_order

    def label(self) -> str:
        """Label of the axis."""
        if self._shows_dates:
            return "time" if self.zone is None else f"time ({self.zone})"
        if self.samples:
            return "sample"
        what = "time" if self.in_order else "recorded time, long gaps left out"
        if self.overlapping:
            what = "recorded time, runs one after the other"
        return f"{what} [{span_unit(self.span)}]"

    def dress(self, axis: Any) -> None:
        """Give an axis of matplotlib its ticks."""
        if self._shows_dates:
            from matplotlib import dates

            most = int(min(max(axis.get_figure().get_figwidth(), 4), 8))
            locator = dates.AutoDateLocator(tz=self.zone, minticks=2 if most < 6 else 3, maxticks=most)
            axis.set_major_locator(locator)
            ticks = ["%Y", "%b %Y", "%d %b", "%H:%M", "%H:%M", "%S.%f"]
            # the date stands next to the axis only where the ticks are times of day
            offsets = ["", "", "%Y", "%d %b %Y", "%d %b %Y", "%d %b %Y %H:%M"]
            zeros = ["", "%Y", "%d %b", "%d %b", "%H:%M", "%H:%M"]
            axis.set_major_formatter(
                dates.ConciseDateFormatter(
                    locator, tz=self.zone, formats=ticks, offset_formats=offsets, zero_formats=zeros
                )
            )

    def joints(self, most: int = 12) -> list[tuple[float, str]]:
        """Starts of later segments, with names of runs."""
        if not 1 < len(self.starts) <= most:
            return []
        return [
            (float(place), "" if run is None or run == before else str(run))
            for place, run, before in zip(self.starts[1:], self.runs[1:], self.runs[:-1], strict=True)
        ]


def _small(recorded: float) -> float:
    """Length of axis that represents a long gap [s]."""
    return LONG_GAP * recorded / 5


def zone_of(X: Any, time: Any) -> Any:
    """Time zone of the data's dates, or None."""
    if time is not None and is_frame(X) and time in X.columns:  # a record that was read has none
        return getattr(getattr(X[time], "dtype", None), "tz", None)
    return getattr(getattr(X, "index", None), "tz", None)


WORSE = 1.5
"""A stretch is shown as failing above this ratio of its share of the excess error to its share of the samples."""


def stretches(diagnosis: Any, timeline: TimeLine) -> list[tuple[float, float]]:
    """Stretches of time in which a model fails [s].

    None where the diagnosis finds nothing missing, or where runs overlap in time, so that a time has several places.
    """
    where = diagnosis.where
    if VERDICTS[diagnosis.verdict].calm or timeline.overlapping:
        return []
    chosen = where[(where["aspect"] == "time") & (where["lift"] > WORSE)]
    joined: list[tuple[float, float]] = []
    for low, high in sorted(zip(chosen["low"], chosen["high"], strict=True)):
        first, last = timeline.interval(low, high)
        if joined and first - joined[-1][1] < 0.02 * timeline.span:
            joined[-1] = (joined[-1][0], last)
        else:
            joined.append((first, last))
    return joined


def dress_time(ax: Any, timeline: TimeLine, labels: bool = True) -> None:
    """Ticks, label and joints of a time axis."""
    timeline.dress(ax.xaxis)
    if labels:
        ax.set_xlabel(timeline.label())
    for place, _ in timeline.joints():
        ax.axvline(float(timeline.on_axis(np.array(place))), color=PALE, lw=0.8, ls=":", zorder=1)


def name_runs(ax: Any, timeline: TimeLine) -> None:
    """Names of the runs along the top edge."""
    joints = [(0.0, str(timeline.runs[0])), *timeline.joints()]
    if len(joints) > 1 and any(name for _, name in joints[1:]):
        for place, name in joints:
            ax.annotate(
                f"run {name}" if name.isdigit() else name,
                (float(timeline.on_axis(np.array(place))), 1.0),
                xycoords=("data", "axes fraction"),
                xytext=(2, -2),
                textcoords="offset points",
                va="top",
                annotation_clip=True,
                color=SOFT,
            )

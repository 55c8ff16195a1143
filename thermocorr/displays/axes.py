"""Time axes of pictures, from milliseconds to years."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import Any, NamedTuple, Self

import numpy as np
import pandas as pd

from ..effects.thermal import column_text
from ..estimators.regressor import DynamicBiasRegressor
from ..estimators.tables import VERDICTS, distinct
from ..estimators.time_constant_search import TimeConstantSearch
from ..estimators.uncertainty.joint import ErrorWalk
from ..records import Block, Record
from ..records.errors import printable
from ..records.numbers import SPANS, is_frame, scale_of, span_text, span_unit, unit_text
from ..records.units import without_unit

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
        """Dates where the record has them, else seconds since the first row [s], or numbers of rows."""
        if not self.dates:
            return seconds
        nanoseconds = int(self.first) + np.round(np.asarray(seconds) * 1e9).astype("i8")
        stamps = pd.DatetimeIndex(nanoseconds.view("M8[ns]"))
        return stamps if self.zone is None else stamps.tz_localize("UTC").tz_convert(self.zone)

    @property
    def zero(self) -> float:
        """Origin of times as numbers: the first row since 1970 for dates, else 0 [s]."""
        return self.first / 1e9 if self.dates else 0.0

    def interval(self, low: float, high: float) -> tuple[float, float]:
        """Places of the ends of a ``time`` interval of `Diagnosis.where` [s]."""
        seconds = np.array((low, high)) - self.zero
        begins = self.starts - self.shifts  # seconds at which each segment begins
        segment = np.clip(np.searchsorted(begins, seconds, side="right") - 1, 0, None)
        first, last = seconds + self.shifts[segment]
        return float(first), float(last)

    def on_axis(self, places: np.ndarray) -> np.ndarray:
        """Positions for matplotlib: days for dates, else the unit of the axis."""
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
        """Give an axis of matplotlib its ticks; its label is left to the caller."""
        if self._shows_dates:
            from matplotlib import dates

            locator = dates.AutoDateLocator(tz=self.zone, minticks=3, maxticks=8)
            axis.set_major_locator(locator)
            ticks = ["%Y", "%b %Y", "%d %b", "%H:%M", "%H:%M", "%S.%f"]
            # the date stands next to the axis only where the ticks are times of day
            beside = ["", "", "%Y", "%d %b %Y", "%d %b %Y", "%d %b %Y %H:%M"]
            zeros = ["", "%Y", "%d %b", "%d %b", "%H:%M", "%H:%M"]
            axis.set_major_formatter(
                dates.ConciseDateFormatter(
                    locator, tz=self.zone, formats=ticks, offset_formats=beside, zero_formats=zeros
                )
            )

    def joints(self, most: int = 12) -> list[tuple[float, str]]:
        """Starts of the segments after the first, with the names of their runs; none where there are too many."""
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
    """Places on the axis of the stretches of time in which a model fails [s]; neighbours are joined.

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


N_CELLS = 2000
"""Cells over the whole axis: about two for each pixel of a picture."""


class Cells:
    """Values that arrive in time order, block by block, and what is kept of them.

    `timeline` (TimeLine). `names` (sequence of str): Names of the values. `n_rows` (int): Rows that will come.
    `n_cells` (int).
    """

    def __init__(self, timeline: TimeLine, names: Sequence[str], n_rows: int, n_cells: int = N_CELLS):
        self.timeline, self.names = timeline, list(names)
        self.whole = n_rows <= 2 * n_cells
        self.n_cells = n_cells
        self.width = max(timeline.span, 1e-300) / n_cells
        self._parts: list[tuple[np.ndarray, ...]] = []
        self._seen = 0

    def add(self, segment: int, seconds: np.ndarray, values: np.ndarray) -> None:
        """Take in rows of one segment: times [s], shape (n,), and values, shape (n, k); NaN for missing ones."""
        if self.whole:
            number = self._seen + np.arange(len(seconds))
        else:
            number = ((seconds + self.timeline.shifts[segment]) // self.width).astype(np.intp)
            number = np.minimum(number, self.n_cells - 1)  # the last row ends the last cell
        self._seen += len(seconds)
        starts = np.flatnonzero(np.diff(number, prepend=-1 - number[0]))
        known = np.isfinite(values)
        self._parts.append(
            (
                np.full(len(starts), segment),
                number[starts],
                np.diff(starts, append=len(number)).astype(float),
                np.add.reduceat(seconds, starts),
                np.add.reduceat(known.astype(float), starts),
                np.add.reduceat(np.where(known, values, 0.0), starts),
                np.fmin.reduceat(values, starts),
                np.fmax.reduceat(values, starts),
            )
        )

    def frame(self) -> pd.DataFrame:
        """One row per cell: segment, seconds (mean), n, and of each value its mean, ``_low`` and ``_high``."""
        segment, number, n, seconds, known, total, low, high = (
            np.concatenate(column) for column in zip(*self._parts, strict=True)
        )
        starts = np.flatnonzero((np.diff(segment, prepend=-1) != 0) | (np.diff(number, prepend=-1) != 0))
        n, seconds, known, total = (np.add.reduceat(column, starts) for column in (n, seconds, known, total))
        low, high = np.fmin.reduceat(low, starts), np.fmax.reduceat(high, starts)
        with np.errstate(invalid="ignore", divide="ignore"):
            mean = np.clip(total / known, low, high)  # a sum's last digit must not lead outside
        columns = {"segment": segment[starts], "seconds": seconds / n, "n": n.astype(int)}
        for k, name in enumerate(self.names):
            columns |= {name: mean[:, k], f"{name}_low": low[:, k], f"{name}_high": high[:, k]}
        return pd.DataFrame(columns)


def cells_of(
    timeline: TimeLine,
    names: Sequence[str],
    n_rows: int,
    parts: Iterable[tuple[int, np.ndarray, np.ndarray]],
    n_cells: int = N_CELLS,
) -> pd.DataFrame:
    """Cells of parts (segment, seconds, values) as a frame whose first column is the time."""
    cells = Cells(timeline, names, n_rows, n_cells)
    for segment, seconds, values in parts:
        cells.add(segment, seconds, values)
    frame = cells.frame()
    frame.insert(0, "time", timeline.times(frame["seconds"].to_numpy()))
    return frame


def places(frame: pd.DataFrame, timeline: TimeLine) -> np.ndarray:
    """Place of each cell on the axis [s]."""
    return np.asarray(frame["seconds"].to_numpy() + timeline.shifts[frame["segment"].to_numpy()])


def with_breaks(frame: pd.DataFrame, timeline: TimeLine) -> tuple[np.ndarray, pd.DataFrame]:
    """Axis values and cells, with a row of NaN where a line must not be drawn: between segments and over gaps."""
    where = places(frame, timeline)
    steps = np.diff(where)
    usual = np.median(steps) if len(steps) else 0.0
    apart = (np.diff(frame["segment"].to_numpy()) != 0) | (steps > max(2.5 * usual, 10 * timeline.usual_step))
    breaks = np.flatnonzero(apart) + 1
    numbers = frame.drop(columns="time")
    spaced = pd.DataFrame(np.insert(numbers.to_numpy(float), breaks, np.nan, axis=0), columns=numbers.columns)
    return np.insert(timeline.on_axis(where), breaks, np.nan), spaced


BLUE, VERMILION, GREEN, ORANGE = "#0072B2", "#D55E00", "#009E73", "#E69F00"
SKY, PURPLE, GREY, BLACK = "#56B4E9", "#CC79A7", "#737373", "#222222"
COLOURS = (BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY)
"""Okabe & Ito's palette, which colour-blind readers can tell apart."""
PALE = "#B8C4CE"
SHADE = "#F0E442"
MARKED = 100
"""Up to this many rows, each is marked."""
TIMES = (1e-3, 1e-2, 0.1, 1, 10, 60, 600, 3600, 21_600, 86_400, 864_000, 8_640_000, 31_557_600, 315_576_000)
FINE_TIMES = (
    1e-3, 2e-3, 5e-3, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 30, 60, 120, 300, 600, 1800, 3600, 7200, 21_600,
    43_200, 86_400, 172_800, 432_000, 864_000, 2_592_000, 8_640_000, 31_557_600,
)  # fmt: skip


def pyplot() -> Any:
    """``matplotlib.pyplot``; an ImportError that names the extra where it is absent."""
    try:
        from matplotlib import pyplot as plt
    except ImportError:
        raise ImportError("Drawing needs matplotlib: pip install matplotlib.") from None
    return plt


class Display:
    """Base of displays in scikit-learn's style: `plot` sets ``ax_``, ``axes_`` and ``figure_`` of matplotlib."""

    def _drawn(self, axes: Any, first: Any) -> Self:
        self.axes_, self.ax_, self.figure_ = axes, first, first.figure
        return self


def axes_grid(
    ax: Any, rows: int = 1, columns: int = 1, *, size: tuple[float, float], sharex: Any = False, **grid: Any
) -> np.ndarray:
    """Axes to draw in, shape (rows, columns).

    Without `ax` a new figure of `size` [inch]; one Axes lends its place, which is divided; several are taken as given.
    """
    plt = pyplot()
    if ax is None:
        _, axes = plt.subplots(
            rows, columns, figsize=size, layout="constrained", squeeze=False, sharex=sharex, gridspec_kw=grid or None
        )
        return np.asarray(axes)
    given = np.asarray(ax, dtype=object)
    if given.size == rows * columns:
        return given.reshape(rows, columns)
    if given.size != 1:
        raise ValueError(f"The 'ax' parameter must be one Axes or {rows * columns} of them. Got {given.size}.")
    only = given.item()
    figure, place = only.figure, only.get_subplotspec()
    if place is None:
        raise ValueError("The 'ax' parameter must be an Axes of a grid, such as plt.subplots() makes: it is divided.")
    only.remove()
    parts = place.subgridspec(rows, columns, **grid)
    axes = np.empty((rows, columns), dtype=object)
    for i in range(rows):
        for j in range(columns):
            shared = axes[0, j] if i and sharex in (True, "col") else None
            axes[i, j] = figure.add_subplot(parts[i, j], sharex=shared)
    return axes


def labelled(name: str, unit: str, power: int = 0, shown: str = "") -> str:
    """``voltage [mV]``; without a unit the name alone. A unit at the end of the name is not said twice.

    With a power of ten, ``voltage [10^-3 mV]``; with a unit to be `shown` in its place, ``voltage [µV]``.
    """
    name = without_unit(name, unit)
    said = unit_text(shown or unit)
    unit = f"$10^{{{power}}}$ {said}".strip() if power and not shown else said
    return printable(f"{name} [{unit}]" if unit else name)


def label_values(axis: Any, name: str, unit: str) -> None:
    """Label an axis of values with the unit that suits their size: ``residual [µV]`` for thousandths of a mV.

    Where the unit takes no prefix, a power of ten stands with it: ``residual [10^-5 ppm]``. Call it after drawing.
    """
    from matplotlib.ticker import ScalarFormatter

    low, high = axis.get_view_interval()
    largest = max(abs(low), abs(high))
    scale = scale_of([largest], unit)
    power = int(np.floor(np.log10(largest))) if largest > 0 and scale.unit == unit else -round(np.log10(scale.factor))
    if scale.unit == unit and -3 < power < 5:
        power = 0
    formatter = ScalarFormatter(useOffset=bool(high - low < 1e-8 * largest))
    formatter.set_powerlimits((power, power) if power else (-9, 9))
    axis.set_major_formatter(formatter)
    if power:
        axis.get_offset_text().set_visible(False)
    axis.set_label_text(labelled(name, unit, power) if scale.unit == unit else labelled(name, unit, 0, scale.unit))


def label_log_values(axis: Any, name: str, unit: str) -> None:
    """Label a logarithmic axis of values with the unit that suits the largest. Call it after drawing."""
    from matplotlib.ticker import LogFormatterSciNotation

    scale = scale_of([max(axis.get_view_interval())], unit)

    class Scaled(LogFormatterSciNotation):
        def __call__(self, x: float, pos: int | None = None) -> str:
            return str(super().__call__(x * scale.factor, pos))

    axis.set_major_formatter(Scaled())
    axis.set_minor_formatter(Scaled(labelOnlyBase=False))
    axis.set_label_text(labelled(name, unit, shown=scale.unit))


def legend_above(ax: Any, **options: Any) -> None:
    """A legend in the free space above the axes, where it hides no data."""
    handles, labels = ax.get_legend_handles_labels()
    if labels:
        ax.legend(
            handles,
            labels,
            loc="lower right",
            bbox_to_anchor=(1.0, 1.0),
            frameon=False,
            borderaxespad=0.1,
            columnspacing=1.2,
            handlelength=1.6,
            **{"ncols": len(labels), **options},
        )


def plain(ax: Any) -> None:
    """Take away what carries no information."""
    ax.spines[["top", "right"]].set_visible(False)
    ax.grid(True, color="0.9", lw=0.6)
    ax.set_axisbelow(True)


def pale(colour: str, share: float = 0.35) -> tuple[float, ...]:
    """A colour mixed with white; unlike a transparent one it does not change what it is drawn on."""
    from matplotlib.colors import to_rgb

    return tuple(1 - share * (1 - part) for part in to_rgb(colour))


def draw_cells(
    ax: Any, frame: pd.DataFrame, timeline: TimeLine, name: str, colour: str, label: str | None = None, lw: float = 1.0
) -> None:
    """Draw a value over time: its mean as a line, its range as a band that shows every spike."""
    x, spaced = with_breaks(frame, timeline)
    if (frame["n"] > 1).any():
        ax.fill_between(
            x,
            spaced[f"{name}_low"],
            spaced[f"{name}_high"],
            facecolor=pale(colour),
            edgecolor=pale(colour, 0.5),
            lw=0.8,
            zorder=2,
        )
    marks: dict[str, Any] = {"marker": "o", "ms": 3} if len(frame) <= MARKED else {}
    ax.plot(x, spaced[name], color=colour, lw=lw, label=label, zorder=3, **marks)


def dress_time(ax: Any, timeline: TimeLine, labels: bool = True) -> None:
    """Ticks and label of a time axis, and thin lines where segments begin."""
    timeline.dress(ax.xaxis)
    if labels:
        ax.set_xlabel(timeline.label())
    for place, _ in timeline.joints():
        ax.axvline(float(timeline.on_axis(np.array(place))), color="0.6", lw=0.8, ls=":", zorder=1)


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
                fontsize=8,
                color=GREY,
            )


def log_time_axis(ax: Any, label: str, samples: bool = False) -> None:
    """A logarithmic axis of times with ticks such as 10 s, 1 min, 1 h, 1 d. Call it after drawing.

    `samples` counts rows, where their times are not known.
    """
    ax.set_xscale("log")
    if samples:
        ax.set_xlabel(f"{label} [samples]")
        return
    from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator

    low, high = ax.get_xlim()
    inside = [t for t in FINE_TIMES if low <= t <= high]
    if len(inside) > 7:
        inside = [t for t in TIMES if low <= t <= high]
    ax.xaxis.set_major_locator(FixedLocator(inside))
    ax.xaxis.set_major_formatter(FuncFormatter(lambda value, position: span_text(value)))
    ax.xaxis.set_minor_locator(NullLocator())
    ax.set_xlabel(label)


class SegmentRows(NamedTuple):
    """Rows of one segment, in time order."""

    segment: int
    rows: Any
    """Rows of the user's data, a slice or numbers."""
    seconds: np.ndarray
    """Since the first row of the record [s]."""
    temperature: np.ndarray
    measured: np.ndarray
    """NaN where no readings are given."""
    contributions: np.ndarray
    """Shape (n, number of effects)."""
    modelled: np.ndarray
    """Reading that the model expects: U0, or the reference and U0, and all contributions."""


class Walk:
    """A model on a record: its time line, and its rows block by block.

    `model` (DynamicBiasRegressor, or a fitted search with a ``best_estimator_``). `X`, `y` (as for
    `DynamicBiasRegressor.evaluate_blocks`; y may be left out).
    """

    def __init__(self, model: Any, X: Any, y: Any = None):
        self.model = regressor_of(model)
        self._reading = None if y is None else self.model._reading_numbers(X, y)
        self._level = self.model._level(X)
        self._blocks = self.model._contribution_blocks(X)
        self._first = next(self._blocks)  # a record has at least one block
        self.record: Record = self._first[0].record
        self.timeline = TimeLine.of(self.record, zone_of(X, self.model.features_.time), without_times(self.model))
        self._shift = self.record.times.between(self.record.first_stamp(), self._first[0].zero)

    @property
    def n_rows(self) -> int:
        """Rows inside segments."""
        return self.record.n_used

    @property
    def temperature_name(self) -> str:
        """Name of the temperature, as in the user's data."""
        return column_text(self.record.temperature_name)

    def labels(self) -> list[str]:
        """Names of the effects."""
        return distinct([effect.label() for effect in self.model.features_.effect_list()])

    def corrected(self, part: SegmentRows) -> np.ndarray:
        """Readings of a part less the bias that `correct` removes."""
        return np.asarray(part.measured - self.model._removed_part(part.contributions))

    def parts(self) -> Iterator[SegmentRows]:
        """Walk; once."""
        for block, contributions in chain([self._first], self._blocks):
            yield self._part(block, contributions)

    def uncertainties(self) -> Iterator[np.ndarray]:
        """Standard uncertainty of a reading in the rows of each of the `parts`, shape (n,)."""
        joint = self.model._joint_errors()
        for _, _, _, errors in ErrorWalk(self.model, joint, removed=False).blocks(self.record):
            yield np.sqrt(errors.of_readings(joint.noise))

    def _part(self, block: Block, contributions: np.ndarray) -> SegmentRows:
        if self._reading is None:
            measured = np.full(len(block), np.nan)
        else:
            measured = self.model._screened(block, np.asarray(self._reading[block.rows], float))
        return SegmentRows(
            segment=block.segment,
            rows=block.rows,
            seconds=block.seconds - self._shift,
            temperature=block.temperature,
            measured=measured,
            contributions=contributions,
            modelled=contributions.sum(axis=1) + self._level[block.rows],
        )


def where_read(modelled: np.ndarray, measured: np.ndarray) -> np.ndarray:
    """Modelled readings as they are drawn: NaN where nothing was measured, where they may be far from any reading."""
    return np.where(np.isfinite(measured), modelled, np.nan)


def regressor_of(model: Any) -> DynamicBiasRegressor:
    """The fitted `DynamicBiasRegressor`, also of a search."""
    found = getattr(model, "best_estimator_", model)
    if isinstance(found, TimeConstantSearch):
        raise TypeError("The search has no fitted model. Fit it first, with refit=True.")
    if not isinstance(found, DynamicBiasRegressor):
        raise TypeError(f"A fitted DynamicBiasRegressor is needed, or a search with one. Got {type(found).__name__}.")
    found.features_  # noqa: B018 - raises NotFittedError where nothing is fitted
    return found


def without_times(fitted: DynamicBiasRegressor) -> bool:
    """True if the rows of a model's record have no times, so that only their number is known."""
    return fitted.features_.history_.kind == "rows" and fitted.features_.sampling_period is None

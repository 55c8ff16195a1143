"""Axes, labels and tick marks of pictures, series thinned out for them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import pandas as pd

from ..estimators.tables import VERDICTS
from ..records.errors import printable
from ..records.numbers import scale_of, span_text
from ..records.units import without_unit
from .protocols import DiagnosisLike
from .timeline import TimeLine

WORSE = 1.5
"""A stretch is shown as failing above this ratio of its share of the excess error to its share of the samples."""


def stretches(diagnosis: DiagnosisLike, timeline: TimeLine) -> list[tuple[float, float]]:
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
SHADE = "#F0E442"
SEQUENTIAL = "viridis"
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

    With a power of ten, ``voltage [10^-3 mV]``; with a unit to be `shown` in its place, ``voltage [uV]``.
    """
    name = without_unit(name, unit)
    unit = shown or (f"$10^{{{power}}}$ {unit}".strip() if power else unit)
    return printable(f"{name} [{unit}]" if unit else name)


def label_values(axis: Any, name: str, unit: str) -> None:
    """Label an axis of values with the unit that suits their size: ``residual [uV]`` for thousandths of a mV.

    Where the unit takes no prefix, a power of ten stands beside it: ``residual [10^-5 ppm]``. Call it after drawing.
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

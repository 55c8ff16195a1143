"""Charts of a page, and the traces in them."""

from __future__ import annotations

import base64
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from markupsafe import Markup

from ..displays.axes import FINE_TIMES, TIMES, TimeLine, where_read
from ..equations.statistics import Moments
from ..records.numbers import SPANS, is_frame, numeric_reading, unit_text
from ..records.units import without_unit
from .html import rendered, units_of_axis

MOST_POINTS = 85_000
"""Points of one line. A record of so many rows is shown whole; of a longer one, the extremes of groups of rows."""

AVERAGES = 400
"""Stretches that the residual is averaged over, to show what its noise hides."""


@dataclass(frozen=True, kw_only=True)
class Traces:
    """Time series of a record, thinned out without hiding a spike."""

    seconds: np.ndarray
    """Place on the time line [s], shape (n,), never decreasing: time since the first row, unless runs overlap or the
    record is mostly gaps, see `thermocorr.displays.axes.TimeLine`."""
    columns: dict[str, np.ndarray]
    """Temperature, reading, model, corrected, residual, and recorded columns asked for; NaN where unknown, and between
    segments."""
    rows_per_cell: int
    """1: every row is there. Otherwise each cell of so many rows has two points: its extremes in their order in time,
    at the times of its first and last row."""
    n_rows: int
    flags: dict[str, int]
    """Number of rows that each flag of `DynamicBiasRegressor.flags` stands at."""
    rms: float
    """Rms residual of all rows, in the unit of the reading."""
    average: tuple[np.ndarray, np.ndarray]
    """Means of the residual over short stretches: first and last point of each, shape (m, 2), and mean, shape (m,)."""
    average_rows: int
    """Rows of such a stretch."""
    corrected: Moments
    """Number, mean and range of the corrected readings."""
    readings: Moments
    """Number, mean and range of the readings that are believed."""

    @classmethod
    def of(
        cls, model: Any, X: Any, y: Any, timeline: TimeLine, beside: tuple[Any, ...] = (), most: int = MOST_POINTS
    ) -> Traces:
        """Run once through a record, block by block.

        `model` (DynamicBiasRegressor): Fitted. `X`, `y` (as for `DynamicBiasRegressor.evaluate_blocks`). `timeline`
        (TimeLine): Of the record. `beside` (tuple): Recorded columns to show beside what the model makes of the
        record. `most` (int): Most points of a line.
        """
        cells = Extremes(most)
        flags: dict[str, int] = {}
        n_rows, known, squares = 0, 0, 0.0
        corrected, readings = Moments(), Moments()
        reading = numeric_reading(y, X)
        for block, values, flagged in model._evaluated_blocks(X, y):
            zero = block.record.times.between(block.record.first_stamp(), block.zero)
            for name, count in flagged.counts().items():
                flags[name] = flags.get(name, 0) + count
            columns = {
                "temperature": block.temperature,
                "reading": model._screened(block, np.asarray(reading[block.rows], float)),
            }
            columns |= {name: values[name] for name in ("model", "corrected", "residual")}
            columns["model"] = where_read(columns["model"], columns["reading"])
            corrected = corrected.merged(Moments.of(values["corrected"]))
            readings = readings.merged(Moments.of(columns["reading"]))
            columns |= {column_key(name): recorded(X, name, block.rows) for name in beside}
            residual = values["residual"][np.isfinite(values["residual"])]
            n_rows, known, squares = n_rows + len(block), known + len(residual), squares + float(residual @ residual)
            cells.add(
                block.segment,
                block.seconds - zero + timeline.shifts[block.segment],
                np.column_stack(list(columns.values())),
            )
        seconds, points = cells.points()
        names = list(columns)
        group = cells.group()
        return cls(
            seconds=seconds,
            columns={name: points[:, i] for i, name in enumerate(names)},
            rows_per_cell=cells.width,
            n_rows=n_rows,
            flags=flags,
            rms=float(np.sqrt(squares / known)) if known else float("nan"),
            average=cells.averages(names.index("residual"), group),
            average_rows=group * cells.width,
            corrected=corrected,
            readings=readings,
        )


class Extremes:
    """Extremes of groups of consecutive rows. Groups double when there are too many, so the memory is bounded."""

    def __init__(self, most: int):
        self.most = most
        self.width = 1
        """Rows of a cell (fewer at the end of a segment)."""
        self.across = False
        """True if segments are so short and many that cells reach over them."""
        self._parts: list[tuple[np.ndarray, ...]] = []
        self._count = 0
        self._segment = -1
        self._rows = np.zeros(2, int)  # taken so far: of all, and of this segment

    def add(self, segment: int, seconds: np.ndarray, values: np.ndarray) -> None:
        """Take the next rows of a segment: times of shape (n,), values of shape (n, k)."""
        if segment != self._segment:
            self._segment, self._rows[1] = segment, 0
        starts = np.arange(0, len(seconds), self.width)
        low, high, falls = extremes(values, values, None, starts)
        ends = np.append(starts[1:], len(seconds)) - 1
        known = np.isfinite(values)
        sums = [np.add.reduceat(part, starts, axis=0) for part in (np.where(known, values, 0.0), known.astype(float))]
        rows = starts[:, None] + self._rows
        self._parts.append(
            (np.full(len(starts), segment), rows, seconds[starts], seconds[ends], low, high, falls, *sums)
        )
        self._rows += len(seconds)
        self._count += len(starts)
        if self._count > self._limit():
            self._merge()
        while self._count > self._limit():
            self.width *= 2
            self._merge()

    def _limit(self) -> int:
        return self.most if self.width == 1 else self.most // 2

    def _merge(self) -> None:
        """Merge cells that fit into one of `width` rows, inside segments as long as these have several cells."""
        segment, rows, first, last, low, high, falls, *sums = self._joined()
        self.across |= bool(2 * (np.count_nonzero(np.diff(segment)) + 1) > len(segment))
        number = rows[:, 0 if self.across else 1] // self.width
        changes = np.diff(number) != 0 if self.across else (np.diff(number) != 0) | (np.diff(segment) != 0)
        starts = np.concatenate(([0], np.flatnonzero(changes) + 1))
        ends = np.append(starts[1:], len(segment)) - 1
        low, high, falls = extremes(low, high, falls, starts)
        sums = [np.add.reduceat(part, starts, axis=0) for part in sums]
        self._parts = [(segment[starts], rows[starts], first[starts], last[ends], low, high, falls, *sums)]
        self._count = len(starts)

    def points(self) -> tuple[np.ndarray, np.ndarray]:
        """Times of shape (n,) and values of shape (n, k), with a row of NaN between segments."""
        _, _, first, last, low, high, falls, *_ = self._joined()
        if self.width == 1:
            seconds, values, per = first, low, 1
        else:
            seconds = np.column_stack((first, last)).ravel()
            pairs = np.stack((np.where(falls, high, low), np.where(falls, low, high)), axis=1)
            values, per = pairs.reshape(-1, low.shape[1]), 2
        breaks = np.flatnonzero(self._begins()[1:]) * per + per
        gaps = np.full((len(breaks), values.shape[1]), np.nan)
        return np.insert(seconds, breaks, seconds[breaks - 1]), np.insert(values, breaks, gaps, axis=0)

    def group(self, most: int = AVERAGES) -> int:
        """Cells of a stretch to average over."""
        # Fewest rows of such a stretch
        return max(-(-self._count // most), -(-4 // self.width))

    def averages(self, column: int, group: int) -> tuple[np.ndarray, np.ndarray]:
        """First and last point (as `points` counts them) and mean of stretches of `group` cells inside segments."""
        *_, total, known = self._joined()
        begins = np.flatnonzero(self._begins())
        place = np.arange(len(total)) - np.repeat(begins, np.diff([*begins, len(total)]))
        starts = np.flatnonzero(place % group == 0)
        ends = np.append(starts[1:], len(total)) - 1
        per = 1 if self.width == 1 else 2
        gaps = np.cumsum(self._begins())[starts] - 1  # rows of NaN before each stretch
        points = np.column_stack((starts * per, ends * per + per - 1)) + gaps[:, None]
        sums, counts = (np.add.reduceat(part[:, column], starts) for part in (total, known))
        return points[counts > 0], sums[counts > 0] / counts[counts > 0]

    def _begins(self) -> np.ndarray:
        """True if a line begins at each cell."""
        segment = self._joined()[0]
        return np.concatenate(([True], (np.diff(segment) != 0) & (not self.across)))

    def _joined(self) -> list[np.ndarray]:
        """Segment, first rows (of all, of the segment), first and last time, low, high, whether it falls, sum and
        number of known values of each cell.
        """
        self._parts = [tuple(np.concatenate(part) for part in zip(*self._parts, strict=True))]
        return list(self._parts[0])


def extremes(
    low: np.ndarray, high: np.ndarray, falls: np.ndarray | None, starts: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Lowest and highest values of groups that begin at `starts`, and whether the highest comes first.

    `low`, `high` (array of shape (n, k)): The same array for single samples, or extremes of cells; NaN where unknown.
    `falls` (array of shape (n, k), optional): Whether the highest of each cell came first. `starts` (array of shape
    (m,)).
    """
    n = len(low)
    lowest, highest = np.fmin.reduceat(low, starts, axis=0), np.fmax.reduceat(high, starts, axis=0)
    group = np.repeat(np.arange(len(starts)), np.diff([*starts, n]))
    place = np.arange(n)[:, None]
    at_low, at_high = (
        np.minimum.reduceat(np.where(values == found[group], place, n), starts, axis=0)
        for values, found in ((low, lowest), (high, highest))
    )
    order = at_high < at_low
    if falls is not None:
        inside = np.take_along_axis(falls, np.minimum(at_low, n - 1), axis=0)
        order = np.where(at_high == at_low, inside, order)
    return lowest, highest, order


def recorded(X: Any, name: Any, rows: Any) -> np.ndarray:
    """Some rows of a recorded column."""
    if not is_frame(X):
        return np.asarray(X[rows, name], float)
    column = X[name]
    if hasattr(column, "iloc"):
        return np.asarray(column.iloc[rows].to_numpy(dtype=float, na_value=np.nan))
    return np.asarray(column[rows], float)


def column_key(name: Any) -> str:
    """Key of a recorded column, apart from those of the model's own."""
    return f"column {name}"


TIME_SPANS = {"units": list(SPANS.items()), "fine": FINE_TIMES, "coarse": TIMES}
"""Units of time spans, and where an axis of them has its ticks [s]."""


@dataclass(frozen=True)
class ChartLine:
    """One line of a panel."""

    label: str
    values: np.ndarray | tuple[str, int, int]
    """Shape (n,), beside the chart's x, NaN where there is none; or chart, panel and line that has the same values."""
    role: str
    """What it shows, which gives it its colour: reading, model, corrected, residual, average, temperature, other."""
    dash: bool = False
    dots: bool = False
    joined: bool = True
    """True if points are joined by a line."""
    edge: bool = False
    """Edge of the band around the line before it: two follow one another, the lower first."""
    stretches: np.ndarray | None = None
    """Where `values` belong to stretches of x: their first and last points, shape (m, 2)."""


@dataclass(frozen=True)
class Panel:
    """Lines over one axis."""

    label: str
    unit: str
    lines: tuple[ChartLine, ...]
    log: bool = False
    rules: tuple[float, ...] = ()
    """Values of horizontal lines."""
    height: int = 200
    scale_of: int | None = None
    """Panel of the same chart whose vertical scale this one has too."""


@dataclass(frozen=True)
class Chart:
    """Panels over one common x, zoomed together."""

    name: str
    """Identifier in the page: letters only."""
    x_label: str
    x: np.ndarray | str
    """Shape (n,), or the chart that has the same x; never decreasing; seconds since 1970 where `dates`."""
    panels: tuple[Panel, ...]
    caption: str
    """One or two sentences: what is to be seen."""
    x_unit: str = ""
    joints: tuple[tuple[float, float], ...] = ()
    """Where x is no true time: x and true time at which segments begin."""
    dates: bool = False
    x_log: bool = False
    shades: tuple[tuple[float, float], ...] = ()
    """Stretches of x that stand out: from, to."""

    def payload(self) -> dict[str, Any]:
        """Data for the script."""
        return {
            "name": self.name,
            "x": {
                "label": without_unit(self.x_label, self.x_unit),
                "unit": unit_text(self.x_unit),
                "spans": TIME_SPANS if self.x_log and self.x_unit == "s" else None,
                "joints": [list(joint) for joint in self.joints],
                "dates": self.dates,
                "log": self.x_log,
                "data": packed_times(self.x),
            },
            "panels": [
                {
                    "label": without_unit(panel.label, panel.unit),
                    "unit": unit_text(panel.unit),
                    "units": units_of_axis(panel.unit),
                    "log": panel.log,
                    "height": panel.height,
                    "like": panel.scale_of,
                    "rules": [float(value) for value in panel.rules],
                    "lines": [
                        {
                            "label": line.label,
                            "role": line.role,
                            "dash": line.dash,
                            "dots": line.dots,
                            "joined": line.joined,
                            "edge": line.edge,
                            "data": packed(line.values),
                            "stretches": None if line.stretches is None else line.stretches.ravel().tolist(),
                        }
                        for line in panel.lines
                    ],
                }
                for panel in self.panels
            ],
            "shades": [[float(low), float(high)] for low, high in self.shades],
        }

    def html(self) -> Markup:
        """Place and caption of the chart."""
        names = dict.fromkeys(line.label for panel in self.panels for line in panel.lines if not line.edge)
        return rendered("chart", chart=self, names=", ".join(names))


def places(charts: Iterable[Chart]) -> Markup:
    """Places and captions of some charts."""
    return Markup("").join(chart.html() for chart in charts)


def packed(values: np.ndarray | tuple[str, int, int]) -> dict[str, Any]:
    """Single-precision distances from the middle, in base64: exact to 6e-8 of the span."""
    if isinstance(values, tuple):
        return {"same": list(values)}
    numbers = np.asarray(values, float)
    known = numbers[np.isfinite(numbers)]
    middle = float((known.min() + known.max()) / 2) if len(known) else 0.0
    return {"add": middle, "f4": base64.b64encode((numbers - middle).astype("<f4").tobytes()).decode()}


def packed_times(x: np.ndarray | str) -> dict[str, Any]:
    """Even steps as three numbers, others in base64 at full precision."""
    if isinstance(x, str):
        return {"same": x}
    x = np.asarray(x, float)
    if len(x) > 2 and np.ptp(np.diff(x)) <= 1e-9 * max(abs(x[-1] - x[0]), 1e-300):
        return {"start": float(x[0]), "step": float((x[-1] - x[0]) / (len(x) - 1)), "n": len(x)}
    return {"f8": base64.b64encode(x.astype("<f8").tobytes()).decode()}


def still(values: np.ndarray, floor: float) -> Markup:
    """A line without a script: extremes of a few hundred groups of rows, as SVG in the colour of the text.

    `values` (array of shape (n,)). `floor` (float): Dashed lines at plus and minus this.
    """
    width, height = 640, 90
    parts = np.array_split(np.asarray(values, float), min(width // 2, len(values)))
    cells = [part[np.isfinite(part)] for part in parts]
    extremes = [(part.min(), part.max()) if len(part) else (np.nan, np.nan) for part in cells]
    low, high = np.array(extremes).T
    bottom, top = np.nanmin([np.nanmin(low), -floor]), np.nanmax([np.nanmax(high), floor])
    scale = (height - 4) / max(top - bottom, 1e-300)

    def y(value: float) -> float:
        return round(float(2 + (top - value) * scale), 1)

    step = width / len(cells)
    strokes = [
        f"M{(i + 0.5) * step:.1f} {y(a) + 0.5:.1f}V{y(b) - 0.5:.1f}"
        for i, (a, b) in enumerate(zip(low, high, strict=True))
        if np.isfinite(a)
    ]
    drawn = []
    drawn.append(f'<path d="{"".join(strokes)}" stroke="#4d86d8" stroke-width="{max(step * 0.8, 1):.2f}" fill="none"/>')
    middles = [f"{(i + 0.5) * step:.1f} {y(part.mean())}" for i, part in enumerate(cells) if len(part) > 3]
    drawn.append(
        f'<path d="M{"L".join(middles)}" stroke="currentColor" stroke-width="1.5" fill="none"/>' if middles else ""
    )
    edges = "".join(f"M0 {y(edge)}H{width}" for edge in (floor, -floor))
    drawn.append(f'<path d="{edges}" stroke="currentColor" stroke-dasharray="6 4" opacity="0.7" fill="none"/>')
    return Markup(
        f'<svg viewBox="0 0 {width} {height}" width="{width}" height="{height}" role="img" aria-label="residual" '
        f'style="max-width:100%;height:auto;display:block">{"".join(drawn)}</svg>'
    )

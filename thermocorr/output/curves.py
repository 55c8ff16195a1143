"""A model on a record as curves, and cells that keep spikes."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import chain
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from ..effects.thermal import column_text
from ..model.regressor import DynamicBiasRegressor
from ..model.runs import is_level
from ..model.tables import distinct
from ..model.time_constant_search import TimeConstantSearch
from ..model.uncertainty import ErrorWalk
from ..records import Block, Record
from ..records.numbers import is_frame
from .style import GREEN
from .timeline import TimeLine, zone_of

N_CELLS = 1000
"""Cells over the whole axis: about one for each pixel of a picture."""


class Part(NamedTuple):
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
    """Reading that the model expects: U0, or the reference and U0, and all contributions; NaN without a reading."""
    residual: np.ndarray
    corrected: np.ndarray
    u: np.ndarray | None
    """Standard uncertainty of a reading."""


class Curves:
    """A model on a record, block by block, and its time line.

    `model` (DynamicBiasRegressor, or a fitted search with a ``best_estimator_``). `X`, `y` (as for
    `DynamicBiasRegressor.evaluate_blocks`; y may be left out). `uncertainty` (bool): With that of each reading. `keep`
    (bool): In memory, to be looked at several times.
    """

    def __init__(self, model: Any, X: Any, y: Any = None, *, uncertainty: bool = False, keep: bool = False):
        self.model, self.X = regressor_of(model), X
        self._reading = None if y is None else self.model._reading_numbers(X, y)
        self._level = self.model._level(X)
        self._blocks = self.model._contribution_blocks(X)
        self._first = next(self._blocks)  # a record has at least one block
        self.record: Record = self._first[0].record
        self.timeline = TimeLine.of(self.record, zone_of(X, self.model.features_.time), without_times(self.model))
        self._shift = self.record.times.between(self.record.first_stamp(), self._first[0].zero)
        self.uncertain = uncertainty and self.model._knows_noise
        self._kept: list[Part] | None = None
        if keep:
            self._kept = list(self.parts())

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

    def level(self, part: Part) -> np.ndarray:
        """Level of each row's run; zeros for none."""
        for k, effect in enumerate(self.model.features_.effect_list()):
            if is_level(self.model, effect):
                return part.contributions[:, k]
        return np.zeros(len(part.seconds))

    def column(self, name: Any, part: Part) -> np.ndarray:
        """A recorded column in the rows of a part."""
        if not is_frame(self.X):
            return np.asarray(self.X[part.rows, name], float)
        column = self.X[name]
        if hasattr(column, "iloc"):
            return np.asarray(column.iloc[part.rows].to_numpy(dtype=float, na_value=np.nan))
        return np.asarray(column[part.rows], float)

    def places(self, part: Part) -> np.ndarray:
        """Places of the rows of a part on the axis [s]."""
        return np.asarray(part.seconds + self.timeline.shifts[part.segment])

    def parts(self) -> Iterator[Part]:
        """All parts; once, unless they are kept."""
        if self._kept is not None:
            yield from self._kept
            return
        uncertainties = self._uncertainties() if self.uncertain else iter(lambda: None, 0)
        for (block, contributions), u in zip(chain([self._first], self._blocks), uncertainties, strict=False):
            yield self._part(block, contributions, u)

    def _uncertainties(self) -> Iterator[np.ndarray]:
        joint = self.model._joint_errors()
        for _, _, _, errors in ErrorWalk(self.model, joint, removed=False).blocks(self.record):
            yield np.sqrt(errors.of_readings(joint.noise))

    def _part(self, block: Block, contributions: np.ndarray, u: np.ndarray | None) -> Part:
        measured = np.full(len(block), np.nan)
        if self._reading is not None:
            measured = self.model._screened(block, np.asarray(self._reading[block.rows], float))
        modelled = contributions.sum(axis=1) + self._level[block.rows]
        return Part(
            segment=block.segment,
            rows=block.rows,
            seconds=block.seconds - self._shift,
            temperature=block.temperature,
            measured=measured,
            contributions=contributions,
            modelled=np.where(np.isfinite(measured), modelled, np.nan),
            residual=measured - modelled,
            corrected=np.asarray(measured - self.model._removed_part(contributions)),
            u=u,
        )


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
    """True if only the rows' numbers are known."""
    return fitted.features_.history_.kind == "rows" and fitted.features_.sampling_period is None


def cells_of(
    timeline: TimeLine,
    names: Sequence[str],
    n_rows: int,
    parts: Iterable[tuple[int, np.ndarray, np.ndarray]],
    span: tuple[float, float] | None = None,
    n_cells: int = N_CELLS,
) -> pd.DataFrame:
    """Values in time order, gathered in cells of time.

    Parameters
    ----------
    timeline : TimeLine
    names : sequence of str
        Names of the values.
    n_rows : int
        Rows that will come. Up to 2 for each cell, each row is a cell of its own.
    parts : iterable of (segment, seconds, values)
        Times [s], shape (n,), and values, shape (n, k); NaN for missing ones.
    span : (float, float), optional
        First and last place on the axis [s]; the whole axis by default.
    n_cells : int
        Cells over the axis.

    Returns
    -------
    DataFrame
        One row per cell: time, segment, seconds (mean), n, and of each value its mean, ``_low`` and ``_high``.
    """
    first, last = (0.0, timeline.span) if span is None else span
    found = [_cells(*part, timeline, (first, last), 0 if n_rows <= 2 * n_cells else n_cells) for part in parts]
    segment, number, n, seconds, known, total, low, high = map(np.concatenate, zip(*found, strict=True))
    starts = np.flatnonzero((np.diff(segment, prepend=-1) != 0) | (np.diff(number, prepend=-1) != 0))
    if n_rows <= 2 * n_cells:
        starts = np.arange(len(segment))
    n, seconds, known, total = (np.add.reduceat(column, starts) for column in (n, seconds, known, total))
    low, high = np.fmin.reduceat(low, starts), np.fmax.reduceat(high, starts)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.clip(total / known, low, high)  # a sum's last digit must not lead outside
    seconds = seconds / n
    columns = {"time": timeline.times(seconds), "segment": segment[starts], "seconds": seconds, "n": n.astype(int)}
    for k, name in enumerate(names):
        columns |= {name: mean[:, k], f"{name}_low": low[:, k], f"{name}_high": high[:, k]}
    return pd.DataFrame(columns)


def _cells(
    segment: int, seconds: np.ndarray, values: np.ndarray, timeline: TimeLine, span: tuple[float, float], n_cells: int
) -> tuple[np.ndarray, ...]:
    """Cells of one part: counts, sums and extremes.

    With no cells each row is one.
    """
    place = seconds + timeline.shifts[segment]
    found = np.flatnonzero((place >= span[0]) & (place <= span[1]))
    if not len(found):
        return (np.zeros(0, int),) * 4 + (np.zeros((0, values.shape[1])),) * 4
    inside = slice(max(found[0] - 1, 0), found[-1] + 2)  # a row more on either side: lines reach the edge
    seconds, values, place = seconds[inside], values[inside], place[inside]
    number = np.arange(len(seconds))
    if n_cells:  # the last row ends the last cell
        share = (place - span[0]) / max(span[1] - span[0], 1e-300)
        number = np.minimum(np.floor(n_cells * share), n_cells - 1).astype(int)
    starts = np.flatnonzero(np.diff(number, prepend=number[0] - 1))
    known = np.isfinite(values)
    return (
        np.full(len(starts), segment),
        number[starts],
        np.diff(starts, append=len(number)).astype(float),
        np.add.reduceat(seconds, starts),
        np.add.reduceat(known.astype(float), starts),
        np.add.reduceat(np.where(known, values, 0.0), starts),
        np.fmin.reduceat(values, starts),
        np.fmax.reduceat(values, starts),
    )


def means_of(cells: pd.DataFrame, name: str) -> pd.DataFrame:
    """A value averaged over `MEANS` stretches, to see through noise."""
    each = max(-(-len(cells) // 240), -(-8 * len(cells) // max(int(cells["n"].sum()), 1)))
    kept = cells[np.isfinite(cells[name])]
    if each < 2 or not len(kept):
        return cells
    weight = kept["n"]
    place = kept.groupby("segment").cumcount() // each
    sums = pd.DataFrame(
        {"n": weight, "seconds": weight * kept["seconds"], name: weight * kept[name]}
    ).groupby([kept["segment"], place], sort=False).sum()  # fmt: skip
    found = sums[["seconds", name]].div(sums["n"], axis=0).assign(n=sums["n"])
    return found.reset_index(0).reset_index(drop=True)


def with_breaks(cells: pd.DataFrame, timeline: TimeLine) -> tuple[np.ndarray, pd.DataFrame]:
    """Axis values and cells, with NaN at breaks."""
    segment = cells["segment"].to_numpy()
    where = cells["seconds"].to_numpy() + timeline.shifts[segment]
    steps = np.diff(where)
    usual = np.median(steps) if len(steps) else 0.0
    breaks = np.flatnonzero((np.diff(segment) != 0) | (steps > max(2.5 * usual, 10 * timeline.usual_step))) + 1
    numbers = cells.drop(columns="time", errors="ignore")
    spaced = pd.DataFrame(np.insert(numbers.to_numpy(float), breaks, np.nan, axis=0), columns=numbers.columns)
    return np.insert(timeline.on_axis(where), breaks, np.nan), spaced


def draw_rows(ax: Any, cells: pd.DataFrame, timeline: TimeLine, name: str, colour: str, label: str | None) -> None:
    """Draw rows as dots, cells as strokes."""
    known = cells[np.isfinite(cells[f"{name}_low"])]
    x = timeline.on_axis(known["seconds"].to_numpy() + timeline.shifts[known["segment"].to_numpy()])
    low, high = known[f"{name}_low"].to_numpy(), known[f"{name}_high"].to_numpy()
    least = 1e-3 * float(np.ptp([low.min(), high.max()])) if len(known) else 0.0  # a line without length is not drawn
    gap = np.full(len(known), np.nan)
    xs, ys = (np.column_stack(columns).ravel() for columns in ((x, x, gap), (low, np.maximum(high, low + least), gap)))
    width = 2.6 if len(known) < 400 else 1.8
    ax.plot(xs, ys, color=colour, lw=width, solid_capstyle="round", label=label, zorder=2)


def draw_line(ax: Any, cells: pd.DataFrame, timeline: TimeLine, name: str, colour: str, **how: Any) -> None:
    """Draw the mean of a value over time."""
    x, spaced = with_breaks(cells, timeline)
    ax.plot(x, spaced[name], color=colour, **{"lw": 1.3, "zorder": 3, **how})


def draw_band(ax: Any, cells: pd.DataFrame, timeline: TimeLine, low: str, high: str, colour: str, **how: Any) -> None:
    """Draw a band between two values over time."""
    x, spaced = with_breaks(cells, timeline)
    ax.fill_between(x, spaced[low], spaced[high], color=colour, **{"alpha": 0.25, "lw": 0, "zorder": 2, **how})


def draw_panel(ax: Any, cells: pd.DataFrame, timeline: TimeLine, name: str, colour: str = GREEN) -> None:
    """Draw a value with its range."""
    if (cells["n"] > 1).any():
        draw_band(ax, cells, timeline, f"{name}_low", f"{name}_high", colour)
    draw_line(ax, cells, timeline, name, colour, lw=1.0, marker="." if len(cells) <= 100 else None)

"""`ResidualLoopDisplay`: residual against temperature; loops show lag and hysteresis."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from .axes import (
    BLACK,
    MARKED,
    SEQUENTIAL,
    VERMILION,
    axes_grid,
    cells_of,
    label_values,
    legend_above,
    places,
    plain,
    with_breaks,
)
from .timeline import TimeLine
from .walk import Walk

FINE_CELLS = 20_000
"""Cells of time while a record passes."""
MERGED = (200, 100, 50, 20, 10, 5, 2)
"""Cells that are averaged into one: the first of these numbers that keeps the swings of the temperature."""
KEPT = 0.98
"""Share of the temperature's standard deviation that averaging must keep."""
FEWEST = 250
"""Merging ends before fewer averages than this are left: these can be followed by eye."""
FOLLOWED = 1200
"""Averages up to which the path from one to the next is drawn."""
BINS = 15
"""Bins of temperature of the curves for heating and cooling."""
LEAST_AVERAGES = 3
"""A bin of fewer averages has no mean."""
NAMES = ("temperature", "residual")


class ResidualLoopDisplay:
    """Residual against temperature, coloured by time: a loop is a lag or a hysteresis that the model does not have.

    Long records are averaged over stretches of time that are short beside the swings of the temperature, so that
    loops rise from the noise. Two curves give the mean for rising and for falling temperature: where they part, the
    device is late, or remembers.

    Attributes
    ----------
    curves : DataFrame
        Temperature (middle of a bin), and mean residual while it rises (heating) and falls (cooling).
    ax_, axes_, figure_ : of matplotlib
        After `plot`.
    """

    def __init__(self, cells: pd.DataFrame, timeline: TimeLine, temperature: str, temperature_unit: str, unit: str):
        self.cells = cells
        self.timeline = timeline
        self.temperature = temperature
        self.temperature_unit = temperature_unit
        self.unit = unit
        self.curves = _curves(cells)

    @classmethod
    def from_estimator(cls, model: Any, X: Any, y: Any) -> ResidualLoopDisplay:
        """Create it from a fitted model and a record of any length, in one pass and bounded memory.

        Parameters
        ----------
        model : DynamicBiasRegressor
            Fitted; or a search with a ``best_estimator_``.
        X, y : as for `DynamicBiasRegressor.evaluate_blocks`
        """
        walk = Walk(model, X, y)
        U0 = walk.model.intercept_
        parts = (
            (
                part.segment,
                part.seconds,
                np.column_stack((part.temperature, part.measured - part.contributions.sum(axis=1) - U0)),
            )
            for part in walk.parts()
        )
        fine = cells_of(walk.timeline, NAMES, walk.n_rows, parts, FINE_CELLS)
        reading = walk.model.reading_
        cells = _merged(fine, walk.timeline)
        return cls(cells, walk.timeline, walk.temperature_name, reading.temperature_unit, reading.unit)

    def frame(self) -> pd.DataFrame:
        """The numbers drawn: time, segment, seconds, n, mean temperature and residual of each stretch."""
        return self.cells.copy()

    def plot(self, ax: Any = None) -> ResidualLoopDisplay:
        """Draw in `ax`, or in a new figure."""
        axes = axes_grid(ax, size=(7.4, 4.8))[0]
        only = axes[0]
        ends = self.timeline.on_axis(np.array((0.0, self.timeline.span)))
        followed = len(self.cells) <= FOLLOWED
        if followed:
            self._path(only, ends)
        dots = only.scatter(
            self.cells["temperature"],
            self.cells["residual"],
            c=self.timeline.on_axis(places(self.cells, self.timeline)),
            cmap=SEQUENTIAL,
            vmin=ends[0],
            vmax=ends[1],
            s=18 if len(self.cells) <= MARKED else 8 if followed else 2,
            lw=0,
            zorder=3,
        )
        for name, colour, style in (("heating", VERMILION, "-"), ("cooling", BLACK, "--")):
            if len(self.curves):
                label = f"mean while {name}"
                only.plot(self.curves["temperature"], self.curves[name], style, color=colour, lw=2.2, label=label,
                          zorder=4)  # fmt: skip
        only.axhline(0.0, color="0.4", lw=0.8, zorder=1)
        plain(only)
        label_values(only.xaxis, self.temperature, self.temperature_unit)
        averaged = "residual, averages" if (self.cells["n"] > 1).any() else "residual"
        label_values(only.yaxis, averaged, self.unit)
        legend_above(only)
        bar = only.figure.colorbar(dots, ax=only, pad=0.02, aspect=30)
        self.timeline.dress(bar.ax.yaxis)
        bar.set_label(self.timeline.label())
        self.axes_, self.ax_, self.figure_ = axes, only, only.figure
        return self

    def _path(self, ax: Any, ends: np.ndarray) -> None:
        """Lines from each average to the next of its segment."""
        from matplotlib.collections import LineCollection

        x, spaced = with_breaks(self.cells, self.timeline)
        points = spaced[list(NAMES)].to_numpy()
        lines = np.stack((points[:-1], points[1:]), axis=1)
        whole = np.isfinite(lines).all(axis=(1, 2))
        path = LineCollection(list(lines[whole]), array=x[:-1][whole], cmap=SEQUENTIAL, lw=0.9, alpha=0.6)
        path.set_clim(*ends)
        ax.add_collection(path)


def _merged(fine: pd.DataFrame, timeline: TimeLine) -> pd.DataFrame:
    """Averages over as many neighbouring cells of a segment as leave the swings of the temperature whole."""
    fine = fine[np.isfinite(fine["residual"].to_numpy())].reset_index(drop=True)
    spread = float(np.std(fine["temperature"])) if len(fine) else 0.0
    for factor in MERGED:
        if len(fine) < FEWEST * factor:
            continue
        averages = _averaged(fine, factor)
        weights = averages["n"] / averages["n"].sum()
        mean = float(np.sum(weights * averages["temperature"]))
        if np.sqrt(np.sum(weights * (averages["temperature"] - mean) ** 2)) >= KEPT * spread:
            averages.insert(0, "time", timeline.times(averages["seconds"].to_numpy()))
            return averages
    return fine[["time", "segment", "seconds", "n", *NAMES]]


def _averaged(fine: pd.DataFrame, factor: int) -> pd.DataFrame:
    """Means over `factor` neighbouring cells of a segment, each with the weight of its rows."""
    group = fine.groupby("segment").cumcount() // factor
    weighted = fine[["seconds", *NAMES]].mul(fine["n"], axis=0).assign(n=fine["n"])
    sums = weighted.groupby([fine["segment"], group]).sum().reset_index(level=0).reset_index(drop=True)
    means = sums[["seconds", *NAMES]].div(sums["n"], axis=0)
    return pd.concat((sums[["segment", "n"]], means), axis=1)[["segment", "seconds", "n", *NAMES]]


def _curves(cells: pd.DataFrame) -> pd.DataFrame:
    """Mean residual in bins of temperature, for rising and for falling temperature; empty for few cells."""
    columns = ["temperature", "heating", "cooling"]
    T = cells["temperature"].to_numpy()
    if len(cells) < MARKED or T.min() == T.max():
        return pd.DataFrame(columns=columns, dtype=float)
    inside = cells["segment"].to_numpy()
    change = np.zeros(len(T))  # from the neighbour before to the one behind, ends of segments left out
    whole = inside[2:] == inside[:-2]
    change[1:-1][whole] = (T[2:] - T[:-2])[whole]
    edges = np.linspace(T.min(), T.max(), BINS + 1)
    number = np.clip(np.searchsorted(edges, T, side="right") - 1, 0, BINS - 1)
    curves = {"temperature": (edges[1:] + edges[:-1]) / 2}
    for name, chosen in (("heating", change > 0), ("cooling", change < 0)):
        weight = np.where(chosen, cells["n"], 0.0)
        count = np.bincount(number, weight, BINS)
        sure = np.bincount(number, chosen, BINS) >= LEAST_AVERAGES
        with np.errstate(invalid="ignore"):
            curves[name] = np.where(sure, np.bincount(number, weight * cells["residual"], BINS) / count, np.nan)
    return pd.DataFrame(curves)

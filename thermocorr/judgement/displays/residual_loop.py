"""`ResidualLoopDisplay`: residual against temperature; loops show lag and hysteresis."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from ._cells import cells_of, places, with_breaks
from ._drawing import MARKED, SEQUENTIAL, axes_grid, label_values, labelled, plain
from ._timeline import TimeLine
from ._walk import Walk

LOOP_CELLS = 300
"""Cells of time: enough for loops, few enough for their means to rise from the noise."""
NAMES = ("temperature", "residual")


class ResidualLoopDisplay:
    """Residual against temperature, coloured by time: a loop is a lag or a hysteresis that the model does not have.

    Records of more than 600 rows are drawn as means over 300 stretches of time, so that loops show in the noise.

    Attributes
    ----------
    ax_, axes_, figure_ : of matplotlib
        After `plot`.
    """

    def __init__(self, cells: pd.DataFrame, timeline: TimeLine, temperature: str, temperature_unit: str, unit: str):
        self.cells = cells
        self.timeline = timeline
        self.temperature = temperature
        self.temperature_unit = temperature_unit
        self.unit = unit

    @classmethod
    def from_estimator(cls, model: Any, X: Any, y: Any) -> ResidualLoopDisplay:
        """From a fitted model and a record of any length, in one pass and bounded memory.

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
        cells = cells_of(walk.timeline, NAMES, walk.n_rows, parts, LOOP_CELLS)
        reading = walk.model.reading_
        return cls(cells, walk.timeline, walk.temperature_name, reading.temperature_unit, reading.unit)

    def frame(self) -> pd.DataFrame:
        """The numbers drawn: time, segment, seconds, n, mean temperature and residual of each stretch, and extremes."""
        return self.cells.copy()

    def plot(self, ax: Any = None) -> ResidualLoopDisplay:
        """Draw in `ax`, or in a new figure."""
        from matplotlib.collections import LineCollection

        axes = axes_grid(ax, size=(7.0, 4.8))[0]
        only = axes[0]
        x, spaced = with_breaks(self.cells, self.timeline)
        points = spaced[list(NAMES)].to_numpy()
        lines = np.stack((points[:-1], points[1:]), axis=1)
        whole = np.isfinite(lines).all(axis=(1, 2))
        ends = self.timeline.on_axis(np.array((0.0, self.timeline.span)))
        path = LineCollection(list(lines[whole]), array=x[:-1][whole], cmap=SEQUENTIAL, lw=1.0, alpha=0.7)
        path.set_clim(*ends)
        only.add_collection(path)
        dots = only.scatter(
            self.cells["temperature"],
            self.cells["residual"],
            c=self.timeline.on_axis(places(self.cells, self.timeline)),
            cmap=SEQUENTIAL,
            vmin=ends[0],
            vmax=ends[1],
            s=18 if len(self.cells) <= MARKED else 9,
            lw=0,
            zorder=3,
        )
        only.axhline(0.0, color="0.4", lw=0.8, zorder=1)
        plain(only)
        only.set_xlabel(labelled(self.temperature, self.temperature_unit))
        averaged = "residual, averages" if (self.cells["n"] > 1).any() else "residual"
        label_values(only.yaxis, averaged, self.unit)
        bar = only.figure.colorbar(dots, ax=only, pad=0.02, aspect=30)
        self.timeline.dress(bar.ax.yaxis)
        bar.set_label(self.timeline.label())
        self.axes_, self.ax_, self.figure_ = axes, only, only.figure
        return self

"""`ResidualsDisplay`: readings and model over time, and what is left below."""

from __future__ import annotations

from itertools import repeat
from typing import Any

import numpy as np
import pandas as pd

from ..estimators.time_constants.resolution import CONFIDENCE_95
from .axes import (
    BLUE,
    GREEN,
    GREY,
    SHADE,
    VERMILION,
    axes_grid,
    cells_of,
    draw_cells,
    dress_time,
    label_values,
    legend_above,
    name_runs,
    plain,
    stretches,
    with_breaks,
)
from .protocols import DiagnosisLike
from .timeline import TimeLine
from .walk import Walk

NAMES = ("measured", "modelled", "residual")


class ResidualsDisplay:
    """Measured, modelled and corrected readings over time, residuals below, failing stretches shaded.

    Make it with `from_estimator`. Records of more than 4000 rows are drawn in 2000 cells of
    time: the mean as a line, lowest to highest value as a band, so that no spike is hidden.

    Attributes
    ----------
    ax_, axes_, figure_ : of matplotlib
        After `plot`: upper axes, both axes, figure.
    """

    def __init__(
        self,
        cells: pd.DataFrame,
        timeline: TimeLine,
        name: str,
        unit: str,
        failing: list[tuple[float, float]] | None = None,
        noise_floor: float | None = None,
    ):
        self.cells = cells
        self.timeline = timeline
        self.name = name
        self.unit = unit
        self.failing = failing or []
        self.noise_floor = noise_floor

    @classmethod
    def from_estimator(
        cls, model: Any, X: Any, y: Any, diagnosis: DiagnosisLike | None = None, *, uncertainty: bool = False
    ) -> ResidualsDisplay:
        """Create it from a fitted model and a record of any length, in one pass and bounded memory.

        Parameters
        ----------
        model : DynamicBiasRegressor
            Fitted; or a search with a ``best_estimator_``.
        X, y : as for `DynamicBiasRegressor.evaluate_blocks`
        diagnosis : DiagnosisLike, optional
            Of the same model and record: its worst stretches of time are shaded, its noise floor is drawn.
        uncertainty : bool, default False
            Draw a band around the residuals that holds 95 % of them, from ``predict(X, return_std=True)``.
        """
        walk = Walk(model, X, y)
        U0 = walk.model.intercept_
        names = (*NAMES, "corrected", *(["u"] if uncertainty else []))

        def parts() -> Any:
            stated = walk.uncertainties() if uncertainty else repeat(None)
            for part, u in zip(walk.parts(), stated, strict=False):
                modelled = part.contributions.sum(axis=1) + U0
                values = [part.measured, modelled, part.measured - modelled, walk.corrected(part)]
                yield part.segment, part.seconds, np.column_stack(values if u is None else [*values, u])

        cells = cells_of(walk.timeline, names, walk.n_rows, parts())
        failing = [] if diagnosis is None else stretches(diagnosis, walk.timeline)
        reading = walk.model.reading_
        floor = None if diagnosis is None else diagnosis.noise_floor
        return cls(
            cells=cells,
            timeline=walk.timeline,
            name=reading.name,
            unit=reading.unit,
            failing=failing,
            noise_floor=floor,
        )

    def frame(self) -> pd.DataFrame:
        """The numbers drawn: one row per cell of time, every row of the record up to 4000 rows.

        Columns time (dates, else seconds since the first row), segment, seconds, n (rows in the cell), and of each of
        measured, modelled, residual and corrected (and ``u``, the standard uncertainty of a
        reading, where it was asked for) its mean and its extremes ``_low`` and ``_high``.
        """
        return self.cells.copy()

    def plot(self, ax: Any = None) -> ResidualsDisplay:
        """Draw; `ax` may be one Axes, whose place is divided, or two."""
        axes = axes_grid(ax, 2, size=(9.0, 5.4), sharex=True, height_ratios=(3, 2))[:, 0]
        top, bottom = axes
        draw_cells(top, self.cells, self.timeline, "measured", BLUE, "measured", lw=1.8)
        draw_cells(top, self.cells, self.timeline, "modelled", VERMILION, "modelled")
        if "corrected" in self.cells:
            draw_cells(top, self.cells, self.timeline, "corrected", GREEN, "corrected")
        draw_cells(bottom, self.cells, self.timeline, "residual", BLUE)
        bottom.axhline(0.0, color="0.4", lw=0.8, zorder=1)
        if "u" in self.cells:
            x, spaced = with_breaks(self.cells, self.timeline)
            half = CONFIDENCE_95 * spaced["u"]
            bottom.fill_between(x, -half, half, color=GREY, alpha=0.25, lw=0, zorder=1, label="95 % of readings")
        if self.noise_floor is not None:
            for sign in (-2, 2):
                label = "noise floor, two standard deviations" if sign > 0 else None
                bottom.axhline(sign * self.noise_floor, color=GREY, lw=1.0, ls="--", zorder=4, label=label)
        for number, (low, high) in enumerate(self.failing):
            for axes_ in axes:
                x = self.timeline.on_axis(np.array((low, high)))
                label = "fails most" if number == 0 and axes_ is top else None
                axes_.axvspan(*x, color=SHADE, alpha=0.45, lw=0, zorder=0, label=label)
        for axes_ in axes:
            plain(axes_)
            axes_.margins(x=0.01)
            dress_time(axes_, self.timeline, labels=axes_ is bottom)
        label_values(top.yaxis, self.name, self.unit)
        label_values(bottom.yaxis, "residual", self.unit)
        top.tick_params(labelbottom=False)
        name_runs(top, self.timeline)
        legend_above(top)
        legend_above(bottom, fontsize="small")
        top.figure.align_ylabels(axes)
        self.axes_, self.ax_, self.figure_ = axes, top, top.figure
        return self

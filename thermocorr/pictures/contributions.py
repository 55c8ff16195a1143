"""What each effect adds, and what the late parts of the device feel."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pandas as pd

from ..records.numbers import quantity_text, span_text
from ..records.units import difference_unit
from .axes import COLOURS, axes_grid, cells_of, draw_cells, dress_time, label_values, legend_above, name_runs, plain
from .timeline import TimeLine
from .walk import Walk

MOST_PANELS = 8
"""Effects that get a panel; the smallest of more are added together."""


class ContributionsDisplay:
    """Contribution of each effect over time, the largest first, one panel each.

    Attributes
    ----------
    rms : Series
        Root mean square of each effect's contribution about its mean, the largest first, in the unit of the reading.
    ax_, axes_, figure_ : of matplotlib
        After `plot`.
    """

    def __init__(self, cells: pd.DataFrame, timeline: TimeLine, rms: pd.Series, unit: str):
        self.cells = cells
        self.timeline = timeline
        self.rms = rms
        self.unit = unit

    @classmethod
    def from_estimator(cls, model: Any, X: Any) -> ContributionsDisplay:
        """Create it from a fitted model and a record of any length, in one pass and bounded memory.

        Parameters
        ----------
        model : DynamicBiasRegressor
            Fitted; or a search with a ``best_estimator_``.
        X : as for `DynamicBiasRegressor.contributions`
        """
        walk = Walk(model, X)
        labels = walk.labels()
        count = np.zeros(1)
        moments = np.zeros((2, len(labels)))

        def parts() -> Any:
            for part in walk.parts():
                known = part.contributions[np.isfinite(part.contributions).all(axis=1)]
                count[:] += len(known)
                moments[:] += known.sum(axis=0), np.einsum("ij,ij->j", known, known)
                yield part.segment, part.seconds, part.contributions

        cells = cells_of(walk.timeline, labels, walk.n_rows, parts())
        mean, square = moments / np.maximum(count, 1)
        rms = pd.Series(np.sqrt(np.maximum(square - mean**2, 0.0)), index=labels, name="rms")
        return cls(cells, walk.timeline, rms.sort_values(ascending=False, kind="stable"), walk.model.reading_.unit)

    def frame(self) -> pd.DataFrame:
        """The numbers drawn: time, segment, seconds, n, and of each effect its mean, ``_low`` and ``_high``.

        One row per cell of time; every row of the record up to 4000 rows.
        """
        return self.cells.copy()

    def plot(self, ax: Any = None) -> ContributionsDisplay:
        """Draw one panel per effect; `ax` may be one Axes, whose place is divided, or one for each effect."""
        labels = self.rms.index[:MOST_PANELS]
        axes = axes_grid(ax, len(labels), size=(9.0, 1.0 + 1.5 * len(labels)), sharex=True)[:, 0]
        for axes_, label, colour in zip(axes, labels, (COLOURS * 2)[: len(labels)], strict=True):
            draw_cells(axes_, self.cells, self.timeline, label, colour)
            plain(axes_)
            axes_.margins(x=0.01)
            dress_time(axes_, self.timeline, labels=axes_ is axes[-1])
            label_values(axes_.yaxis, "adds", self.unit)
            axes_.set_title(f"{label}: rms {quantity_text(self.rms[label], self.unit)}", loc="left", fontsize=10)
            axes_.tick_params(labelbottom=axes_ is axes[-1])
        name_runs(axes[0], self.timeline)
        axes[0].figure.align_ylabels(axes)
        self.axes_, self.ax_, self.figure_ = axes, axes[0], axes[0].figure
        return self


MOST_LINES = 8
"""Time constants that are drawn, evenly over all."""
AMBIENT = "ambient"
KINDS = ("temperature", "start", "difference")


class InnerTemperaturesDisplay:
    """Ambient and inner temperatures, what is left of their starts, and inner less ambient temperature, over time.

    Attributes
    ----------
    ax_, axes_, figure_ : of matplotlib
        After `plot`.
    """

    def __init__(self, cells: pd.DataFrame, timeline: TimeLine, time_constants: np.ndarray, name: str, unit: str):
        self.cells = cells
        self.timeline = timeline
        self.time_constants = time_constants
        self.name = name
        self.unit = unit

    @classmethod
    def from_estimator(cls, model: Any, X: Any) -> InnerTemperaturesDisplay:
        """Create it from a fitted model and a record of any length, in one pass and bounded memory.

        Parameters
        ----------
        model : DynamicBiasRegressor
            Fitted, with lags; or a search with a ``best_estimator_``.
        X : as for `DynamicBiasRegressor.inner_temperatures`

        Raises
        ------
        ValueError
            For a model without lags.
        """
        walk = Walk(model, X)
        taus = np.asarray(walk.model.time_constants_, float)
        chosen = np.unique(np.linspace(0, len(taus) - 1, min(len(taus), MOST_LINES)).round().astype(int))
        names = [AMBIENT, *(f"{kind} {span_text(tau)}" for kind in KINDS for tau in taus[chosen])]

        def parts() -> Iterator[tuple[int, np.ndarray, np.ndarray]]:
            for segment, seconds, ambient, inner in walk.inner():
                each = [part[:, chosen] for part in (inner.temperature, inner.start, inner.difference)]
                yield segment, seconds, np.column_stack((ambient, *each))

        cells = cells_of(walk.timeline, names, walk.n_rows, parts())
        return cls(cells, walk.timeline, taus[chosen], walk.temperature_name, walk.model.reading_.temperature_unit)

    def frame(self) -> pd.DataFrame:
        """The numbers drawn: time, segment, seconds, n, and of each temperature its mean, ``_low`` and ``_high``.

        One row per cell of time; every row of the record up to 4000 rows.
        """
        return self.cells.copy()

    def plot(self, ax: Any = None) -> InnerTemperaturesDisplay:
        """Draw three panels; `ax` may be one Axes, whose place is divided, or three."""
        axes = axes_grid(ax, 3, size=(9.0, 7.5), sharex=True)[:, 0]
        colours = (COLOURS * 2)[: len(self.time_constants)]
        draw_cells(axes[0], self.cells, self.timeline, AMBIENT, "0.55", label=AMBIENT)
        for axes_, kind in zip(axes, KINDS, strict=True):
            for tau, colour in zip(self.time_constants, colours, strict=True):
                label = span_text(tau) if kind == KINDS[0] else None
                draw_cells(axes_, self.cells, self.timeline, f"{kind} {span_text(tau)}", colour, label=label)
            plain(axes_)
            axes_.margins(x=0.01)
            dress_time(axes_, self.timeline, labels=axes_ is axes[-1])
            axes_.tick_params(labelbottom=axes_ is axes[-1])
        degree = difference_unit(self.unit)
        said = ((self.name, self.unit), ("left of the start", degree), ("inner less ambient", degree))
        for axes_, (name, unit) in zip(axes, said, strict=True):
            label_values(axes_.yaxis, name, unit)
        legend_above(axes[0], ncols=5)
        name_runs(axes[0], self.timeline)
        axes[0].figure.align_ylabels(axes)
        self.axes_, self.ax_, self.figure_ = axes, axes[0], axes[0].figure
        return self

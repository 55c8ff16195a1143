"""`ContributionsDisplay`: what each effect adds to the reading over time."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from ..records.numbers import quantity_text
from .axes import COLOURS, axes_grid, cells_of, draw_cells, dress_time, label_values, name_runs, plain
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

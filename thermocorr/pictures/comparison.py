"""`VariantsDisplay`: the paper's comparison of static and dynamic, linear and nonlinear corrections."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from ..effects.thermal import column_text
from ..equations import moving_average
from ..estimators.variants import VariantComparison
from ..records import Record
from ..records.numbers import quantity_text, scale_of
from .axes import BLACK, COLOURS, MARKED, axes_grid, cells_of, draw_cells, dress_time, label_values, labelled, plain
from .timeline import TimeLine
from .walk import without_times

READING = "before correction"


class VariantsDisplay:
    """Reading before and after each variant's correction, over time and against temperature.

    The paper's figures 4 to 11 for any record: corrected readings less U0, smoothed by a moving average, eqs. (9)
    (26). All corrections have the same scale.

    Attributes
    ----------
    ax_, axes_, figure_ : of matplotlib
        After `plot`.
    """

    def __init__(
        self,
        cells: pd.DataFrame,
        timeline: TimeLine,
        table: pd.DataFrame,
        window: int,
        temperature: tuple[str, str],
        reading: tuple[str, str],
    ):
        self.cells = cells
        self.timeline = timeline
        self.table = table
        self.window = window
        self.temperature = temperature
        self.reading = reading

    @classmethod
    def from_comparison(cls, comparison: VariantComparison) -> VariantsDisplay:
        """Create it from what `compare_variants` found."""
        record = comparison.record
        if record is None or record.reading is None:
            raise ValueError("The comparison does not hold its record. Make it with compare_variants(X, y).")
        model = comparison.models["static linear"]
        zone = getattr(comparison.residuals.index, "tz", None)
        timeline = TimeLine.of(record, zone, without_times(model))
        names = [READING, *comparison.residuals.columns, "temperature"]
        cells = cells_of(timeline, names, record.n_used, _parts(record, comparison))
        reading = model.reading_
        temperature = (column_text(record.temperature_name), reading.temperature_unit)
        return cls(
            cells=cells,
            timeline=timeline,
            table=comparison.frame(),
            window=comparison.window,
            temperature=temperature,
            reading=(reading.name, reading.unit),
        )

    def frame(self) -> pd.DataFrame:
        """The numbers drawn, smoothed: one row per cell of time; every row of the record up to 4000 rows.

        Columns time, segment, seconds, n; "before correction" (less its mean), the corrected reading of each variant
        (less U0) and the temperature, each with its extremes ``_low`` and ``_high`` in the cell.
        """
        return self.cells.copy()

    def plot(self, ax: Any = None) -> VariantsDisplay:
        """Draw; `ax` may be one Axes, whose place is divided, or two for each variant and for the reading."""
        variants = [name for name in self.table.index if name != READING]
        rows = [READING, *variants]
        axes = axes_grid(ax, len(rows), 2, size=(11.0, 1.9 * len(rows) + 0.6), sharex="col", width_ratios=(3, 1.4))
        for (left, right), name, colour in zip(axes, rows, (BLACK, *COLOURS), strict=False):
            draw_cells(left, self.cells, self.timeline, name, colour, lw=0.9)
            size = 7 if len(self.cells) <= MARKED else 2.5
            right.plot(self.cells["temperature"], self.cells[name], ".", ms=size, color=colour, alpha=0.6)
            left.set_title(self._title(name), loc="left", fontsize=10)
            left.margins(x=0.01)
        axes[0, 1].set_ylim(axes[0, 0].get_ylim())
        self._share_scale(axes[1:], variants)
        for i, (left, right) in enumerate(axes):
            last = i == len(rows) - 1
            dress_time(left, self.timeline, labels=last)
            for axes_ in (left, right):
                plain(axes_)
                axes_.tick_params(labelbottom=last)
            label_values(left.yaxis, self.reading[0] if i == 0 else "corrected", self.reading[1])
            label_values(right.yaxis, "", "")
            right.set_ylabel("")
            right.tick_params(labelleft=False)
            right.locator_params(axis="x", nbins=4)
        axes[0, 0].figure.align_ylabels(axes[:, 0])
        axes[-1, 1].set_xlabel(labelled(*self.temperature))
        axes[0, 1].set_title("against temperature", loc="left", fontsize=10)
        self.axes_, self.ax_, self.figure_ = axes, axes[0, 0], axes[0, 0].figure
        return self

    def _title(self, name: str) -> str:
        figures: Any = self.table.loc[name]
        unit = self.reading[1]
        if name == READING:
            smoothing = f"curves: moving average of {self.window} samples"
            return f"{name}, less its mean: std {quantity_text(figures['std'], unit)} ({smoothing})"
        scale = scale_of(self.table["std_smoothed"].drop(READING), unit)
        return f"{name}: std {scale.text(figures['std_smoothed'])}, {figures['reduction_db']:.1f} dB"

    def _share_scale(self, axes: np.ndarray, variants: list[str]) -> None:
        """One scale for all corrections, on both sides."""
        ends = [self.cells[f"{name}_{end}"] for name in variants for end in ("low", "high")]
        low, high = float(np.nanmin(ends)), float(np.nanmax(ends))
        room = 0.05 * (high - low) or 1.0
        for axes_ in axes.flat:
            axes_.set_ylim(low - room, high + room)


def _parts(record: Record, comparison: VariantComparison) -> Any:
    """Smoothed columns, segment by segment: the moving average does not reach over a joint."""
    assert record.reading is not None
    reading = np.asarray(record.reading, float)
    columns = [reading - np.nanmean(reading), *comparison.residuals.to_numpy().T]
    temperature = np.asarray(record.columns[record.temperature_name], float)
    for number, segment in enumerate(record.segments):
        rows = record.rows(segment.start, segment.stop)
        seconds = record.times.seconds(rows, record.first_stamp())
        smooth = [moving_average(column[rows], comparison.window) for column in columns]
        yield number, seconds, np.column_stack([*smooth, temperature[rows]])

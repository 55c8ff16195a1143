"""`ResidualsDisplay`: readings and model over time, and what is left below."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import repeat
from typing import Any, Self

import numpy as np
import pandas as pd

from ..equations import AllanDeviation, allan_deviation, regular_cells
from ..estimators.time_constants.search import CONFIDENCE_95
from ..records import Record
from ..records.errors import printable
from ..records.numbers import quantity_texts, span_text
from .axes import (
    BLUE,
    GREEN,
    GREY,
    SHADE,
    VERMILION,
    Display,
    TimeLine,
    Walk,
    axes_grid,
    cells_of,
    draw_cells,
    dress_time,
    label_log_values,
    label_values,
    legend_above,
    log_time_axis,
    name_runs,
    plain,
    regressor_of,
    stretches,
    where_read,
    with_breaks,
)

TRACES = ("measured", "modelled", "residual")


@dataclass(eq=False)
class ResidualsDisplay(Display):
    """Measured, modelled and corrected readings over time, residuals below, failing stretches shaded.

    Make it with `from_estimator`. Records of more than 4000 rows are drawn in 2000 cells of
    time: the mean as a line, lowest to highest value as a band, so that no spike is hidden.

    Attributes
    ----------
    ax_, axes_, figure_ : of matplotlib
        After `plot`: upper axes, both axes, figure.
    """

    cells: pd.DataFrame
    timeline: TimeLine
    name: str
    unit: str
    failing: list[tuple[float, float]] = field(default_factory=list)
    noise_floor: float | None = None

    @classmethod
    def from_estimator(
        cls, model: Any, X: Any, y: Any, diagnosis: Any = None, *, uncertainty: bool = False
    ) -> ResidualsDisplay:
        """Create it from a fitted model and a record.

        Parameters
        ----------
        model : DynamicBiasRegressor
            Fitted; or a search with a ``best_estimator_``.
        X, y : as for `DynamicBiasRegressor.evaluate_blocks`
        diagnosis : Diagnosis, optional
            Of the same model and record: its worst stretches of time are shaded, its noise floor is drawn.
        uncertainty : bool, default False
            Draw a band around the residuals that holds 95 % of them, from ``predict(X, return_std=True)``.
        """
        walk = Walk(model, X, y)
        names = (*TRACES, "corrected", *(["u"] if uncertainty else []))

        def parts() -> Any:
            stated = walk.uncertainties() if uncertainty else repeat(None)
            for part, u in zip(walk.parts(), stated, strict=False):
                modelled = where_read(part.modelled, part.measured)
                values = [part.measured, modelled, part.measured - part.modelled, walk.corrected(part)]
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

    def plot(self, ax: Any = None) -> Self:
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
        return self._drawn(axes, top)


def added_noise(model: Any, X: Any, y: Any) -> str:
    """A sentence on the averaging times at which a correction adds noise, and the column that does it; "" for none.

    `model` (DynamicBiasRegressor): Fitted; or a search with a ``best_estimator_``. `X`, `y` (as for
    `DynamicBiasRegressor.evaluate`): A frame or an array.

    Examples
    --------
    >>> from thermocorr import DynamicBiasRegressor
    >>> from thermocorr.datasets import make_record
    >>> record = make_record(2000, seed=1)
    >>> X, y = record[["temperature"]], record["reading"]
    >>> added_noise(DynamicBiasRegressor("temperature", ["5 min", "90 min"]).fit(X, y), X, y)
    ''
    """
    fitted = regressor_of(model)
    if fitted.reference is not None:  # the measurand moves, and its motion is no noise
        return ""
    return added_noise_shown(AllanDisplay.from_estimator(fitted, X, y), fitted, X)


def added_noise_shown(display: AllanDisplay, model: Any, X: Any) -> str:
    """Sentence of `added_noise` from an existing display; no column is named for a log in a file."""
    before, after = display.before, display.after
    n = min(len(before.deviation), len(after.deviation))
    ratio = after.deviation[:n] / np.maximum(before.deviation[:n], 1e-300)
    # Allan deviation after over before, from which the correction adds noise: ten per cent of the variance
    # Degrees of freedom from which the two are compared: their ratio is known far better than either, since they share
    # their noise
    worse = (ratio > 1.05) & (np.minimum(before.degrees_of_freedom, after.degrees_of_freedom)[:n] >= 30)
    if not worse.any():
        return ""
    at = int(np.argmax(np.where(worse, ratio, 0.0)))
    tau, last = float(after.averaging_times[at]), float(after.averaging_times[:n][worse].max())
    now, then = quantity_texts([after.deviation[at], before.deviation[at]], display.unit, 2)
    said = (
        f"At averaging times up to {_times(last, display)} the correction adds noise: Allan deviation "
        f"{now} after and {then} before at {_times(tau, display)}"
    )
    through = _loudest(model, X, tau / float(after.averaging_times[0]))
    return printable(f"{said}, most of it through {through}, which passes on the noise of its input.")


def _times(seconds: float, display: AllanDisplay) -> str:
    return f"{seconds:.0f} samples" if display.samples else span_text(seconds)


def _loudest(model: Any, X: Any, n_rows: float) -> str:
    """Name of the column whose contribution has the largest Allan deviation at an averaging time [rows]."""
    record = Walk(model, X).record
    longest = record.longest()
    rows = record.rows(longest.start, min(longest.stop, longest.start + LOOKED_AT))
    columns = np.asarray(model.features_.transform(X.iloc[rows] if hasattr(X, "iloc") else X[rows]), float)
    removed = np.concatenate(
        [np.full(effect.n_columns(), effect.removed_by_correct) for effect in model.features_.effect_list()]
    )
    made = columns * model.coef_ * removed
    sizes = [allan_deviation(part[np.isfinite(part)], 1.0, [round(n_rows)]).deviation for part in made.T]
    return str(model.features_.get_feature_names_out()[int(np.argmax([s[0] if len(s) else 0.0 for s in sizes]))])


LOOKED_AT = 1 << 14
"""Rows whose steps are looked at."""


@dataclass(eq=False)
class AllanDisplay(Display):
    """Overlapping Allan deviation of the reading before and after correction, with confidence bands.

    The dashed line is what white noise alone would give, from the corrected reading's shortest averaging time. Where a
    curve leaves it, longer averaging no longer helps. Irregular times are averaged into regular cells, gaps are left
    out, see `thermocorr.equations.allan`.

    Attributes
    ----------
    before, after : AllanDeviation
    """

    before: AllanDeviation
    after: AllanDeviation
    name: str
    unit: str
    confidence: float = 0.95
    samples: bool = False

    @classmethod
    def from_estimator(
        cls, model: Any, X: Any, y: Any, *, averaging_times: Any = "octave", confidence: float = 0.95
    ) -> AllanDisplay:
        """Create it from a fitted model and a record.

        Parameters
        ----------
        model : DynamicBiasRegressor
            Fitted; or a search with a ``best_estimator_``.
        X, y : as for `DynamicBiasRegressor.evaluate_blocks`
        averaging_times : {"octave", "log"} or sequence of float
            Factors of 2 from one another, or eight per factor of 10; or the times themselves [s].
        confidence : float
            Probability of the bands.
        """
        walk = Walk(model, X, y)
        step = cell_length(walk.record)
        parts = [(part, walk.corrected(part)) for part in walk.parts()]
        pieces = np.concatenate([np.full(len(part.seconds), part.segment) for part, _ in parts])
        piece = pd.factorize(pd.Series(walk.timeline.runs, dtype=object))[0][pieces]
        seconds = np.concatenate([part.seconds for part, _ in parts])
        gap = max(walk.n_rows // 100, 1000)  # a longer one begins another piece
        before, after = (
            allan_deviation(
                regular_cells(piece, seconds, np.concatenate(values), step, gap), step, averaging_times, confidence
            )
            for values in ([part.measured for part, _ in parts], [corrected for _, corrected in parts])
        )
        reading = walk.model.reading_
        return cls(
            before=before,
            after=after,
            name=reading.name,
            unit=reading.unit,
            confidence=confidence,
            samples=walk.timeline.samples,
        )

    def frame(self) -> pd.DataFrame:
        """One row per averaging time [s]: deviation, low, high, degrees of freedom and noise exponent, of both."""
        frames = [
            pd.DataFrame(vars(found)).set_index("averaging_times").add_suffix(f"_{name}")
            for name, found in (("before", self.before), ("after", self.after))
        ]
        return pd.concat(frames, axis=1).reset_index().rename(columns={"averaging_times": "averaging_time"})

    def plot(self, ax: Any = None) -> Self:
        """Draw in `ax`, or in a new figure."""
        axes = axes_grid(ax, size=(7.0, 4.6))[0]
        only = axes[0]
        for found, colour, label, marker in (
            (self.before, VERMILION, "before correction", "s"),
            (self.after, BLUE, "after", "o"),
        ):
            only.plot(found.averaging_times, found.deviation, f"{marker}-", color=colour, ms=4, lw=1.4, label=label)
            band = None if found is self.before else f"{100 * self.confidence:g} % confidence"
            only.fill_between(found.averaging_times, found.low, found.high, color=colour, alpha=0.2, lw=0, label=band)
        first = self.after.averaging_times[:1]
        times = np.unique(np.concatenate((self.before.averaging_times, self.after.averaging_times)))
        if len(first):
            white = self.after.deviation[0] * np.sqrt(first[0] / times)
            only.plot(times, white, "--", color=GREY, lw=1.2, label="white noise", zorder=1)
        else:
            only.text(0.5, 0.5, "Too few readings in a row to compare.", ha="center", transform=only.transAxes)
        only.set_yscale("log")
        plain(only)
        log_time_axis(only, "averaging time", self.samples)
        label_log_values(only.yaxis, f"Allan deviation of {self.name}", self.unit)
        legend_above(only)
        return self._drawn(axes, only)


def cell_length(record: Record) -> float:
    """The sampling step [s]; where steps differ much, one that nine in ten of them do not exceed."""
    longest = record.longest()
    rows = record.rows(longest.start, min(longest.stop, longest.start + LOOKED_AT))
    steps = record.times.steps(rows)[1:]
    usual, wide = record.usual_step(), float(np.quantile(steps, 0.9)) if len(steps) else 0.0
    # Step that nine in ten do not exceed, over the usual one, above which steps differ much
    return wide if wide > 1.5 * usual else usual

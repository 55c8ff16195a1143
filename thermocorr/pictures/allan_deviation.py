"""Allan deviation of residuals, and the noise that a correction adds."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from ..equations import AllanDeviation, AllanStream, allan_deviation
from ..records import Log, Record
from ..records.errors import printable
from ..records.numbers import quantity_texts, span_text
from .axes import BLUE, GREY, VERMILION, axes_grid, label_log_values, legend_above, log_time_axis, plain
from .walk import Walk, regressor_of

WORTH_A_WORD = 1.05
"""Allan deviation after over before, from which the correction adds noise: ten per cent of the variance."""
KNOWN = 30
"""Degrees of freedom from which the two are compared: their ratio is known far better than either, since they share
their noise."""


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
    return added_noise_shown(AllanDisplay.from_estimator(fitted, X, y), fitted, X)


def added_noise_shown(display: AllanDisplay, model: Any, X: Any) -> str:
    """What `added_noise` says, from a display of what the model makes of X; no column is named for a log in a file."""
    before, after = display.before, display.after
    n = min(len(before.deviation), len(after.deviation))
    ratio = after.deviation[:n] / np.maximum(before.deviation[:n], 1e-300)
    worse = (ratio > WORTH_A_WORD) & (np.minimum(before.degrees_of_freedom, after.degrees_of_freedom)[:n] >= KNOWN)
    if not worse.any():
        return ""
    at = int(np.argmax(np.where(worse, ratio, 0.0)))
    tau, last = float(after.averaging_times[at]), float(after.averaging_times[:n][worse].max())
    now, then = quantity_texts([after.deviation[at], before.deviation[at]], display.unit, 2)
    said = (
        f"At averaging times up to {_times(last, display)} the correction adds noise: Allan deviation "
        f"{now} after and {then} before at {_times(tau, display)}"
    )
    if isinstance(X, Log):
        return f"{said}."
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
UNEVEN = 1.5
"""Step that nine in ten do not exceed, over the usual one, above which steps differ much."""


class AllanDisplay:
    """Overlapping Allan deviation of the reading before and after correction, with confidence bands.

    The dashed line is what white noise alone would give, from the corrected reading's shortest averaging time. Where a
    curve leaves it, longer averaging no longer helps. Irregular times are averaged into regular cells, gaps are left
    out, see `thermocorr.equations.allan`.

    Attributes
    ----------
    before, after : AllanDeviation
    ax_, axes_, figure_ : of matplotlib
        After `plot`.
    """

    def __init__(
        self,
        before: AllanDeviation,
        after: AllanDeviation,
        name: str,
        unit: str,
        confidence: float = 0.95,
        samples: bool = False,
    ):
        self.before = before
        self.after = after
        self.name = name
        self.unit = unit
        self.confidence = confidence
        self.samples = samples

    @classmethod
    def from_estimator(
        cls, model: Any, X: Any, y: Any, *, averaging_times: str = "octave", confidence: float = 0.95
    ) -> AllanDisplay:
        """Create it from a fitted model and a record of any length, in one pass and bounded memory.

        Parameters
        ----------
        model : DynamicBiasRegressor
            Fitted; or a search with a ``best_estimator_``.
        X, y : as for `DynamicBiasRegressor.evaluate_blocks`
        averaging_times : {"octave", "log"}
            Factors of 2 from one another, or eight per factor of 10.
        confidence : float
            Probability of the bands.
        """
        walk = Walk(model, X, y)
        step = cell_length(walk.record)
        gap = max(walk.n_rows, 1)
        length = min(walk.record.times.between(*_ends(walk)) / step, walk.n_rows * (gap + 1))  # longer gaps are cut out
        n_cells = max(int(length), walk.n_rows)
        streams = [AllanStream(step, n_cells, gap, averaging_times, confidence) for _ in range(2)]
        for part in walk.parts():
            for stream, values in zip(streams, (part.measured, walk.corrected(part)), strict=True):
                stream.add(walk.timeline.runs[part.segment], part.seconds, values)
        before, after = (stream.result() for stream in streams)
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

    def plot(self, ax: Any = None) -> AllanDisplay:
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
        self.axes_, self.ax_, self.figure_ = axes, only, only.figure
        return self


def cell_length(record: Record) -> float:
    """The sampling step [s]; where steps differ much, one that nine in ten of them do not exceed."""
    longest = record.longest()
    rows = record.rows(longest.start, min(longest.stop, longest.start + LOOKED_AT))
    steps = record.times.steps(rows)[1:]
    usual, wide = record.usual_step(), float(np.quantile(steps, 0.9)) if len(steps) else 0.0
    return wide if wide > UNEVEN * usual else usual


def _ends(walk: Walk) -> tuple[float, float]:
    """Stamps of the last and of the first row."""
    stamps = [walk.record.stamp(k) for s in walk.record.segments for k in (s.start, s.stop - 1)]
    return max(stamps), min(stamps)

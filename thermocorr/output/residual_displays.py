"""Pictures of residuals: over time, conditions, averages."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np
import pandas as pd

from ..effects import Rate, ThermalLag
from ..effects.stream import own_starts, walk
from ..effects.thermal import column_text
from ..equations import AllanDeviation, allan_deviation, regular_cells
from ..model.regressor import largest_lag
from ..model.search import CONFIDENCE_95
from ..records import Record
from ..records.errors import printable
from ..records.numbers import quantity_texts, span_text
from ..records.units import difference_unit, unit_of
from .axes import Display, label_values, labelled, legend_above, log_time_axis
from .curves import N_CELLS, Curves, Part, cells_of, draw_band, draw_line, draw_panel, draw_rows, means_of, regressor_of
from .style import BLUE, GREEN, ORANGE, PURPLE, SKY, SOFT, TEXT, VERMILION, YELLOW
from .timeline import TimeLine, dress_time, name_runs, stretches


@dataclass(eq=False)
class ResidualsDisplay(Display):
    """Readings and model over time, the residual below.

    Make it with `from_estimator`. Of more than 2000 rows, each of 1000 cells of time has a stroke from its lowest to
    its highest value, so that no spike is hidden. The dark line in the residual is its mean over short stretches.

    Attributes
    ----------
    ax_, axes_, figure_ : of matplotlib
        After `plot`: first axes, all axes, figure.
    """

    alt: ClassVar[str] = "readings and model over time, and what the model leaves"
    stacked: ClassVar[bool] = True
    cells: pd.DataFrame
    timeline: TimeLine
    name: str
    unit: str
    columns: tuple[tuple[str, str], ...] = ()
    """Names and units of recorded columns that are drawn below."""
    failing: list[tuple[float, float]] = field(default_factory=list)
    noise_floor: float | None = None
    others: dict[str, pd.DataFrame] = field(default_factory=dict)
    """What other models leave: cells with a column ``residual``."""
    span: tuple[float, float] | None = None

    @classmethod
    def from_estimator(
        cls,
        model: Any,
        X: Any,
        y: Any,
        diagnosis: Any = None,
        *,
        uncertainty: bool = False,
        columns: Sequence[Any] = (),
        others: Mapping[str, Any] | None = None,
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
            Draw bands that hold 95 % of the readings, from ``predict(X, return_std=True)``.
        columns : sequence of column names
            Recorded columns, such as the temperature, that are drawn below.
        others : dict of str to fitted models, optional
            Models to compare with: the mean of what each leaves is drawn as a line.
        """
        curves = Curves(model, X, y, uncertainty=uncertainty)
        more = {label: Curves(other, X, y) for label, other in (others or {}).items()}
        return cls.of(curves, diagnosis, columns=columns, others=more)

    @classmethod
    def of(
        cls,
        curves: Curves,
        diagnosis: Any = None,
        *,
        columns: Sequence[Any] = (),
        others: Mapping[str, Curves] | None = None,
        span: tuple[float, float] | None = None,
        learned: np.ndarray | None = None,
        levels: bool = True,
        n_cells: int = N_CELLS,
    ) -> ResidualsDisplay:
        """Create it from curves.

        `span` (pair of float): Between two places on the axis [s]. `learned` (array of bool): The rows that the model
        was learned from; others are drawn grey. `levels` (bool): False draws readings less the level of their run.
        `n_cells` (int): Over the axis.
        """
        names = ["measured", "modelled", "residual", "corrected", "left out", "low", "high"]
        names += [f"column {name}" for name in columns]

        def values(part: Part) -> np.ndarray:
            level = 0.0 if levels else curves.level(part)
            out = np.zeros(len(part.seconds), bool) if learned is None else ~learned[part.rows]
            half = np.nan if part.u is None else CONFIDENCE_95 * part.u
            own = [np.where(out, np.nan, column) for column in (part.measured, part.residual, part.corrected)]
            rows = [own[0] - level, part.modelled - level, own[1], own[2] - level]
            rows += [np.where(out, part.measured, np.nan) - level, part.modelled - level - half]
            rows += [part.modelled - level + half, *(curves.column(name, part) for name in columns)]
            return np.column_stack(np.broadcast_arrays(*rows))

        reading = curves.model.reading_
        return cls(
            cells=_celled(curves, names, values, span, n_cells),
            timeline=curves.timeline,
            name=reading.name,
            unit=reading.unit,
            columns=tuple((str(name), unit_of(name, curves.X)) for name in columns),
            failing=[] if diagnosis is None else stretches(diagnosis, curves.timeline),
            noise_floor=None if diagnosis is None else diagnosis.noise_floor,
            others={
                label: _celled(other, ["residual"], lambda part: part.residual[:, None], span, n_cells)
                for label, other in (others or {}).items()
            },
            span=span,
        )

    def frame(self) -> pd.DataFrame:
        """The numbers drawn, a row per cell of time.

        Columns time (dates, else seconds since the first row), segment, seconds, n (rows in the cell), and of each of
        measured, modelled, residual, corrected, left out, low and high (of the band), and ``column <name>``, its mean
        and its extremes ``_low`` and ``_high``.
        """
        return self.cells.copy()

    def grid(self) -> dict[str, Any]:
        """Rows, columns and size of the picture."""
        more = len(self.columns)
        heights = (3, 2.2, *[1] * more)
        return {"rows": 2 + more, "size": (9.0, 5.2 + 1.1 * more), "sharex": True, "height_ratios": heights}

    def draw(self, axes: np.ndarray) -> None:
        """Draw in axes of shape (rows, 1)."""
        (top, bottom, *below), cells, line = axes[:, 0], self.cells, self.timeline
        draw_rows(top, cells, line, "left out", SOFT, "left out" if cells["left out"].notna().any() else None)
        draw_rows(top, cells, line, "measured", SKY, "measured")
        draw_line(top, cells, line, "corrected", GREEN, lw=1.0, label="corrected")
        if cells["low"].notna().any():
            draw_band(top, cells, line, "low", "high", VERMILION, label="95 % of readings", zorder=2.5)
        draw_line(top, cells, line, "modelled", VERMILION, label="model")
        draw_rows(bottom, cells, line, "residual", SKY, "measured less model")
        if cells["low"].notna().any():
            for end in ("low", "high"):
                edge = cells.assign(edge=cells[end] - cells["modelled"])
                draw_line(bottom, edge, line, "edge", VERMILION, lw=0.9)
        for (label, other), usual in zip(self.others.items(), (SOFT, ORANGE, PURPLE), strict=False):
            colour = GREEN if label.startswith("with ") else usual
            draw_line(bottom, means_of(other, "residual"), line, "residual", colour, label=label, lw=1.5)
        means = means_of(cells, "residual")
        if means is not cells or len(self.others):
            draw_line(bottom, means, line, "residual", TEXT, label="its mean", lw=1.5)
        if self.noise_floor is not None:
            for sign in (-2, 2):
                name = "twice the noise floor" if sign > 0 else None
                bottom.axhline(sign * self.noise_floor, color=BLUE, lw=1.0, ls="--", zorder=4, label=name)
        for ax, (name, unit), colour in zip(below, self.columns, (PURPLE, GREEN, ORANGE, SKY) * 9, strict=False):
            draw_panel(ax, cells, line, f"column {name}", colour)
            label_values(ax.yaxis, printable(name), unit)
        for number, (low, high) in enumerate(self.failing):
            for ax in axes[:, 0]:
                said = "fails most" if number == 0 and ax is top else None
                ax.axvspan(*line.on_axis(np.array((low, high))), color=YELLOW, alpha=0.35, lw=0, zorder=0, label=said)
        for ax in axes[:, 0]:
            ax.margins(x=0.01)
            dress_time(ax, line, labels=ax is axes[-1, 0])
            ax.tick_params(labelbottom=ax is axes[-1, 0])
        if self.span is not None:
            top.set_xlim(*line.on_axis(np.array(self.span)))
        label_values(top.yaxis, self.name, self.unit)
        label_values(bottom.yaxis, "left", self.unit)
        name_runs(top, line)
        legend_above(top)
        legend_above(bottom)
        top.figure.align_ylabels(axes[:, 0])


def _celled(
    curves: Curves, names: Sequence[str], values: Any, span: tuple[float, float] | None, n_cells: int
) -> pd.DataFrame:
    """Values of each part of some curves in cells of time."""
    n_rows = curves.n_rows
    if span is not None:
        places = (curves.places(part) for part in curves.parts())
        n_rows = sum(int(np.count_nonzero((place >= span[0]) & (place <= span[1]))) for place in places)
    parts = ((part.segment, part.seconds, values(part)) for part in curves.parts())
    return cells_of(curves.timeline, names, n_rows, parts, span, n_cells)


BINS, POINTS = 60, 2000
"""Bins of a cloud of points, each with its mean; points that are drawn."""


@dataclass(eq=False)
class AgainstDisplay(Display):
    """Residual over a condition; its mean shows a missing law.

    Attributes
    ----------
    points, bins : DataFrame
        Some of the rows; of all rows in each range the mean, and its error as if the noise were white.
    """

    alt: ClassVar[str] = "what the model leaves, over a condition"
    points: pd.DataFrame
    bins: pd.DataFrame
    against: str
    against_unit: str
    unit: str
    range: tuple[float, float] | None = None
    """Part of the axis that is marked."""

    @classmethod
    def from_estimator(cls, model: Any, X: Any, y: Any, against: Any = None) -> AgainstDisplay:
        """Create it from a fitted model and a record.

        Parameters
        ----------
        model : DynamicBiasRegressor
            Fitted; or a search with a ``best_estimator_``.
        X, y : as for `DynamicBiasRegressor.evaluate_blocks`
        against : column name or str, optional
            A recorded column, by default the temperature; or "rate" (of the temperature), "lag difference" (of the
            slowest lag), "hour" (of the day), or the label of one of the model's effects, for its contribution.
        """
        return cls.of(Curves(model, X, y, keep=True), against)

    @classmethod
    def of(cls, curves: Curves, against: Any = None, range: tuple[float, float] | None = None) -> AgainstDisplay:
        """Create it from curves that are kept."""
        x, name, unit = condition(curves, curves.record.temperature_name if against is None else against)
        y = np.concatenate([part.residual for part in curves.parts()])
        known = np.flatnonzero(np.isfinite(x) & np.isfinite(y))
        x, y = x[known], y[known]
        shown = np.unique(np.linspace(0, max(len(x) - 1, 0), min(len(x), POINTS)).astype(int))
        low, high = (float(x.min()), float(x.max())) if len(x) else (0.0, 1.0)
        number = np.minimum(((x - low) / max(high - low, 1e-300) * BINS).astype(int), BINS - 1)
        grouped = pd.DataFrame({"center": x, "mean": y}).groupby(number)
        bins = grouped.mean().assign(error=grouped["mean"].std(ddof=0) / np.sqrt(grouped.size()), n=grouped.size())
        points = pd.DataFrame({"x": x[shown], "residual": y[shown]})
        return cls(points, bins.reset_index(drop=True), name, unit, curves.model.reading_.unit, range)

    def frame(self) -> pd.DataFrame:
        """One row per range: center, mean, error, n."""
        return self.bins.copy()

    def grid(self) -> dict[str, Any]:
        """Size of the picture."""
        return {"size": (9.0, 3.4)}

    def draw(self, axes: np.ndarray) -> None:
        """Draw in axes of shape (1, 1)."""
        ax, bins = axes[0, 0], self.bins
        if self.range is not None:
            ax.axvspan(*self.range, color=YELLOW, alpha=0.35, lw=0, zorder=0, label="fails most")
        ax.plot(self.points["x"], self.points["residual"], ".", ms=3, color=SKY, label="rows", rasterized=False)
        ax.axhline(0.0, color=SOFT, lw=0.8, zorder=1)
        half = 2 * bins["error"]
        band = {"color": VERMILION, "alpha": 0.3, "lw": 0}
        ax.fill_between(bins["center"], bins["mean"] - half, bins["mean"] + half, **band, zorder=3)
        ax.plot(bins["center"], bins["mean"], color=VERMILION, lw=1.6, zorder=4, label="mean, twice its error")
        ax.set_xlabel(labelled(self.against, self.against_unit))
        label_values(ax.yaxis, "left", self.unit)
        legend_above(ax)


def conditions(curves: Curves) -> dict[str, tuple[str, str]]:
    """Conditions that are no recorded columns: name -> label and unit."""
    model, degrees = curves.model, difference_unit(curves.model.reading_.temperature_unit)
    found = {"rate": ("rate of the temperature", f"{degrees}/h")}
    if (lag := largest_lag(model)) is not None:
        found["lag difference"] = (f"lag difference, {span_text(lag)}", degrees)
    if curves.timeline.dates:
        zone = "" if model.features_.history_.kind == "datetime" else " (UTC)"
        found["hour"] = (f"hour of day{zone}", "h")
    return found


def condition(curves: Curves, against: Any) -> tuple[np.ndarray, str, str]:
    """Values of a condition, its name and unit."""
    model, known, labels = curves.model, conditions(curves), curves.labels()
    if against == curves.record.temperature_name:
        values = np.concatenate([part.temperature for part in curves.parts()])
        return values, curves.temperature_name, model.reading_.temperature_unit
    if against in known and against not in getattr(curves.X, "columns", ()):
        return (_condition(curves, against), *known[against])
    if against in labels:
        at = labels.index(against)
        values = np.concatenate([part.contributions[:, at] for part in curves.parts()])
        return values, f"contribution of {against}", model.reading_.unit
    values = np.concatenate([curves.column(against, part) for part in curves.parts()])
    return values, column_text(against), unit_of(against, curves.X)


def _condition(curves: Curves, name: str) -> np.ndarray:
    """A condition that is computed, as in `Diagnosis.where`."""
    if name == "hour":
        seconds = np.concatenate([part.seconds for part in curves.parts()])
        return np.asarray((curves.timeline.zero + seconds) % 86_400 / 3600)
    effect = Rate() if name == "rate" else ThermalLag([largest_lag(curves.model)])
    effect.learn(curves.record)
    steps = walk([effect], curves.record, starts=own_starts(curves.record))
    values = np.concatenate([step.columns[:, 0] for step in steps])
    return values * 3600.0 if name == "rate" else values


def added_noise(model: Any, X: Any, y: Any) -> str:
    """Sentence on averaging times at which a correction adds noise.

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
    """`added_noise` from an existing display."""
    before, after = display.before, display.after
    n = min(len(before.deviation), len(after.deviation))
    ratio = after.deviation[:n] / np.maximum(before.deviation[:n], 1e-300)
    # A correction that raises the Allan deviation by 5 % adds noise. The ratio is known far better than either
    # deviation, since they share their noise: thirty degrees of freedom do.
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
    """Name of the noisiest contribution at an averaging time."""
    record = Curves(model, X).record
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
    """Allan deviation before and after correction, with bands.

    The dashed line is what white noise alone would give, from the corrected reading's shortest averaging time. Where a
    curve leaves it, longer averaging no longer helps. Irregular times are averaged into regular cells, gaps are left
    out, see `thermocorr.equations.allan`.

    Attributes
    ----------
    before, after : AllanDeviation
    """

    alt: ClassVar[str] = "Allan deviation before and after correction"
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
        curves = Curves(model, X, y)
        step = cell_length(curves.record)
        parts = list(curves.parts())
        pieces = np.concatenate([np.full(len(part.seconds), part.segment) for part in parts])
        piece = pd.factorize(pd.Series(curves.timeline.runs, dtype=object))[0][pieces]
        seconds = np.concatenate([part.seconds for part in parts])
        gap = max(curves.n_rows // 100, 1000)  # a longer one begins another piece
        before, after = (
            allan_deviation(
                regular_cells(piece, seconds, np.concatenate(values), step, gap), step, averaging_times, confidence
            )
            for values in ([part.measured for part in parts], [part.corrected for part in parts])
        )
        reading = curves.model.reading_
        return cls(
            before=before,
            after=after,
            name=reading.name,
            unit=reading.unit,
            confidence=confidence,
            samples=curves.timeline.samples,
        )

    def frame(self) -> pd.DataFrame:
        """One row per averaging time [s], before and after.

        Deviation, low, high, degrees of freedom and noise exponent, of both.
        """
        frames = [
            pd.DataFrame(vars(found)).set_index("averaging_times").add_suffix(f"_{name}")
            for name, found in (("before", self.before), ("after", self.after))
        ]
        return pd.concat(frames, axis=1).reset_index().rename(columns={"averaging_times": "averaging_time"})

    def grid(self) -> dict[str, Any]:
        """Size of the picture."""
        return {"size": (7.0, 4.2)}

    def draw(self, axes: np.ndarray) -> None:
        """Draw in axes of shape (1, 1)."""
        only = axes[0, 0]
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
            only.plot(times, white, "--", color=SOFT, lw=1.2, label="white noise", zorder=1)
        else:
            only.text(0.5, 0.5, "Too few readings in a row to compare.", ha="center", transform=only.transAxes)
        only.set_yscale("log")
        log_time_axis(only, "averaging time", self.samples)
        label_values(only.yaxis, f"Allan deviation of {self.name}", self.unit)
        legend_above(only)


def cell_length(record: Record) -> float:
    """The sampling step [s], or one that nine in ten keep."""
    longest = record.longest()
    rows = record.rows(longest.start, min(longest.stop, longest.start + LOOKED_AT))
    steps = record.times.steps(rows)[1:]
    usual, wide = record.usual_step(), float(np.quantile(steps, 0.9)) if len(steps) else 0.0
    # Steps differ much where one in ten exceeds the usual one by half.
    return wide if wide > 1.5 * usual else usual

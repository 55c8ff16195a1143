"""Pictures of a diagnosis and of a refinement: suspects, places, steps, and all of them on one page."""

from __future__ import annotations

import textwrap
from dataclasses import dataclass, field
from typing import Any, Self

import numpy as np
import pandas as pd

from ..effects.thermal import column_text
from ..equations import moving_average
from ..estimators.variants import VariantComparison
from ..records import Record
from ..records.numbers import quantity_text, quantity_texts, scale_of
from ..records.units import unit_of
from .axes import (
    BLACK,
    BLUE,
    COLOURS,
    GREEN,
    GREY,
    MARKED,
    ORANGE,
    PALE,
    SKY,
    VERMILION,
    Display,
    TimeLine,
    axes_grid,
    cells_of,
    draw_cells,
    dress_time,
    label_log_values,
    label_values,
    labelled,
    legend_above,
    plain,
    pyplot,
    without_times,
)
from .words import aspect_text, each_row, ends_text, probability_text, wrapped


@dataclass(eq=False)
class WhereDisplay(Display):
    """Conditions under which a model fails: one panel each, the worst first, one bar per interval.

    A bar is the interval's share of the error beyond the noise over its share of the samples: 1, dashed, where the
    error is as large as elsewhere. The worst interval is orange, with its share of the error.
    """

    where: pd.DataFrame
    units: dict[str, str] = field(default_factory=dict)

    @classmethod
    def from_diagnosis(cls, diagnosis: Any, X: Any = None) -> WhereDisplay:
        """Create it from what `diagnose` found; `X`, the record, tells the units of its columns."""
        units = {} if X is None else {str(name): unit_of(name, X) for name in getattr(X, "columns", ())}
        return cls(diagnosis.where, units)

    def frame(self) -> pd.DataFrame:
        """`Diagnosis.where` with the aspect in words, as `condition`; the worst place first."""
        return self.where.assign(condition=[aspect_text(row) for row in each_row(self.where)])

    def plot(self, ax: Any = None) -> Self:
        """Draw in a new figure; `ax` may be one Axes, whose place is divided."""
        # Conditions that are drawn
        strips = [strip for _, strip in self.frame().groupby(["aspect", "condition"], sort=False)][:8]
        rows = max(-(-len(strips) // 2), 1)
        axes = axes_grid(ax, rows, 2 if len(strips) > 1 else 1, size=(9.0, 0.6 + 1.45 * rows))
        first = axes[0, 0]
        self._drawn(axes, first)
        if not strips:
            first.text(0.5, 0.5, "No error beyond the noise.", ha="center", va="center", transform=first.transAxes)
            first.set_axis_off()
            return self
        highest = 1.25 * max(1.0, *(float(strip["lift"].max()) for strip in strips))
        for only, strip in zip(axes.ravel(), strips, strict=False):
            self._panel(only, strip.sort_values("low"), highest)
        for only in axes.ravel()[len(strips) :]:
            only.set_axis_off()
        for only in axes[:, 0]:
            only.set_ylabel("error share /\nsample share", fontsize=8)
        return self

    def _panel(self, ax: Any, strip: pd.DataFrame, highest: float) -> None:
        """Bars of a condition's intervals, each as wide as the others; their ends are named."""
        lift = strip["lift"].to_numpy(float)
        worst = int(np.argmax(strip["share"] - strip["n"] / strip["n"].sum()))
        colours = [ORANGE if i == worst else SKY for i in range(len(strip))]
        ax.bar(np.arange(len(strip)) + 0.5, lift, width=0.92, color=colours)
        ax.axhline(1.0, color=BLACK, ls="--", lw=0.8)
        ax.text(worst + 0.5, lift[worst], f"{strip['share'].iloc[worst]:.0%}", ha="center", va="bottom", fontsize=8)
        ends = [ends_text(row, float(strip["high"].max() - strip["low"].min())) for row in each_row(strip)]
        ax.set_xticks([0, len(strip)], [ends[0][0], ends[-1][1]], fontsize=8)
        for label, side in zip(ax.get_xticklabels(), ("left", "right"), strict=True):
            label.set_horizontalalignment(side)
        low, high = ends[worst]
        ax.set_title(low if low == high else f"{low} to {high}", loc="right", fontsize=8, color=VERMILION)
        ax.set_xlim(0, len(strip))
        ax.set_ylim(0, highest)
        ax.tick_params(axis="y", labelsize=8)
        # Letters of a condition's name on one line
        ax.set_title(wrapped(self._name(strip.iloc[0]), 26, 2), loc="left", fontsize=9)
        plain(ax)

    def _name(self, place: Any) -> str:
        """An aspect with its unit."""
        if place.aspect in ("column", "temperature"):
            return labelled(place.condition, self.units.get(place.condition, ""))
        return str(place.condition)


@dataclass(eq=False)
class RefinementDisplay(Display):
    """Error of the model after each step of `refine`, in sample, held out and on later blocks, to the noise floor."""

    steps: pd.DataFrame
    noise_floor: float
    unit: str
    verdict: str

    @classmethod
    def from_refinement(cls, refinement: Any) -> RefinementDisplay:
        """Create it from what `refine` did."""
        last = refinement.diagnoses[-1]
        return cls(refinement.steps, last.noise_floor, last.unit, last.verdict)

    def frame(self) -> pd.DataFrame:
        """Step, effect, change, rms (in sample), held_out_rms, later_rms, db, verdict, noise_floor."""
        return self.steps.assign(noise_floor=self.noise_floor)

    def plot(self, ax: Any = None) -> Self:
        """Draw in `ax`, or in a new figure."""
        n = len(self.steps)
        axes = axes_grid(ax, size=(max(5.0, 2.2 + 1.6 * n), 4.2))[0]
        only = axes[0]
        x = np.arange(n)
        later = self.steps["later_rms"]
        if later.notna().any():
            only.plot(x, later, "o-", color=VERMILION, label="later stretches", zorder=3)
        only.plot(x, self.steps["held_out_rms"], "^:", color=GREEN, ms=5, label="held out", zorder=3)
        only.plot(x, self.steps["rms"], "s-", color=BLUE, ms=5, label="in sample", zorder=3)
        only.axhline(self.noise_floor, color=GREY, ls="--", lw=1.2, label="noise floor")
        values = np.array([*self.steps["held_out_rms"], *later, *self.steps["rms"], self.noise_floor])
        values = values[np.isfinite(values) & (values > 0)]
        # Largest over smallest error, above which the axis is logarithmic
        if len(values) and values.max() > 5.0 * values.min():
            only.set_yscale("log")
            label_log_values(only.yaxis, "rms error", self.unit)
        else:
            only.set_ylim(0.0, 1.15 * float(values.max(initial=0.0)) or 1.0)
            label_values(only.yaxis, "rms error", self.unit)
        only.set_xticks(x, [wrapped(_name(step), 16) for step in each_row(self.steps)], fontsize=9)
        only.set_xlim(-0.4, n - 0.6)
        for i, step in enumerate(each_row(self.steps)):
            if i and np.isfinite(step.later_rms):
                above = _free_above(step, only.get_yscale() == "log")
                only.annotate(
                    f"{step.db:+.1f} dB", (i, step.later_rms), xytext=(0, 9 if above else -9),
                    textcoords="offset points", ha="center", va="bottom" if above else "top", fontsize=8,
                    color=VERMILION, bbox={"facecolor": "white", "edgecolor": "none", "pad": 1.0}, zorder=5,
                )  # fmt: skip
        plain(only)
        only.grid(False, axis="x")
        legend_above(only)
        return self._drawn(axes, only)


def _free_above(step: Any, logarithmic: bool) -> bool:
    """True if there is more room for a label above the error on later stretches than below it."""
    errors = np.array([step.later_rms, step.rms, step.held_out_rms])
    with np.errstate(divide="ignore"):
        places = np.log(errors) if logarithmic else errors
    apart = places[1:] - places[0]
    return bool(apart[apart > 0].min(initial=np.inf) >= -apart[apart <= 0].max(initial=-np.inf))


def _name(step: Any) -> str:
    """A step below its place on the axis."""
    return f"+ {step.effect}" if step.change == "added" else step.effect or "given model"


SHOWN = 8
COLUMNS = ["label", "kind", "column", "standing", "gain_db", "later_db", "p_value", "share", "confusable_with"]


@dataclass(eq=False)
class SuspectsDisplay(Display):
    """Suspects ranked: fall of the error on later data, how sure it is, and what each cannot be told from."""

    ranking: pd.DataFrame
    verdict: str
    named: bool = False
    level: float = 0.001

    @classmethod
    def from_diagnosis(cls, diagnosis: Any) -> SuspectsDisplay:
        """Create it from what `diagnose` found."""
        return cls(diagnosis.ranking, diagnosis.verdict, diagnosis.best is not None, diagnosis.level)

    def frame(self) -> pd.DataFrame:
        """Label, kind, column, standing, gain_db, later_db, p_value, share and confusable_with, the best first."""
        return self.ranking.reindex(columns=COLUMNS)

    def plot(self, ax: Any = None) -> Self:
        """Draw in `ax`, or in a new figure."""
        frame = self.frame().head(SHOWN)
        axes = axes_grid(ax, size=(9.0, 1.3 + 0.42 * max(len(frame), 1)))[0]
        only = axes[0]
        self._drawn(axes, only)
        title = f"Verdict: {self.verdict}" + (f" - {frame['label'].iloc[0]}" if self.named and len(frame) else "")
        only.set_title(wrapped(title, 80), loc="left", fontsize=10)
        if not len(frame):
            only.text(0.5, 0.5, "No suspects.", ha="center", va="center", transform=only.transAxes)
            only.set_axis_off()
            return self
        certain = frame["standing"].fillna("") != ""
        falls = frame["later_db"].fillna(frame["gain_db"])  # a jump at the end has no later data
        gains = falls.clip(lower=0.0)
        only.barh(range(len(frame)), gains, color=[BLUE if sure else PALE for sure in certain], height=0.62)
        # Shortest length of the axis of gains [dB], so that small gains look small
        reach = max(float(gains.max()), 0.5)
        for row, suspect in enumerate(each_row(frame)):
            text = f"p-value {probability_text(suspect.p_value)}"
            if suspect.standing == "helps":
                text = "helps on later data, cause not proven"
            text += f", takes away {suspect.share:.0%}"
            if falls.iloc[row] <= 0:
                text += ", no gain"
            if len(suspect.confusable_with):
                others = ", ".join(suspect.confusable_with)
                # Letters next to a bar; `frame` has everything
                text += "\n" + textwrap.shorten(f"not to be told from {others}", 58, placeholder=" ...")
            only.text(
                float(gains.iloc[row]) + 0.015 * reach, row, text, va="center", fontsize=8, linespacing=1.1,
                color="0.1" if certain.iloc[row] else "0.4",
            )  # fmt: skip
        # Letters of a suspect's name on one line
        labels = [wrapped(label, 38) for label in frame["label"]]
        only.set_yticks(range(len(frame)), labels, fontsize=8 if any("\n" in label for label in labels) else None)
        if self.named:
            only.get_yticklabels()[0].set_fontweight("bold")
        only.invert_yaxis()
        only.set_xlim(0, 1.9 * reach)
        plain(only)
        only.grid(False, axis="y")
        only.set_xlabel(
            f"fall of the squared error on later data [dB]\nblue: named (proven at p <= {self.level:g}, or helpful)"
        )
        return self


def plot_diagnosis(diagnosis: Any, X: Any = None) -> Any:
    """Draw suspects above, places of failure below; returns the figure. `X`, the record, tells units of columns."""
    figure = pyplot().figure(figsize=(9.5, 8.0), layout="constrained")
    upper, lower = figure.subplots(2, 1, height_ratios=(1, 1.2))
    SuspectsDisplay.from_diagnosis(diagnosis).plot(upper)
    WhereDisplay.from_diagnosis(diagnosis, X).plot(lower)
    residual, floor = quantity_texts((diagnosis.residual_rms, diagnosis.noise_floor), diagnosis.unit)
    figure.suptitle(
        f"Residual {residual}, noise floor {floor}: "
        f"{diagnosis.explainable:.0%} of the residual variance could still be explained",
        fontsize=11,
    )
    return figure


def plot_refinement(refinement: Any) -> Any:
    """Draw the steps above, what is suspected after the last one below; returns the figure."""
    figure = pyplot().figure(figsize=(9.5, 8.0), layout="constrained")
    upper, lower = figure.subplots(2, 1)
    RefinementDisplay.from_refinement(refinement).plot(upper)
    SuspectsDisplay.from_diagnosis(refinement.diagnoses[-1]).plot(lower)
    return figure


READING = "before correction"


@dataclass(eq=False)
class VariantsDisplay(Display):
    """Reading before and after each variant's correction, over time and against temperature.

    The paper's figures 4 to 11 for any record: corrected readings less U0, smoothed by a moving average, eqs. (9)
    (26). All corrections have the same scale.
    """

    cells: pd.DataFrame
    timeline: TimeLine
    table: pd.DataFrame
    window: int
    temperature: tuple[str, str]
    reading: tuple[str, str]

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

    def plot(self, ax: Any = None) -> Self:
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
        return self._drawn(axes, axes[0, 0])

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

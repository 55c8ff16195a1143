"""Pictures of findings: errors, suspects, places, variants."""

from __future__ import annotations

import textwrap
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np
import pandas as pd

from ..effects.thermal import column_text
from ..equations import moving_average
from ..model.advice import NEEDLESS
from ..model.variants import VariantComparison
from ..records import Record
from ..records.numbers import quantity_text, quantity_texts, scale_of
from ..records.units import unit_of
from .axes import Display, label_values, labelled, pyplot
from .curves import cells_of, draw_panel, without_times
from .style import BLUE, COLOURS, GREEN, ORANGE, PALE, SKY, SOFT, STYLE, TEXT, VERMILION
from .timeline import TimeLine, dress_time
from .words import aspect_text, each_row, ends_text, probability_text, wrapped


@dataclass(eq=False)
class WhereDisplay(Display):
    """Conditions under which a model fails, a panel each.

    A bar is the interval's share of the error beyond the noise over its share of the samples: 1, dashed, where the
    error is as large as elsewhere. The worst interval is orange, with its share of the error.
    """

    alt: ClassVar[str] = "conditions under which the model fails"
    where: pd.DataFrame
    units: dict[str, str] = field(default_factory=dict)

    @classmethod
    def from_diagnosis(cls, diagnosis: Any, X: Any = None) -> WhereDisplay:
        """Create it from a diagnosis; `X` tells units."""
        units = {} if X is None else {str(name): unit_of(name, X) for name in getattr(X, "columns", ())}
        return cls(diagnosis.where, units)

    def frame(self) -> pd.DataFrame:
        """`Diagnosis.where` with the `condition` in words."""
        return self.where.assign(condition=[aspect_text(row) for row in each_row(self.where)])

    def _strips(self) -> list[pd.DataFrame]:
        """Intervals of each condition that is drawn."""
        return [strip for _, strip in self.frame().groupby(["aspect", "condition"], sort=False)][:8]

    def grid(self) -> dict[str, Any]:
        """Rows, columns and size of the picture."""
        n = len(self._strips())
        rows = max(-(-n // 2), 1)
        return {"rows": rows, "columns": 2 if n > 1 else 1, "size": (9.0, 0.5 + 1.5 * rows)}

    def draw(self, axes: np.ndarray) -> None:
        """Draw a panel for each condition."""
        strips, first = self._strips(), axes[0, 0]
        for only in axes.ravel()[max(len(strips), 1) :]:
            only.set_axis_off()
        if not strips:
            first.text(0.5, 0.5, "No error beyond the noise.", ha="center", va="center", transform=first.transAxes)
            first.set_axis_off()
            return
        highest = 1.3 * max(1.0, *(float(strip["lift"].max()) for strip in strips))
        for only, strip in zip(axes.ravel(), strips, strict=False):
            self._panel(only, strip.sort_values("low"), highest)
        for only in axes[:, 0]:
            only.set_ylabel("error share /\nsample share")

    def _panel(self, ax: Any, strip: pd.DataFrame, highest: float) -> None:
        """Bars of a condition's intervals."""
        lift = strip["lift"].to_numpy(float)
        worst = int(np.argmax(strip["share"] - strip["n"] / strip["n"].sum()))
        colours = [ORANGE if i == worst else SKY for i in range(len(strip))]
        ax.bar(np.arange(len(strip)) + 0.5, lift, width=0.92, color=colours)
        ax.axhline(1.0, color=TEXT, ls="--", lw=0.8)
        ax.text(worst + 0.5, lift[worst], f"{strip['share'].iloc[worst]:.0%}", ha="center", va="bottom")
        ends = [ends_text(row, float(strip["high"].max() - strip["low"].min())) for row in each_row(strip)]
        ax.set_xticks([0, len(strip)], [ends[0][0], ends[-1][1]])
        for label, side in zip(ax.get_xticklabels(), ("left", "right"), strict=True):
            label.set_horizontalalignment(side)
        low, high = ends[worst]
        ax.set_title(low if low == high else f"{low} to {high}", loc="right", color=VERMILION)
        ax.set_xlim(0, len(strip))
        ax.set_ylim(0, highest)
        ax.set_title(wrapped(self._name(strip.iloc[0]), 26, 2), loc="left")
        ax.grid(False, axis="x")

    def _name(self, place: Any) -> str:
        """An aspect with its unit."""
        if place.aspect in ("column", "temperature"):
            return labelled(place.condition, self.units.get(place.condition, ""))
        return str(place.condition)


@dataclass(eq=False)
class ErrorsDisplay(Display):
    """Rms error on later data of each correction and step.

    Each is the error on stretches of the record that are predicted from everything before them: one scale for all, and
    a line where the noise begins.
    """

    alt: ClassVar[str] = "error on later data of each correction"
    errors: pd.Series
    """Error by the name of the correction, in their order."""
    unit: str
    noise_floor: float | None = None
    chosen: str = ""
    """The correction that is advised."""
    promised: float | None = None
    """Error that a suspect would leave."""

    @classmethod
    def from_comparison(cls, comparison: VariantComparison) -> ErrorsDisplay:
        """Create it from what `compare_variants` found."""
        advice = comparison.advice
        known = advice.table["all"].drop(index=list(NEEDLESS), errors="ignore")
        errors = pd.concat([pd.Series({"no correction": advice.before}), known])
        return cls(errors, advice.unit, None, advice.variant or "no correction")

    @classmethod
    def from_refinement(cls, refinement: Any) -> ErrorsDisplay:
        """Create it from what `refine` did."""
        last, steps = refinement.diagnoses[-1], refinement.steps
        names = [_name(step) for step in each_row(steps)]
        errors = pd.Series(steps["later_rms"].to_numpy(float), index=names)
        return cls(errors, last.unit, last.noise_floor, names[-1])

    def frame(self) -> pd.DataFrame:
        """One row per correction: its name and its error."""
        return self.errors.rename("error").rename_axis("correction").reset_index()

    def grid(self) -> dict[str, Any]:
        """Size of the picture."""
        return {"size": (9.0, 0.5 + 0.26 * max(len(self.errors), 1))}

    def draw(self, axes: np.ndarray) -> None:
        """Draw in axes of shape (1, 1)."""
        ax, sizes = axes[0, 0], self.errors.to_numpy(float)
        known = sizes[np.isfinite(sizes)]
        longest = max(known.max(initial=0.0), self.noise_floor or 0.0) or 1.0
        scale, rows = scale_of(known[known > 0].min(initial=longest), self.unit), np.arange(len(sizes))
        colours = [BLUE if name == self.chosen else PALE for name in self.errors.index]
        ax.barh(rows, np.nan_to_num(sizes), color=colours, height=0.66)
        for row, size in zip(rows, sizes, strict=True):
            text = scale.text(size) if np.isfinite(size) else "being measured"
            ax.text(np.nan_to_num(size) + 0.01 * longest, row, text, va="center")
        if self.promised is not None and len(sizes):
            ax.barh(rows[-1:], self.promised, color=GREEN, height=0.3)
        if self.noise_floor is not None:
            ax.axvline(self.noise_floor, color=TEXT, lw=1.2)
        ax.set_yticks(rows, [wrapped(name, 44, 2) for name in self.errors.index])
        ax.invert_yaxis()
        ax.set_xlim(0.0, 1.15 * longest)
        ax.grid(False, axis="y")
        ax.spines["left"].set_visible(False)
        ax.tick_params(axis="y", length=0)
        ax.set_xticks([])
        ax.spines["bottom"].set_visible(False)
        said = ["rms error on later data"] if ax.figure.get_figwidth() > 5 else []
        said += [] if self.noise_floor is None else ["line: noise floor"]
        said += [] if self.promised is None else ["green: with the suspect"]
        ax.set_title("; ".join(said))


def _name(step: Any) -> str:
    """A step of a refinement in words."""
    return f"+ {step.effect}" if step.change == "added" else step.effect or "given model"


SHOWN = 8
COLUMNS = ["label", "kind", "column", "standing", "gain_db", "later_db", "p_value", "share", "confusable_with"]


@dataclass(eq=False)
class SuspectsDisplay(Display):
    """Suspects, their worth, certainty and rivals."""

    alt: ClassVar[str] = "suspects and what each takes away"
    ranking: pd.DataFrame
    verdict: str
    named: bool = False
    level: float = 0.001

    @classmethod
    def from_diagnosis(cls, diagnosis: Any) -> SuspectsDisplay:
        """Create it from what `diagnose` found."""
        return cls(diagnosis.ranking, diagnosis.verdict, diagnosis.best is not None, diagnosis.level)

    def frame(self) -> pd.DataFrame:
        """The first columns of `Diagnosis.ranking`.

        Label, kind, column, standing, gain_db, later_db, p_value, share and confusable_with, the best first.
        """
        return self.ranking.reindex(columns=COLUMNS)

    def grid(self) -> dict[str, Any]:
        """Size of the picture."""
        shown = self.frame().head(SHOWN)
        lines = sum(2 if len(others) else 1 for others in shown["confusable_with"])
        return {"size": (9.0, 1.2 + 0.25 * max(lines, 1) + 0.1 * len(shown))}

    def draw(self, axes: np.ndarray) -> None:
        """Draw in axes of shape (1, 1)."""
        frame, only = self.frame().head(SHOWN), axes[0, 0]
        title = f"Verdict: {self.verdict}" + (f" ({frame['label'].iloc[0]})" if self.named and len(frame) else "")
        only.set_title(wrapped(title, 80), loc="left")
        if not len(frame):
            only.text(0.5, 0.5, "No suspects.", ha="center", va="center", transform=only.transAxes)
            only.set_axis_off()
            return
        certain = frame["standing"].fillna("") != ""
        falls = frame["later_db"].fillna(frame["gain_db"])  # a jump at the end has no later data
        gains = falls.clip(lower=0.0)
        only.barh(range(len(frame)), gains, color=[BLUE if sure else PALE for sure in certain], height=0.62)
        # The axis of gains is at least 0.5 dB long, so that small gains look small.
        reach = max(float(gains.max()), 0.5)
        for row, suspect in enumerate(each_row(frame)):
            text = f"p-value {probability_text(suspect.p_value)}"
            if suspect.standing == "helps":
                text = "helps on later data, cause not proven"
            text += f", takes away {suspect.share:.0%}" if falls.iloc[row] > 0 else ", no gain"
            if len(suspect.confusable_with):
                others = ", ".join(suspect.confusable_with)
                # `frame` has all that is cut off here.
                text += "\n" + textwrap.shorten(f"not distinguishable from {others}", 58, placeholder=" ...")
            colour = TEXT if certain.iloc[row] else SOFT
            only.text(float(gains.iloc[row]) + 0.015 * reach, row, text, va="center", linespacing=1.1, color=colour)
        only.set_yticks(range(len(frame)), [wrapped(label, 34) for label in frame["label"]])
        if self.named:
            only.get_yticklabels()[0].set_fontweight("bold")
        only.invert_yaxis()
        only.set_xlim(0, 2.1 * reach)
        only.grid(False, axis="y")
        only.set_xlabel(f"fall of the squared error on later data [dB]; blue: named (p ≤ {self.level:g}, or helpful)")


def plot_diagnosis(diagnosis: Any, X: Any = None) -> Any:
    """Draw suspects above places of failure; `X` tells units."""
    figure = _both(SuspectsDisplay.from_diagnosis(diagnosis), WhereDisplay.from_diagnosis(diagnosis, X))
    residual, floor = quantity_texts((diagnosis.residual_rms, diagnosis.noise_floor), diagnosis.unit)
    figure.suptitle(
        f"Residual {residual}, noise floor {floor}: "
        f"{diagnosis.explainable:.0%} of the residual variance could still be explained",
        fontsize=11,
    )
    return figure


def plot_refinement(refinement: Any) -> Any:
    """Draw the steps above the last suspects."""
    last = refinement.diagnoses[-1]
    return _both(ErrorsDisplay.from_refinement(refinement), SuspectsDisplay.from_diagnosis(last))


def _both(*displays: Display) -> Any:
    """Two pictures on one page."""
    heights = [display.grid()["size"][1] for display in displays]
    with pyplot().rc_context(STYLE):
        figure = pyplot().figure(figsize=(9.0, sum(heights) + 0.4), layout="constrained")
        for display, place in zip(displays, figure.subplots(2, 1, height_ratios=heights), strict=True):
            display.plot(place)
    return figure


READING = "before correction"


@dataclass(eq=False)
class VariantsDisplay(Display):
    """Reading before and after each correction.

    The paper's figures 4 to 11 for any record: corrected readings less U0, smoothed by a moving average, eqs. (9)
    (26). All corrections have the same scale.
    """

    alt: ClassVar[str] = "reading before and after each correction"
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
        """The numbers drawn, smoothed, a row per cell.

        Columns time, segment, seconds, n; "before correction" (less its mean), the corrected reading of each variant
        (less U0) and the temperature, each with its extremes ``_low`` and ``_high`` in the cell.
        """
        return self.cells.copy()

    def grid(self) -> dict[str, Any]:
        """Rows, columns and size of the picture."""
        rows = len(self.table)
        return {"rows": rows, "columns": 2, "size": (9.0, 1.6 * rows), "sharex": "col", "width_ratios": (3, 1.4)}

    def draw(self, axes: np.ndarray) -> None:
        """Draw the reading, then each variant, over time and against temperature."""
        variants = [name for name in self.table.index if name != READING]
        for (left, right), name, colour in zip(axes, [READING, *variants], (TEXT, *COLOURS), strict=False):
            draw_panel(left, self.cells, self.timeline, name, colour)
            size = 7 if len(self.cells) <= 100 else 2.5
            right.plot(self.cells["temperature"], self.cells[name], ".", ms=size, color=colour, alpha=0.6)
            left.set_title(self._title(name), loc="left")
            left.margins(x=0.01)
        axes[0, 1].set_ylim(axes[0, 0].get_ylim())
        self._share_scale(axes[1:], variants)
        for i, (left, right) in enumerate(axes):
            last = i == len(axes) - 1
            dress_time(left, self.timeline, labels=last)
            for ax in (left, right):
                ax.tick_params(labelbottom=last)
            label_values(left.yaxis, self.reading[0] if i == 0 else "corrected", self.reading[1])
            label_values(right.yaxis, "", "")
            right.set_ylabel("")
            right.tick_params(labelleft=False)
            right.locator_params(axis="x", nbins=4)
        axes[0, 0].figure.align_ylabels(axes[:, 0])
        axes[-1, 1].set_xlabel(labelled(*self.temperature))
        axes[0, 1].set_title("against temperature", loc="left")

    def _title(self, name: str) -> str:
        figures: Any = self.table.loc[name]
        unit = self.reading[1]
        if name == READING:
            return f"{name}: std {quantity_text(figures['std'], unit)}; curves: means of {self.window} samples"
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
    """Smoothed columns, segment by segment."""
    assert record.reading is not None
    reading = np.asarray(record.reading, float)
    columns = [reading - np.nanmean(reading), *comparison.residuals.to_numpy().T]
    temperature = np.asarray(record.columns[record.temperature_name], float)
    for number, segment in enumerate(record.segments):
        rows = record.rows(segment.start, segment.stop)
        seconds = record.times.seconds(rows, record.first_stamp())
        smooth = [moving_average(column[rows], comparison.window) for column in columns]
        yield number, seconds, np.column_stack([*smooth, temperature[rows]])

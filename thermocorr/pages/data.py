"""Data of a page on a fitted model and a record, small enough to stay with a diagnosis."""

from __future__ import annotations

import platform
from dataclasses import dataclass
from importlib.metadata import version
from typing import Any

import numpy as np
import pandas as pd

from .._version import __version__
from ..displays import AllanDisplay, ContributionsDisplay, StepResponseDisplay
from ..displays.axes import TimeLine, Walk
from ..displays.residual_displays import added_noise_shown
from ..effects.thermal import column_text
from ..records import Record
from ..records.numbers import quantity_texts, span_text
from ..records.units import unit_of
from .charts import MOST_POINTS, Traces, column_key

UPLOT = "1.6.32"
"""Version of the chart library in ``assets``."""


@dataclass(frozen=True)
class PageData:
    """A fitted model on a record: series, formula, coefficients, and what is odd about the data."""

    reading: str
    temperature: str
    unit: str
    temperature_unit: str
    unit_named: bool
    """True if the record names that; else its values were taken for it by their size."""
    traces: Traces
    beside: tuple[tuple[str, str, str], ...]
    """Recorded columns in the traces: key, name, unit."""
    timeline: TimeLine
    span: str
    """First to last time, in words."""
    n_rows: int
    n_readings: int
    step: float
    """Usual step [s]."""
    segments: tuple[tuple[str, str, str, int], ...]
    """First segments: run, first time, last time, rows."""
    n_segments: int
    notes: tuple[str, ...]
    warnings: tuple[str, ...]
    """What speaks against the correction itself."""
    equation: str
    coefficients: pd.DataFrame
    thermometers: tuple[tuple[str, tuple[float, ...]], ...]
    """Each thermometer, and the time constants of the lags that follow it [s]."""
    model: str
    """The estimator as code."""
    allan: pd.DataFrame
    """`AllanDisplay.frame`: Allan deviation before and after correction."""
    step_response: pd.DataFrame
    """`StepResponseDisplay.frame`: bias after a step of temperature by one unit."""
    shares: pd.Series
    """`ContributionsDisplay.rms`: what each effect moves the reading by, largest first."""
    uncertainties: tuple[tuple[str, float], ...]
    """Usual standard uncertainty of a corrected reading, and of its parts, in words; empty where nobody knows."""
    versions: tuple[tuple[str, str], ...]

    @classmethod
    def of(cls, model: Any, X: Any, y: Any, beside: tuple[Any, ...] = (), most: int = MOST_POINTS) -> PageData:
        """Gather it in one pass through the record.

        `model` (DynamicBiasRegressor): Fitted. `X`, `y` (as for `DynamicBiasRegressor.fit`): Read block by block.
        `beside` (tuple): Recorded columns to show under the residual. `most`
        (int): Most points of a line.
        """
        walk = Walk(model, X)
        record: Record = walk.record
        traces = Traces.of(model, X, y, walk.timeline, beside=beside, most=most)
        allan = AllanDisplay.from_estimator(model, X, y)
        last = record.segments[-1].stop - 1
        # Gaps and runs listed by name
        return cls(
            reading=model.reading_.name,
            temperature=walk.temperature_name,
            unit=model.reading_.unit,
            temperature_unit=model.reading_.temperature_unit,
            unit_named=model.reading_.unit_named,
            traces=traces,
            beside=tuple((column_key(name), column_text(name), unit_of(name, X)) for name in beside),
            timeline=walk.timeline,
            span=" to ".join(record.times.label(record.row(k)) for k in (record.segments[0].start, last)),
            n_rows=record.n_rows,
            n_readings=record.n_used - sum(traces.flags.get(why, 0) for why in ("no reading", "sentinel", "spike")),
            step=record.usual_step(),
            segments=tuple(
                (
                    "" if run is None else str(run),
                    record.times.label(record.row(start)),
                    record.times.label(record.row(stop - 1)),
                    stop - start,
                )
                for start, stop, run in record.segments[:20]
            ),
            n_segments=len(record.segments),
            notes=tuple(dict.fromkeys((*model.notes_, *record.notes))),
            warnings=tuple(filter(None, (_left_behind(model, traces), added_noise_shown(allan, model, X)))),
            equation=model.equation(),
            coefficients=model.coef_table(),
            thermometers=tuple((column_text(name), tuple(taus.tolist())) for name, taus in model.thermometers_.items()),
            model=repr(model),
            allan=allan.frame(),
            step_response=StepResponseDisplay.from_estimator(model).frame(),
            shares=ContributionsDisplay.from_estimator(model, X).rms,
            uncertainties=_uncertainties(model),
            versions=versions(),
        )

    @property
    def start(self) -> float | None:
        """Seconds since 1970 of the first row; None for a record without dates."""
        return self.timeline.zero if self.timeline.dates else None

    def record_sentence(self) -> str:
        """Sentence on what was measured."""
        many = "" if self.n_segments == 1 else f", in {self.n_segments} stretches"
        said = f"{self.n_readings:,} readings of {self.reading}"
        if self.timeline.samples:
            return f"{said}, at unknown times{many}."
        zone = "" if self.timeline.zone is None else " UTC"
        return f"{said}, {self.span}{zone}, every {span_text(self.step)}{many}."


def _left_behind(model: Any, traces: Traces) -> str:
    """A sentence where the mean of the corrected readings is none that was read; "" where it is, or was asked for."""
    corrected, readings = traces.corrected, traces.readings
    low, high = model.reading_.temperature_range
    if (
        not corrected.n
        or readings.low <= corrected.mean <= readings.high
        or not low <= model.reference_temperature_ <= high
    ):
        return ""
    mean, lowest, highest = quantity_texts((corrected.mean, readings.low, readings.high), model.reading_.unit, 6)
    return (
        f"The corrected readings have a mean of {mean}, and the readings lie between {lowest} and {highest}: what was "
        "taken away is no bias of this instrument alone. See in the model below which effect makes it, and whether the "
        "temperature left the fitted range."
    )


def _uncertainties(model: Any) -> tuple[tuple[str, float], ...]:
    """Typical uncertainty of a corrected reading of the fitted record, by source."""
    if not model._knows_noise:
        return ()
    joint = model._joint_errors()
    unpredicted = joint.noise.unpredicted(model.features_.history_.usual_step)
    parts = {
        "noise that its past does not predict": unpredicted,
        "noise that its past predicts": max(joint.noise.variance - unpredicted, 0.0),
        "the bias": joint.usual,
    }
    whole = ("one corrected reading", float(np.sqrt(sum(parts.values()))))
    return (whole, *((name, float(np.sqrt(variance))) for name, variance in parts.items()))


def versions() -> tuple[tuple[str, str], ...]:
    """Versions of what computed the page."""
    others = [(name, version(name)) for name in ("numpy", "scipy", "scikit-learn", "pandas")]
    return (("thermocorr", __version__), *others, ("Python", platform.python_version()), ("uPlot (charts)", UPLOT))

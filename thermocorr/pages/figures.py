"""The charts of a page, from the numbers that stand with a diagnosis."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from ..displays.axes import TimeLine
from ..estimators.time_constants.search import CONFIDENCE_95
from ..records.numbers import SPANS, span_text, span_unit, unit_text
from ..records.units import difference_unit
from .charts import Chart, ChartLine, Panel
from .data import PageData

FEW = 8
"""Fewer means than this are not drawn."""


def series(data: PageData, floor: float | None = None, shades: Sequence[tuple[float, float]] = ()) -> Chart:
    """Reading, residual, temperature and recorded columns over time."""
    traces = data.traces
    columns = traces.columns
    axis = time_axis(data)
    rules = () if floor is None else (2 * floor, -2 * floor)
    panels = [
        Panel(
            data.reading,
            data.unit,
            (
                ChartLine("measured", columns["reading"], "reading"),
                ChartLine("modelled", columns["model"], "model"),
                ChartLine("corrected", columns["corrected"], "corrected"),
            ),
        ),
        Panel("residual", data.unit, residual_lines(data, floor), rules=rules),
        Panel(
            data.temperature,
            data.temperature_unit,
            (ChartLine(data.temperature, columns["temperature"], "temperature"),),
            height=140,
        ),
    ]
    panels += [
        Panel(name, unit_, (ChartLine(name, columns[key], "other"),), height=140) for key, name, unit_ in data.beside
    ]
    return Chart(
        "series",
        axis.label,
        axis.x,
        tuple(panels),
        caption=series_caption(data, floor, bool(shades)),
        x_unit=axis.unit,
        joints=axis.joints,
        dates=axis.dates,
        shades=tuple((axis.at(low), axis.at(high)) for low, high in shades),
    )


def residual_lines(data: PageData, floor: float | None) -> tuple[ChartLine, ...]:
    """The residual, and its averages where noise hides something."""
    traces = data.traces
    own = ChartLine("residual", traces.columns["residual"], "residual")
    # Noise floor over residual, above which the noise hides what is to be seen and averages are drawn too
    if floor is not None and floor < 0.3 * traces.rms:
        return (replace(own, role="average"),)
    if len(traces.average[1]) < FEW:
        return (own,)
    return own, ChartLine(f"mean of {traces.average_rows}", traces.average[1], "average", stretches=traces.average[0])


def refined(first: PageData, last: PageData, floor: float) -> Chart:
    """Residual before and after refinement, on the scale of the one before."""
    axis = time_axis(last)
    rules = (2 * floor, -2 * floor)
    lines = [replace(line, values=("series", 1, i)) for i, line in enumerate(residual_lines(last, floor))]
    panels: tuple[Panel, ...] = (Panel("after", last.unit, tuple(lines), rules=rules),)
    if np.array_equal(first.traces.seconds, last.traces.seconds):  # else the effects need columns with missing values
        before = Panel("before", last.unit, residual_lines(first, floor), rules=rules)
        panels = (before, replace(panels[0], scale_of=0))
    return Chart(
        "refined",
        axis.label,
        "series",
        panels,
        caption="What the model leaves, before and after. Dashed: twice the noise floor.",
        x_unit=axis.unit,
        joints=axis.joints,
        dates=axis.dates,
    )


class Axis(NamedTuple):
    """The axis of time."""

    x: np.ndarray
    label: str
    unit: str
    scale: float
    """Seconds in one unit of x."""
    dates: bool
    zero: float
    """What is added to the place on the time line [s] before it is divided by `scale`."""
    joints: tuple[tuple[float, float], ...]
    """x and true time (seconds since 1970, else in the unit of x) where segments begin, if they were moved."""

    def at(self, place: float) -> float:
        """Position on x of a place on the time line [s]."""
        return (place + self.zero) / self.scale


def time_axis(data: PageData) -> Axis:
    """Dates, or time since the first row in a fitting unit."""
    return axis_of(data.timeline, data.traces.seconds)


def axis_of(line: TimeLine, places: np.ndarray) -> Axis:
    """Axis of places on a time line [s]."""
    zone = "time" if line.zone is None else "time (UTC)"
    if line.dates and line.in_order:
        return Axis(x=places + line.zero, label=zone, unit="", scale=1.0, dates=True, zero=line.zero, joints=())
    if line.samples and line.in_order:
        return Axis(x=places, label="sample", unit="", scale=1.0, dates=False, zero=0.0, joints=())
    unit = "samples" if line.samples else span_unit(line.span)
    scale = 1.0 if line.samples else SPANS[unit]
    label = "time since the first row" if line.in_order else "recorded time, long gaps left out"
    joints: tuple[tuple[float, float], ...] = ()
    # Segments whose true times a pointer can show
    if not line.in_order and len(line.starts) <= 5000:
        true = line.starts - line.shifts
        true = true + line.zero if line.dates else true / scale
        joints = tuple(zip((line.starts / scale).tolist(), true.tolist(), strict=True))
    return Axis(x=places / scale, label=label, unit=unit, scale=scale, dates=False, zero=0.0, joints=joints)


def placed(data: PageData, low: float, high: float) -> tuple[float, float] | None:
    """Ends of a ``time`` interval of `Diagnosis.where` on the axis; None where a time has several places."""
    if data.timeline.overlapping or not np.isfinite((low, high)).all():
        return None
    first, last = data.timeline.interval(low, high)
    return time_axis(data).at(first), time_axis(data).at(last)


def spectrum(found: Any) -> Chart | None:
    """Spectrum of what no cause explains, and of the noise that explanations were weighed against."""
    frame = found.left.spectrum
    if len(frame) < FEW:
        return None
    lines = [
        ChartLine("noise as judged", frame["noise"].to_numpy(float), "model"),
        ChartLine("white part of it", frame["white"].to_numpy(float), "floor", dash=True),
        ChartLine("what no cause explains", frame["residual"].to_numpy(float), "residual", dots=True, joined=False),
    ]
    return Chart(
        "spectrum",
        "frequency",
        frame["frequency"].to_numpy(float),
        (Panel("amplitude spectral density", f"{found.unit}/√Hz", tuple(lines), log=True, height=260),),
        caption=(
            "Causes were weighed against this noise: white, and parts that remember. Where what no cause explains "
            "stands far out of it, something is left."
        ),
        x_unit="Hz",
        x_log=True,
    )


def stability(data: PageData) -> Chart | None:
    """Allan deviation before and after correction."""
    frame = data.allan
    if len(frame) < 3:
        return None
    times = frame["averaging_time"].to_numpy(float)
    lines = []
    for name, role, label in (("before", "model", "before correction"), ("after", "corrected", "after correction")):
        lines.append(ChartLine(label, frame[f"deviation_{name}"].to_numpy(float), role, dots=True))
        lines += [ChartLine(end, frame[f"{end}_{name}"].to_numpy(float), role, edge=True) for end in ("low", "high")]
    after = frame["deviation_after"].to_numpy(float)
    seen = np.flatnonzero(~np.isnan(after))
    if len(seen):
        white = after[seen[0]] * np.sqrt(times[seen[0]] / times)
        lines.append(ChartLine("white noise alone", white, "floor", dash=True))
    return Chart(
        "allan",
        "averaging time",
        times,
        (Panel("Allan deviation", data.unit, tuple(lines), log=True, height=260),),
        caption=(
            "Averaging helps as long as the corrected reading's Allan deviation falls along the dashed line of white "
            "noise; where it leaves that line, longer averages are no better. Bands: 95 % confidence."
        ),
        x_unit="samples" if data.timeline.samples else "s",
        x_log=True,
    )


def following(data: PageData) -> Chart | None:
    """Bias after a step of temperature."""
    frame = data.step_response
    if not len(frame) or not data.thermometers[0][1]:
        return None
    value, error = (frame[name].to_numpy(float) for name in ("response", "standard_error"))
    lines = (
        ChartLine("bias", value, "corrected"),
        ChartLine("low", value - CONFIDENCE_95 * error, "corrected", edge=True),
        ChartLine("high", value + CONFIDENCE_95 * error, "corrected", edge=True),
    )
    degree = unit_text(difference_unit(data.temperature_unit))
    return Chart(
        "step",
        "time after the step",
        frame["time"].to_numpy(float),
        (Panel("bias", data.unit, lines, height=220),),
        caption=f"How the reading follows a step of temperature of 1 {degree}, by this model. Band: 95 % confidence.",
        x_unit="samples" if data.timeline.samples else "s",
        x_log=True,
    )


def series_caption(data: PageData, floor: float | None, shaded: bool) -> str:
    """Caption of the series: what it shows, and what a point is."""
    parts = ["The reading as measured, modelled and corrected; what the model leaves; and the temperature."]
    if floor is not None:
        parts.append("Dashed: twice the noise floor; about one white-noise sample in twenty lies outside.")
    if len(residual_lines(data, floor)) > 1:
        span = span_text(data.traces.average_rows * data.step)
        parts.append(f"The line inside the residual is its mean over stretches of {span}: what the noise hides.")
    if shaded:
        parts.append("Shaded: where it fails clearly more than elsewhere.")
    width = data.traces.rows_per_cell
    if width > 1:
        parts.append(
            f"The record has {data.traces.n_rows:,} rows: shown are the smallest and the largest of every {width} "
            f"({span_text(width * data.step)}), so that no spike is hidden."
        )
    parts.append("Drag across to zoom, double-click for the whole record.")
    return " ".join(parts)

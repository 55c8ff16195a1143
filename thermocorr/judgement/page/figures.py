"""The charts of a page, from the numbers that stand with a diagnosis."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from .charts import Chart, Line, Panel
from .data import PageData, seconds_text

NOISY = 0.3
"""Noise floor over residual from which the noise hides what is to be seen."""
TIME_UNITS = ((86_400.0, "d"), (3600.0, "h"), (60.0, "min"), (1.0, "s"))


def series(data: PageData, floor: float | None = None, worst: tuple[float, float] | None = None) -> Chart:
    """Reading, residual, temperature and recorded columns over time."""
    traces = data.traces
    columns = traces.columns
    x, label, unit, scale, dates = _axis(data)
    rules = () if floor is None else ((2 * floor, "twice the noise floor"), (-2 * floor, ""))
    panels = [
        Panel(
            data.reading,
            data.unit,
            (
                Line("measured", columns["reading"], "reading"),
                Line("modelled", columns["model"], "model"),
                Line("corrected", columns["corrected"], "corrected"),
            ),
        ),
        Panel(
            "residual",
            data.unit,
            residual_lines(data, floor),
            rules=rules,
        ),
        Panel(
            data.temperature,
            data.temperature_unit,
            (Line(data.temperature, columns["temperature"], "temperature"),),
            height=140,
        ),
    ]
    panels += [Panel(name, unit_, (Line(name, columns[key], "other"),), height=140) for key, name, unit_ in data.beside]
    return Chart(
        "series",
        label,
        x,
        tuple(panels),
        caption=series_caption(data, floor, worst is not None),
        x_unit=unit,
        x_scale=scale,
        dates=dates,
        shades=() if worst is None else ((worst[0] / scale, worst[1] / scale, "fails most here"),),
    )


def residual_lines(data: PageData, floor: float | None) -> tuple[Line, ...]:
    """The residual, and its averages where noise hides something."""
    traces = data.traces
    own = Line("residual", traces.columns["residual"], "residual")
    if floor is not None and floor < NOISY * traces.rms:
        return (replace(own, role="average"),)
    return own, Line(f"mean of {traces.average_rows}", traces.average[1], "average", stretches=traces.average[0])


def refined(first: PageData, last: PageData, floor: float) -> Chart:
    """Residual before and after refinement, on the scale of the one before."""
    x, label, unit, scale, dates = _axis(last)
    rules = ((2 * floor, "twice the noise floor"), (-2 * floor, ""))
    after = Panel("after", last.unit, residual_lines(last, floor), rules=rules)
    panels: tuple[Panel, ...] = (after,)
    where: np.ndarray | str = x
    if np.array_equal(first.traces.seconds, last.traces.seconds):  # else the effects need columns with missing values
        lines = [replace(line, values=("series", 1, i)) for i, line in enumerate(residual_lines(first, floor))]
        where, panels = "series", (Panel("before", last.unit, tuple(lines), rules=rules), replace(after, scale_of=0))
    return Chart(
        "refined",
        label,
        where,
        panels,
        caption="What the model leaves, before and after. Dashed: twice the noise floor.",
        x_unit=unit,
        x_scale=scale,
        dates=dates,
    )


def _axis(data: PageData) -> tuple[np.ndarray, str, str, float, bool]:
    """Values, name, unit, seconds per unit, and whether they are dates."""
    seconds = data.traces.seconds
    if data.start is not None and not data.traces.shifted:
        return seconds + data.start, "time (UTC)" if data.zoned else "time", "", 1.0, True
    scale, unit = next(((size, unit) for size, unit in TIME_UNITS if seconds[-1] >= 3 * size), TIME_UNITS[-1])
    label = "time, runs one after the other" if data.traces.shifted else "time since the first row"
    return seconds / scale, label, unit, scale, False


def series_caption(data: PageData, floor: float | None, shaded: bool) -> str:
    """What is to be seen, and what the points are."""
    parts = ["The reading as measured, modelled and corrected; what the model leaves; and the temperature."]
    if floor is not None:
        parts.append("Dashed: twice the noise floor; about one white-noise sample in twenty lies outside.")
    if len(residual_lines(data, floor)) > 1:
        span = seconds_text(data.traces.average_rows * data.step)
        parts.append(f"The line inside the residual is its mean over stretches of {span}: what the noise hides.")
    if shaded:
        parts.append("Shaded: the stretch of time with most of the error.")
    width = data.traces.rows_per_cell
    if width > 1:
        parts.append(
            f"The record has {data.traces.n_rows:,} rows: shown are the smallest and the largest of every {width} "
            f"({seconds_text(width * data.step)}), so that no spike is hidden."
        )
    parts.append("Drag across to zoom, double-click for the whole record.")
    return " ".join(parts)

"""Where the numbers of an export come from, for the comment that heads its files."""

from __future__ import annotations

import platform
from typing import Any

import numpy as np

from .target import Target


def fitted_range(model: Any) -> tuple[float, float]:
    """Lowest and highest temperature of the fitted rows."""
    limits = getattr(model, "temperature_range_", None)
    low, high = model.reading_.temperature_range if limits is None else limits
    return float(low), float(high)


def provenance(model: Any, target: Target, effects: list[Any]) -> list[str]:
    """Lines of the header's first comment."""
    from .._version import __version__

    lines = [f"{target.name}: dynamic thermal bias, corrected sample by sample. Made by thermocorr {__version__}"]
    lines[0] += f" (Python {platform.python_version()}, numpy {np.__version__}); do not edit."
    lines.append("")
    reading = getattr(model, "reading_", None)
    if reading is not None:
        lines.append(f"Reading: {reading.name} [{reading.unit or 'its own unit'}], mean {reading.mean:.10g}")
        lines.append(f"Fitted readings: {reading.n_readings}")
    low, high = fitted_range(model)
    unit = "" if reading is None else f" {reading.temperature_unit}"
    unit += "" if reading is None or reading.unit_named else ", as its values have it: the record named no unit"
    lines.append(f"Temperature: {target.temperature_name}, fitted from {low:.6g} to {high:.6g}{unit}")
    lines.append(
        f"U0, reading at the reference temperature {model.reference_temperature_:.10g}: {model.intercept_:.17g}"
    )
    if target.history is not None:
        record = target.history.record
        first, last = (record.times.label(row) for row in (0, target.last_row))
        lines.append(f"Fitted rows: {target.history.n_fitted}, from {first} to {last}")
        lines.append(f"Their usual step: {target.history.usual_step:.10g} s")
    taus = ", ".join(f"{tau:.6g}" for tau in model.time_constants_)
    lines.append(f"Time constants: {taus or 'none'} s")
    std = getattr(model, "residual_std_", None)
    if std is not None:
        lines.append(f"Standard deviation of the fitted residuals: {std:.6g}")
    lines.append(f"Effects removed: {'; '.join(e.label() for e in effects if e.removed_by_correct) or 'none'}")
    kept = "; ".join(e.label() for e in effects if not e.removed_by_correct)
    lines.append(f"Effects kept in the corrected reading: {kept or 'none'}")
    step = "given to each update" if target.period is None else f"{target.period:.17g} s, fixed"
    lines.append(f"Time between samples: {step}")
    start = "that of the fitted record's end" if target.continues else "unknown, taken to be at rest"
    lines.append(f"State after init: {start}")
    if not target.continues:
        lines.append(f"Flagged after it, while the lags forget: {float(model.washout_):.6g} s")
    return lines

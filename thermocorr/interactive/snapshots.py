"""The workbench as the screen shows it: one JSON value in which every number stands as text and as itself."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pandas as pd

from ..displays.axes import stretches
from ..displays.words import (
    aspect_text,
    better_text,
    each_row,
    effect_text,
    interval_text,
    left_sentences,
    probability_text,
    share_of_samples,
    small_sentence,
    when_text,
)
from ..effects.thermal import column_text
from ..estimators.tables import VERDICTS
from ..judgement import Diagnosis
from ..judgement.where import largest_lag
from ..pages.chapters import HELPS, Scales, parameters_text
from ..pages.html import units_of_axis, with_signs
from ..readers import guess
from ..records.errors import printable
from ..records.numbers import Scale, number_text, scale_of, span_text, unit_text
from ..records.types import kind_of
from ..records.units import difference_unit, unit_of
from .acts import Add, Columns, LeaveOut, Roles
from .bench import Bench
from .learning import COLUMN, EFFECT, LESS_LEVEL, Fitted, axis_of, fall, figure, gain, share
from .source import SAMPLES
from .takeaway import KINDS
from .tiles import Store

NOTED = 12
DRAWN, COLUMNS = 600, 12
"""Rows and columns of a log that are drawn before there is a model."""


def snapshot(bench: Bench) -> dict[str, Any]:
    """Everything that the screen shows besides curves and clouds."""
    found = bench.current
    roles = bench.arrangement().roles
    frame = bench.source.frame
    role_of = _role_of(roles, frame)
    shape = bench.arrangement().settings
    return {
        "source": {"name": printable(bench.source.name), "rows": len(frame), "said": _said(bench, found)},
        "columns": [
            {
                "name": str(name),
                "shown": printable(name),
                "unit": unit_text(unit_of(name, frame)),
                "kind": kind_of(frame[name]),
                "role": role_of(str(name)),
                "missing": int(frame[name].isna().sum()),
            }
            for name in frame.columns
        ],
        "samples": {name: sample.title for name, sample in SAMPLES.items()},
        "take": {name: kind.what for name, kind in KINDS.items()},
        "decided": roles is not None,
        "raw": [] if found is not None else _raw(frame),
        "model": {
            "time_constants": shape.time_constants if isinstance(shape.time_constants, int | str)
            else ", ".join(map(str, shape.time_constants)) or "none",
            "degree": shape.degree,
            "products": shape.products,
        },
        "problem": bench.problem,
        "advised": _advised(bench),
        "history": _history(bench, found),
        "can_undo": bench.past.at > 0,
        "can_redo": bench.past.at < len(bench.past.versions) - 1,
        "fitted": None if found is None else {**_fitted(found), "left_out": _marked(found, bench.store)},
        "judged": None if found is None or found.diagnosis is None else _judged(found),
        "lacking": {} if found is None else dict(found.said),
    }  # fmt: skip


def _raw(frame: pd.DataFrame) -> list[dict[str, Any]]:
    """Columns of numbers in some of the rows, to be drawn before there is a model."""
    rows = np.linspace(0, len(frame) - 1, min(len(frame), DRAWN)).astype(int)
    shown = []
    for name in [name for name in frame.columns if kind_of(frame[name]) == "number"][:COLUMNS]:
        values = frame[name].to_numpy(float)
        known = values[np.isfinite(values)]
        if len(known):
            low, high = number_text(known.min(), 4), number_text(known.max(), 4)
            drawn = [float(v) if np.isfinite(v) else None for v in values[rows]]
            unit = unit_text(unit_of(name, frame))
            shown.append({"shown": printable(name), "unit": unit, "low": low, "high": high, "values": drawn})
    return shown


def _role_of(roles: Roles | None, frame: pd.DataFrame) -> Callable[[str], str]:
    """The role of each column; where not all is known, what could be guessed."""
    if roles is not None:
        return roles.of
    known = guess(frame)
    guessed = {getattr(known, role): role for role in ("temperature", "reading", "run")}
    return lambda name: guessed.get(name, "suspect")


def _marked(found: Fitted, store: Store) -> list[list[float]]:
    """Stretches that are left out, on the axis."""
    row, place, axis = store.get(found.curves["row"]), store.get(found.curves["place"]), axis_of(found)
    shown = []
    for start, stop in found.arrangement.left_out:
        inside = np.flatnonzero((row >= start) & (row < stop))
        if len(inside):
            shown.append([axis.at(float(place[inside[0]])), axis.at(float(place[inside[-1]]))])
    return shown


def _said(bench: Bench, found: Fitted | None) -> list[str]:
    said = list(bench.source.timed(None)[1] if found is None else found.data.said)
    if found is not None:
        said.append(f"steps of {span_text(found.model.features_.history_.usual_step)}")
    return [printable(words) for words in said]


def _advised(bench: Bench) -> str:
    """Sentence on which correction to begin with; "" where that is not known, or an effect has been added since."""
    advice = bench.advised.get(bench.arrangement().key())
    if advice is None:
        return ""
    later = bench.known(bench.arrangement().key()).get("later", {}).get(None)
    return with_signs(printable(advice.sentence(None if later is None else scale_of([later], advice.unit))))


def _history(bench: Bench, found: Fitted | None) -> list[dict[str, Any]]:
    """The steps with their errors, each against the first that has one and learns from the same readings."""
    errors = [bench.known(bench.arrangement(number).key()) for number in range(1, len(bench.acts) + 1)]
    sizes = [known.get(name) for known in errors for name in ("rms", "held_out")]
    sizes += [known.get("later", {}).get(bench.moment) for known in errors]
    scale = scale_of([size for size in sizes if size is not None], found.model.reading_.unit if found else "")
    rows: list[dict[str, Any]] = []
    firsts: dict[Any, float] = {}
    for number, act in enumerate(bench.acts, 1):
        arrangement = bench.arrangement(number)
        key, learned = arrangement.key(), arrangement.learned()
        known = bench.known(key)
        later = known.get("later", {}).get(bench.moment)
        if later is not None:
            firsts.setdefault(learned, later)
        rows.append(
            {
                "step": number,
                "key": key,
                "text": printable(act.sentence()),
                "kind": {Columns: "columns", Add: "add", LeaveOut: "leave_out"}.get(type(act), "shape"),
                "rms": figure(known.get("rms"), scale),
                "held_out": figure(known.get("held_out"), scale),
                "later": figure(later, scale),
                "db": fall(later, firsts.get(learned)) if number > 1 else None,
                "same": learned == bench.arrangement(1).learned(),
                "verdict": known.get("verdict", ""),
            }
        )
    return rows


def _fitted(found: Fitted) -> dict[str, Any]:
    """The model, the axis of time, and the curves that can be drawn."""
    model, axis, X = found.model, axis_of(found), found.data.X
    unit, degrees = model.reading_.unit, model.reading_.temperature_unit
    curves = [
        {
            "name": "temperature",
            "label": printable(column_text(model.temperature)),
            "unit": degrees,
            "group": "condition",
        }
    ]
    conditions = {
        "rate": ("rate of the temperature", f"{difference_unit(degrees)}/h"),
        "lag difference": (f"lag difference, {span_text(largest_lag(model) or 0.0)}", difference_unit(degrees)),
        "hour": ("hour of day" if model.features_.history_.kind == "datetime" else "hour of day (UTC)", "h"),
    }
    curves += [
        {"name": name, "label": label, "unit": unit_, "group": "condition"}
        for name, (label, unit_) in conditions.items()
        if name in found.curves
    ]
    curves += [
        {
            "name": name,
            "label": printable(name.removeprefix(COLUMN)),
            "unit": unit_of(name.removeprefix(COLUMN), X),
            "group": "column",
        }
        for name in found.curves
        if name.startswith(COLUMN)
    ]
    curves += [
        {"name": name, "label": printable(name.removeprefix(EFFECT)), "unit": unit, "group": "contribution"}
        for name in found.curves
        if name.startswith(EFFECT)
    ]
    return {
        "key": found.arrangement.key(),
        "reading": printable(model.reading_.name),
        "temperature": printable(column_text(model.temperature)),
        "unit": unit_text(unit),
        "units": units_of_axis(unit),
        "axis": {
            "label": axis.label,
            "unit": axis.unit,
            "dates": axis.dates,
            "joints": [list(joint) for joint in axis.joints],
            "scale": axis.scale,
            "zero": axis.zero,
            "low": axis.at(0.0),
            "high": axis.at(found.timeline.span),
        },
        "curves": [
            {**curve, "unit": unit_text(unit_), "units": units_of_axis(unit_)}
            for curve, unit_ in ((curve, str(curve["unit"])) for curve in curves)
        ],
        "levels": f"reading{LESS_LEVEL}" in found.curves,
        "time_constants": ", ".join(map(span_text, model.time_constants_)),
        "without_times": found.timeline.samples,
        "equation": printable(model.equation(), "\n"),
        "notes": [printable(note) for note in found.notes[:NOTED]],
    }


def _judged(found: Fitted) -> dict[str, Any]:
    """The verdict, where it fails, and the suspects."""
    judged = found.diagnosis
    assert judged is not None
    unit, axis = judged.unit, axis_of(found)
    sizes = [size for suspect in judged.causes for size in (suspect.before, suspect.after)]
    scale = scale_of((judged.residual_rms, judged.noise_floor, *sizes), unit)
    helps = judged.best is not None and judged.suspects[0].standing == "helps"
    start = found.timeline.zero if found.timeline.dates else None
    scales = Scales(start, found.model.reading_.temperature_unit)
    # Places of failure that are listed
    return {
        "verdict": judged.verdict,
        "calm": VERDICTS[judged.verdict].calm,
        "said": HELPS if helps else VERDICTS[judged.verdict].sentence,
        "floor": figure(judged.noise_floor, scale),
        "rms": figure(judged.residual_rms, scale),
        "explainable": f"{judged.explainable:.0%}",
        "left": _left(judged, Scale(scale.factor, unit_text(scale.unit))),
        "where": [_place(row, found) for row in each_row(judged.where.head(12))],
        "shades": [[axis.at(low), axis.at(high)] for low, high in stretches(judged, found.timeline)],
        "suspects": [
            {
                "label": printable(effect_text(suspect.effect)),
                "parameters": printable(parameters_text(suspect.effect, scales)),
                "exactly": printable(suspect.effect.label()),
                "cause": number < judged.n_causes,
                "standing": suspect.standing,
                "before": figure(suspect.before, scale),
                "after": figure(suspect.after, scale),
                "later": gain(-suspect.later_db),
                "stretches": better_text(suspect),
                "p": probability_text(suspect.p_value),
                "alike": [printable(effect.title()) for effect in suspect.confusable_with],
                "when": printable(when_text(suspect)),
                "physics": suspect.effect.info.physics if suspect.effect.info else "",
                "bench_check": suspect.effect.info.bench_check if suspect.effect.info else "",
            }
            for number, suspect in enumerate(judged.suspects)
        ],
    }


def _left(judged: Diagnosis, scale: Scale) -> list[str]:
    """Residual that no cause explains."""
    said = [small_sentence(judged), *left_sentences(judged.left, scale, judged.verdict)]
    return [printable(words) for words in said if words]


def _place(row: Any, found: Fitted) -> dict[str, Any]:
    """A place of failure: in words, and where the plot is to go."""
    line = found.timeline
    shown: dict[str, Any] = {"share": share(row.share), "rows": share(share_of_samples(row))}
    shown |= {"aspect": printable(aspect_text(row)), "interval": printable(interval_text(row))}
    if row.aspect == "time" and not line.overlapping:
        first, last = line.interval(row.low, row.high)
        axis = axis_of(found)
        shown["from_to"] = [axis.at(first), axis.at(last)]
    curve = f"{COLUMN}{row.column}" if row.aspect == "column" else row.aspect
    if curve in found.curves:
        shown |= {"curve": curve, "range": [float(row.low), float(row.high)]}
    return shown

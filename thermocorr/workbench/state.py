"""A story as a screen shows it, in one JSON value."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pandas as pd

from ..effects.thermal import column_text
from ..model.tables import VERDICTS
from ..output.html import percent_text, quantity
from ..output.residual_displays import conditions
from ..output.words import (
    HELPS,
    aspect_text,
    better_text,
    each_row,
    effect_text,
    interval_text,
    parameters_text,
    probability_text,
    said_of_rest,
    share_of_samples,
    when_text,
)
from ..readers import guess
from ..records.errors import printable, times_word
from ..records.numbers import Scale, number_text, scale_of, span_text, unit_text
from ..records.types import kind_of
from ..records.units import unit_of
from .files import KINDS
from .story import Step, Story

DRAWN, COLUMNS = 600, 12
"""Rows and columns of a log that are drawn before there is a model."""


def state_of(story: Story) -> dict[str, Any]:
    """Everything that a screen shows besides pictures."""
    found, frame = story.now, story.log.frame
    roles = _roles(story, frame)
    return {
        "source": {"name": printable(story.log.name), "rows": len(frame), "said": _said(story, found)},
        "columns": [
            {
                "name": str(name),
                "shown": printable(name),
                "unit": unit_text(unit_of(name, frame)),
                "kind": kind_of(frame[name]),
                "role": roles.get(str(name), "suspect"),
                "missing": int(frame[name].isna().sum()),
            }
            for name in frame.columns
        ],
        "take": {name: kind.title for name, kind in KINDS.items()},
        "decided": story.roles is not None,
        "raw": [] if found is not None else _raw(frame),
        "model": _settings(story),
        "problem": story.problem,
        "advised": _advised(story),
        "errors": _errors(story, found),
        "history": _history(story, found),
        "can_undo": story.at > 0,
        "can_redo": story.at < len(story.versions) - 1,
        "fitted": None if found is None else _fitted(story, found),
        "judged": None if found is None or found.diagnosis is None else _judged(found),
        "lacking": "" if found is None else found.lacking,
    }


def figure(value: float | None, scale: Scale, digits: int = 4) -> dict[str, Any] | None:
    """A number as text with unit, and itself; or None."""
    if value is None or not math.isfinite(value):
        return None
    return {"text": quantity(float(value), digits, scale), "value": float(value)}


def _share(value: float) -> dict[str, Any]:
    """A share; of what nobody knows it is nothing."""
    known = float(value) if math.isfinite(value) else 0.0
    return {"text": percent_text(known), "value": known}


def _gain(value: float) -> dict[str, Any] | None:
    """Decibels, with their sign."""
    if not math.isfinite(value):
        return None
    return {"text": f"{value:+.1f}\u00a0dB".replace("-", "\u2212"), "value": float(value)}


def _roles(story: Story, frame: pd.DataFrame) -> dict[str, str]:
    """The role of each column, known or guessed."""
    if story.roles is not None:
        given = {column: role for role, column in story.roles.items() if isinstance(column, str)}
        if story.roles["reference"] and story.roles["reading"] == story.roles["temperature"]:
            given[story.roles["reading"]] = "reading"
        return {**given, **dict.fromkeys(story.roles["ignored"], "ignored")}
    known = guess(frame)
    return {column: role for role in ("temperature", "reading", "run") if (column := getattr(known, role)) is not None}


def _raw(frame: pd.DataFrame) -> list[dict[str, Any]]:
    """Columns to draw before there is a model."""
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


def _said(story: Story, found: Step | None) -> list[str]:
    said = list(story.log.timed(None)[1] if found is None else found.said)
    if found is not None:
        said.append(f"steps of {span_text(found.model.features_.history_.usual_step)}")
    return [printable(words) for words in said]


def _settings(story: Story) -> dict[str, Any]:
    """Settings of the model, as they may be typed."""
    given = {name: getattr(story.base, name) for name in ("time_constants", "degree", "products")}
    for act in story.acts:
        given |= act.get("begun", {})
        given |= {name: act[name] for name in given if act["do"] in ("shape", "add") and act.get(name)}
        if act["do"] == "shape":
            given |= {name: act[name] for name in given}
    taus = given["time_constants"]
    if not isinstance(taus, int | str):
        given["time_constants"] = ", ".join(map(str, taus or ())) or "none"
    return given


def _advised(story: Story) -> str:
    """Sentence on the advised correction, or ""."""
    advice = story.advice.get(story.key())
    if advice is None:
        return ""
    later = story.known().get("later", {}).get(None)
    return str(printable(advice.sentence(None if later is None else scale_of([later], advice.unit))))


def _scale(story: Story, found: Step | None) -> Scale:
    errors = story.errors()["error"].to_numpy(float)
    known = errors[np.isfinite(errors) & (errors > 0)]
    return scale_of([known.min()] if len(known) else [], found.model.reading_.unit if found else "")


def _errors(story: Story, found: Step | None) -> list[dict[str, Any]]:
    """Errors on one scale: no correction, static, dynamic, each step."""
    scale = _scale(story, found)
    return [
        {"step": printable(row.step), "error": figure(row.error, scale)} for row in each_row(story.errors())
    ]  # fmt: skip


def _history(story: Story, found: Step | None) -> list[dict[str, Any]]:
    """The steps with their errors."""
    scale, moment = _scale(story, found), story.moment
    rows: list[dict[str, Any]] = []
    first: float | None = None
    table = story.errors().dropna(subset=["act"])
    for number, (act, shown) in enumerate(zip(story.acts, each_row(table), strict=True), 1):
        known = story.known(story.acts[:number])
        later = known.get("later", {}).get(moment)
        same = math.isfinite(shown.error) or later is None  # else it was learned from other readings
        change = 20 * math.log10(later / first) if same and later and first else math.nan
        first = later if first is None and same else first
        rows.append(
            {
                "step": number,
                "text": printable(shown.step),
                "kind": act["do"],
                "later": figure(later, scale) if same else None,
                "rms": figure(known.get("rms"), scale),
                "held_out": figure(known.get("held_out"), scale),
                "db": _gain(change),
                "same": same,
                "verdict": known.get("verdict", ""),
            }
        )
    return rows


def _fitted(story: Story, found: Step) -> dict[str, Any]:
    """The model, and what can be drawn of it."""
    model, X, curves = found.model, found.X, found.curves
    below = [str(name) for name in X.columns if kind_of(X[name]) in ("number", "switch")]
    against = [curves.record.temperature_name, *(name for name in below if name != curves.record.temperature_name)]
    shown = {name: printable(column_text(name)) for name in against}
    shown |= {name: label for name, (label, _) in conditions(curves).items() if name not in shown}
    shown |= {label: f"contribution of {printable(label)}" for label in curves.labels()}
    n_out = sum(stop - start for start, stop in found.left_out)
    return {
        "key": found.key,
        "reading": printable(model.reading_.name),
        "temperature": str(curves.record.temperature_name),
        "span": curves.timeline.span,
        "below": {name: printable(name) for name in below},
        "against": shown,
        "levels": any(curves.level(part).any() for part in curves.parts()),
        "left_out": f"{times_word(n_out, 'row')} left out" if n_out else "",
        "time_constants": ", ".join(map(span_text, model.time_constants_)),
        "without_times": curves.timeline.samples,
        "equation": printable(model.equation(), "\n"),
        "notes": [printable(note) for note in found.notes[:12]],
        "where": _where(found),
    }


def _where(found: Step) -> list[dict[str, Any]]:
    """Conditions under which the model fails."""
    judged = found.diagnosis
    table = found.where if judged is None else judged.where
    if table is None or (judged is not None and VERDICTS[judged.verdict].calm):
        return []
    return [_place(row, found) for row in each_row(table.head(12)) if row.share > 0]


def _place(row: Any, found: Step) -> dict[str, Any]:
    """A place of failure, in words and numbers."""
    line = found.curves.timeline
    shown: dict[str, Any] = {"share": _share(row.share), "rows": _share(share_of_samples(row))}
    shown |= {"aspect": printable(aspect_text(row)), "interval": printable(interval_text(row))}
    if row.aspect == "time" and not line.overlapping:
        shown["from_to"] = list(line.interval(row.low, row.high))
    elif row.aspect != "time":
        column = row.column if row.aspect in ("column", "temperature") else row.aspect
        shown |= {"column": column, "range": [float(row.low), float(row.high)]}
    return shown


def _judged(found: Step) -> dict[str, Any]:
    """The verdict, and the suspects."""
    judged = found.diagnosis
    assert judged is not None
    sizes = [size for suspect in judged.causes for size in (suspect.before, suspect.after)]
    scale = scale_of((judged.residual_rms, judged.noise_floor, *sizes), judged.unit)
    helps = judged.best is not None and judged.suspects[0].standing == "helps"
    left = said_of_rest(judged, scale)
    return {
        "verdict": judged.verdict,
        "calm": VERDICTS[judged.verdict].calm,
        "said": HELPS if helps else VERDICTS[judged.verdict].sentence,
        "floor": figure(judged.noise_floor, scale),
        "rms": figure(judged.residual_rms, scale),
        "explainable": percent_text(judged.explainable),
        "left": [printable(words) for words in left if words],
        "suspects": _suspects(found, scale),
    }


def _suspects(found: Step, scale: Scale) -> list[dict[str, Any]]:
    """Cards of the suspects, no two under one name."""
    judged, line = found.diagnosis, found.curves.timeline
    assert judged is not None
    start, degrees = line.zero if line.dates else None, found.model.reading_.temperature_unit
    names = [str(printable(effect_text(suspect.effect))) for suspect in judged.suspects]
    cards = []
    for number, (suspect, name) in enumerate(zip(judged.suspects, names, strict=True)):
        effect, cause = suspect.effect, number < judged.n_causes
        parameters = str(printable(parameters_text(effect, start, degrees)))
        several = names.count(name) > 1
        cards.append(
            {
                "label": f"{name}, {parameters or names[:number].count(name) + 1}" if several else name,
                "parameters": "" if several else parameters,
                "exactly": printable(effect.label()),
                "cause": cause,
                "standing": suspect.standing,
                "before": figure(suspect.before, scale) if cause else None,
                "after": figure(suspect.after, scale) if cause else None,
                "later": _gain(-suspect.later_db),
                "stretches": better_text(suspect),
                "p": probability_text(suspect.p_value),
                "alike": [printable(other.title()) for other in suspect.confusable_with],
                "when": printable(when_text(suspect)),
                "physics": effect.info.physics if effect.info else "",
                "bench_check": effect.info.bench_check if effect.info else "",
            }
        )
    return cards

"""Model files of earlier versions, each made one of the next."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from .codec import ModelFileError, fields


def _from_draft(node: dict[str, Any]) -> dict[str, Any]:
    """Version 0, the draft: no digest, no provenance, no standard errors."""
    node = fields(node, "$", ("format", "version", "model"))
    model = node["model"]
    if not isinstance(model, dict) or not isinstance(model.get("coefficients"), list):
        raise ModelFileError("$.model has no list of coefficients")
    model = {"standard_errors": [0.0] * (len(model["coefficients"]) + 1), **model}
    return {**node, "version": 1, "provenance": {"versions": {}, "data": {}}, "model": model}


def _from_digest_inside(node: dict[str, Any]) -> dict[str, Any]:
    """Version 1: its digest has been looked at."""
    return {**node, "version": 2, "digest": ""}


def _without_screen(node: dict[str, Any]) -> dict[str, Any]:
    """Version 2: nothing was screened."""
    model = node.get("model")
    parameters, history = (model.get(name) if isinstance(model, dict) else None for name in ("parameters", "history"))
    if not (isinstance(model, dict) and isinstance(parameters, dict) and isinstance(history, dict)):
        raise ModelFileError("$.model has no parameters, or no history")
    model = {**model, "parameters": {"screen": False, **parameters}}
    model["history"] = {"skipped": [], "screen": None, **history}
    return {**node, "version": 3, "model": model}


def _without_errors(node: dict[str, Any]) -> dict[str, Any]:
    """Version 3: no joint errors, no noise."""
    if not isinstance(node.get("model"), dict):
        raise ModelFileError("$.model is no object")
    return {**node, "version": 4, "model": {"errors": None, **node["model"]}}


def _with_one_level(node: dict[str, Any]) -> dict[str, Any]:
    """Version 4: all runs had the same U0."""
    model = node.get("model")
    if not (isinstance(model, dict) and isinstance(model.get("parameters"), dict)):
        raise ModelFileError("$.model has no parameters")
    return {**node, "version": 5, "model": {**model, "parameters": {"run_offset": "same", **model["parameters"]}}}


def _with_pairs_alone(node: dict[str, Any]) -> dict[str, Any]:
    """Version 5: products of lags were of two of them."""
    return {**_ordered(node), "version": 6}


def _ordered(node: Any) -> Any:
    """A part of a file in which products of lags say their order."""
    if isinstance(node, list):
        return [_ordered(part) for part in node]
    if not isinstance(node, dict):
        return node
    parts = {key: _ordered(part) for key, part in node.items()}
    if parts.get("kind") == "lag_products" and isinstance(parts.get("parameters"), dict):
        parts["parameters"] = {"order": 2, **parts["parameters"]}
    return parts


def _without_filling(node: dict[str, Any]) -> dict[str, Any]:
    """Version 6: rows that lack something were passed over, and no device had a fleet behind it."""
    model = node.get("model")
    if not (isinstance(model, dict) and isinstance(model.get("parameters"), dict)):
        raise ModelFileError("$.model has no parameters")
    model = {"filling": [], **model, "parameters": {"fill": None, "prior": None, **model["parameters"]}}
    return {**node, "version": 7, "model": model}


def _without_thermometers(node: dict[str, Any]) -> dict[str, Any]:
    """Version 7: nothing was declared of thermometers."""
    return {**node, "version": 8}


def _without_gaps(node: dict[str, Any]) -> dict[str, Any]:
    """Version 8: what happens in gaps was not stated."""
    model = node.get("model")
    if not (isinstance(model, dict) and isinstance(model.get("history"), dict)):
        raise ModelFileError("$.model has no history")
    return {**node, "version": 9, "model": {**model, "history": {"gaps": None, **model["history"]}}}


def _without_rules(node: dict[str, Any]) -> dict[str, Any]:
    """Version 9: cells were held, or estimated where other columns were named; no fit said what it did."""
    model = node.get("model")
    if not (
        isinstance(model, dict) and isinstance(model.get("filling"), list) and isinstance(model.get("parameters"), dict)
    ):
        raise ModelFileError("$.model has no filling, or no parameters")
    filling = [
        {"rule": "estimate" if one.get("others") else "hold", **one} if isinstance(one, dict) else one
        for one in model["filling"]
    ]
    parameters = {"verbose": 0, **model["parameters"]}
    return {**node, "version": 10, "model": {**model, "filling": filling, "parameters": parameters}}


def _with_plain_curvature(node: dict[str, Any]) -> dict[str, Any]:
    """Version 10: what may be curved beyond the fitted temperatures was taken to feel them at once."""
    return _with_more_beyond(node, 11, weights=None)


def _with_measured_range(node: dict[str, Any]) -> dict[str, Any]:
    """Version 11: only the measured temperature was asked whether it is beyond the fitted ones."""
    return _with_more_beyond(node, 12, lowest=None, highest=None)


def _with_hinges_at_knee(node: dict[str, Any]) -> dict[str, Any]:
    """Version 12: a hinge was 0 at its knee, not at T0; a T0 of its own there keeps what was fitted."""

    def told(value: Any) -> Any:
        if not isinstance(value, dict):
            return [told(item) for item in value] if isinstance(value, list) else value
        value = {key: told(item) for key, item in value.items()}
        knee = isinstance(value.get("parameters"), dict) and value["parameters"].get("knee")
        if value.get("kind") == "hinge" and "import" not in value and isinstance(value.get("learned"), dict):
            value["learned"] = {"reference_temperature_": knee, **value["learned"]}
        return value

    return {**told(node), "version": 13}


def _with_more_beyond(node: dict[str, Any], version: int, **unknown: None) -> dict[str, Any]:
    """A node of the next version, in which more is known of what lies beyond the fitted temperatures."""
    model = node.get("model")
    if not isinstance(model, dict):
        raise ModelFileError("$.model is no object")
    errors = model.get("errors")
    if isinstance(errors, dict) and isinstance(errors.get("beyond"), dict):
        errors = {**errors, "beyond": {**unknown, **errors["beyond"]}}
    return {**node, "version": version, "model": {**model, "errors": errors}}


MIGRATIONS: dict[int, Callable[[dict[str, Any]], dict[str, Any]]] = {
    0: _from_draft,
    1: _from_digest_inside,
    2: _without_screen,
    3: _without_errors,
    4: _with_one_level,
    5: _with_pairs_alone,
    6: _without_filling,
    7: _without_thermometers,
    8: _without_gaps,
    9: _without_rules,
    10: _with_plain_curvature,
    11: _with_measured_range,
    12: _with_hinges_at_knee,
}
"""Version -> what makes of its content that of the next version."""

"""The `effects` parameter of `make_record`."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple
from zlib import crc32

import numpy as np
import pandas as pd

from ..records import seconds_of
from ..records.errors import check_int
from ..records.times import date_of, span_of
from ._heat import STREAMS, Array, check_choice, check_float
from ._planted import PLANTS, Parameters, Run, Scene, of_own_columns

_WHO = "make_record"
_MOMENTS = ("time", "start", "end")
_INTERVALS = {"width": "(0.0, inf)", "knee": "(-inf, inf)"}
_CHOICES = {"side": ("above", "below")}


class Planting(NamedTuple):
    """One effect to plant."""

    label: str
    kind: str
    strength: float
    given: Parameters
    """Parameters that are not left to the seed."""
    occurrence: int
    """How many of its kind stand before it."""
    effect: Any = None
    """An effect of a kind that has no formula here: it is planted by columns of its own."""


def read_plantings(effects: Any, start: pd.Timestamp) -> list[Planting]:
    """List of what to plant; ValueError for the impossible."""
    plantings: list[Planting] = []
    for what, strength, given in _items(effects):
        kind, parameters = _kind_and_parameters(what)
        own = what if hasattr(what, "columns") and kind not in PLANTS else None
        occurrence = sum(planting.kind == kind for planting in plantings)
        if own is None:
            if kind not in tuple(PLANTS):
                raise ValueError(
                    f"The 'effects' parameter of {_WHO} must be one of {', '.join(map(repr, PLANTS))}, or for another "
                    f"kind the effect itself, [(FanNoise('rpm'), 2.0)]. Got {kind!r} instead."
                )
            parameters = {name: _checked(kind, name, value, start) for name, value in {**parameters, **given}.items()}
        else:
            parameters = own.get_params(deep=False)
        number = check_float(_WHO, f"effects[{kind!r}]", strength, "[0.0, inf)")
        label = kind if occurrence == 0 else f"{kind}_{occurrence + 1}"
        plantings.append(Planting(label, kind, number, parameters, occurrence, effect=own))
    return plantings


def _items(effects: Any) -> Iterable[tuple[Any, Any, Mapping[str, Any]]]:
    """(kind or effect, strength, parameters) of each item."""
    if effects is None:
        return
    items = list(effects.items()) if isinstance(effects, Mapping) else effects
    if isinstance(items, str) or not isinstance(items, Iterable):
        items = [items]
    for item in items:
        if not isinstance(item, Sequence) or isinstance(item, str) or len(item) not in (2, 3):
            raise ValueError(
                f"The 'effects' parameter of {_WHO} must be a dictionary of kind and strength, or a list of (kind or "
                f"effect, strength) or (kind, strength, parameters). Got {item!r} instead."
            )
        yield item[0], item[1], (item[2] if len(item) == 3 else {})


def _kind_and_parameters(what: Any) -> tuple[Any, dict[str, Any]]:
    """Kind and parameters of an effect, or of a bare kind."""
    if not hasattr(what, "get_params"):
        return what, {}
    kind = getattr(what, "kind", None)
    known = _parameter_names(kind) if kind in PLANTS else ()
    return kind, {name: value for name, value in what.get_params(deep=False).items() if name in known}


def _parameter_names(kind: str) -> tuple[str, ...]:
    """Parameters of a planted kind, read off a drawing of them."""
    one = np.linspace(0.0, 1.0, 9)
    scene = Scene(1.0, 8.0, one, {"temperature": one})
    return tuple(PLANTS[kind].draw(scene, np.random.default_rng(0)))


def _checked(kind: str, name: str, value: Any, start: pd.Timestamp) -> Any:
    """A parameter as the formulas need it."""
    names = _parameter_names(kind)
    if name not in names:
        listed = ", ".join(names) or "none"
        raise ValueError(
            f"The 'effects' parameter of {_WHO} names a parameter {name!r} of {kind!r}. Its parameters are: {listed}."
        )
    if name == "time_constants":
        values = [value] if isinstance(value, str) or np.ndim(value) == 0 else list(value)
        return [seconds_of(tau, name) for tau in values]
    if name in ("time_constant", "delay", "lead", "onset", "period", "dwell") and value is not None:
        return seconds_of(value, name)
    if name in _MOMENTS and isinstance(value, str | pd.Timestamp):
        return _since(start, value)
    said = f"effects[{kind!r}][{name!r}]"
    if name in _CHOICES:
        check_choice(_WHO, said, value, _CHOICES[name])
    if name == "temperature_products":
        return bool(value)
    if name in ("degree", "harmonics", "power"):
        return check_int(_WHO, said, value, 1)
    if name in _INTERVALS or name in _MOMENTS:
        return check_float(_WHO, said, value, _INTERVALS.get(name, "(-inf, inf)"))
    return value


def _since(start: pd.Timestamp, moment: str | pd.Timestamp) -> float:
    """Seconds from the record's start to a date or span."""
    try:
        return float(span_of(moment).total_seconds())
    except (TypeError, ValueError):
        date = date_of(moment)
    if not isinstance(date, pd.Timestamp):
        raise ValueError(
            f"A moment in {_WHO} must be a date, seconds, or a span such as '2 days'. Got {moment!r} instead."
        )
    return float((date - start).total_seconds())


def plant(
    plantings: Sequence[Planting], runs: Sequence[Run], step: float, noise: float, seed: int
) -> tuple[list[dict[str, Array]], dict[str, dict[str, Any]]]:
    """Contributions of all planted effects.

    `plantings` (sequence of Planting). `runs` (sequence of Run). `step` (float): Sampling period [s]. `noise`
    (float): Standard deviation of the white noise, in which strengths are counted. `seed` (int). Returns
    contributions (list of dict of str to ndarray): for each run, label -> contribution at every sample, gaps filled.
    Returns truth (dict): label -> kind, parameters, strength, coefficient (what multiplies the plain formula), rms.
    """
    contributions: list[dict[str, Array]] = [{} for _ in runs]
    truth: dict[str, dict[str, Any]] = {}
    if plantings and noise == 0.0:
        raise ValueError(f"The strengths in the 'effects' parameter of {_WHO} count in noise: pass noise > 0.")
    if not plantings:
        return contributions, truth
    scene = _scene(runs, step)
    for planting in plantings:
        for name in ("column", "fast", "slow"):
            column = planting.given.get(name)
            if column is not None:
                check_choice(_WHO, f"effects[{planting.kind!r}][{name!r}]", column, tuple(runs[0].columns))
        shared = _stream(planting, seed, 0, 0)
        sign = float(shared.choice((-1.0, 1.0)))
        parameters, shapes = _shapes(planting, runs, scene, seed, shared)
        kept = np.concatenate([shape[run.kept] for shape, run in zip(shapes, runs, strict=True)])
        left = left_by_static_law(scene.columns["temperature"], kept)
        # What leaves less than 1e-9 of its rms is explained by a static quadratic altogether.
        if left <= 1e-9 * np.sqrt(np.mean(kept**2)):
            raise ValueError(
                f"The 'effects' parameter of {_WHO} plants {planting.kind!r} with {parameters}: on this record a "
                "static quadratic in temperature explains it altogether. Choose other parameters or a longer record."
            )
        coefficient = sign * planting.strength * noise / left
        for part, shape in zip(contributions, shapes, strict=True):
            part[planting.label] = coefficient * shape
        truth[planting.label] = {
            "kind": planting.kind,
            "parameters": parameters,
            "strength": planting.strength,
            "coefficient": coefficient,
            "rms": planting.strength * noise,
        }
    return contributions, truth


def _shapes(
    planting: Planting, runs: Sequence[Run], scene: Scene, seed: int, shared: np.random.Generator
) -> tuple[Parameters, list[Array]]:
    """Parameters, and the contribution at each sample."""
    if planting.effect is not None:
        return planting.given, of_own_columns(planting.effect, runs, shared)
    how = PLANTS[planting.kind]
    parameters = {**how.draw(scene, shared), **planting.given}
    own = [_stream(planting, seed, number, 2) for number in range(len(runs))]
    return parameters, [
        how.shape(run, scene, parameters, _stream(planting, seed, 0, 1), rng)
        for run, rng in zip(runs, own, strict=True)
    ]


def left_by_static_law(temperature: Array, values: Array) -> float:
    """Rms that a static quadratic law leaves, eq. (3)."""
    excess = (temperature - temperature.mean()) / max(float(temperature.std()), 1e-300)
    static = np.stack([np.ones_like(excess), excess, excess**2], axis=1)
    residual = values - static @ np.linalg.lstsq(static, values, rcond=None)[0]
    return float(np.sqrt(np.mean(residual**2)))


def _scene(runs: Sequence[Run], step: float) -> Scene:
    times = np.concatenate([run.began + run.time[run.kept] for run in runs])
    columns = {name: np.concatenate([run.columns[name][run.kept] for run in runs]) for name in runs[0].columns}
    return Scene(step, min(float(run.time[-1]) for run in runs), times, columns)


def _stream(planting: Planting, seed: int, run: int, purpose: int) -> np.random.Generator:
    """Random generator of one planted effect alone."""
    part = STREAMS.index("contributions")
    return np.random.default_rng([seed, run, part, crc32(planting.kind.encode()), planting.occurrence, purpose])

"""Everything that a fit depends on, as one value: roles of columns, settings, what was added and marked."""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass, field, replace
from typing import Any, NamedTuple

from ..effects import LaggedCovariate
from .roles import Roles

Stretch = tuple[int, int]
"""First row of the log, and the one behind the last."""
Moment = float | str
"""Seconds since the record began, or a date."""


@dataclass(frozen=True, kw_only=True)
class ModelSettings:
    """Settings of the model, see `DynamicBiasRegressor`."""

    time_constants: Any = 6
    degree: int = 2
    products: bool | int = False
    screen: bool = True
    sampling_period: float | str | None = None
    max_gap: float | str | None = None


class AddedEffect(NamedTuple):
    """An effect in a form that can be compared and written: JSON of its kind and parameters."""

    node: str
    label: str

    @classmethod
    def of(cls, node: dict[str, Any], label: str) -> AddedEffect:
        """Make one of a node of `EffectCodec.pack`."""
        return cls(json.dumps(node, sort_keys=True), label)


@dataclass(frozen=True, kw_only=True)
class Arrangement:
    """What stands on the workbench. Equal arrangements of one log give equal models, bit for bit."""

    roles: Roles | None = None
    """None until it is known which column is the temperature and which the reading."""
    settings: ModelSettings = field(default_factory=ModelSettings)
    effects: tuple[AddedEffect, ...] = ()
    left_out: tuple[Stretch, ...] = ()
    """Stretches that are not learned from."""
    own_runs: tuple[Stretch, ...] = ()
    """Stretches that are runs of their own."""
    changes: tuple[Moment, ...] = ()
    """Moments from which the measurand is another one."""
    spikes: tuple[int, ...] = ()
    """Rows whose readings are none."""

    def key(self) -> str:
        """A name that only equal arrangements share."""
        return hashlib.sha256(json.dumps(asdict(self), sort_keys=True, default=list).encode()).hexdigest()[:24]

    def with_effect(self, effect: AddedEffect) -> Arrangement:
        """The arrangement with one effect more; lags of one column are one effect with several time constants."""
        for place, other in enumerate(self.effects):
            merged = _merged(json.loads(other.node), json.loads(effect.node))
            if merged is not None:
                both = AddedEffect.of(merged, effect.label)
                return replace(self, effects=(*self.effects[:place], both, *self.effects[place + 1 :]))
        return replace(self, effects=(*self.effects, effect))


def _merged(one: dict[str, Any], other: dict[str, Any]) -> dict[str, Any] | None:
    """Two nodes of lags of the same column as one; None for any others."""
    first, second = ({**node.get("parameters", {}), "time_constants": None} for node in (one, other))
    if one["kind"] != LaggedCovariate.kind or other["kind"] != one["kind"] or first != second:
        return None
    times = sorted({*one["parameters"]["time_constants"], *other["parameters"]["time_constants"]})
    return {**one, "parameters": {**one["parameters"], "time_constants": times}}

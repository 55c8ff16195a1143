"""What a user has arranged: roles of columns, and the steps taken."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Collection, Iterable
from dataclasses import asdict, dataclass, field, replace
from typing import Any, NamedTuple

import pandas as pd

from ..effects import LaggedCovariate
from ..foreign import RUN
from ..records import RecordError
from ..records.errors import listing, quoted
from ..records.files import TIME_NAMES
from ..records.types import kind_of
from ..records.units import DEGREES, TEMPERATURES, name_and_unit, unit_of

READINGS = re.compile(
    r"reading|measur|messwert|anzeige|spannung|widerstand|voltage|volt|resist|value|output|frequency|freq|weight|load|force|strain|tilt|mass|^u$|^v$|^r$",
    re.IGNORECASE,
)
"""Names that readings go by."""
RUNS = ("run", "run_id", "run id", RUN)
"""Names, in small letters, that labels of runs go by; several files are such runs."""


@dataclass(frozen=True, kw_only=True)
class Roles:
    """What the columns of a log are; a column with no role here is under suspicion."""

    temperature: str
    reading: str
    time: str | None = None
    run: str | None = None
    ignored: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        taken = [name for name in (self.temperature, self.reading, self.time, self.run) if name is not None]
        twice = next((name for name in taken if taken.count(name) > 1), None)
        if twice is not None:
            raise RecordError(
                f"The column {quoted(twice)} cannot be two things at once. Give each role its own column."
            )
        lost = next((name for name in self.ignored if name in taken), None)
        if lost is not None:
            raise RecordError(f"The column {quoted(lost)} is used by the model and cannot be ignored as well.")

    def of(self, column: str) -> str:
        """The role of a column: temperature, reading, time, run, ignored or suspect."""
        for role in ("temperature", "reading", "time", "run"):
            if getattr(self, role) == column:
                return role
        return "ignored" if column in self.ignored else "suspect"

    def check(self, columns: Iterable[str]) -> None:
        """Raise RecordError for a role of a column that is not there."""
        columns = list(columns)
        for name in (self.temperature, self.reading, self.time, self.run, *self.ignored):
            if name is not None and name not in columns:
                raise RecordError(f"There is no column {quoted(name)}. The log has: {listing(columns)}.")


def guessed(
    frame: pd.DataFrame,
    *,
    temperature: str | None = None,
    reading: str | None = None,
    time: str | None = None,
    run: str | None = None,
) -> Roles | None:
    """Roles from names and units, those that are given as they are; None where a person must choose.

    `frame` (DataFrame). `temperature`, `reading`, `time`, `run` (str, optional): Columns whose role the user knows.
    """
    time = guessed_time(frame, (temperature, reading, run)) if time is None else time
    run = guessed_run(frame, reading) if run is None else run
    numbers = [str(c) for c in frame.columns if kind_of(frame[c]) == "number" and str(c) not in (time, run)]
    if temperature is None:
        temperature = _temperature([name for name in numbers if name != reading], frame)
    if reading is None:
        reading = _reading([name for name in numbers if name != temperature], frame)
    if temperature is None or reading is None:
        return None
    return Roles(temperature=temperature, reading=reading, time=time, run=run)


def guessed_time(frame: pd.DataFrame, taken: Collection[str | None] = ()) -> str | None:
    """The column of times, by its name or by what is in it; None where there is none, or the index has them.

    Columns that are `taken` are known to be something else.
    """
    if isinstance(frame.index, pd.DatetimeIndex | pd.TimedeltaIndex):
        return None
    names = [name for name in frame.columns if str(name) not in taken]
    by_name = {str(name).strip().lower(): str(name) for name in reversed(names)}
    time = next((by_name[name] for name in TIME_NAMES if name in by_name), None)
    return time or next((str(c) for c in names if kind_of(frame[c]) in ("date", "span")), None)


def guessed_run(frame: pd.DataFrame, reading: str | None = None) -> str | None:
    """The column of labels of runs, by its name; None where there is none."""
    return next((str(c) for c in frame.columns if str(c).strip().lower() in RUNS and str(c) != reading), None)


def _temperature(names: list[str], frame: pd.DataFrame) -> str | None:
    plain = {name: name_and_unit(name)[0].strip() for name in names}
    exact = [name for name in names if plain[name].lower() in ("temperature", "ambient_temperature", "temperatur")]
    degrees = [name for name in names if unit_of(name, frame) in DEGREES]
    called = [name for name in names if TEMPERATURES.search(plain[name])]
    return next(iter([*exact, *degrees, *called]), None)


def _reading(names: list[str], frame: pd.DataFrame) -> str | None:
    """The column that is called a reading; else the only one that could be."""
    plain = {name: name_and_unit(name)[0].strip() for name in names}
    exact = [name for name in names if plain[name].lower() == "reading"]
    called = [name for name in names if READINGS.search(plain[name])]
    others = [name for name in names if unit_of(name, frame) not in DEGREES and not TEMPERATURES.search(plain[name])]
    for found in (exact, called, others):
        if len(found) == 1:
            return found[0]
    return None


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

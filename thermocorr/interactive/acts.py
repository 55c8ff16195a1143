"""Acts of the user: roles of columns, and the steps taken."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass, field, replace
from typing import Any, NamedTuple

import pandas as pd

from ..effects import LaggedCovariate
from ..files.codec import ModelFileError, fields, integer, items, number, text
from ..readers import guess, is_counter
from ..records import RecordError
from ..records.errors import listing, quoted
from ..records.hints import LEAST

ROLES = ("reading", "temperature", "reference", "time", "run")
"""What a column may be; else it is ignored, or a suspect."""


@dataclass(frozen=True, kw_only=True)
class Roles:
    """Roles of a log's columns; a column without a role is a suspect.

    A thermometer that is compared with a reference may be both, the temperature and the reading.
    """

    temperature: str
    reading: str
    reference: str | None = None
    time: str | None = None
    run: str | None = None
    ignored: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        own = () if self.reference and self.temperature == self.reading else (self.temperature,)
        taken = [name for name in (*own, self.reading, self.reference, self.time, self.run) if name is not None]
        twice = next((name for name in taken if taken.count(name) > 1), None)
        if twice is not None:
            raise RecordError(
                f"The column {quoted(twice)} cannot be two things at once. Give each role its own column."
            )
        lost = next((name for name in self.ignored if name in taken), None)
        if lost is not None:
            raise RecordError(f"The column {quoted(lost)} is used by the model and cannot be ignored as well.")

    def of(self, column: str) -> str:
        """The role of a column: reading, temperature, reference, time, run, ignored or suspect."""
        for role in ROLES:
            if getattr(self, role) == column:
                return role
        return "ignored" if column in self.ignored else "suspect"

    def check(self, columns: Iterable[str]) -> None:
        """Raise RecordError for a role of a column that is not there."""
        columns = list(columns)
        for name in (*(getattr(self, role) for role in ROLES), *self.ignored):
            if name is not None and name not in columns:
                raise RecordError(f"There is no column {quoted(name)}. The log has: {listing(columns)}.")


def guessed(frame: pd.DataFrame, **known: Any) -> Roles | None:
    """Roles of the columns of a log, see `guess`; None where a person must choose."""
    found = guess(frame, **{role: name for role, name in known.items() if role != "time"})
    if found.temperature is None or found.reading is None:
        return None
    counters = (name for name in frame.columns if is_counter(frame[name]) and name not in found)
    return Roles(
        temperature=found.temperature,
        reading=found.reading,
        reference=known.get("reference"),
        time=known.get("time"),
        run=found.run,
        ignored=tuple(map(str, counters)),
    )


Stretch = tuple[int, int]
"""First row of the log, and the one behind the last."""


@dataclass(frozen=True, kw_only=True)
class ModelSettings:
    """Settings of the model, see `DynamicBiasRegressor`."""

    time_constants: Any = 6
    degree: int = 2
    products: bool | int = False
    screen: bool = True
    sampling_period: float | str | None = None
    max_gap: float | str | None = None

    @property
    def open(self) -> bool:
        """True if nobody has chosen lags, degree or products, so that the work begins with what is advised."""
        return self.time_constants in ("auto", 6) and self.degree == 2 and self.products is False


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
    """State of the workbench. Equal arrangements of one log give equal models, bit for bit."""

    roles: Roles | None = None
    """None until it is known which column is the temperature and which the reading."""
    settings: ModelSettings = field(default_factory=ModelSettings)
    effects: tuple[AddedEffect, ...] = ()
    left_out: tuple[Stretch, ...] = ()
    """Stretches that are not learned from."""

    def key(self) -> str:
        """A name that only equal arrangements share."""
        return hashlib.sha256(json.dumps(asdict(self), sort_keys=True, default=list).encode()).hexdigest()[:24]

    def learned(self) -> tuple[Any, ...]:
        """Key of the readings that are learned from: errors on other readings cannot be compared."""
        return (self.roles and self.roles.reading, self.left_out)

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


PRODUCTS = {1: ", products of lags", 2: ", products of lags", 3: ", products of two and three lags"}
MOST_ROWS = 10**12


@dataclass(frozen=True)
class Columns:
    """The columns get their roles."""

    roles: Roles

    def on(self, before: Arrangement) -> Arrangement:
        """The arrangement with these roles instead of its own."""
        return replace(before, roles=self.roles)

    def sentence(self) -> str:
        """Sentence that describes this step."""
        against = "" if self.roles.reference is None else f" against {self.roles.reference}"
        return f"{self.roles.reading}{against} over {self.roles.temperature}"

    def node(self) -> dict[str, Any]:
        """The step as JSON."""
        return {"do": "columns", **asdict(self.roles), "ignored": list(self.roles.ignored)}


@dataclass(frozen=True)
class Shape:
    """The model gets other settings."""

    time_constants: Any
    degree: int
    products: bool | int

    def on(self, before: Arrangement) -> Arrangement:
        """The arrangement with other settings."""
        return replace(before, settings=replace(before.settings, **asdict(self)))

    def sentence(self) -> str:
        """Sentence that describes this step."""
        count = self.time_constants
        lags = f"{count} time constants" if isinstance(count, int) else f"time constants {count or 'none'}"
        return f"{lags}, degree {self.degree}{PRODUCTS.get(int(self.products), '')}"

    def node(self) -> dict[str, Any]:
        """The step as JSON."""
        return {"do": "shape", **asdict(self)}


@dataclass(frozen=True)
class Add:
    """An effect is added."""

    effect: AddedEffect
    time_constants: tuple[float, ...] = ()
    """Where a lag of the temperature is added: those of the model with it [s]."""

    def on(self, before: Arrangement) -> Arrangement:
        """The arrangement with one effect more, or one lag."""
        if self.time_constants:
            return replace(before, settings=replace(before.settings, time_constants=self.time_constants))
        return before.with_effect(self.effect)

    def sentence(self) -> str:
        """Sentence that describes this step."""
        return f"added {self.effect.label}"

    def node(self) -> dict[str, Any]:
        """The step as JSON."""
        added = {"do": "add", "effect": json.loads(self.effect.node), "label": self.effect.label}
        return {**added, "time_constants": list(self.time_constants)}


@dataclass(frozen=True)
class LeaveOut:
    """Rows are no longer learned from."""

    rows: tuple[Stretch, ...]
    where: str
    """From when to when, in words."""

    def on(self, before: Arrangement) -> Arrangement:
        """The arrangement without more rows."""
        return replace(before, left_out=tuple(sorted({*before.left_out, *self.rows})))

    def sentence(self) -> str:
        """Sentence that describes this step."""
        return f"leave out: {self.where}"

    def node(self) -> dict[str, Any]:
        """The step as JSON."""
        return {"do": "leave_out", "rows": [list(stretch) for stretch in self.rows], "where": self.where}


Act = Columns | Shape | Add | LeaveOut


def act_of(node: Any, where: str, effect_label: Callable[[Any, str], str]) -> Act:
    """An act from JSON; ModelFileError says what is wrong with it.

    `effect_label` gives the label of an effect's node, or refuses it.
    """
    if not isinstance(node, dict):
        raise ModelFileError(f"{where} is no step")
    kind = text(node.get("do"), f"{where}.do")
    if kind == "columns":
        return Columns(roles_of(fields(node, where, ("do", *ROLES, "ignored")), where))
    if kind == "shape":
        return shape_of(fields(node, where, ("do", "time_constants", "degree", "products")), where)
    if kind == "add":
        node = fields(node, where, ("do", "effect", "label", "time_constants"))
        taus = items(node["time_constants"], f"{where}.time_constants")
        return Add(
            AddedEffect.of(node["effect"], effect_label(node["effect"], f"{where}.effect")),
            tuple(number(tau, f"{where}.time_constants", LEAST) for tau in taus),
        )
    if kind == "leave_out":
        node = fields(node, where, ("do", "rows", "where"))
        rows = tuple(_stretch(pair, f"{where}.rows[{i}]") for i, pair in enumerate(items(node["rows"], where)))
        return LeaveOut(rows, text(node["where"], f"{where}.where"))
    raise ModelFileError(f"{where}.do is {kind!r}, which is no step")


def roles_of(node: dict[str, Any], where: str) -> Roles:
    """Roles from JSON."""
    named = {key: text(node[key], f"{where}.{key}") for key in ("temperature", "reading")}
    maybe = {
        key: None if node[key] is None else text(node[key], f"{where}.{key}") for key in ("reference", "time", "run")
    }
    ignored = tuple(text(name, f"{where}.ignored[{i}]") for i, name in enumerate(items(node["ignored"], where)))
    return Roles(temperature=named["temperature"], reading=named["reading"], ignored=ignored, **maybe)


def shape_of(node: dict[str, Any], where: str) -> Shape:
    """Settings of a model from JSON: a number of time constants, auto, or a list of spans."""
    taus = node["time_constants"]
    if isinstance(taus, list):
        place = f"{where}.time_constants"
        taus = tuple(text(tau, place) if isinstance(tau, str) else number(tau, place, LEAST) for tau in taus)
    elif taus != "auto":
        taus = integer(taus, f"{where}.time_constants", 1, 64)
    return Shape(taus, integer(node["degree"], f"{where}.degree", 0, 9), products_of(node["products"], where))


def products_of(value: Any, where: str) -> bool | int:
    """Products of lags from JSON: see `DynamicBiasRegressor`."""
    if type(value) not in (bool, int) or value not in (False, True, 2, 3):
        raise ModelFileError(f"{where}.products is none of: false, true, 2, 3")
    return bool(value) if isinstance(value, bool) else int(value)


def _stretch(node: Any, where: str) -> Stretch:
    start, stop = (integer(item, where, 0, MOST_ROWS) for item in items(node, where, 2))
    if stop <= start:
        raise ModelFileError(f"{where} ends before it begins")
    return start, stop


def folded(acts: tuple[Act, ...], settings: ModelSettings) -> Arrangement:
    """The arrangement that a row of acts makes."""
    arrangement = Arrangement(settings=settings)
    for act in acts:
        arrangement = act.on(arrangement)
    return arrangement


class Past(NamedTuple):
    """All rows of steps that ever stood, and which one stands now: one value, so that nothing is half done."""

    versions: tuple[tuple[Act, ...], ...]
    at: int

    @property
    def acts(self) -> tuple[Act, ...]:
        """The steps that stand."""
        return self.versions[self.at]

    def followed_by(self, acts: tuple[Act, ...]) -> Past:
        """The past that goes on with other steps; what was undone before is forgotten, and what is very long ago."""
        # Steps that can be undone
        versions = (*self.versions[: self.at + 1], acts)[-1000:]
        return Past(versions, len(versions) - 1)

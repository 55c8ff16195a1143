"""What a user can do on the workbench: steps, each of which makes another arrangement of the one before it."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from typing import Any, NamedTuple

from ..files.codec import ModelFileError, fields, integer, items, number, positive, text
from .arrangement import AddedEffect, Arrangement, ModelSettings, Moment, Roles, Stretch

MARKS = {
    "left out": "Leave out",
    "own run": "Treat as another run",
    "change": "The measurand changed here",
    "spikes": "Mark spikes",
}
"""What a stretch can be marked as, and in the words of a button."""
PRODUCTS = {1: ", products of lags", 2: ", products of lags", 3: ", products of two and three lags"}
MOST_VERSIONS = 1000
"""Steps that can be undone."""
MOST_ROWS = 10**12
MOST_SPIKES = 1000
"""Rows that are marked as spikes at once."""


@dataclass(frozen=True)
class Columns:
    """The columns get their roles."""

    roles: Roles

    def on(self, before: Arrangement) -> Arrangement:
        """The arrangement with these roles instead of its own."""
        return replace(before, roles=self.roles)

    def sentence(self) -> str:
        """Sentence that describes this step."""
        return f"{self.roles.reading} over {self.roles.temperature}"

    def node(self) -> dict[str, Any]:
        """The step as a session file has it."""
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
        lags = f"{count} time constants" if isinstance(count, int) else f"time constants {count}"
        return f"{lags}, degree {self.degree}{PRODUCTS.get(int(self.products), '')}"

    def node(self) -> dict[str, Any]:
        """The step as a session file has it."""
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
        """The step as a session file has it."""
        added = {"do": "add", "effect": json.loads(self.effect.node), "label": self.effect.label}
        return {**added, "time_constants": list(self.time_constants)}


@dataclass(frozen=True)
class Mark:
    """Rows are marked as something, see `MARKS`."""

    what: str
    rows: tuple[Stretch, ...]
    where: str
    """Sentence that describes this step."""
    moments: tuple[Moment, ...] = ()
    """When the measurand changes, for such a mark."""

    def on(self, before: Arrangement) -> Arrangement:
        """The arrangement with more marks."""
        if self.what == "left out":
            return replace(before, left_out=tuple(sorted({*before.left_out, *self.rows})))
        if self.what == "own run":
            return replace(before, own_runs=tuple(sorted({*before.own_runs, *self.rows})))
        if self.what == "change":
            return replace(before, changes=tuple(sorted({*before.changes, *self.moments})))
        rows = {row for start, stop in self.rows for row in range(start, stop)}
        return replace(before, spikes=tuple(sorted({*before.spikes, *rows})))

    def sentence(self) -> str:
        """Sentence that describes this step."""
        return f"{MARKS[self.what].lower()}: {self.where}"

    def node(self) -> dict[str, Any]:
        """The step as a session file has it."""
        return {
            "do": "mark",
            "what": self.what,
            "rows": [list(stretch) for stretch in self.rows],
            "where": self.where,
            "moments": list(self.moments),
        }


Act = Columns | Shape | Add | Mark


def act_of(node: Any, where: str, effect_label: Callable[[Any, str], str]) -> Act:
    """An act from a session file; ModelFileError says what is wrong with it.

    `effect_label` gives the label of an effect's node, or refuses it.
    """
    if not isinstance(node, dict):
        raise ModelFileError(f"{where} is no step of a session")
    kind = text(node.get("do"), f"{where}.do")
    if kind == "columns":
        return Columns(roles_of(fields(node, where, ("do", "temperature", "reading", "time", "run", "ignored")), where))
    if kind == "shape":
        return shape_of(fields(node, where, ("do", "time_constants", "degree", "products")), where)
    if kind == "add":
        node = fields(node, where, ("do", "effect", "label", "time_constants"))
        taus = items(node["time_constants"], f"{where}.time_constants")
        return Add(
            AddedEffect.of(node["effect"], effect_label(node["effect"], f"{where}.effect")),
            tuple(positive(tau, f"{where}.time_constants") for tau in taus),
        )
    if kind == "mark":
        node = fields(node, where, ("do", "what", "rows", "where", "moments"))
        what = text(node["what"], f"{where}.what")
        if what not in MARKS:
            raise ModelFileError(f"{where}.what is {what!r}, which is none of: {', '.join(MARKS)}")
        rows = tuple(_stretch(pair, f"{where}.rows[{i}]") for i, pair in enumerate(items(node["rows"], where)))
        moments = tuple(
            text(moment, f"{where}.moments") if isinstance(moment, str) else number(moment, f"{where}.moments")
            for moment in items(node["moments"], f"{where}.moments")
        )
        if len({type(moment) for moment in moments}) > 1:
            raise ModelFileError(f"{where}.moments holds dates and numbers, of which one belongs there")
        if what == "spikes" and sum(stop - start for start, stop in rows) > MOST_SPIKES:
            raise ModelFileError(f"{where}.rows holds more than {MOST_SPIKES} spikes")
        return Mark(what, rows, text(node["where"], f"{where}.where"), moments)
    raise ModelFileError(f"{where}.do is {kind!r}, which is no step of a session")


def roles_of(node: dict[str, Any], where: str) -> Roles:
    """Roles from JSON."""
    named = {key: text(node[key], f"{where}.{key}") for key in ("temperature", "reading")}
    maybe = {key: None if node[key] is None else text(node[key], f"{where}.{key}") for key in ("time", "run")}
    ignored = tuple(text(name, f"{where}.ignored[{i}]") for i, name in enumerate(items(node["ignored"], where)))
    return Roles(temperature=named["temperature"], reading=named["reading"], ignored=ignored, **maybe)


def shape_of(node: dict[str, Any], where: str) -> Shape:
    """Settings of a model from JSON: a number of time constants, auto, or a list of spans."""
    taus = node["time_constants"]
    if isinstance(taus, list):
        place = f"{where}.time_constants"
        taus = tuple(text(tau, place) if isinstance(tau, str) else positive(tau, place) for tau in taus)
    elif taus != "auto":
        taus = integer(taus, f"{where}.time_constants", 1, 64)
    return Shape(taus, integer(node["degree"], f"{where}.degree", 0, 9), products_of(node["products"], where))


def products_of(value: Any, where: str) -> bool | int:
    """Which products of lags a model has, from JSON: see `DynamicBiasRegressor`."""
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
        versions = (*self.versions[: self.at + 1], acts)[-MOST_VERSIONS:]
        return Past(versions, len(versions) - 1)

"""Effects in a model file: what each kind has learned, checked value by value when it is read."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable, Collection
from typing import Any

import numpy as np

from ..effects import CATALOGUE, Effect, TransformerEffect
from ..effects.expressions import Delayed, Lag, Word, words_of
from ..effects.signals import DelayState
from ..effects.thermal import seconds_array
from ..equations import LagState
from ..equations.sensor_artefacts import OVERLOAD
from .codec import MOST_STATE, ModelFileError, fields, name, number, pack, positive, text, unexpected, unpack, vector


def _times(value: Any, where: str, effect: Any) -> None:
    if not np.array_equal(vector(value, where), seconds_array(effect.time_constants)):
        raise unexpected(where, "time constants", "those of the effect's parameters")


def _times_of_segments(value: Any, where: str, effect: Any) -> None:
    times = seconds_array(effect.time_constants)
    if not isinstance(value, dict) or any(type(key) is not int or key < 0 for key in value):
        raise unexpected(where, "keys", "numbers of segments")
    for key, taus in value.items():
        taus = vector(taus, f"{where}[{key}]")
        own = np.isin(taus, times)
        as_long_as_segment = len(taus) > 0 and 0 < taus[-1] < times.max(initial=0.0)  # it stands for all longer ones
        if not len(taus) or not own[:-1].all() or not (own[-1] or as_long_as_segment):
            raise unexpected(f"{where}[{key}]", "time constants", "some of those of the effect's parameters")


def _texts_of_segments(value: Any, where: str, effect: Any) -> None:
    if not isinstance(value, dict) or set(value) != set(effect.decays_):
        raise unexpected(where, "labels", "one for each segment with decays")
    for key, item in value.items():
        text(item, f"{where}[{key}]")


def _each(value: Any, where: str, check: Callable[[Any, str], Any]) -> None:
    if not isinstance(value, list):
        raise unexpected(where, "values", "a list")
    for i, item in enumerate(value):
        check(item, f"{where}[{i}]")


CHECKS: dict[str, Callable[[Any, str, Any], Any]] = {
    "number": lambda value, where, effect: number(value, where, -1e300, 1e300),
    "temperature": lambda value, where, effect: number(value, where, -OVERLOAD, OVERLOAD),
    "positive": lambda value, where, effect: positive(value, where),
    "positive or None": lambda value, where, effect: value is None or positive(value, where),
    "numbers": lambda value, where, effect: _each(value, where, lambda item, at: number(item, at, -1e300, 1e300)),
    "text": lambda value, where, effect: text(value, where),
    "texts": lambda value, where, effect: _each(value, where, text),
    "column": lambda value, where, effect: name(value, where),
    "times": _times,
    "times of segments": _times_of_segments,
    "texts of segments": _texts_of_segments,
}
"""Words of `Effect.learned` -> how such a value is checked; a check may look at what stands before it."""


class ImportNotAllowedError(ModelFileError):
    """A file needs an effect that its reader has not allowed to be imported."""

    remedy = "Without that, nothing of the file was run."


class EffectCodec:
    """Effects to JSON and back.

    `allow_imports` (collection of str): Import paths of effects that are not in the catalogue and may be loaded, such
    as "mypackage.effects.FanNoise".
    """

    def __init__(self, allow_imports: Collection[str] = ()):
        if isinstance(allow_imports, str):
            allow_imports = [allow_imports]
        self.allow_imports = tuple(allow_imports)

    # ---------------------------------------------------------------------------------------------------------- to JSON

    def pack(self, effect: Any, where: str, learned: bool) -> dict[str, Any]:
        """One effect, with what it has learned or without."""
        if not isinstance(effect, Effect) or isinstance(effect, TransformerEffect):
            inner = getattr(effect, "transformer", effect)
            if hasattr(inner, "transform"):
                raise ModelFileError(
                    f"{where} is the scikit-learn transformer {type(inner).__name__}, which a model file cannot hold "
                    "without running code when it is read. Write it as an effect of your own (see "
                    "thermocorr.effects.Effect), or keep the model with skops or joblib."
                )
            raise ModelFileError(f"{where} is a {type(effect).__name__}, which has no place in a model file.")
        node: dict[str, Any] = {"kind": effect.kind}
        if CATALOGUE.get(effect.kind) is not type(effect):
            node["import"] = import_path(type(effect), where)
        parameters = effect.get_params(deep=False)
        node["parameters"] = {key: pack(value, f"{where}.{key}", self.pack_effect) for key, value in parameters.items()}
        if learned:
            found = {key: value for key, value in vars(effect).items() if key not in parameters}
            stray = next((key for key in found if not key.endswith("_") or key.startswith("_")), None)
            if stray is not None:
                raise ModelFileError(
                    f"{where} ({type(effect).__name__}) keeps something in {stray!r}. What an effect learns must stand "
                    "in attributes whose names end with an underscore."
                )
            node["learned"] = {key: pack(value, f"{where}.{key}", self.pack_learned) for key, value in found.items()}
        return node

    def pack_effect(self, value: Any, where: str) -> Any:
        """An effect among parameters."""
        return {"$effect": self.pack(value, where, learned=False)}

    def pack_learned(self, value: Any, where: str) -> Any:
        """An effect that another one has made and taught."""
        return {"$effect": self.pack(value, where, learned=True)}

    # -------------------------------------------------------------------------------------------------------- from JSON

    def unpack_nested(self, node: Any, where: str) -> Effect:
        """An effect among parameters or learned attributes: taught where the file says so."""
        return self.unpack(node, where, learned=isinstance(node, dict) and "learned" in node)

    def unpack(self, node: Any, where: str, learned: bool) -> Effect:
        """One effect; raises ModelFileError for what is not one, and for imports that are not allowed."""
        required = ("kind", "parameters", "learned") if learned else ("kind", "parameters")
        node = fields(node, where, required, ("import", "name"))
        cls = self._class_of(node, where)
        parameters = fields(node["parameters"], f"{where}.parameters", tuple(cls._get_param_names()))
        given = {
            key: unpack(value, f"{where}.parameters.{key}", self.unpack_nested) for key, value in parameters.items()
        }
        try:
            effect = cls(**given)
            if "import" not in node:
                effect._validate_params()
                _check_parameters(effect, f"{where}.parameters")
        except ModelFileError:
            raise
        except Exception as error:
            raise ModelFileError(f"{where}.parameters are refused by {cls.__name__}: {error}") from None
        if learned:
            self._teach(effect, node["learned"], f"{where}.learned")
        return effect

    def _teach(self, effect: Effect, node: Any, where: str) -> None:
        wanted = vars(type(effect)).get("learned")  # a subclass may learn more than it inherits
        if wanted is None:
            if not isinstance(node, dict) or any(not k.endswith("_") or k.startswith("_") for k in node):
                raise unexpected(where, "something", "names that end with an underscore")
            wanted = dict.fromkeys(node, "")
        node = fields(node, where, tuple(wanted))
        for key, check in wanted.items():
            place = f"{where}.{key}"
            value = unpack(node[key], place, self.unpack_nested)
            try:
                if check:
                    CHECKS[check](value, place, effect)
            except ModelFileError:
                raise
            except (ValueError, TypeError, OverflowError) as error:
                raise ModelFileError(f"{place}: {error}") from None
            setattr(effect, key, value)

    def _class_of(self, node: dict[str, Any], where: str) -> type[Effect]:
        kind, path = text(node["kind"], f"{where}.kind"), node.get("import")
        if path is None:
            if kind not in CATALOGUE:
                raise unexpected(f"{where}.kind", repr(kind), f"one of {', '.join(CATALOGUE)}")
            return CATALOGUE[kind]
        path = text(path, f"{where}.import")
        if path not in self.allow_imports:
            raise ImportNotAllowedError(
                f"{where} is an effect of its own, {path!r}, which would be imported and run. If you trust it, load "
                f"with allow_imports=[{path!r}]"
            )
        module, _, qualified = path.rpartition(".")
        try:
            found: Any = importlib.import_module(module)
            found = getattr(found, qualified)
        except (ImportError, AttributeError, ValueError) as error:
            raise ModelFileError(f"{where} needs {path!r}, which cannot be imported: {error}") from None
        if not (isinstance(found, type) and issubclass(found, Effect)) or found.kind != kind:
            raise ModelFileError(f"{where} needs {path!r}, which is no effect of the kind {kind!r}")
        return found


def import_path(cls: type, where: str) -> str:
    """Import path of a class; ModelFileError for one that cannot be imported."""
    path = f"{cls.__module__}.{cls.__qualname__}"
    if getattr(sys.modules.get(cls.__module__), cls.__qualname__, None) is not cls:
        raise ModelFileError(
            f"{where} is of the class {path}, which cannot be imported from there. Define it at the top level of a "
            "module."
        )
    return path


def _check_parameters(effect: Any, where: str) -> None:
    """Checks of parameters that effects make only while they learn, or not at all."""
    if hasattr(effect, "time_constants"):
        try:
            seconds_array(effect.time_constants)
        except (ValueError, TypeError, OverflowError) as error:
            raise ModelFileError(f"{where}.time_constants: {error}") from None
    if hasattr(effect, "column") and (effect.column is not None or None in effect.inputs()):
        name(effect.column, f"{where}.column")
    for limited in effect.info.parameters:
        value = getattr(effect, limited)
        if isinstance(value, int | float):
            number(value, f"{where}.{limited}", -1e300, 1e300)


def check_state(effect: Any, state: Any, where: str) -> None:
    """Refuse a state that the effect cannot go on from: its formula's words say what belongs there.

    That of an effect with columns of its own is not looked at.
    """
    words = words_of(effect)
    if words is None:
        return
    states = [state]
    if len(words) != 1:
        if state is not None if not words else type(state) is not tuple or len(state) != len(words):
            raise unexpected(where, repr(state)[:60], f"the states of {len(words)} words" if words else "null")
        states = list(state or ())
    for word, one in zip(words, states, strict=True):
        _check_word(word, one, where)


def _check_word(word: Word, state: Any, where: str) -> None:
    if isinstance(word, Lag):
        if type(state) is not LagState:
            raise unexpected(where, repr(state)[:60], f"the state of {len(word.time_constants)} lags")
        vector(state.lag_difference, f"{where}.lag_difference", len(word.time_constants), MOST_STATE)
        number(state.temperature, f"{where}.temperature", -MOST_STATE, MOST_STATE)
    elif isinstance(word, Delayed):
        if type(state) is not DelayState or not len(vector(state.elapsed, where, most=MOST_STATE)):
            raise unexpected(where, repr(state)[:60], "the samples that a delay looks back to")
        vector(state.temperature, f"{where}.temperature", len(state.elapsed), MOST_STATE)
        if (np.diff(state.elapsed) <= 0).any():
            raise unexpected(f"{where}.elapsed", "times", "increasing times")
    else:
        number(state, where, -MOST_STATE, MOST_STATE)

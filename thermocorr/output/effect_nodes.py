"""Effects in a model file, checked when read."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Collection
from typing import Annotated, Any

import numpy as np

from ..effects import CATALOGUE, Effect, TransformerEffect
from ..effects.expressions import Delayed, Lag, Word, words_of
from ..effects.signals import DelayState
from ..effects.thermal import seconds_array
from ..equations import LagState
from ..equations.outliers import OVERLOAD
from ..records.errors import way
from ..records.types import LARGEST, Column, Large, Positive, Sizes, within
from .codec import ModelFileError, fields, number, pack, read, shown, text, unexpected, unpack, write

LEARNED: dict[str, Any] = {
    "number": Large, "temperature": Annotated[float, within(-OVERLOAD, OVERLOAD)], "positive": Positive,
    "positive or None": Positive | None, "numbers": list[Large], "text": str, "texts": list[str], "column": Column,
    "times": Sizes, "times of segments": dict[int, Sizes], "texts of segments": dict[int, str],
}  # fmt: skip
"""Words of `Effect.learned`, and the hints of such values."""


class ImportNotAllowedError(ModelFileError):
    """A file needs an import that was not allowed."""

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

    def pack(self, effect: Any, where: str) -> dict[str, Any]:
        """One effect, with what it has learned."""
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
        node["parameters"] = {key: pack(value, f"{where}.{key}", self.pack) for key, value in parameters.items()}
        learned = {key: value for key, value in vars(effect).items() if key not in parameters}
        for key in learned:
            if not key.endswith("_") or key.startswith("_"):
                raise ModelFileError(
                    f"{where} ({type(effect).__name__}) keeps something in {key!r}. What an effect learns must stand "
                    "in attributes whose names end with an underscore."
                )
        if learned:
            words = vars(type(effect)).get("learned") or {}
            node["learned"] = {
                key: write(LEARNED[words[key]] if key in words else Any, value, f"{where}.{key}", self.pack)
                for key, value in learned.items()
            }
        return node

    def unpack(self, node: Any, where: str) -> Effect:
        """One effect; ModelFileError for anything else."""
        node = fields(node, where, ("kind", "parameters"), ("import", "learned"))
        cls = self._class_of(node, where)
        given = fields(node["parameters"], f"{where}.parameters", cls._get_param_names())
        given = {key: unpack(value, f"{where}.parameters.{key}", self.unpack) for key, value in given.items()}
        try:
            effect = cls(**given)
            if "import" not in node:
                effect._validate_params()
                _check_parameters(effect, f"{where}.parameters")
        except ModelFileError:
            raise
        except Exception as error:
            raise ModelFileError(f"{where}.parameters are refused by {cls.__name__}: {error}") from None
        words = vars(cls).get("learned")  # a subclass may learn more than it inherits
        learned = fields(node.get("learned", {}), f"{where}.learned", words if words and "learned" in node else None)
        for key, value in learned.items():
            if not key.endswith("_") or key.startswith("_") or (words is not None and key not in words):
                raise unexpected(f"{where}.learned", f"the key {shown(key)}", "names that end with an underscore")
            hint = Any if words is None else LEARNED[words[key]]
            setattr(effect, key, read(hint, value, f"{where}.learned.{key}", self.unpack))
        return effect

    def _class_of(self, node: dict[str, Any], where: str) -> type[Effect]:
        kind, path = text(node["kind"], f"{where}.kind"), node.get("import")
        if path is None:
            if kind not in CATALOGUE:
                raise unexpected(f"{where}.kind", repr(kind), f"one of {', '.join(CATALOGUE)}")
            return CATALOGUE[kind]
        path = text(path, f"{where}.import")
        if path not in self.allow_imports:
            raise ImportNotAllowedError(
                f"{where} is an effect from outside the package, {path!r}, which would be imported and run. If you "
                + way(
                    "trust it, use it in Python: load_model(..., allow_imports=[...])",
                    f"trust it, load with allow_imports=[{path!r}]",
                )
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
    """Import path of a class, or ModelFileError."""
    path = f"{cls.__module__}.{cls.__qualname__}"
    if getattr(sys.modules.get(cls.__module__), cls.__qualname__, None) is not cls:
        raise ModelFileError(
            f"{where} is of the class {path}, which cannot be imported from there. Define it at the top level of a "
            "module."
        )
    return path


def _check_parameters(effect: Any, where: str) -> None:
    """Check parameters that effects check late."""
    if hasattr(effect, "column") and (effect.column is not None or None in effect.inputs()):
        read(Column, effect.column, f"{where}.column")
    for limited, unit in effect.info.parameters.items():
        value = getattr(effect, limited)
        if isinstance(value, int | float):
            number(value, f"{where}.{limited}", -1e300, 1e300)
        if unit == "s" and value is not None and np.any(np.asarray(value, object) != 0):
            try:
                seconds_array(value)
            except (ValueError, TypeError, OverflowError) as error:
                raise ModelFileError(f"{where}.{limited}: {error}") from None


def check_state(effect: Any, state: Any, where: str) -> None:
    """Refuse a state that does not fit the effect.

    That of an effect with columns of its own is not looked at.
    """
    words = words_of(effect)
    if words is None:
        return
    states = [state]
    if len(words) != 1:
        if state is not None if not words else type(state) is not tuple or len(state) != len(words):
            raise unexpected(where, shown(state), f"the states of {len(words)} words" if words else "null")
        states = list(state or ())
    for word, one in zip(words, states, strict=True):
        if not _goes_on(word, one):
            raise unexpected(where, shown(one), f"the state of a {type(word).__name__}")


def _goes_on(word: Word, state: Any) -> bool:
    """True if a word can go on from a state."""
    limits = within(-(LARGEST**3), LARGEST**3)  # of powers of columns
    if isinstance(word, Lag | Delayed):
        kind = LagState if isinstance(word, Lag) else DelayState
        if type(state) is not kind or not all(map(limits.holds, state)):
            return False
        shapes = [np.shape(part) for part in state]
        if isinstance(word, Lag):
            return shapes == [(len(word.time_constants),), ()]
        return len(shapes[0]) == 1 and shapes[0] == shapes[1] != (0,) and bool((np.diff(state[0]) > 0).all())
    return type(state) is float and limits.holds(state)

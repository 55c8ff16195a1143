"""The catalogue: every kind of effect.

A class of a file in this folder is in it once it says what it is, in `info`: its physics and bench check, its formula,
its place. Its search range is `Effect.candidates`.
"""

from __future__ import annotations

from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules

from .protocol import Effect


def _kinds() -> Iterator[type[Effect]]:
    """Classes with a kind and `info` of their own."""
    for file in iter_modules([str(Path(__file__).parent)]):
        module = import_module(f".{file.name}", __package__)
        here = (thing for thing in vars(module).values() if getattr(thing, "__module__", "") == module.__name__)
        yield from (thing for thing in here if isinstance(thing, type) and vars(thing).get("info") is not None)


CATALOGUE: dict[str, type[Effect]] = {
    effect.kind: effect for effect in sorted(_kinds(), key=lambda effect: effect.info.place if effect.info else 9.0)
}
"""Kind -> class: thermal kinds first, then recorded columns, then time, then what depends on history or place."""

"""Effects of the user's own, from a Python file that is named on the command line."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

from ..effects import CATALOGUE
from ..effects.protocol import Effect
from ..records import RecordError
from ..records.paths import existing_file


def effects_in(path: str | Path) -> tuple[type[Effect], ...]:
    """The classes of effects that a file defines; the file is run.

    Raises RecordError for a file that cannot be run, or defines none.
    """
    path = existing_file(path)
    name = path.stem
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None or not name.isidentifier():
        raise RecordError(f"{path} is no Python file. Effects of your own are classes in a file such as my_effects.py.")
    if name in sys.modules and getattr(sys.modules[name], "__file__", None) != str(path):
        raise RecordError(f"{path} is called like the module {name!r}, which is loaded already. Rename the file.")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    try:
        spec.loader.exec_module(module)
    except (Exception, SystemExit) as error:
        del sys.modules[name]
        raise RecordError(f"{path} cannot be run: {type(error).__name__}: {error}.") from None
    found = tuple(
        thing
        for thing in vars(module).values()
        if isinstance(thing, type) and issubclass(thing, Effect) and thing.__module__ == name
    )
    if not found:
        raise RecordError(f"{path} defines no effect: a class that is derived from thermocorr.effects.Effect.")
    taken = next((cls for cls in found if cls.kind in CATALOGUE), None)
    if taken is not None:
        raise RecordError(f"{path}: {taken.__name__} has the kind {taken.kind!r}, which is taken. Give it another one.")
    return found

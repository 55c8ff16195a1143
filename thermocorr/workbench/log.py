"""The log under work, and the user's own effects."""

from __future__ import annotations

import importlib.util
import sys
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import pandas as pd

from ..datasets import load_voltage_reference
from ..effects import CATALOGUE
from ..effects.protocol import Effect
from ..readers import Options, read_logs
from ..readers.log import timed
from ..records import RecordError, RecordWarning
from ..records.errors import existing_file, noted

BUILT_IN = "the built-in voltage reference with a hidden effect"


@dataclass(frozen=True, kw_only=True)
class Log:
    """A log, read."""

    frame: pd.DataFrame
    """Indexed by its times, where a file has them; its `attrs` say how it was read."""
    name: str
    """What it is called on a screen."""
    files: tuple[str, ...] = ()
    """Where it stands; none for the built-in record and for a frame."""
    how: Options = field(default_factory=Options)

    @classmethod
    def built_in(cls) -> Log:
        """The built-in record, its hidden effect unsaid."""
        return cls(frame=load_voltage_reference(hidden="moisture"), name=BUILT_IN)

    @classmethod
    def opened(cls, paths: Sequence[str | Path], how: Options | None = None, names: Sequence[str] = ()) -> Log:
        """A log in files, with their names at the source.

        Raises RecordError for files that cannot be read.
        """
        how = how or Options()
        for path in paths:
            if not existing_file(path).is_file():
                raise RecordError(f"{path} is no regular file. Name the log's file.")
        with noted() as notes:
            frame = read_logs(paths, how)
        frame.attrs["notes"] = [*frame.attrs["notes"], *notes]
        return cls(
            frame=frame,
            name=", ".join(Path(path).name for path in names or paths),
            files=tuple(names) or tuple(str(Path(path).resolve()) for path in paths),
            how=how,
        )

    def timed(self, time: str | None) -> tuple[pd.DataFrame, tuple[str, ...]]:
        """The log with its times, and notes on them.

        `time` (str, optional): A column that has them in place of those that were found. Raises RecordError for times
        that can be read in two ways, or not at all.
        """
        frame = timed(self.frame, replace(self.how, time=time)) if self.files and time is not None else self.frame
        return frame, tuple(frame.attrs.get("notes", ()))

    def code(self, time: str | None) -> str:
        """Python code that reads it."""
        if self.files:
            how = "".join(f", {name}={value!r}" for name, value in self.how.given().items())
            how += "" if time is None or self.how.time else f", time={time!r}"
            files = self.files[0] if len(self.files) == 1 else list(self.files)
            return f"read_log({files!r}{how})"
        if self.name == BUILT_IN:
            return 'load_voltage_reference(hidden="moisture")'
        return "X.rename(columns=str).assign(**{y.name or 'reading': y})  # X, y: as the workbench was given them"


def effects_in(path: str | Path) -> tuple[type[Effect], ...]:
    """Classes of effects that a file defines; it is run.

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


class quiet(warnings.catch_warnings):
    """Without warnings about parts of the record."""

    def __enter__(self) -> Any:
        """Begin."""
        entered = super().__enter__()
        warnings.simplefilter("ignore", RecordWarning)
        return entered

"""Built-in records to try the workbench on: in most of them something is hidden."""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import NamedTuple

import pandas as pd

from ..datasets import load_voltage_reference, make_record
from ..effects import CATALOGUE
from ..effects.protocol import Effect
from ..readers import Options, read_logs
from ..readers.log import timed
from ..records import RecordError
from ..records.errors import existing_file, noted


class TrialRecord(NamedTuple):
    """A built-in record."""

    title: str
    make: partial[pd.DataFrame]

    @property
    def loader(self) -> str:
        """Name of the function in `thermocorr.datasets` that makes it."""
        return self.make.func.__name__

    def code(self) -> str:
        """Python code that makes it."""
        given = [*map(repr, self.make.args), *(f"{name}={value!r}" for name, value in self.make.keywords.items())]
        return f"{self.loader}({', '.join(given)})"


def _simulated(title: str, seed: int, **effects: float) -> TrialRecord:
    return TrialRecord(title, partial(make_record, 20_000, effects=effects, seed=seed))


FIRST = "the built-in voltage reference with a hidden effect"
SAMPLES = {
    FIRST: TrialRecord("voltage reference, two weeks", partial(load_voltage_reference, hidden="moisture")),
    "simulated device 1": _simulated("simulated device 1", 11, hysteresis=1.5),
}
"""Name -> record. What is hidden is for the diagnosis to find."""


@dataclass(frozen=True, kw_only=True)
class ReadLog:
    """A log, read."""

    frame: pd.DataFrame
    """Indexed by its times, where a file has told them; its `attrs` say how it was read."""
    name: str
    """What it is called on the screen."""
    files: tuple[str, ...] = ()
    """Where it stands; none for the built-in record and for a frame."""
    how: Options = field(default_factory=Options)

    def timed(self, time: str | None) -> tuple[pd.DataFrame, tuple[str, ...]]:
        """The log with its times understood, and in words how it was read.

        `time` (str, optional): A column that has them in place of those that were found. Raises RecordError for times
        that can be read in two ways, or not at all.
        """
        frame = timed(self.frame, replace(self.how, time=time)) if self.files and time is not None else self.frame
        return frame, tuple(frame.attrs.get("notes", ()))

    def keywords(self) -> str:
        """What was said of the files, as keywords of `read_log`."""
        return "".join(f", {name}={value!r}" for name, value in self.how.given().items())


def built_in(name: str = "") -> ReadLog:
    """A record of `SAMPLES`, the first one by default; ValueError for any other name."""
    name = name or FIRST
    if name not in SAMPLES:
        raise ValueError(f"There is no built-in record {name!r}. There are: {', '.join(SAMPLES)}.")
    return ReadLog(frame=SAMPLES[name].make(), name=name)


def opened(paths: Sequence[str | Path], how: Options | None = None, *, names: Sequence[str] = ()) -> ReadLog:
    """Read a log.

    `paths` (sequence of paths). `how` (Options, optional). `names` (sequence of str): What the files are called where
    they came from, if that is not here. Raises RecordError for files that cannot be read.
    """
    how = how or Options()
    for path in paths:
        if not existing_file(path).is_file():
            raise RecordError(f"{path} is no regular file. Name the log's file.")
    with noted() as notes:
        frame = read_logs(paths, how)
    frame.attrs["notes"] = [*frame.attrs["notes"], *notes]
    return ReadLog(
        frame=frame,
        name=", ".join(Path(path).name for path in names or paths),
        files=tuple(names) or tuple(str(Path(path).resolve()) for path in paths),
        how=how,
    )


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

"""What the disturbed commands work on: a model, logs, results of earlier runs, and those of undisturbed ones."""

from __future__ import annotations

import contextlib
import gc
import os
import tempfile
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import pandas as pd

from thermocorr import DynamicBiasRegressor, RecordWarning, diagnose, refine, save_model
from thermocorr.datasets import make_record
from thermocorr.judgement import Diagnosis, Refinement

FITTED, ROWS, LONG = 500, 250, 1000
"""Rows that the model is fitted to; of a log that is fed piece by piece; of one that is there from the start."""


@dataclass
class Lab:
    """What all moments share."""

    place: Path
    """Folder to work in."""
    model: DynamicBiasRegressor
    fitted: tuple[Any, Any]
    """What it was fitted to."""
    model_file: bytes
    record: bytes
    """A log to analyse."""
    log: bytes
    """A short log to correct."""
    damaged: bytes
    """The same with dates in the future and in the past."""
    long: bytes
    """A long log to correct, with dates in the future."""
    known: dict[Any, Any]
    """What undisturbed runs gave, by kind of run."""

    @cached_property
    def diagnosis(self) -> Diagnosis:
        """What is missing in the model."""
        return diagnose(self.model, *self.fitted)

    @cached_property
    def refinement(self) -> Refinement:
        """The model with something added."""
        return refine(self.model, *self.fitted, max_steps=1)


def make_lab(place: Path) -> Lab:
    """Fit the model and write the logs."""
    record = _record()
    fitted = record[:FITTED].drop(columns="note")
    X, y = fitted.drop(columns="reading"), fitted["reading"]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RecordWarning)
        model = DynamicBiasRegressor(time="time", time_constants=[600.0, 7200.0], max_gap="1h").fit(X, y)
    save_model(model, place / "model.json")
    gc.freeze()  # children share what is there
    log = record[FITTED:]
    late = _dated(log, "2124", 15)
    parts = (fitted, log[:ROWS], _dated(late, "1924", 5)[:ROWS], late)
    texts = [part.to_csv(index=False).encode() for part in parts]
    return Lab(place, model, (X, y), (place / "model.json").read_bytes(), *texts, {})


def _record() -> pd.DataFrame:
    """With a gap, empty cells and a column of text, behind what the model is fitted to."""
    record = make_record(FITTED + LONG, seed=5).reset_index()
    record.loc[FITTED + 100 :, "time"] += pd.Timedelta("2h")
    record["time"] = record["time"].dt.strftime("%Y-%m-%dT%H:%M:%S")
    record["note"] = ["as usual", 'the "door", open'] * (len(record) // 2)
    for column, row in (("reading", 40), ("temperature", 160), ("reading", 500), ("temperature", 750)):
        record.loc[FITTED + row, column] = float("nan")
    return record


def _dated(log: pd.DataFrame, year: str, first: int) -> pd.DataFrame:
    """With every twentieth date damaged."""
    times = log["time"].copy()
    times[first::20] = year + times[first::20].str[4:]
    return log.assign(time=times)


@contextlib.contextmanager
def folder_in(place: Path) -> Iterator[Path]:
    """An empty folder, for a while."""
    with tempfile.TemporaryDirectory(dir=place) as name:
        yield Path(name)


def lines_in(path: Path) -> int:
    """Whole lines of a file; none where there is no file."""
    with contextlib.suppress(FileNotFoundError):
        return path.read_bytes().count(b"\n")
    return 0


def look(path: Path) -> tuple[Any, ...]:
    """What a command must not change in a file that it reads."""
    seen = os.stat(path)
    return path.read_bytes(), seen.st_mtime_ns, seen.st_mode, seen.st_ino

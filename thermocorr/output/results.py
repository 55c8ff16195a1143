"""Corrected log and model in files."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from pathlib import Path
from typing import BinaryIO

import pandas as pd

from ..model import DynamicBiasRegressor
from ..records.errors import printable
from .model_file import content_of
from .writer import Outputs

RESULT_COLUMNS = ("corrected", "model", "residual", "flag", "u", "smoothed")
TAKEN = "_thermocorr"
"""Ending of a column's name where the log has one of that name."""
_RESULTS = (RESULT_COLUMNS, ("corrected", "bias", "flag", "u", "smoothed", "u_smoothed", "reference"))
"""Columns that `thermocorr analyze` and `thermocorr correct` may write: always the first three."""


def write_corrected(outputs: Outputs, folder: Path, log: pd.DataFrame, evaluated: pd.DataFrame) -> Path:
    """Write corrected.csv: the log with its times, then what `evaluated` has."""
    path = folder / "corrected.csv"
    write_csv(outputs.open(path), log, evaluated)
    return path


def write_csv(file: BinaryIO, log: pd.DataFrame, evaluated: pd.DataFrame, header: bool = True) -> None:
    """Write a log, then the columns of `evaluated`.

    Times are dates of ISO 8601, or seconds; a range, of a log without times, is not written.
    """
    names = new_names(list(evaluated.columns), log.columns)
    result = log.assign(**{new: evaluated[old].to_numpy() for new, old in zip(names, evaluated.columns, strict=True)})
    if isinstance(result.index, pd.TimedeltaIndex):
        result.index = result.index.total_seconds()
    label = new_names([str(log.index.name or "time")], log.columns)[0]
    result.to_csv(
        file,
        mode="wb",
        header=header,
        index=not isinstance(log.index, pd.RangeIndex),
        index_label=label,
        lineterminator="\n",
    )


def new_names(names: Sequence[str], taken: Collection[str]) -> list[str]:
    """Names for new columns, with an ending where taken.

    Examples
    --------
    >>> new_names(["corrected", "bias"], ["reading", "corrected"])
    ['corrected_thermocorr', 'bias']
    """
    return [_free(name, taken) for name in names]


def _free(name: str, taken: Collection[str]) -> str:
    return _free(name + TAKEN, taken) if name in taken else name


def result_columns(columns: Collection[object]) -> list[str]:
    """Columns that an earlier result added to a log.

    Examples
    --------
    >>> result_columns(["time", "u", "temperature", "reading", "corrected", "bias", "flag"])
    ['corrected', 'bias', 'flag']
    """
    texts = [name for name in columns if isinstance(name, str)]
    if "corrected" not in texts:
        return []
    behind = texts[texts.index("corrected") :]
    bare = {name.replace(TAKEN, "") for name in behind}
    known = {name for names in _RESULTS if bare.issuperset(names[:3]) for name in names}
    return [name for name in behind if name.replace(TAKEN, "") in known]


def write_model(outputs: Outputs, folder: Path, model: DynamicBiasRegressor) -> list[Path]:
    """Write model.json, and model.txt to read."""
    paths = [folder / "model.json", folder / "model.txt"]
    table = model.coef_table().to_string()
    notes = "\n".join(f"Note: {note}" for note in model.notes_)
    outputs.write(paths[1], printable(f"{model.equation()}\n\n{table}\n{notes}\n", "\n"))
    outputs.write(paths[0], content_of(model))  # last: it says that all are there
    return paths

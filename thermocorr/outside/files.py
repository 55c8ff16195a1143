"""Logs in files: CSV and Parquet in, corrected log and model out."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from ..estimators import DynamicBiasRegressor
from ..records import RecordError
from ..records.errors import listing
from .model_file import save

RESULT_COLUMNS = ("corrected", "model", "residual", "flag")
EVERY_DIGIT: dict[str, Any] = (
    {"float_precision": "round_trip"} if tuple(map(int, pd.__version__.split(".")[:2])) < (3, 1) else {}
)
"""How pandas is told to read numbers as they were written: a matter of course from 3.1 on."""
TIME_NAMES = ("time", "timestamp", "datetime", "date", "time_s")
"""Columns that are taken as times where none is named, the first that is there."""


def read_log(path: str | Path) -> pd.DataFrame:
    """Read a log: Parquet by its ending (.parquet, .pq), else CSV with a header line.

    Raises RecordError with one sentence for a file that is missing, empty, or no table.
    """
    path = Path(path)
    if path.is_dir():
        raise RecordError(f"{path} is a folder. Name the log file in it.")
    if not path.exists():
        raise RecordError(f"There is no file {path}. Check its name and the folder you are in ({Path.cwd()}).")
    try:
        if path.suffix.lower() in (".parquet", ".pq"):
            frame = pd.read_parquet(path)
        else:
            frame = pd.read_csv(path, low_memory=False, **EVERY_DIGIT)
    except pd.errors.EmptyDataError:
        raise RecordError(
            f"{path} is empty: a header line with the columns' names is needed, then one line per sample."
        ) from None
    except ImportError:
        raise RecordError(
            f"{path} is Parquet, which needs pyarrow. Install it with: pip install 'thermocorr[parquet]'"
        ) from None
    except (pd.errors.ParserError, UnicodeDecodeError, OSError, ValueError) as error:
        reason = " ".join(str(error).split())
        raise RecordError(
            f"{path} cannot be read as a table: {reason}. Is it a CSV file with commas, or Parquet?"
        ) from None
    if frame.shape[1] == 1 and isinstance(frame.columns[0], str) and any(c in frame.columns[0] for c in ";\t"):
        raise RecordError(
            f"{path} seems to be separated by semicolons or tabs. Save it with commas between its columns."
        )
    if len(frame) == 0:
        raise RecordError(f"{path} has a header ({listing(frame.columns)}) but no rows.")
    return frame


def require_column(frame: pd.DataFrame, name: str | None, option: str, guesses: tuple[str, ...] = ()) -> str:
    """The column that an option names, or the first of `guesses` that is there."""
    columns = [str(column) for column in frame.columns]
    if name is None:
        for guess in guesses:
            if guess in columns:
                return guess
        raise RecordError(f"Which column is the {option}? Say it with --{option}; there are {listing(columns)}.")
    if name not in columns:
        raise RecordError(f"There is no column {name!r} for --{option}; there are {listing(columns)}.")
    return name


def write_corrected(folder: Path, log: pd.DataFrame, evaluated: pd.DataFrame, index: bool) -> Path:
    """Write corrected.csv: the log as it came, and four columns more."""
    names = new_names(RESULT_COLUMNS, log.columns)
    result = log.assign(**{new: evaluated[old].to_numpy() for new, old in zip(names, RESULT_COLUMNS, strict=True)})
    path = folder / "corrected.csv"
    result.to_csv(path, index=index)  # floats are written with all the digits that tell them apart
    return path


def new_names(names: Sequence[str], taken: Collection[str]) -> list[str]:
    """Names for columns beside others: those that are taken get an ending."""
    return [name if name not in taken else f"{name}_thermocorr" for name in names]


def write_model(folder: Path, model: DynamicBiasRegressor, data: tuple[Any, Any] | None = None) -> list[Path]:
    """Write the fitted model: model.json for `thermocorr.load_model` and `thermocorr correct`, model.txt to read."""
    path = save(model, folder / "model.json", data=data)
    table = model.coef_table().to_string()
    notes = "\n".join(f"Note: {note}" for note in model.notes_)
    (folder / "model.txt").write_text(f"{model.equation()}\n\n{table}\n{notes}\n", encoding="utf-8")
    return [path, folder / "model.txt"]


def prepare_folder(path: str | Path) -> Path:
    """Make the folder for results; RecordError where that cannot be done."""
    folder = Path(path)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RecordError(
            f"Results cannot be written to {folder}: {error.strerror}. Choose another folder with --out."
        ) from None
    return folder

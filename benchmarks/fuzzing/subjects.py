"""What is mutated: small logs of every kind of time, the models fitted to them, and states of live correctors."""

import csv
import io
import json
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from thermocorr import DynamicBiasRegressor, load_model, save_model
from thermocorr.datasets import make_record
from thermocorr.effects import Delay, Hysteresis, LaggedCovariate, Rate

from . import oracle
from .outcomes import run

ROWS, FITTED = 100, 60
HEADER = ["time", "temperature", "humidity", "note", "reading", "run"]
TIMES = {
    "dates": ("datetime", lambda index: index.strftime("%Y-%m-%dT%H:%M:%S")),
    "zoned": ("datetime with time zone", lambda index: index.strftime("%Y-%m-%d %H:%M:%S+02:00")),
    "seconds": ("seconds", lambda index: [repr(60.0 * k + 0.125) for k in range(len(index))]),
    "rows": ("rows", lambda index: [str(k) for k in range(len(index))]),
}


@dataclass
class Subject:
    """A log as cells of text, the model fitted to its first rows, and the model's file."""

    name: str
    cells: list[list[str]]
    roles: oracle.Roles
    model: DynamicBiasRegressor
    path: Path
    state: dict[str, Any]  # a saved state after the first `FITTED` rows of the log


def all_subjects(folder: Path) -> dict[str, Subject]:
    """One of each kind, made anew: the same every time."""
    warnings.simplefilter("ignore")
    runs = {"runs": "dates", "numbered": "seconds"}
    made = {name: _subject(folder, name, name) for name in TIMES}
    made |= {name: _subject(folder, name, times) for name, times in runs.items()}
    return made


def _subject(folder: Path, name: str, times: str) -> Subject:
    kind, write = TIMES[times]
    record = make_record(ROWS, seed=sorted([*TIMES, "runs", "numbered"]).index(name))
    labels = {"runs": ["cold", "warm"], "numbered": ["1", "2"]}.get(name, ["x", "x"])
    table = pd.DataFrame({"time": list(write(record.index))}, dtype=object)
    for column in ("temperature", "humidity"):
        table[column] = [repr(round(value, 3)) for value in record[column]]
    table["note"] = [("", "calm", "door, open", 'a "good" row')[k % 4] for k in range(ROWS)]
    table["reading"] = [repr(value) for value in record["reading"]]
    table["run"] = [labels[k >= 45] for k in range(ROWS)]
    cells = table[HEADER].values.tolist()
    run_column = "run" if name in ("runs", "numbered") else None
    roles = oracle.Roles(
        "temperature", "reading", kind, None if kind == "rows" else "time", ("humidity",), run_column,
        name == "numbered",
    )  # fmt: skip
    model = _fitted(name, frame_of(cells, roles))
    path = folder / f"{name}.json"
    save_model(model, path)
    return Subject(name, cells, roles, load_model(path), path, _state(folder, path, cells))


def frame_of(cells: list[list[str]], roles: oracle.Roles) -> pd.DataFrame:
    """The columns that a model uses, by the oracle."""
    rows = [oracle._row(0, line_of(row), HEADER, roles) for row in cells]
    frame = pd.DataFrame([row.values for row in rows])
    if roles.time is not None:
        frame["time"] = times_of([row.stamp for row in rows], roles.kind)
    if roles.run is not None:
        frame["run"] = [row.run for row in rows]
    return frame


def times_of(stamps: list[Any], kind: str) -> Any:
    """Stamps as a column of times."""
    if kind == "seconds":
        return pd.Series(stamps, dtype=float)
    return pd.Series(pd.to_datetime(stamps, unit="ns", utc=kind == "datetime with time zone"))


def _fitted(name: str, frame: pd.DataFrame) -> DynamicBiasRegressor:
    effects: list[Any] = [LaggedCovariate("humidity", ["20 min"])]
    if name == "dates":
        effects += [Hysteresis(0.5), Rate()]
    if name == "seconds":
        effects += [Delay("5 min")]
    options: dict[str, Any] = {"time": "time" if "time" in frame else None, "run": "run" if "run" in frame else None}
    options |= {"sampling_period": 60.0} if "time" not in frame else {}
    options |= {"max_gap": "15 min"} if name == "zoned" else {}
    model = DynamicBiasRegressor("temperature", [600.0, 7200.0], effects=effects, **options)
    return model.fit(frame[:FITTED].drop(columns="reading"), frame["reading"][:FITTED])


def _state(folder: Path, model: Path, cells: list[list[str]]) -> dict[str, Any]:
    log, state = folder / "begun.csv", folder / "begun.json"
    log.write_bytes(text_of(HEADER, cells[:FITTED]))
    state.unlink(missing_ok=True)
    done = run("correct", "--model", model, log, "--state", state, "--average", 3, "--track", "2h")
    assert done.status == 0, done
    return json.loads(state.read_text())


def line_of(row: list[str]) -> bytes:
    """One line of CSV without its end."""
    text = io.StringIO()
    csv.writer(text, lineterminator="").writerow(row)
    return text.getvalue().encode("utf-8", "surrogatepass")


def text_of(header: list[str], rows: list[list[str]]) -> bytes:
    """A log as CSV."""
    return b"".join(line_of(row) + b"\n" for row in [header, *rows])

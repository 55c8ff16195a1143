"""Faults of real sensors in each input of a model: does any row behind them lie without a word?

    python benchmarks/faults.py                                # every effect, 3 seeds: in use, and in the fit
    python benchmarks/faults.py --first 40 --kinds covariate lagged_covariate --verbose
    python benchmarks/faults.py --clean ../shared/records      # rows of sound records that are flagged

A device has the columns of one effect beside a static law and a lag of ten minutes, each worth thirty times the noise.
A model is fitted to 3000 sound rows; in 600 later rows one input has one fault. A row is wrong where the fault moves
the corrected reading by more than five times the noise, and silent where it has no flag. `batch`: the whole record;
`live`: one by one, then in blocks; `C`: the exported code. A thermometer that walks off slowly and one that stands
still for the first rows look like a room: they are counted apart. In the fit: a note, and the residual over that of the
sound record.
"""

from __future__ import annotations

import argparse
import shutil
import sys
import tempfile
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

import real_diagnosis
from effect_records import EXAMPLES
from firmware_runs import compile_c, run_c, start_of

from thermocorr import DiffusiveFeatures, DynamicBiasRegressor, OnlineCorrector, RecordError, RecordWarning
from thermocorr.effects import Covariate
from thermocorr.effects.protocol import Effect
from thermocorr.firmware import export_c

FITTED, LATER, STEP = 3000, 600, 60.0
AT = 150
"""Row of the later record in which the fault begins."""
WORTH, NOISES = 30.0, 5.0
BIT = 0.0625 * 2**7
"""A flipped bit of a thermometer with steps of 1/16 K: 8 K."""
SCALES = {"temperature": 1.0, "humidity": 8.0}
"""Size of what each input does by itself."""
UNSEEN = ("drift", "stuck")
"""Faults that begin like a room."""
Answer = tuple[np.ndarray, np.ndarray]


def room(seed: int, n: int) -> pd.DataFrame:
    """Temperature from 21 to 25 degC, and a humidity that follows it and more, once a minute."""
    rng = np.random.default_rng(seed)
    t, (a, b) = STEP * np.arange(n), rng.uniform(0, 2 * np.pi, 2)
    slow = np.interp(t, np.linspace(0, t[-1], n // 200), np.clip(0.4 * rng.normal(size=n // 200), -0.8, 0.8))
    T = 23 + np.sin(2 * np.pi * t / 21_000 + a) + 0.2 * np.sin(2 * np.pi * t / 2700 + b) + slow
    T += 0.003 * rng.normal(size=n)
    humid = np.interp(t, np.linspace(0, t[-1], n // 150), 45 + 8 * rng.normal(size=n // 150))
    index = pd.date_range("2024-03-04", periods=n, freq=pd.Timedelta(STEP, "s"))
    return pd.DataFrame({"temperature": T, "humidity": humid + 0.05 * rng.normal(size=n)}, index=index)


def faults(values: np.ndarray, at: int, scale: float, rng: np.random.Generator) -> Iterator[tuple[str, np.ndarray]]:
    """Values of one input with one fault each."""

    def changed(rows: int, to: Any) -> np.ndarray:
        result = values.copy()
        result[at : at + rows] = to
        return result

    for code in (85.0, -127.0, 0.0, 999.0, 1000.0, 1e30, np.inf):
        yield f"{code:g}, one row", changed(1, code)
    for code in (85.0, 0.0):
        yield f"{code:g}, ten rows", changed(10, code)
    sign = rng.choice((-1.0, 1.0))
    yield "bit", changed(1, values[at] + sign * BIT * scale)
    for rows in (1, 3, 12):
        yield f"jump of {rows} rows", changed(rows, values[at : at + rows] + sign * 1.5 * scale)
    yield "far jump of 12 rows", changed(12, values[at : at + 12] + sign * 20 * scale)
    yield "other unit, 20 rows", changed(20, 1.8 * values[at : at + 20] + 32)
    yield "missing, 8 rows", changed(8, np.nan)
    yield "missing, 30 rows", changed(30, np.nan)
    yield "stuck", changed(100, values[at])
    walk = values.copy()
    walk[at:] += scale * np.minimum(np.arange(len(values) - at) / 300, 1.0)
    yield "drift", walk


class Device:
    """A model of an effect, and what its readings are."""

    def __init__(self, effect: Effect | None, seed: int):
        self.effects = [] if effect is None else [effect]
        self.X, rng = room(seed, FITTED + LATER), np.random.default_rng(seed)
        self.settings: dict[str, Any] = {"effects": self.effects, "degree": 1, "max_gap": "2 h"}
        features = DiffusiveFeatures([600.0], **self.settings)
        columns = features.fit_transform(self.X[:FITTED])
        spread = columns.std(axis=0)
        coef = np.where(spread > 0, WORTH * rng.uniform(0.5, 1.5, len(spread)) / np.where(spread > 0, spread, 1), 0.0)
        bias = np.concatenate((columns, features.transform(self.X[FITTED:]))) @ coef
        self.reading = 1000.0 + bias + rng.normal(size=len(bias))
        self.inputs = ["temperature"] + ["humidity"] * any("humidity" in each.inputs() for each in self.effects)

    def fit(self, fitted: pd.DataFrame | None = None) -> DynamicBiasRegressor:
        model = DynamicBiasRegressor("temperature", [600.0], **self.settings)
        return model.fit(self.X[:FITTED] if fitted is None else fitted, self.reading[:FITTED])


def batch(model: DynamicBiasRegressor, X: pd.DataFrame, y: np.ndarray) -> Answer:
    found = model.evaluate(X, y)
    return found["corrected"].to_numpy(), found["flag"].to_numpy(str)


def live(model: DynamicBiasRegressor, X: pd.DataFrame, y: np.ndarray) -> Answer:
    stream, half = OnlineCorrector(model), AT + 40
    names = stream.columns
    rows = zip(X.index[:half], X["temperature"][:half], y[:half], *(X[name][:half] for name in names), strict=True)
    first = [stream.update(*row[:3], **dict(zip(names, row[3:], strict=True))) for row in rows]
    rest = stream.update_many(X[half:], y[half:])
    corrected = np.concatenate(([one.corrected for one in first], rest["corrected"]))
    return corrected, np.concatenate(([one.flag for one in first], rest["flag"].to_numpy(str)))


def exported(model: DynamicBiasRegressor, fitted: pd.DataFrame, X: pd.DataFrame, folder: str) -> Callable[..., Answer]:
    """The exported code as a function of a record."""
    export = export_c(model, Path(folder) / "bias.c", "double", sampling_period=STEP, force=True)
    program = compile_c(export, ("gcc", "-O1", "-w"), start_of(export, fitted, X))

    def run(model: DynamicBiasRegressor, X: pd.DataFrame, y: np.ndarray) -> Answer:
        said = run_c(program, X, y, export.columns)
        return said.corrected, np.where(said.flags > 0, "flagged", "")

    return run


class Row(NamedTuple):
    """What a fault does."""

    effect: str
    input: str
    fault: str
    way: str
    silent: int
    wrong: int
    worst: float
    flagged: int


def ways(model: DynamicBiasRegressor, device: Device, folder: str) -> dict[str, Callable[..., Answer]]:
    """How the model can be used."""
    found: dict[str, Callable[..., Answer]] = {"batch": batch}
    try:
        OnlineCorrector(model)
        found["live"] = live
        if shutil.which("gcc"):
            found["C"] = exported(model, device.X[:FITTED], device.X[FITTED:], folder)
    except ValueError:  # it looks ahead, or cannot be exported
        pass
    return found


def in_use(label: str, device: Device, rng: np.random.Generator, folder: str) -> Iterator[Row]:
    model, y, clean = device.fit(), device.reading[FITTED:], device.X[FITTED:]
    for way, run in ways(model, device, folder).items():
        sound = run(model, clean, y)[0]
        for column in device.inputs:
            for name, values in faults(clean[column].to_numpy(), AT, SCALES[column], rng):
                try:
                    corrected, flags = run(model, clean.assign(**{column: values}), y)
                except RecordError:
                    continue
                error = np.nan_to_num(np.abs(corrected - sound))
                quiet = (error > NOISES) & (flags == "")
                worst = float(error[quiet].max(initial=0.0))
                flagged = int((flags != "").sum())
                yield Row(label, column, name, way, int(quiet.sum()), int((error > NOISES).sum()), worst, flagged)


def in_fit(label: str, device: Device, rng: np.random.Generator) -> Iterator[tuple[str, str, str, float, bool]]:
    """Effect, input, fault, residual over that of the sound record, and whether a note was made."""
    usual, sound = device.fit().residual_std_, device.X[:FITTED]
    for column in device.inputs:
        for name, values in faults(sound[column].to_numpy(), 1500, SCALES[column], rng):
            try:
                with warnings.catch_warnings(record=True) as caught:
                    warnings.simplefilter("always")
                    model = device.fit(sound.assign(**{column: values}))
            except RecordError:
                yield label, column, name, 1.0, True
                continue
            yield label, column, name, model.residual_std_ / usual, bool(caught or model.notes_)


def clean_rows(folder: str) -> None:
    """Rows of the last 30 % of measured records that the gates flag, every other column being an input too."""
    rows, flagged = 0, 0
    for name, (X, y, temperature, n) in real_diagnosis.every(folder).items():
        kept = [
            c for c in X if c not in (temperature, "run") and X[c].dtype.kind in "fi" and X[c][:n].notna().mean() > 0.9
        ]
        effects = [Covariate(column) for column in kept if X[column][:n].std() > 0]
        model = DynamicBiasRegressor(temperature, degree=1, run="run" if "run" in X else None, effects=effects)
        flags = model.fit(X[:n], y[:n]).flags(X[n:], y[n:])
        found = int(np.isin(flags, ("jump", "doubtful input")).sum())
        print(f"{name:25s} {len(effects) + 1} inputs, {len(X) - n:6d} rows, {found} flagged")
        rows, flagged = rows + len(X) - n, flagged + found
    print(f"{flagged} of {rows} rows flagged, {flagged / rows:.3%}")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--kinds", nargs="*", default=[])
    parser.add_argument("--clean", metavar="FOLDER")
    parser.add_argument("--verbose", action="store_true")
    options = parser.parse_args()
    warnings.simplefilter("ignore", RecordWarning)
    if options.clean:
        clean_rows(options.clean)
        return 0
    used, fitted = [], []
    for effect in (None, *EXAMPLES):
        label = "none" if effect is None else effect.label()
        if options.kinds and (effect is None or effect.kind not in options.kinds):
            continue
        for seed in range(options.first, options.first + options.seeds):
            device, rng = Device(effect, seed), np.random.default_rng(seed)
            with tempfile.TemporaryDirectory() as folder:
                used += in_use(label, device, rng, folder)
            fitted += in_fit(label, device, rng)
    found = pd.DataFrame(used, columns=list(Row._fields))
    counts = {"silent": ("silent", "sum"), "wrong": ("wrong", "sum"), "worst": ("worst", "max")}
    table = found.groupby(["fault", "way"], sort=False).agg(**counts, flagged=("flagged", "mean"))
    print(table.round(1).to_string())
    fits = pd.DataFrame(fitted, columns=["effect", "input", "fault", "residual", "noted"])
    shares = {"median": ("residual", "median"), "worst": ("residual", "max"), "noted": ("noted", "mean")}
    print(fits.groupby(["input", "fault"], sort=False).agg(**shares).round(2).to_string())
    if options.verbose:
        print(found[found["silent"] > 0].to_string(), fits[fits["residual"] > 1.05].to_string(), sep="\n")
    silent = found.loc[~found["fault"].isin(UNSEEN), "silent"].sum()
    print(f"{silent} silent rows of {found.loc[~found['fault'].isin(UNSEEN), 'wrong'].sum()} wrong ones")
    return int(silent > 0)


if __name__ == "__main__":
    sys.exit(main())

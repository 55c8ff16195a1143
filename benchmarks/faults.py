"""Faults of real sensors in each input of a model: does any row behind them lie without a word?

    python benchmarks/faults.py                                # every effect, 3 seeds
    python benchmarks/faults.py --first 40 --kinds covariate lagged_covariate --verbose
    python benchmarks/faults.py --clean ../shared/records      # rows of sound records that are flagged

A device has the columns of one effect besides a static law and a lag of ten minutes, each worth thirty times the noise.
A model is fitted to 3000 sound rows; in 600 later rows one input has one fault. A row is wrong where the fault moves
the corrected reading by more than five times the noise, and silent where it has no flag. `batch`: the whole record;
`live`: one by one, then in blocks; `C`: the exported code. A thermometer that walks off slowly and one that stands
still for the first rows look like a room: they are counted apart.
"""

import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import real_records
from common import asked, seeds_of
from effect_records import EXAMPLES
from firmware_runs import compile_c, run_c, seconds_to

from thermocorr import DiffusiveFeatures, DynamicBiasRegressor, OnlineCorrector, RecordError
from thermocorr.effects import Covariate
from thermocorr.effects.protocol import Effect
from thermocorr.firmware import export_c

FITTED, LATER, STEP = 3000, 600, 60.0
AT = 150  # row of the later record in which the fault begins
WORTH, NOISES = 30.0, 5.0
BIT = 0.0625 * 2**7  # a flipped bit of a thermometer with steps of 1/16 K: 8 K
SCALES = {"temperature": 1.0, "humidity": 8.0}  # size of what each input does by itself
UNSEEN = ("drift", "stuck")  # faults that begin like a room
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
    for rows in (25, 28, 29, 30, 31, 35, 45):
        yield f"far jump of {rows} rows", changed(rows, values[at : at + rows] + sign * 20 * scale)
    for missing in (1, 20, 31, 45):  # the fault begins before a hole, and its last row stands in or behind it
        held = changed(2, values[at] + sign * 20 * scale)
        held[at + 2 : at + 2 + missing] = np.nan
        yield f"two rows, then {missing} missing", held
        held = held.copy()
        held[at + 2 + missing] = values[at] + sign * 20 * scale
        yield f"two rows, {missing} missing, one row", held
    toggles = values.copy()
    toggles[at : at + 40 : 2] += sign * 20 * scale
    yield "every second row of 40", toggles
    pairs = values.copy()
    for k in range(0, 40, 4):
        pairs[at + k : at + k + 2] += sign * 20 * scale
    yield "pairs in 40 rows", pairs
    first = values.copy()
    first[0] += sign * 20 * scale
    yield "first row", first
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
    export = export_c(model, Path(folder) / "bias.c", force=True)
    program, start = compile_c(export, ("gcc", "-O1", "-w")), seconds_to(fitted, X)

    def run(model: DynamicBiasRegressor, X: pd.DataFrame, y: np.ndarray) -> Answer:
        said = run_c(program, X, y, export.columns, start)
        return said.corrected, np.where(said.flags > 0, "flagged", "")

    return run


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


def in_use(label: str, device: Device, rng: np.random.Generator, folder: str) -> Iterator[dict[str, Any]]:
    """Rows that are silent, wrong and flagged, and the worst silent error, for each fault."""
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
                counts = {
                    "silent": int(quiet.sum()),
                    "wrong": int((error > NOISES).sum()),
                    "flagged": (flags != "").sum(),
                }
                worst = float(error[quiet].max(initial=0.0))
                yield {"effect": label, "input": column, "fault": name, "way": way, "worst": worst, **counts}


def clean_rows(folder: str) -> None:
    """Rows of the last 30 % of measured records that the gates flag, every other column being an input too."""
    rows, flagged = 0, 0
    for name, (X, y, temperature, n) in real_records.every(folder).items():
        known = X[:n].select_dtypes("number").drop(columns=temperature)
        kept = known.columns[(known.notna().mean() > 0.9) & (known.std() > 0) & (known.columns != "run")]
        effects = [Covariate(column) for column in kept]
        model = DynamicBiasRegressor(temperature, degree=1, run="run" if "run" in X else None, effects=effects)
        flags = model.fit(X[:n], y[:n]).flags(X[n:], y[n:])
        found = int(np.isin(flags, ("jump", "doubtful input")).sum())
        print(f"{name:25s} {len(effects) + 1} inputs, {len(X) - n:6d} rows, {found} flagged")
        rows, flagged = rows + len(X) - n, flagged + found
    print(f"{flagged} of {rows} rows flagged, {flagged / rows:.3%}")


def main() -> int:
    every = ["none", *dict.fromkeys(effect.kind for effect in EXAMPLES)]
    options = asked(__doc__, first=0, seeds=3, kinds=every, clean=str, verbose=False)
    if options.clean:
        clean_rows(options.clean)
        return 0
    used = []
    for effect in (None, *EXAMPLES):
        if (effect.kind if effect else "none") not in options.kinds:
            continue
        label = effect.label() if effect else "none"
        for seed in seeds_of(options):
            device, rng = Device(effect, seed), np.random.default_rng(seed)
            with tempfile.TemporaryDirectory() as folder:
                used += in_use(label, device, rng, folder)
    found = pd.DataFrame(used)
    counts = {"silent": ("silent", "sum"), "wrong": ("wrong", "sum"), "worst": ("worst", "max")}
    table = found.groupby(["fault", "way"], sort=False).agg(**counts, flagged=("flagged", "mean"))
    print(table.round(1).to_string())
    if options.verbose:
        print(found[found["silent"] > 0].to_string())
    said = found[~found["fault"].isin(UNSEEN)]
    print(f"{said['silent'].sum()} silent rows of {said['wrong'].sum()} wrong ones")
    return int(said["silent"].sum() > 0)


if __name__ == "__main__":
    sys.exit(main())

"""Faults of real sensors in each input of a model: does any row behind them lie without a word?

    python benchmarks/faults.py                     # every effect, 3 seeds, in use: batch and live
    python benchmarks/faults.py --first 40 --kinds covariate lagged_covariate --verbose
    python benchmarks/faults.py --clean ../shared/records   # rows of sound records that are flagged

A device has the columns of one effect beside a static law and a lag of ten minutes, each worth thirty times the noise. A
model is fitted to 3000 sound rows; in 600 later rows one input has one fault. A row is wrong where the corrected reading
is off by more than five times the noise, and silent where it has no flag. `fit` puts the same fault into the fitted rows,
and counts rows of a sound later record.
"""

from __future__ import annotations

import argparse
import sys
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from effect_records import EXAMPLES

from thermocorr import DiffusiveFeatures, DynamicBiasRegressor, OnlineCorrector, RecordError, RecordWarning
from thermocorr.effects.protocol import Effect, refuse_foresight

FITTED, LATER, STEP = 3000, 600, 60.0
AT = 150
"""Row of the later record in which the fault begins."""
WORTH, NOISES = 30.0, 5.0
BIT = 0.0625 * 2**7
"""A flipped bit of a thermometer with steps of 1/16 K: 8 K."""
SCALES = {"temperature": 1.0, "humidity": 8.0}
"""Size of what each input does by itself."""


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
    yield "stuck for 100 rows", changed(100, values[at])
    yield "other unit for 20 rows", changed(20, 1.8 * values[at : at + 20] + 32)
    yield "missing for 8 rows", changed(8, np.nan)
    yield "power off for 30 rows", changed(30, np.nan)


def drift(values: np.ndarray, at: int, scale: float) -> np.ndarray:
    """A thermometer that walks off by 1 K in five hours: no look at one input tells; reported apart."""
    result = values.copy()
    result[at:] += scale * np.minimum(np.arange(len(values) - at) / 300, 1.0)
    return result


class Device:
    """A model of an effect, and what its readings truly are."""

    def __init__(self, effect: Effect | None, seed: int, reading_seed: int = 0):
        effects = [] if effect is None else [effect]
        self.X = room(seed, FITTED + LATER)
        settings: dict[str, Any] = {"effects": effects, "degree": 1, "max_gap": "2 h"}
        features = DiffusiveFeatures([600.0], **settings)
        fitted, rng = self.X[:FITTED], np.random.default_rng(seed)
        columns = features.fit_transform(fitted)
        spread = columns.std(axis=0)
        coef = np.where(spread > 0, WORTH * rng.uniform(0.5, 1.5, len(spread)) / np.where(spread > 0, spread, 1), 0.0)
        bias = np.concatenate((columns, features.transform(self.X[FITTED:]))) @ coef
        self.reading = 1000.0 + bias + rng.normal(size=len(bias))
        self.model = DynamicBiasRegressor("temperature", [600.0], **settings)

    def fit(self, fitted: pd.DataFrame | None = None) -> DynamicBiasRegressor:
        return self.model.fit(self.X[:FITTED] if fitted is None else fitted, self.reading[:FITTED])

    def silent(self, corrected: np.ndarray, sound: np.ndarray, flags: np.ndarray) -> tuple[int, int, float]:
        """Rows that are wrong and silent, rows that are wrong, and the worst silent error [noises]."""
        error = np.nan_to_num(np.abs(corrected - sound))
        wrong = error > NOISES
        quiet = wrong & (flags == "")
        return int(quiet.sum()), int(wrong.sum()), float(error[quiet].max(initial=0.0))

    def later(self, column: str | None = None, values: np.ndarray | None = None) -> pd.DataFrame:
        later = self.X[FITTED:]
        return later if column is None else later.assign(**{column: values})


def batch(model: DynamicBiasRegressor, X: pd.DataFrame, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    found = model.evaluate(X, y)
    return found["corrected"].to_numpy(), found["flag"].to_numpy(str)


def live(model: DynamicBiasRegressor, X: pd.DataFrame, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Samples one by one, and then in blocks."""
    stream = OnlineCorrector(model)
    names = stream.columns
    half = AT + 40
    rows = zip(X.index[:half], X["temperature"][:half], y[:half], *(X[name][:half] for name in names), strict=True)
    first = [stream.update(*row[:3], **dict(zip(names, row[3:], strict=True))) for row in rows]
    rest = stream.update_many(X[half:], y[half:])
    corrected = np.concatenate(([one.corrected for one in first], rest["corrected"]))
    return corrected, np.concatenate(([one.flag for one in first], rest["flag"].to_numpy(str)))


def cases(kinds: list[str], first: int, seeds: int) -> Iterator[tuple[str, Device, str]]:
    """Effect, device and input."""
    for effect in (None, *EXAMPLES):
        label = "none" if effect is None else f"{effect.kind}: {effect.label()}"
        if kinds and label.split(":")[0] not in kinds:
            continue
        for seed in range(first, first + seeds):
            device = Device(effect, seed)
            inputs = {"temperature", *(device.model.unfitted_features(()).further_effects() and [])}
            inputs |= {c for c in ("humidity",) if effect is not None and c in effect.inputs()}
            for column in sorted(inputs):
                yield label, device, column


def measured(kinds: list[str], first: int, seeds: int, verbose: bool) -> pd.DataFrame:
    rows = []
    for label, device, column in cases(kinds, first, seeds):
        model = device.fit()
        y, clean = device.reading[FITTED:], device.later()
        sound = batch(model, clean, y)[0]
        foresight = False
        try:
            refuse_foresight(model.features_.effect_list(), "a stream")
        except ValueError:
            foresight = True
        rng = np.random.default_rng(first)
        values = clean[column].to_numpy()
        for name, faulty in [("none", values), *faults(values, AT, SCALES[column], rng), ("drift", drift(values, AT, SCALES[column]))]:
            X = device.later(column, faulty)
            for way, run in (("batch", batch), ("live", live)):
                if way == "live" and foresight:
                    continue
                try:
                    corrected, flags = run(model, X, y)
                except RecordError:
                    continue
                quiet, wrong, worst = device.silent(corrected, sound, flags)
                rows.append((label, column, name, way, quiet, wrong, worst, int((flags != "").sum())))
    return pd.DataFrame(rows, columns=["effect", "input", "fault", "way", "silent", "wrong", "worst", "flagged"])


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--kinds", nargs="*", default=[])
    parser.add_argument("--verbose", action="store_true")
    options = parser.parse_args()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RecordWarning)
        found = measured(options.kinds, options.first, options.seeds, options.verbose)
    pd.set_option("display.width", 200, "display.max_rows", 500)
    table = found.groupby(["fault", "way"], sort=False)[["silent", "wrong", "worst", "flagged"]].agg({"silent": "sum", "wrong": "sum", "worst": "max", "flagged": "mean"})
    print(table.round(1).to_string())
    if options.verbose:
        print(found[found["silent"] > 0].to_string())
    return int(found.loc[found["fault"] != "drift", "silent"].sum() > 0)


if __name__ == "__main__":
    sys.exit(main())

"""Live correction: how fast it is, and whether it says the same as the whole record at once.

    python benchmarks/live.py            # a million samples
    python benchmarks/live.py 100000

Prints updates per second of processor time, one core (best and median of several runs: other work on the machine only
ever slows one down), for `OnlineCorrector.update` and `update_many` with the default model (J = 6, n = 2), the same per
effect kind, and the largest difference between live and `correct` over a stream with gaps, irregular steps, missing
temperatures and restarts from a saved state.
"""

from __future__ import annotations

import json
import statistics
import sys
import time
import warnings

import numpy as np
import pandas as pd

from thermocorr import DynamicBiasRegressor, OnlineCorrector, RecordWarning
from thermocorr.effects import (
    CATALOGUE,
    Covariate,
    Delay,
    Hinge,
    Hysteresis,
    LaggedCovariate,
    LagProducts,
    Periodic,
    Rate,
)


def stream(n: int, seed: int = 0) -> pd.DataFrame:
    """A log with irregular steps, gaps and missing temperatures."""
    rng = np.random.default_rng(seed)
    steps = rng.choice([15.0, 15.0, 15.0, 14.9, 15.2, 30.0], n) * rng.choice([1.0, 1.0, 1.0, 1.37], n)
    steps[rng.random(n) < 3e-4] += rng.uniform(100, 20_000)
    seconds = np.round(np.cumsum(steps), 3)
    wander = np.cumsum(rng.normal(0, 0.01, n))
    temperature = 23 + 2 * np.sin(seconds / 13_000) + wander - np.linspace(0, wander[-1], n)
    frame = pd.DataFrame(
        {"temperature": temperature, "humidity": 45 + 5 * np.sin(seconds / 40_000)},
        index=pd.Timestamp("2024-03-04") + pd.to_timedelta(seconds, unit="s"),
    )
    frame["reading"] = 10 + 1e-3 * (np.roll(temperature, 40) - 23) + rng.normal(0, 1e-4, n)
    frame.loc[rng.random(n) < 1e-4, "temperature"] = np.nan
    return frame


def rate(run, n: int, repeats: int) -> str:
    """Best and median number of samples per second of processor time."""
    seconds = []
    for _ in range(repeats):
        begin = time.process_time()
        run()
        seconds.append(time.process_time() - begin)
    return f"best {n / min(seconds):>9,.0f}, median {n / statistics.median(seconds):>9,.0f} samples/s"


def one_by_one(corrector: OnlineCorrector, times: list, T: list, U: list, h: list | None = None) -> None:
    update = corrector.update
    if h is None:
        for row in zip(times, T, U, strict=True):
            update(*row)
    else:
        for time_, temperature, reading, humidity in zip(times, T, U, h, strict=True):
            update(time_, temperature, reading, humidity=humidity)


def main(n: int) -> None:
    warnings.simplefilter("ignore", RecordWarning)  # the missing temperatures are meant
    log = stream(n)
    X, y = log[["temperature", "humidity"]], log["reading"]
    fitted = slice(0, 20_000)
    model = DynamicBiasRegressor(time_constants=6, degree=2, max_gap="10 min").fit(X[fitted], y[fitted])
    print(f"default model: {len(model.time_constants_)} lags, degree 2, {len(model.coef_)} columns; {n:,} samples")
    gaps = np.diff(X.index[X["temperature"].notna()]) / pd.Timedelta("1s") > model.gap_error().least
    felt = model.judged(X)[0].gap_variance > 0
    print(f"{gaps.mean():.1%} of the steps are gaps to it, what was in them is felt in {felt.mean():.0%} of the rows\n")

    part = slice(0, min(n, 50_000))
    times, T, U = X.index[part].tolist(), X["temperature"][part].tolist(), y[part].tolist()
    seconds = DynamicBiasRegressor(time="s", time_constants=model.time_constants_, max_gap=600).fit(
        X[fitted].assign(s=np.arange(20_000) * 15.0), y[fitted]
    )
    grid = (np.arange(len(T)) * 15.0).tolist()
    print("update, dates, irregular  :", rate(lambda: one_by_one(OnlineCorrector(model), times, T, U), len(T), 7))
    print("update, seconds, regular  :", rate(lambda: one_by_one(OnlineCorrector(seconds), grid, T, U), len(T), 7))
    whole = OnlineCorrector(model)
    print("update_many, all at once  :", rate(lambda: (whole.reset(), whole.update_many(X, y)), n, 3))

    def chunks(size: int, rows: int) -> None:
        live = OnlineCorrector(model)
        for start in range(0, rows, size):
            live.update_many(X[start : start + size], y[start : start + size])

    for size, rows in ((1000, n), (100, n // 10), (10, n // 50), (1, n // 100)):
        print(f"update_many, {size:4d} at once :", rate(lambda size=size, rows=rows: chunks(size, rows), rows, 3))

    print("\nlive against the whole record:")
    expected = model.bias(X).to_numpy()
    rng, live, got, at, restarts = np.random.default_rng(1), OnlineCorrector(model), np.empty((2, n)), 0, 0
    while at < n:
        stop = min(n, at + int(rng.integers(1, 4000)))
        if rng.random() < 0.5:
            got[:, at:stop] = live.update_many(X[at:stop], y[at:stop])[["bias", "corrected"]].to_numpy().T
        else:
            rows = zip(X.index[at:stop], X["temperature"][at:stop].tolist(), y[at:stop].tolist(), strict=True)
            samples = [live.update(*row) for row in rows]
            got[:, at:stop] = np.array([(sample.bias, sample.corrected) for sample in samples]).T
        live, at, restarts = OnlineCorrector.from_state(model, json.loads(json.dumps(live.state()))), stop, restarts + 1
    assert (np.isnan(got[0]) == np.isnan(expected)).all()
    share = np.nanmax(np.abs(got[0] - expected)) / (np.nanmax(expected) - np.nanmin(expected))
    corrected = model.correct(X, y).to_numpy()
    places = np.nanmax(np.abs(got[1] - corrected) / np.spacing(np.abs(corrected)))
    segments = len(model.features_.resume(X)[0].segments)
    print(f"{n:,} samples, {segments} segments, {restarts} restarts")
    print(f"bias: at most {share:.1e} of its range apart; corrected reading: {places:.0f} units in the last place")

    print("\nupdate, one more effect each (best of 3):")
    examples = [
        Rate(), Delay("10 min"), Covariate("humidity"), LaggedCovariate("humidity"), Hysteresis(0.5), Periodic(),
        Hinge(23.0, time_constants=["1 h"]), LagProducts(model.time_constants_[:3].tolist(), temperature_products=True),
    ]  # fmt: skip
    assert all(effect.kind in CATALOGUE for effect in examples)
    h = X["humidity"][part].tolist()
    for effect in examples:
        more = DynamicBiasRegressor(time_constants=model.time_constants_, effects=[effect], max_gap="10 min")
        more.fit(X[fitted], y[fitted])
        print(f"{effect.kind:>18}: {rate(lambda m=more: one_by_one(OnlineCorrector(m), times, T, U, h), len(T), 3)}")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 1_000_000)

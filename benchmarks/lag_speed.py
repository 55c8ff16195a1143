"""Lag differences alone, at even steps, at some with ten gaps, and at uneven ones: nanoseconds per sample and lag.

    python benchmarks/lag_speed.py                      # 84 000 and 1 000 000 rows, 12 lags and one
    python benchmarks/lag_speed.py --first              # what numba compiles for a first fit, in an empty cache [s]

The least processor time of some runs, columns and all. Times are those of a machine: compare two states on one.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time

import numpy as np
import pandas as pd

from thermocorr import DynamicBiasRegressor
from thermocorr.equations import lag_differences

STEP, RUNS = 60.0, 15


def nanoseconds(n: int, n_lags: int, jitter: float = 0.0, gaps: int = 0) -> float:
    """Per sample and time constant."""
    rng = np.random.default_rng(0)
    temperature = 23 + 0.01 * np.cumsum(rng.standard_normal(n))
    steps = STEP * (1 + jitter * rng.uniform(-1, 1, n))
    steps[rng.integers(1, n, gaps)] *= 3
    time_constants = np.geomspace(300, 50_000, n_lags)
    lag_differences(temperature, steps, time_constants)
    spent = []
    for _ in range(RUNS):
        began = time.process_time()
        lag_differences(temperature, steps, time_constants)
        spent.append(time.process_time() - began)
    return min(spent) / n / n_lags * 1e9


def first_fit() -> float:
    """Time of a first fit [s]."""
    frame = pd.DataFrame({"temperature": np.sin(np.arange(20_000) / 300)})
    reading = np.random.default_rng(0).standard_normal(len(frame))
    began = time.perf_counter()
    lag_differences(frame["temperature"].to_numpy(), np.ones(len(frame)), np.array([60.0]))
    DynamicBiasRegressor(time_constants=(60, 900), sampling_period=15.0).fit(frame, reading)
    return time.perf_counter() - began


def main() -> None:
    """Print a line for each length and number of lags, or the time of a first fit and of one that finds its code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rows", type=int, nargs="*", default=[84_000, 1_000_000])
    parser.add_argument("--first", action="store_true")
    parser.add_argument("--fit", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.fit:
        print(f"{first_fit():.1f} s")
    elif options.first:
        with tempfile.TemporaryDirectory() as kept:
            for what in ("nothing kept", "code kept"):
                print(f"{what}: ", end="", flush=True)
                given = {**os.environ, "NUMBA_CACHE_DIR": kept}
                subprocess.run([sys.executable, __file__, "--fit"], check=True, env=given)
    else:
        for n in options.rows:
            for n_lags in (12, 1):
                even, broken = nanoseconds(n, n_lags), nanoseconds(n, n_lags, gaps=10)
                uneven = nanoseconds(n, n_lags, jitter=0.5)
                print(
                    f"{n} rows, {n_lags} lags: {even:.2f} ns at even steps, {broken:.2f} with ten gaps, {uneven:.2f} "
                    "at uneven ones",
                    flush=True,
                )


if __name__ == "__main__":
    main()

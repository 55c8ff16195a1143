"""Time and memory that a diagnosis of a long record takes beside the data and the fit.

    python benchmarks/long_diagnosis.py --rows 1000000 3000000 10000000
    python benchmarks/long_diagnosis.py --rows 1000000 --jitter 0.8     # uneven steps: 0.6 to 1.4 of the usual one

A device with two lags in a room, and two recorded columns: none of them is a cause, or one of them is. Each diagnosis
runs in a process of its own, whose peak resident memory is printed less what it has before. Beyond 4 million rows a
record is judged by averages.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import time
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before numpy is imported, here and in the processes below

import numpy as np
import pandas as pd
from scipy.signal import lfilter

from thermocorr import DynamicBiasRegressor, diagnose
from thermocorr.equations import lag_differences

STEP = 15.0


def record_of(n: int, weight: float, jitter: float) -> tuple[pd.DataFrame, pd.Series]:
    """A temperature with days, seasons and weather, a humidity of some weight, and another column."""
    rng = np.random.default_rng(1)
    seconds = STEP * (np.arange(n) + jitter * np.random.default_rng(2).uniform(-0.25, 0.25, n))
    steps = np.diff(seconds, prepend=seconds[0] - STEP)
    T = 23 + np.sin(2 * np.pi * seconds / 86_400) + 1.5 * np.sin(2 * np.pi * seconds / (120 * 86_400))
    T += 0.8 * wandering(rng.standard_normal(n), np.exp(-STEP / 4000))
    humidity = 40 + 5 * wandering(rng.standard_normal(n), 0.9999)
    late = T[:, None] + lag_differences(T, steps, np.array([600.0, 9000.0]))[0]
    reading = 6 * T + 3 * late[:, 0] + late[:, 1] + weight * (humidity - 40)
    reading += 0.2 * rng.standard_normal(n)
    index = pd.to_timedelta(seconds, unit="s") if jitter else None
    columns = {"T": T, "humidity": humidity, "other": np.roll(humidity, n // 3)}
    return pd.DataFrame(columns, index=index), pd.Series(reading, index=index)


def wandering(noise: np.ndarray, kept: float) -> np.ndarray:
    """A noise of unit variance that remembers."""
    return np.asarray(lfilter([np.sqrt(1 - kept**2)], [1, -kept], noise))


def resident(what: str) -> float:
    """Memory of this process, now ("VmRSS") or at most so far ("VmHWM") [MiB]."""
    return int(Path("/proc/self/status").read_text().split(f"{what}:")[1].split()[0]) / 1024


def job(n: int, weight: float, jitter: float) -> None:
    """One diagnosis."""
    X, y = record_of(n, weight, jitter)
    model = DynamicBiasRegressor("T", sampling_period=None if jitter else STEP).fit(X, y)
    Path("/proc/self/clear_refs").write_text("5")  # the peak so far was that of making the record
    before, began, used = resident("VmRSS"), time.perf_counter(), time.process_time()
    found = diagnose(model, X, y)
    spent, used = time.perf_counter() - began, time.process_time() - used
    print(
        f"{n} rows: {spent:.1f} s, {used:.1f} s of the processor, {resident('VmHWM') - before:.0f} MiB; "
        f"{found.verdict}, {[cause.label for cause in found.causes]}"
    )


def main() -> None:
    """Print a line for each record."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rows", type=int, nargs="*", default=[1_000_000, 10_000_000])
    parser.add_argument("--jitter", type=float, default=0.0, help="spread of the steps over the usual one")
    parser.add_argument("--weight", type=float, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.weight is not None:
        job(options.rows[0], options.weight, options.jitter)
        return
    for n in options.rows:
        for weight in (0.0, 0.04):
            given = ["--rows", str(n), "--weight", str(weight), "--jitter", str(options.jitter)]
            subprocess.run([sys.executable, __file__, *given], check=True)


if __name__ == "__main__":
    main()

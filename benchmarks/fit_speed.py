"""Fit with six given time constants against a materialised matrix and scikit-learn's Ridge, and against the floor.

    python benchmarks/fit_speed.py                      # 84 000 and 1 000 000 rows
    python benchmarks/fit_speed.py --rows 10000000

One BLAS thread unless said; medians of alternated runs in one process, ratios within one run. "Floor" is one read of
the temperature and a symmetric product of ready blocks of 15 columns, the least that any least squares could do.
"""

from __future__ import annotations

import argparse
import time
import tracemalloc
import warnings
from collections.abc import Callable

import numpy as np
import pandas as pd
from scipy.linalg.blas import dsyrk
from scipy.signal import lfilter
from sklearn.linear_model import Ridge
from threadpoolctl import threadpool_limits

from thermocorr import DiffusiveFeatures, DynamicBiasRegressor, RecordWarning

TIME_CONSTANTS = (60.0, 240.0, 900.0, 3600.0, 14_400.0, 43_200.0)
STEP = 15.0


def record(n: int, jitter: float = 0.0) -> tuple[pd.DataFrame, np.ndarray]:
    """A room with two swings and a random walk."""
    rng = np.random.default_rng(0)
    seconds = STEP * np.arange(n) + jitter * STEP * rng.uniform(-0.5, 0.5, n)
    T = 23 + np.sin(seconds / 7000) + 0.3 * np.sin(seconds / 900) + 0.003 * np.cumsum(rng.normal(size=n))
    frame = pd.DataFrame({"temperature": T}, index=pd.to_timedelta(seconds, unit="s"))
    return frame, 10 * T + 0.2 * rng.normal(size=n)


def materialised(X: pd.DataFrame, y: np.ndarray) -> None:
    """The package's own columns as one matrix, then Ridge."""
    Q = DiffusiveFeatures(TIME_CONSTANTS).fit_transform(X)
    Ridge(alpha=1e-10, solver="cholesky").fit(Q, y)


def by_hand(X: pd.DataFrame, y: np.ndarray) -> None:
    """A user's own matrix by scipy's lfilter, then Ridge."""
    T = X["temperature"].to_numpy()
    seconds = X.index.total_seconds().to_numpy()
    columns = [T]
    for tau in TIME_CONSTANTS:
        a = np.exp(-STEP / tau)
        columns.append(lfilter([1 - a], [1, -a], T, zi=[a * T[0]])[0] - T)
        columns.append(np.exp(-seconds / tau))
    Ridge(alpha=1e-10, solver="cholesky").fit(np.column_stack(columns), y)


def floor(X: pd.DataFrame, blocks: int, ready: np.ndarray) -> None:
    """One read, and the cross products of ready blocks."""
    X["temperature"].to_numpy().sum()
    for _ in range(blocks):
        dsyrk(1.0, ready, trans=1)


def medians(runs: dict[str, Callable[[], object]], repeats: int) -> dict[str, float]:
    """Median time of each, alternated [s]."""
    times: dict[str, list[float]] = {name: [] for name in runs}
    for _ in range(repeats):
        for name, run in runs.items():
            began = time.perf_counter()
            run()
            times[name].append(time.perf_counter() - began)
    return {name: float(np.median(spent)) for name, spent in times.items()}


def line(n: int) -> str:
    """All figures for one length."""
    model = DynamicBiasRegressor(time_constants=TIME_CONSTANTS, degree=1)
    X, y = record(n)
    uneven, _ = record(n, jitter=0.5)
    ready = np.asfortranarray(np.random.default_rng(1).normal(size=(8192, 15)))
    repeats = 15 if n < 500_000 else 5 if n < 5_000_000 else 1
    model.fit(X[:1000], y[:1000])
    runs: dict[str, Callable[[], object]] = {
        "fit": lambda: model.fit(X, y),
        "irregular": lambda: model.fit(uneven, y),
        "materialised": lambda: materialised(X, y),
        "by hand": lambda: by_hand(X, y),
        "floor": lambda: floor(X, -(-n // 8192), ready),
    }
    with threadpool_limits(1):
        spent = medians(runs, repeats)
    free = medians({"fit": runs["fit"]}, repeats)["fit"]  # BLAS threads as the user's machine has them
    tracemalloc.start()
    model.fit(X, y)
    peak = tracemalloc.get_traced_memory()[1] / 2**20
    tracemalloc.stop()
    fit = spent["fit"]
    return (
        f"{n} rows: fit {fit * 1e3:.1f} ms; of materialised + Ridge {fit / spent['materialised']:.2f}, of lfilter + "
        f"Ridge {fit / spent['by hand']:.2f}, times the floor {fit / spent['floor']:.2f}; irregular over regular "
        f"{spent['irregular'] / fit:.2f}; BLAS threads not limited {free / fit:.2f}; extra memory {peak:.1f} MiB"
    )


def main() -> None:
    """Print a line for each length."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rows", type=int, nargs="*", default=[84_000, 1_000_000])
    warnings.simplefilter("ignore", RecordWarning)
    for n in parser.parse_args().rows:
        print(line(n), flush=True)


if __name__ == "__main__":
    main()

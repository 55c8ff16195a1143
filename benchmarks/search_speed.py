"""The search for time constants against scikit-learn's: speed, winner, errors, memory.

    python benchmarks/search_speed.py                    # 84 000 rows
    python benchmarks/search_speed.py --rows 1000000     # scikit-learn's share takes a minute

Pool of 24, sets of 6, 5 folds of TimeSeriesSplit, BLAS limited to one thread; ratios within one run. GridSearchCV is
timed over `--sets` sets and scaled to 1000: its time is proportional to their number.
"""

from __future__ import annotations

import argparse
import os
import time
import tracemalloc
import warnings
from collections.abc import Callable
from itertools import combinations
from typing import Any

import numpy as np
import pandas as pd
from sklearn.linear_model import Ridge
from sklearn.model_selection import GridSearchCV, TimeSeriesSplit
from sklearn.pipeline import Pipeline
from sklearn.preprocessing import StandardScaler
from threadpoolctl import threadpool_limits

from thermocorr import DiffusiveFeatures, DynamicBiasRegressor, RecordWarning, TimeConstantSearch
from thermocorr.datasets import make_record

ALPHA = 1e-6


def timed(function: Callable[[], Any], repeats: int) -> tuple[float, Any]:
    """Median time [s] and the last result."""
    times = []
    for _ in range(repeats):
        began = time.perf_counter()
        result = function()
        times.append(time.perf_counter() - began)
    return float(np.median(times)), result


def traced(function: Callable[[], Any]) -> float:
    """Peak of the allocations [MiB]."""
    tracemalloc.start()
    function()
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return peak / 2**20


def grid_search(X: pd.DataFrame, y: pd.Series, sets: list[tuple[float, ...]]) -> GridSearchCV:
    """What a user would write."""
    pipeline = Pipeline(
        [
            ("features", DiffusiveFeatures(initial_state="equilibrium")),
            ("scale", StandardScaler()),
            ("ridge", Ridge(ALPHA, solver="svd")),
        ]
    )
    grid = {"features__time_constants": sets}
    search = GridSearchCV(pipeline, grid, cv=TimeSeriesSplit(5), scoring="neg_root_mean_squared_error", refit=False)
    return search.fit(X, y)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rows", type=int, default=84_000)
    parser.add_argument("--sets", type=int, default=50, help="sets that GridSearchCV is timed over (default 50)")
    parser.add_argument("--repeats", type=int, default=5)
    options = parser.parse_args()
    warnings.simplefilter("ignore", RecordWarning)
    record = make_record(options.rows, sampling_period=15.0, device="layered", seed=1)
    X, y = record[["temperature"]], record["reading"]
    pool = np.geomspace(30.0, options.rows * 15.0 / 3, 24)
    rng = np.random.default_rng(0)
    every = list(combinations(range(24), 6))
    sets = [tuple(pool[list(every[i])]) for i in rng.choice(len(every), 1000, replace=False)]
    model = DynamicBiasRegressor(degree=1, initial_state="equilibrium")
    common = {"alphas": [ALPHA], "cv": TimeSeriesSplit(5), "refit": False, "refine": False, "rule": "best"}

    def search(candidates: Any = sets, **more: Any) -> TimeConstantSearch:
        return TimeConstantSearch(model, candidates, **common, **more).fit(X, y)

    compiled = "plain" if os.environ.get("THERMOCORR_COMPILED") == "0" else "compiled where numba is installed"
    print(f"{options.rows} rows, pool of 24, 5 folds, one BLAS thread, recursion {compiled}")
    with threadpool_limits(1):
        grid_time, grid = timed(lambda: grid_search(X, y, sets[: options.sets]), 1)
        per_1000 = grid_time * 1000 / options.sets
        print(f"GridSearchCV, {options.sets} sets: {grid_time:.2f} s, 1000 sets would be {per_1000:.1f} s")
        ours, found = timed(search, options.repeats)
        print(f"1000 sets x 5 folds, factors included: {ours * 1e3:.0f} ms, {per_1000 / ours:.0f} times faster")
        scores = dict(zip(found.cv_results_["param_time_constants"], range(1000), strict=True))
        differences = [
            abs(found.cv_results_[f"split{f}_test_score"][scores[params["features__time_constants"]]] / score - 1)
            for f in range(5)
            for params, score in zip(grid.cv_results_["params"], grid.cv_results_[f"split{f}_test_score"], strict=True)
        ]
        print(f"largest relative difference of {len(differences)} fold scores: {max(differences):.1e}")
        same = search(sets[: options.sets]).best_params_["time_constants"]
        print("same winner" if same == grid.best_params_["features__time_constants"] else "ANOTHER WINNER")
        print(f"extra memory of 1000 sets: {traced(search):.1f} MiB")
        everything, best = timed(lambda: search(pool, method="exhaustive", count=6), 1)
        print(
            f"all {len(every)} sets of 6 (and all smaller ones), exactly: {everything:.2f} s, "
            f"{everything / grid_time:.2f} of GridSearchCV over {options.sets} sets"
        )
        optimum = -best.best_score_
        for name, choose in (
            ("default search", lambda: TimeConstantSearch(model, pool, cv=TimeSeriesSplit(5), refit=False).fit(X, y)),
            ("greedy with exchanges, 6", lambda: search(pool, method="greedy", count=6)),
        ):
            spent, chosen = timed(choose, options.repeats)
            print(
                f"{name}: CV error {-chosen.best_score_ / optimum - 1:+.2%} of that optimum's, {spent * 1e3:.0f} ms, "
                f"{spent / grid_time:.3f} of GridSearchCV over {options.sets} sets"
            )


if __name__ == "__main__":
    main()

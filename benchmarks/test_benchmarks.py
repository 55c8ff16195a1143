"""Timings of the parts, to compare versions: pytest-benchmark keeps and compares runs.

pip install '.[bench]'
pytest benchmarks/test_benchmarks.py --benchmark-only --benchmark-autosave
pytest benchmarks/test_benchmarks.py --benchmark-only --benchmark-compare
"""

from __future__ import annotations

import numpy as np
import pytest
from threadpoolctl import threadpool_limits

from thermocorr import DynamicBiasRegressor, TimeConstantSearch
from thermocorr.datasets import make_record
from thermocorr.equations import TriangularFactor, lag_differences, solve_ridge

N = 84_000
TIME_CONSTANTS = np.geomspace(60.0, 43_200.0, 6)


@pytest.fixture(autouse=True)
def _one_thread():
    with threadpool_limits(1):
        yield


@pytest.fixture(scope="module")
def record():
    record = make_record(N, sampling_period=15.0, seed=1)
    return record[["temperature"]], record["reading"]


@pytest.mark.parametrize("jitter", [0.0, 5.0], ids=["regular", "irregular"])
def test_lag_recursion(benchmark, record, jitter):
    T = record[0]["temperature"].to_numpy()
    steps = 15.0 + jitter * np.random.default_rng(0).uniform(-1, 1, N)
    benchmark(lag_differences, T[:8192], steps[:8192], TIME_CONSTANTS)


@pytest.mark.parametrize("width", [9, 15, 27, 51])
def test_sweep_of_a_block(benchmark, width):
    rows = np.asfortranarray(np.random.default_rng(0).normal(size=(8192, width)))
    benchmark(lambda: TriangularFactor(width).update(rows.copy(order="F")))


def test_solve(benchmark):
    factor = TriangularFactor(27).update(np.asfortranarray(np.random.default_rng(0).normal(size=(1000, 27))))
    benchmark(solve_ridge, factor, 1e-3)


def test_fit_of_six(benchmark, record):
    model = DynamicBiasRegressor(time_constants=TIME_CONSTANTS, degree=1)
    benchmark(model.fit, *record)


def test_predict(benchmark, record):
    model = DynamicBiasRegressor(time_constants=TIME_CONSTANTS, degree=1).fit(*record)
    benchmark(model.predict, record[0])


@pytest.mark.parametrize("method", ["spectrum", "cross_validation"])
def test_search(benchmark, record, method):
    search = TimeConstantSearch(method=method, refit=False)
    benchmark.pedantic(search.fit, record, rounds=5)

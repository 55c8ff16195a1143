"""What the temperature did in gaps: how wrong the bias is behind them, what is learned from, and who is blamed."""

from __future__ import annotations

import warnings

import numpy as np
import pandas as pd
import pytest

from thermocorr import DynamicBiasRegressor, ParquetLog, compare_variants, diagnose, refine
from thermocorr.datasets import make_record
from thermocorr.equations import lag_differences
from thermocorr.equations.lags import bridge_error
from thermocorr.estimators.input_errors import GapError, InputLaw, error_behind_gaps
from thermocorr.records import Layout, read_record
from thermocorr.records.gaps import Gaps

TAUS = np.array([120.0, 900.0, 7200.0])


def felt_late(weights):
    return InputLaw("temperature", (), TAUS, weights, 0.0, True)


def wandering(rng, n, remembers):
    """An Ornstein-Uhlenbeck process of unit variance, a row a step."""
    kept = np.exp(-1 / remembers)
    noise = np.sqrt(1 - kept**2) * rng.standard_normal(n)
    noise[0] = rng.standard_normal()
    for k in range(1, n):
        noise[k] += kept * noise[k - 1]
    return noise


def test_the_error_of_a_bridge_is_that_of_drawn_ones():
    """Brownian motion: bridges drawn at random, and the lags' integrals over them."""
    rng, h, steps = np.random.default_rng(0), 3600.0, 400
    t = np.linspace(0, h, steps + 1)
    walk = np.cumsum(np.sqrt(h / steps) * rng.standard_normal((4000, steps)), axis=1)
    bridge = np.column_stack((np.zeros(4000), walk)) - t / h * walk[:, -1:]
    kernel = np.exp(-(h - t) / TAUS[:, None]) / TAUS[:, None]
    drawn = np.cov((bridge @ kernel.T) * h / steps, rowvar=False)
    found = bridge_error(lambda lag: np.asarray(lag, float), h, TAUS)
    np.testing.assert_allclose(found, drawn, rtol=0.12)


def by_matrices(law, gaps, steps):
    """The definition, row by row: matrices J x J; forgotten where all lags together err by no more than `least`."""
    felt, said = None, []
    for step in steps.tolist():
        decay = np.diag(np.exp(-step / law.time_constants))
        felt = None if felt is None else decay @ felt @ decay
        if step > gaps.least:
            bridge = bridge_error(gaps.structure(law.column), float(f"{step:.2g}"), law.time_constants)
            felt = bridge if felt is None else felt + bridge
        if felt is not None and np.abs(law.weights) @ np.sqrt(np.diag(felt)) <= law.least:
            felt = None
        said.append(0.0 if felt is None else law.weights @ felt @ law.weights)
    return np.array(said)


def laws_and_steps(seed):
    """Two columns with lags, one of which forgets sooner; dense and sparse gaps, the first row behind one or not."""
    rng, lags = np.random.default_rng(seed), np.concatenate(([0.0], np.geomspace(10, 1e5, 20)))
    laws = [
        InputLaw(column, (), np.sort(10 ** rng.uniform(1, 4, n_lags)), rng.uniform(0.2, 1, n_lags), least, True)
        for column, n_lags, least in (("T", 4, 0.15), ("H", 2, 0.15))
    ]
    squares = {"T": np.minimum(1e-3 * lags**1.2, 4.0), "H": np.minimum(1e-2 * lags**0.6, 2.0)}
    steps = rng.choice([10.0, 12.0, 15.3], 400)
    behind = rng.random(400) < (0.3, 0.05, 0.02)[seed % 3]
    behind[0] = seed % 2
    steps[behind] += 10 ** rng.uniform(1.5, 4, behind.sum())
    return laws, Gaps(least=30.0, lags=lags, squares=squares), steps


@pytest.mark.parametrize("seed", range(6))
def test_what_is_felt_of_gaps_fades_as_matrices_do(seed):
    """Whole, in pieces, one by one and after a stop; the weights are of one sign, so sums lose no digits to 1e-12."""
    laws, gaps, steps = laws_and_steps(seed)
    error, rng, felt, parts, at = GapError(laws, gaps), np.random.default_rng(seed), (), [], 0
    expected = sum(by_matrices(law, gaps, steps) for law in laws)
    assert expected.any()
    np.testing.assert_allclose(error.of_rows(steps)[0], expected, rtol=1e-12)
    while at < len(steps):
        stop = at + int(rng.integers(1, 50))
        if rng.random() < 0.5:
            said, felt = error.of_rows(steps[at:stop], felt)
            parts.extend(said)
        else:
            for step in steps[at:stop].tolist():
                said, felt = error.of_row(step, felt)
                parts.append(said)
        felt, at = error.taken_up(error.plain(felt)), stop
    np.testing.assert_allclose(parts, expected, rtol=1e-12)


@pytest.mark.parametrize("remembers", [30.0, 300.0])
def test_the_error_behind_a_gap_is_that_of_many_records(remembers):
    rng, n = np.random.default_rng(1), 3000
    weights, gap = np.array([3.0, -1.0, 2.0]), slice(1500, 1560)
    seconds = 60.0 * np.arange(n)
    kept = np.ones(n, bool)
    kept[gap] = False
    missed, said = [], []
    for _ in range(60):
        T = 23 + wandering(rng, n, remembers)
        whole = lag_differences(T, np.diff(seconds, prepend=-60.0), TAUS)[0][kept]
        X = pd.DataFrame({"temperature": T, "seconds": seconds})[kept]
        bridged = lag_differences(T[kept], np.diff(seconds[kept], prepend=-60.0), TAUS)[0]
        missed.append((whole - bridged) @ weights)
        record = read_record(X, Layout("temperature", "seconds"), quiet=True)
        rows, error = error_behind_gaps(record, [felt_late(weights)])
        said.append(np.zeros(len(X)))
        said[-1][rows] = error
    rms, said = np.sqrt(np.mean(np.square(missed), axis=0)), np.sqrt(np.mean(np.square(said), axis=0))
    assert (said[:1500] == 0).all() and (rms[:1500] < 1e-12).all()
    for behind in (0, 5, 30, 120):
        assert said[1500 + behind] == pytest.approx(rms[1500 + behind], rel=0.3)  # of sixty records
    np.testing.assert_allclose(said[1500:1700].mean(), rms[1500:1700].mean(), rtol=0.2)


def test_without_gaps_there_is_no_error():
    X = make_record(1000, irregular=0.5, seed=1)[["temperature"]]
    record = read_record(X, Layout("temperature"), quiet=True)
    assert len(error_behind_gaps(record, [felt_late(np.ones(3))])[0]) == 0
    assert len(error_behind_gaps(record, [])[0]) == 0
    apart = read_record(X.drop(X.index[300:400]), Layout("temperature", max_gap="10 min"), quiet=True)
    assert len(error_behind_gaps(apart, [felt_late(np.ones(3))])[0]) == 0  # a start has decays of its own


def test_how_the_temperature_wanders_is_read_off_it():
    T = np.cumsum(np.random.default_rng(2).standard_normal(50_000))
    X = pd.DataFrame({"temperature": T, "seconds": 10.0 * np.arange(50_000)})
    record = read_record(X, Layout("temperature", "seconds"), quiet=True)
    structure = Gaps.of(record, ["temperature"], 10.0, 1000.0).structure("temperature")
    np.testing.assert_allclose(structure(np.array([0.0, 5.0, 100.0, 1000.0])), [0.0, 0.5, 10.0, 100.0], rtol=0.1)


def test_missing_temperatures_are_a_gap_too():
    record = make_record(5000, seed=713)
    X, y = record[["temperature"]], record["reading"]
    holes = X.copy()
    for start in (700, 1500, 2600, 3300, 4100):
        holes.iloc[start : start + 80] = np.nan
    kept = holes["temperature"].notna().to_numpy()
    with_nan, without = (
        DynamicBiasRegressor("temperature", ["5 min", "90 min"]).fit(*data) for data in ((holes, y), (X[kept], y[kept]))
    )
    np.testing.assert_allclose(with_nan.coef_, without.coef_, rtol=1e-9)
    searched = DynamicBiasRegressor("temperature").fit(holes, y)
    assert diagnose(searched, holes, y).verdict == "nothing missing"


def test_it_is_said_how_many_readings_are_left_out():
    record = make_record(3000, gaps=3, seed=714)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        model = DynamicBiasRegressor("temperature").fit(record[["temperature"]], record["reading"])
    said = [str(one.message) for one in caught if "behind gaps" in str(one.message)]
    assert len(said) == 1 and "are not learned from" in said[0] and "max_gap" in said[0]
    assert said[0] in model.notes_ and "% of all" not in said[0]


def test_a_log_on_disk_is_fitted_alike(tmp_path):
    pytest.importorskip("pyarrow", reason="Parquet needs pyarrow: pip install '.[parquet]'")
    record = make_record(4000, gaps=6, seed=715).reset_index()
    record.to_parquet(tmp_path / "log.parquet")
    log = ParquetLog(tmp_path / "log.parquet")
    model = DynamicBiasRegressor("temperature", ["5 min", "90 min"], time="time")
    here, there = model.fit(record[["time", "temperature"]], record["reading"]).coef_, model.fit(log, log["reading"])
    np.testing.assert_allclose(there.coef_, here, rtol=1e-9)


def test_a_gap_in_one_run_is_not_felt_in_the_next():
    record = make_record(1500, runs=3, gaps=2, seed=716)
    layout = Layout("temperature", run="run")
    record_read = read_record(record[["run", "temperature"]], layout, quiet=True)
    rows, error = error_behind_gaps(record_read, [felt_late(np.ones(3))])
    runs, steps = record["run"].to_numpy(), record.index.to_series().diff().dt.total_seconds().to_numpy()
    first = {
        run: int(np.flatnonzero((runs == run) & (steps > 150) & (np.roll(runs, 1) == run))[0]) for run in set(runs)
    }
    assert (error > 0).all() and all(rows[runs[rows] == run].min() == start for run, start in first.items())


@pytest.mark.parametrize("work", ["variants", "refine"])
def test_what_many_fits_say_is_said_once(work):
    record = make_record(3000, gaps=3, seed=717)
    X, y = record[["temperature"]], record["reading"]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        model = DynamicBiasRegressor("temperature", ["5 min", "90 min"]).fit(X, y)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        if work == "variants":
            compare_variants(X, y, model=model)
        else:
            refine(model, X, y)
    said = [" ".join(str(one.message).split()[:2]) for one in caught]
    assert sorted(said) == ["Sampling has", "The temperature"]

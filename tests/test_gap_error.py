"""What the temperature did in gaps: how wrong the bias is behind them, what is learned from, and who is blamed."""

from __future__ import annotations

import warnings

import numpy as np
import pandas as pd
import pytest
from scipy.signal import lfilter

from thermocorr import DynamicBiasRegressor, ParquetLog, RecordWarning, compare_variants, diagnose, later_errors, refine
from thermocorr.datasets import make_record
from thermocorr.equations import lag_differences
from thermocorr.equations.lags import bridge_error
from thermocorr.estimators.gap_error import GapError, error_behind_gaps
from thermocorr.estimators.input_law import InputLaw
from thermocorr.records import Layout, read_record
from thermocorr.records.gaps import Gaps

PERIODS = {"lab": 60.0, "outdoor": 600.0, "chamber": 30.0}
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


def test_no_variance_is_negative_whatever_the_structure():
    found = bridge_error(lambda lag: np.interp(lag, [0.0, 50.0, 400.0], [0.0, 1.0, 0.2]), 400.0, TAUS)  # of nothing
    assert np.linalg.eigvalsh(found).min() > -1e-12 * np.linalg.eigvalsh(found).max()
    np.testing.assert_allclose(found, found.T)


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


def test_gaps_that_come_often_are_all_forgotten_or_none():
    """Each gap beside what is left of those before it: a closed form for one lag and gaps of one length."""
    law = InputLaw("T", (), np.array([600.0]), np.array([2.0]), 0.0, True)
    gaps = Gaps(least=30.0, lags=np.array([0.0, 10.0, 1e4]), squares={"T": np.array([0.0, 10.0, 1e4])})
    steps = np.tile([60.0, 20.0, 20.0], 400)
    alone = 4.0 * bridge_error(gaps.structure("T"), 60.0, law.time_constants)[0, 0]
    sum_of_all = alone / (1.0 - np.exp(-2 * 100.0 / 600.0))  # a geometric series: a period is 100 s
    said = GapError([law], gaps).of_rows(steps)[0]
    np.testing.assert_allclose(said[:3], alone * np.exp(-2 * np.array([0.0, 20.0, 40.0]) / 600.0))
    np.testing.assert_allclose(said[-3:], sum_of_all * np.exp(-2 * np.array([0.0, 20.0, 40.0]) / 600.0))
    least = np.sqrt(alone) * np.exp(-30.0 / 600.0)  # forgotten before the third row behind each gap
    forgets = GapError([InputLaw("T", (), law.time_constants, law.weights, least, True)], gaps).of_rows(steps)[0]
    np.testing.assert_allclose(forgets.reshape(-1, 3), np.tile([*said[:2], 0.0], (400, 1)))


@pytest.mark.parametrize("power", [0.5, 1.0, 1.9])
def test_between_its_times_a_structure_is_a_power(power):
    lags = np.array([0.0, 60.0, 300.0, 3000.0])
    structure = Gaps(least=150.0, lags=lags, squares={"T": 2.0 * lags**power}).structure("T")
    between = np.geomspace(60.0, 3000.0, 40)
    np.testing.assert_allclose(structure(between), 2.0 * between**power)
    assert structure(np.array(0.0)) == 0 and structure(np.array(1e5)) == structure(np.array(3000.0))
    np.testing.assert_allclose(structure(np.array([30.0])), 60.0**power)
    constant = Gaps(least=150.0, lags=lags, squares={"T": 0.0 * lags}).structure("T")
    assert not constant(between).any()


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


@pytest.mark.newest
@pytest.mark.parametrize("seed", [711, 712])
@pytest.mark.parametrize("setting", PERIODS)
def test_nobody_is_blamed_for_what_happened_in_gaps(setting, seed):
    record, truth = make_record(
        5000, gaps=10, seed=seed, setting=setting, sampling_period=PERIODS[setting], return_truth=True
    )
    X, y = record.drop(columns="reading"), record["reading"]
    model = DynamicBiasRegressor("temperature").fit(X, y)
    assert diagnose(model, X, y).verdict == "nothing missing"
    assert model.residual_std_ == pytest.approx(0.2, rel=0.06)
    behind = model.without_spoilt(read_record(X, model.features_.layout(), y=y.to_numpy(), quiet=True)).reading
    sound = np.isfinite(np.asarray(behind[:]))
    assert 0.5 < sound.mean() < 0.99
    wrong = model.predict(X) - truth["noise_free"]
    assert np.sqrt(np.mean(wrong[sound] ** 2)) < 0.08 < np.sqrt(np.mean(wrong[~sound] ** 2))


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


def test_it_is_said_where_gaps_spoil_much_of_a_record():
    """A slow part of the model, which has taken an ageing that it does not have, feels gaps of a week for a year."""
    rng, hours = np.random.default_rng(2), np.arange(24 * 500)
    weather = lfilter([1 / 60], [1, -59 / 60], rng.standard_normal(len(hours)))
    T = 23 + 2 * np.sin(2 * np.pi * hours / 8760) + 0.5 * np.sin(2 * np.pi * hours / 24) + 5 * weather
    y = 3 * T + 20 * np.log1p(hours / 720) + 0.1 * rng.standard_normal(len(hours))
    kept = (hours % 4000 < 3000) | (hours % 4000 > 3160)
    X = pd.DataFrame({"T": T}, pd.date_range("2024-01-01", periods=len(hours), freq="h"))[kept]
    with pytest.warns(RecordWarning, match=r"readings behind gaps, \d\d % of all, are not learned from"):
        model = DynamicBiasRegressor("T", degree=1).fit(X, y[kept])
    found = diagnose(model, X, y[kept])
    assert found.best.kind == "log_ageing"
    assert 0.1 < found.left.unjudged < 0.2 and found.left.unjudged_rms > 1.5 * found.residual_rms
    assert f"{found.left.unjudged:.0%} of the readings are behind gaps" in " ".join(str(found).split())


@pytest.mark.newest
@pytest.mark.parametrize("kind", ["hysteresis", "step", "hinge", "lead"])
def test_what_is_hidden_is_found_all_the_same(kind):
    record = make_record(5000, gaps=10, seed=802, effects={kind: 1.0}, device="layered")
    X, y = record.drop(columns="reading"), record["reading"]
    found = diagnose(DynamicBiasRegressor("temperature").fit(X, y), X, y)
    assert found.best.kind == kind


def test_a_log_on_disk_is_fitted_alike(tmp_path):
    pytest.importorskip("pyarrow", reason="Parquet needs pyarrow: pip install 'thermocorr[parquet]'")
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


@pytest.mark.parametrize("work", ["variants", "refine", "later"])
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
            refine(model, X, y) if work == "refine" else later_errors({"model": model}, X, y)
    said = [" ".join(str(one.message).split()[:2]) for one in caught]
    assert sorted(said) == ["Sampling has", "The temperature"]


@pytest.mark.parametrize("seed", [31, 32, 33, 34])
def test_what_nobody_saw_in_regular_dead_times_is_no_cause(seed):
    """25 rows, then 19 missed, over and over, in a room that moves as fast: leads were told of it, and waves."""
    rng, n = np.random.default_rng(seed), 5000
    T = 22 + lfilter([0.05], [1, -1.92, 0.945], rng.standard_normal(n + 500))  # it rings within 40 rows
    late = lfilter([0.05], [1, -0.95], T - T[0]) + T[0]
    X = pd.DataFrame({"temperature": T}, pd.date_range("2024-01-01", periods=n + 500, freq="min"))
    y = pd.Series(8 * T - 5 * late + rng.standard_normal(n + 500), X.index)
    kept = (np.arange(n + 500) % 44 < 25) & (np.arange(n + 500) >= 500)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RecordWarning)
        found = diagnose(DynamicBiasRegressor("temperature").fit(X[kept], y[kept]), X[kept], y[kept])
    assert not found.causes and found.left.in_gaps > 0.3
    assert "What the temperature did in gaps may have moved" in " ".join(str(found).split())

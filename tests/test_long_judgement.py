"""Diagnosis and refinement of logs in files and of long records, which are averaged over short stretches first."""

import tracemalloc

import numpy as np
import pandas as pd
import pytest

from thermocorr import DynamicBiasRegressor, ParquetLog, diagnose, refine
from thermocorr.datasets import make_record
from thermocorr.judgement import data
from thermocorr.records import Layout, read_record
from thermocorr.records.history import Thinned, thinned

pytestmark = pytest.mark.newest

N = 12_000


def record_with(effect, n=N, seed=91):
    record = make_record(n, effects={effect: 2.0}, seed=seed)
    return record.drop(columns="reading"), record["reading"]


@pytest.fixture
def as_log(tmp_path):
    pytest.importorskip("pyarrow", reason="Parquet needs pyarrow: pip install '.[parquet]'")

    def write(X, y, name="log.parquet"):
        X.assign(reading=y).to_parquet(tmp_path / name, row_group_size=777)
        log = ParquetLog(tmp_path / name)
        return log, log["reading"]

    return write


@pytest.mark.parametrize("effect", ["hysteresis", "covariate"])
def test_a_log_is_judged_as_the_frame_is(effect, as_log):
    X, y = record_with(effect, 5000)
    y.iloc[[700, 2500]] += 40.0
    X.iloc[100:110, X.columns.get_loc("humidity")] = np.nan  # a suspect with a short hole
    model = DynamicBiasRegressor("temperature", ["5 min", "90 min"]).fit(X[["temperature"]], y)
    log, reading = as_log(X, y)
    expected, found = diagnose(model, X, y), diagnose(model, log, reading)
    assert str(found) == str(expected) and found.best.kind == effect
    pd.testing.assert_frame_equal(found.where, expected.where)
    assert found.data.n_readings == expected.data.n_readings  # the page is gathered from the log as well


def test_a_log_is_refined_as_the_frame_is(as_log):
    X, y = record_with("step", 4000)
    model = DynamicBiasRegressor("temperature", ["5 min", "90 min"])
    log, reading = as_log(X, y)
    expected, found = refine(model, X, y), refine(model, log, reading)
    pd.testing.assert_frame_equal(found.steps, expected.steps)
    np.testing.assert_allclose(found.model_.coef_, expected.model_.coef_, rtol=1e-9)


@pytest.mark.parametrize("gaps", [0, 3])
def test_thinned_rows_are_averages(gaps):
    """Against pandas: stretches of seven or eight rows inside segments, missing readings left out."""
    record = make_record(3000, gaps=gaps, seed=5)
    record.iloc[100:120, record.columns.get_loc("reading")] = np.nan
    X, y = record[["temperature"]], record["reading"]
    long = read_record(X, Layout(max_gap="10 min"), y=y, quiet=True)
    short, sound = thinned(long, {"humidity": record["humidity"].to_numpy()}, len(record) // 7)
    assert isinstance(short, Thinned) and sound["humidity"] == 1.0 and len(short.segments) == gaps + 1
    width = -(-long.n_used // (len(record) // 7))
    group = np.concatenate([i * 10_000 + np.arange(s.stop - s.start) // width for i, s in enumerate(long.segments)])
    means = record.assign(seconds=long.times.seconds(slice(0, 3000), long.first_stamp())).groupby(group).mean()
    for name, values in (("temperature", short.columns["temperature"]), ("humidity", short.columns["humidity"])):
        np.testing.assert_allclose(values, means[name], rtol=1e-12)
    np.testing.assert_allclose(short.reading, means["reading"], rtol=1e-12)
    assert short.counts.sum() == y.notna().sum()
    places = long.kept_places(0, 3000)
    np.testing.assert_array_equal(short.places_of(places), np.unique(group, return_inverse=True)[1][places])
    seconds = short.times.seconds(slice(0, short.n_rows), short.first_stamp())
    np.testing.assert_allclose(seconds, means["seconds"], rtol=0, atol=1e-6)


@pytest.mark.long
@pytest.mark.parametrize("effect", ["covariate", "hysteresis", "step", "lagged_covariate"])
def test_averages_are_judged_as_their_rows(effect, monkeypatch):
    """The same cause and residual; a step lies where it lay, though rows are six times as long.

    So is the noise floor, but for hysteresis: the play of averages misses the turning points.
    """
    X, y = record_with(effect)
    model = DynamicBiasRegressor("temperature").fit(X, y)
    expected = diagnose(model, X, y)
    monkeypatch.setattr(data, "MOST_ROWS", N // 6)
    found = diagnose(model, X, y)
    assert found.best.kind == expected.best.kind == effect
    assert found.residual_rms == pytest.approx(expected.residual_rms, rel=1e-9)
    assert found.noise_floor == pytest.approx(expected.noise_floor, rel=0.15 if effect == "hysteresis" else 0.05)
    if effect == "step":
        assert found.best.time == pytest.approx(expected.best.time, abs=360.0)


def test_averages_take_little_memory():
    """A row costs 8 bytes for each column, for the reading and for its time, and 6 for where it comes from."""
    n = 1_000_000
    T = np.sin(np.arange(n) / 5000)
    long = read_record(pd.DataFrame({"T": T}), Layout(temperature="T", sampling_period=1.0), y=pd.Series(T), quiet=True)
    tracemalloc.start()
    short, _ = thinned(long, {"other": T}, n // 3)
    held = tracemalloc.get_traced_memory()[0]
    tracemalloc.stop()
    assert isinstance(short, Thinned) and held < 1.02 * (4 * 8 + 6) * short.n_rows

"""Parquet logs: the same numbers as frames in memory, in bounded memory, with errors that name row and column.

Also: A record that was read once, in the place of the data: the same results, and refusals where it cannot serve.
"""

import pickle
import tracemalloc

import numpy as np
import pandas as pd
import pytest

from thermocorr import DynamicBiasRegressor, ParquetLog, RecordError, TimeConstantSearch
from thermocorr.datasets import make_record

pytest.importorskip("pyarrow", reason="Parquet needs pyarrow: pip install '.[parquet]'")


@pytest.fixture(scope="module")
def record():
    record = make_record(5000, seed=6, irregular=0.3)
    record.iloc[1000:1010, record.columns.get_loc("reading")] = np.nan
    return record


@pytest.fixture(scope="module")
def log(record, tmp_path_factory):
    folder = tmp_path_factory.mktemp("logs")
    record[:3000].to_parquet(folder / "a.parquet", row_group_size=700)
    record[3000:].to_parquet(folder / "b.parquet", row_group_size=1100)
    return ParquetLog([folder / "a.parquet", folder / "b.parquet"])


def test_rows_are_those_of_the_frame(record, log):
    assert log.columns == list(record.columns)
    assert len(log) == len(record)
    values, column = record["temperature"].to_numpy(), log["temperature"]
    for rows in (slice(0, 5000), slice(650, 1500), slice(2990, 3010), slice(5, 5), slice(0, 4000, 7)):
        assert np.array_equal(column[rows], values[rows])
    some = np.array([0, 699, 700, 2999, 3000, 4999])
    assert np.array_equal(column[some], values[some])
    assert column[-1] == values[-1]
    assert column[3000] == values[3000]


def test_fit_search_and_evaluation_equal_those_of_the_frame(record, log):
    for model in (DynamicBiasRegressor("temperature", ["5 min", "1 h"]), DynamicBiasRegressor("temperature")):
        from_frame = model.fit(record, record["reading"])
        frame = from_frame.evaluate(record, record["reading"])
        coef, taus = from_frame.coef_, from_frame.time_constants_
        from_log = model.fit(log, log["reading"])
        assert np.array_equal(from_log.coef_, coef)
        assert np.array_equal(from_log.time_constants_, taus)
        blocks = pd.concat(list(from_log.evaluate_blocks(log, log["reading"])))
        assert blocks.index.tolist() == list(range(5000))
        for name in frame:
            assert np.array_equal(
                blocks[name].to_numpy(), frame[name].to_numpy(), equal_nan=frame[name].dtype == float
            ), name
        assert np.array_equal(from_log.predict(record), from_frame.predict(record))  # fitted on a file, used on a frame
    search = TimeConstantSearch(DynamicBiasRegressor("temperature")).fit(log, log["reading"])
    np.testing.assert_allclose(search.best_estimator_.time_constants_, taus)


def test_a_log_travels(log, record):
    again = pickle.loads(pickle.dumps(log))
    assert np.array_equal(again["temperature"][700:2100], record["temperature"].to_numpy()[700:2100])


def test_seconds_spans_and_zones_are_times(tmp_path, record):
    taus = [300.0, 3600.0]
    expected = DynamicBiasRegressor("temperature", taus).fit(record, record["reading"]).coef_
    seconds = (record.index - record.index[0]).total_seconds()
    frames = {
        "seconds": record.assign(clock=seconds).reset_index(drop=True),
        "span": record.assign(clock=record.index - record.index[0]).reset_index(drop=True),
        "zoned": record.assign(clock=record.index.tz_localize("Europe/Paris")).reset_index(drop=True),
    }
    for name, frame in frames.items():
        frame.to_parquet(tmp_path / f"{name}.parquet", index=False)
        log = ParquetLog(tmp_path / f"{name}.parquet")
        model = DynamicBiasRegressor("temperature", taus, time="clock").fit(log, log["reading"])
        np.testing.assert_allclose(model.coef_, expected, rtol=1e-9)


def test_memory_does_not_grow_with_the_record(tmp_path):
    """Row groups of 50 000 rows; the columns together are 24 MB. pyarrow's own memory is not traced: see benchmarks."""
    n = 1_000_000
    t = np.arange(n, dtype=float)
    frame = pd.DataFrame({"temperature": 23 + np.sin(t / 3000), "reading": np.sin(t / 3000 - 0.1), "t": t})
    frame.to_parquet(tmp_path / "long.parquet", row_group_size=50_000, index=False)
    log = ParquetLog(tmp_path / "long.parquet")
    tracemalloc.start()
    model = DynamicBiasRegressor("temperature", [100.0, 3000.0], time="t").fit(log, log["reading"])
    worst = max(abs(block["residual"]).max() for block in model.evaluate_blocks(log, log["reading"]))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert worst < 1.0
    assert peak < 16 * 2**20


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda f: f.assign(temperature="warm"), "'temperature' holds .*string.*, not numbers"),
        (lambda f: f.assign(temperature=f["temperature"] / (np.arange(len(f)) != 900)), "infinity in row 900"),
        (lambda f: f.assign(reading=f["reading"] / (np.arange(len(f)) != 900)), "y contains infinity in row 900"),
        (lambda f: f.assign(reading=f["reading"].where(np.arange(len(f)) != 100, 1e300)), "y is 1e.300 in row 100"),
        (lambda f: f.set_index(f.index.where(np.arange(len(f)) != 800)), "no time in row 800"),
        (lambda f: f.iloc[::-1], "Time goes backward at row 1"),
        (lambda f: f.iloc[:0], "has 0 rows"),
        (lambda f: f.rename(columns={"temperature": "room"}), "There is no temperature 'temperature'"),
    ],
)  # fmt: skip
def test_bad_files_are_refused_by_row_and_column(record, tmp_path, change, words):
    change(record[:1500]).to_parquet(tmp_path / "bad.parquet", row_group_size=400)
    log = ParquetLog(tmp_path / "bad.parquet")
    with pytest.raises(RecordError, match=words):
        DynamicBiasRegressor("temperature", [300.0]).fit(log, log["reading"])
    with pytest.raises(RecordError, match=words):  # whoever walks through the file finds it
        DynamicBiasRegressor("temperature", [300.0], screen=False).fit(log, log["reading"])


def test_files_of_one_log_have_the_same_columns(record, tmp_path):
    record[:100].to_parquet(tmp_path / "a.parquet")
    record[100:200].drop(columns="supply").to_parquet(tmp_path / "b.parquet")
    with pytest.raises(RecordError, match="same columns"):
        ParquetLog([tmp_path / "a.parquet", tmp_path / "b.parquet"])
    with pytest.raises(RecordError, match="no column 'supply'"):
        ParquetLog(tmp_path / "b.parquet")["supply"]


def test_rows_in_any_order(record, log):
    """Runs that take turns are read in the order of the runs, across row groups and files."""
    rows = np.random.default_rng(0).permutation(5000)
    np.testing.assert_array_equal(log["temperature"][rows], record["temperature"].to_numpy()[rows])

"""Records: times, segments and blocks from what users hold."""

import numpy as np
import pandas as pd
import pytest
from effect_records import temperatures

from thermocorr import DiffusiveFeatures, RecordError
from thermocorr.records import BLOCK_ROWS, Layout, read, read_record
from thermocorr.records.times import Times

N = 60


def record_of(X, y=None, **layout):
    return read_record(X, Layout(**layout), y=y, quiet=True)


def spans(record):
    return [(segment.start, segment.stop) for segment in record.segments]


def steps_of(record):
    """Steps [s] of the whole record in time order; NaN where a segment begins."""
    return np.concatenate([np.r_[np.nan, b.steps[1:]] if b.begins else b.steps for b in record.blocks(size=7)])


DATES = pd.date_range("2024-05-31T22:00:00.250", periods=N, freq="15s")
FORMS = {
    "DatetimeIndex": (DATES, "datetime"),
    "DatetimeIndex with zone": (DATES.tz_localize("Asia/Tokyo"), "datetime with time zone"),
    "TimedeltaIndex": (DATES - DATES[0], "timedelta"),
    "datetime column": (pd.Series(DATES), "datetime"),
    "ISO text": (pd.Series(DATES.map(lambda t: t.isoformat())), "datetime"),
    "ISO text, Z": (pd.Series(DATES.map(lambda t: t.isoformat() + "Z")), "datetime with time zone"),
    "seconds": (pd.Series(1e6 + 15.0 * np.arange(N)), "seconds"),
    "whole seconds": (pd.Series(15 * np.arange(N), dtype="Int32"), "seconds"),
    "datetime objects": (pd.Series(list(DATES.to_pydatetime()), dtype=object), "datetime"),
    "arrow dates": (pd.Series(DATES.as_unit("ns")).astype("timestamp[ns][pyarrow]"), "datetime"),
    "arrow dates, UTC": (pd.Series(DATES).astype("timestamp[us, tz=UTC][pyarrow]"), "datetime with time zone"),
    "arrow index": (pd.Index(pd.Series(DATES.as_unit("us")).astype("timestamp[us][pyarrow]")), "datetime"),
}


@pytest.mark.parametrize("form", FORMS)
def test_times_of_every_form_give_the_same_steps(form):
    times, kind = FORMS[form]
    T = temperatures()
    if isinstance(times, pd.Index):
        record = record_of(pd.DataFrame({"temperature": T}, index=times))
    else:
        record = record_of(pd.DataFrame({"temperature": T, "when": times}), time="when")
    assert record.times.kind == kind
    assert spans(record) == [(0, N)]
    assert np.array_equal(steps_of(record), np.r_[np.nan, np.full(N - 1, 15.0)], equal_nan=True)
    assert record.duration(record.segments[0]) == 15.0 * (N - 1)
    assert record.usual_step() == 15.0
    seconds = np.concatenate([block.seconds for block in record.blocks(size=11)])
    assert np.array_equal(seconds, 15.0 * np.arange(N))


@pytest.mark.parametrize("unit", ["s", "ms", "us", "ns"])
@pytest.mark.parametrize("zone", [None, "Europe/Berlin"])
def test_every_unit_of_dates_gives_the_same_seconds(unit, zone):
    dates = pd.date_range("2024-01-01", periods=N, freq="61s", tz=zone, unit=unit)
    record = record_of(pd.DataFrame({"temperature": temperatures()}, index=dates))
    assert np.array_equal(steps_of(record)[1:], np.full(N - 1, 61.0))
    assert record.stamp(1) - record.stamp(0) == 61 * 10**9
    assert np.array_equal(next(record.blocks()).elapsed, 61.0 * np.arange(N))


@pytest.mark.parametrize("period", [15, 15.0, np.float32(15), "15 s", "0.25min", pd.Timedelta("15s")])
def test_sampling_period_of_an_array_may_be_a_number_or_a_span(period):
    record = record_of(temperatures()[:, None], sampling_period=period)
    assert np.array_equal(steps_of(record)[1:], np.full(N - 1, 15.0))
    assert record.temperature_name == 0


@pytest.mark.parametrize("name", ["sampling_period", "max_gap"])
@pytest.mark.parametrize("span", [0, -1.0, np.nan, np.inf, "soon", True])
def test_impossible_time_spans_are_refused(name, span):
    X = pd.DataFrame({"temperature": temperatures()}, index=None if name == "sampling_period" else DATES)
    with pytest.raises(ValueError, match=f"{name!r} parameter must be a positive time"):
        record_of(X, **{name: span})


@pytest.mark.parametrize("month", ["2024-03-31", "2024-10-27"])
@pytest.mark.parametrize("offset", ["+01:00", "+0100", "+01"])
def test_change_to_or_from_summer_time_is_no_gap_and_no_step_back(month, offset):
    local = pd.date_range(f"{month}T00:00", periods=N, freq="5min", tz="UTC").tz_convert("Europe/Berlin")
    X = pd.DataFrame({"temperature": temperatures()}, index=local)
    assert len({t.utcoffset() for t in local}) == 2
    assert np.array_equal(steps_of(record_of(X))[1:], np.full(N - 1, 300.0))

    def written(t):
        text = t.strftime("%Y-%m-%dT%H:%M:%S%z")  # ...+0200; PostgreSQL writes +02, ISO 8601 knows all three
        return {"+0100": text, "+01:00": f"{text[:-2]}:{text[-2:]}", "+01": text[:-2]}[offset]

    text = record_of(X.assign(when=[written(t) for t in local]), time="when")
    assert text.times.kind == "datetime with time zone"
    assert text.stamp(0) == local[0].as_unit("ns").value
    assert np.array_equal(steps_of(text)[1:], np.full(N - 1, 300.0))


def test_local_times_without_a_zone_that_step_back_are_refused_with_the_reason():
    local = pd.date_range("2024-10-27T00:00", periods=N, freq="5min", tz="UTC").tz_convert("Europe/Berlin")
    with pytest.raises(RecordError, match=r"Time goes backward at row 12: .*summer time ends"):
        record_of(pd.DataFrame({"temperature": temperatures()}, index=local.tz_localize(None)))


@pytest.mark.parametrize(
    ("times", "said"),
    [
        (np.repeat(np.arange(N // 2), 2), "rows 0 and 1; every time stands there twice. Drop every second row, or"),
        (np.delete(np.repeat(np.arange(N), 2), 0)[:N], "rows 1 and 2, and 28 more like these. Drop one of each, or"),
        ([0, *range(N - 1)], "rows 0 and 1. Drop one of them, or"),
    ],
)
@pytest.mark.parametrize("column", ["when", None])
def test_of_times_that_come_twice_it_is_said_how_many_do(times, said, column):
    times = DATES[0] + pd.to_timedelta(np.asarray(times), unit="min")
    X = pd.DataFrame({"temperature": temperatures()}, index=times).rename_axis("when")
    with pytest.raises(RecordError, match=said) as refused:
        record_of(X.reset_index() if column else X, **({"time": column} if column else {}))
    stamps = "X['when']" if column else "X.index"
    assert f"keep = ~{stamps}.duplicated()" in str(refused.value)


def test_same_time_twice_and_missing_times_are_refused_by_row():
    X = pd.DataFrame({"temperature": temperatures(), "when": 15.0 * np.arange(N)})
    X.loc[7, "when"] = X.loc[6, "when"]
    with pytest.raises(RecordError, match=r"same time 0 days 00:01:30: rows 6 and 7"):
        record_of(X.assign(when=pd.to_timedelta(X["when"], unit="s")), time="when")
    with pytest.raises(RecordError, match=r"same time 90 s: rows 6 and 7"):
        record_of(X, time="when")
    texts = DATES.map(lambda t: t.isoformat())
    for times in (X["when"], pd.Series(texts), pd.Series(texts + "Z")):
        with pytest.raises(RecordError, match=r"no time in 1 of 60 rows, the first is row 7"):
            record_of(X.assign(when=times.where(times.index != 7)), time="when")


@pytest.mark.parametrize("unit", ["s", "ns"])
@pytest.mark.parametrize("index", [DATES, DATES - DATES[0]], ids=["dates", "spans"])
def test_an_index_without_a_time_in_a_row_is_refused_by_row(index, unit):
    index = index.as_unit(unit)
    X = pd.DataFrame({"temperature": temperatures()}, index=index.where(np.arange(N) != 7))
    with pytest.raises(RecordError, match=r"no time in 1 of 60 rows, the first is row 7"):
        record_of(X)


@pytest.mark.parametrize("form", ["column", "index"])
@pytest.mark.parametrize("zone", [None, "Europe/Berlin"])
def test_dates_and_spans_may_be_as_late_as_2170(form, zone):
    dates = pd.date_range("2169-12-31T21:00", periods=N, freq="1min", unit="us", tz=zone)

    def given(dates):
        X = pd.DataFrame({"temperature": temperatures()}, index=dates)
        return record_of(X) if form == "index" else record_of(X.reset_index(names="when"), time="when")

    for times in (dates, (dates.tz_localize(None) - pd.Timestamp("1970-01-01").as_unit("us"))):
        assert given(times).stamp(N - 1) == times[-1].as_unit("ns").value
    with pytest.raises(RecordError, match=r"2170-01-01T\d\d:00:00 in row 0. Times may lie between"):
        given(dates + pd.Timedelta(days=1))


@pytest.mark.parametrize("chunk", [1, 7, N // 2, N - 1, N, N + 1])
@pytest.mark.parametrize("runs", [False, True])
def test_a_record_that_is_looked_at_in_pieces_is_the_same(chunk, runs, monkeypatch):
    """Steps reach over the pieces' ends, and no piece is empty."""
    gaps = np.where(np.isin(np.arange(N), [20, 30, 31, N - 1]), 3600.0, 15.0)
    X = pd.DataFrame({"temperature": temperatures(), "t": np.cumsum(gaps), "run": np.arange(N) % 2 if runs else 0})
    X.loc[[7, 29, 40], "temperature"] = np.nan
    layout = {"time": "t", "max_gap": 60.0, "run": "run" if runs else None}
    whole = record_of(X, **layout)
    monkeypatch.setattr(read, "_CHUNK", chunk)
    pieces = record_of(X, **layout)
    assert spans(pieces) == spans(whole) and len(spans(whole)) > 4
    assert np.array_equal(pieces.skipped, whole.skipped) and len(whole.skipped) > 1
    X.loc[N // 2, "t"] = X.loc[N // 2 - 1 - runs, "t"]
    with pytest.raises(RecordError, match=f"same time.*rows {N // 2 - 1 - runs} and {N // 2}"):
        record_of(X, **layout)


def test_the_usual_step_is_one_between_rows_that_are_used():
    T = pd.Series(temperatures()).where(np.arange(N) % 2 == 1)
    X = pd.DataFrame({"temperature": T.to_numpy()}, index=DATES)
    step = (DATES[1] - DATES[0]).total_seconds()
    record = record_of(X)
    assert len(record.segments) == 1 and record.usual_step() == 2 * step
    alone = record_of(X, max_gap=1.5 * step)
    assert len(alone.segments) == N // 2 and alone.usual_step() == 1.0


def test_rows_without_times_may_be_taken_in_any_order():
    times = Times(9, "rows", period=15.0)
    np.testing.assert_array_equal(times.steps(np.array([1, 2, 8])), [15.0, 15.0, 90.0])
    np.testing.assert_array_equal(times.steps(slice(1, 4)), [15.0, 15.0, 15.0])


@pytest.mark.parametrize("role", ["time", "run", "temperature"])
def test_name_that_stands_over_two_columns_is_refused(role):
    X = pd.DataFrame({"temperature": temperatures(), "time": np.arange(N), "run": 1})
    with pytest.raises(RecordError, match="unique names"):
        record_of(pd.concat((X, X[[role]]), axis=1), time="time", run="run")


def with_gap(n=N):
    return np.cumsum(np.r_[0.0, np.full(19, 10.0), 500.0, np.full(n - 21, 12.5)])


@pytest.mark.parametrize(("usual_steps", "noted"), [(9.9, False), (10.1, True)])
def test_a_step_of_more_than_ten_usual_ones_is_worth_a_note(usual_steps, noted):
    steps = np.where(np.arange(N) == 20, 15.0 * usual_steps, 15.0)
    record = record_of(pd.DataFrame({"temperature": temperatures(), "t": np.cumsum(steps)}), time="t")
    assert any("Sampling has 1 gap" in note for note in record.notes) == noted


@pytest.mark.parametrize("max_gap", [60, "1 min", 499.9, 500, None])
def test_gap_longer_than_max_gap_starts_a_segment_and_a_shorter_one_is_a_long_step(max_gap):
    record = record_of(pd.DataFrame({"temperature": temperatures(), "t": with_gap()}), time="t", max_gap=max_gap)
    elapsed = np.concatenate([block.elapsed for block in record.blocks(size=9)])
    if max_gap in (500, None):
        assert spans(record) == [(0, N)]
        assert np.array_equal(elapsed, with_gap())
        assert np.array_equal(steps_of(record)[1:], np.diff(with_gap()))
    else:
        assert spans(record) == [(0, 20), (20, N)]
        assert np.array_equal(elapsed, np.r_[10.0 * np.arange(20), 12.5 * np.arange(N - 20)])
    assert ("1 gap, the first after row 19 (500 s" in " ".join(record.notes)) == (max_gap is None)


def test_rows_that_lack_a_needed_value_are_passed_over():
    T, y = temperatures(), np.arange(N, dtype=float)
    T[[0, 10, 11, N - 1]], y[30:40] = np.nan, np.nan
    X = pd.DataFrame({"temperature": T, "humidity": 40.0, "note": 1.0})
    X.loc[20, "humidity"] = X.loc[25, "note"] = np.nan  # the note is not needed, but humidity is
    assert read_record(X, Layout(), needed=["humidity"], quiet=True).skipped.tolist() == [10, 11, 20]
    record = record_of(X, y=y, sampling_period=1.0)
    assert spans(record) == [(1, N - 1)] and record.skipped.tolist() == [10, 11]
    assert record.n_used == N - 4
    for max_gap, segments in ((3.0, [(1, N - 1)]), (2.9, [(1, 10), (12, N - 1)])):
        cut = record_of(X, y=y, sampling_period=1.0, max_gap=max_gap)
        assert spans(cut) == segments and cut.n_used == N - 4
    assert record.reading is not None
    assert np.array_equal(record.reading, y, equal_nan=True)
    assert record.notes[0].startswith(
        "4 rows of 60 have a missing value, the first is row 0 ('temperature'). They are passed over as if they had "
        "not been recorded: temperature is taken as a straight line across, for 3 s at most. "
    )
    with pytest.raises(RecordError, match="No row has a number in 'temperature': all 60 values are missing"):
        record_of(X * np.nan)


def test_runs_are_segments_and_gaps_and_missing_values_cut_them_further():
    T = temperatures()
    T[[45, *range(50, 55)]] = np.nan
    X = pd.DataFrame({"temperature": T, "run": ["a"] * 20 + ["b"] * 20 + ["c"] * 20, "t": np.tile(np.arange(20.0), 3)})
    X.loc[30:39, "t"] += 100.0
    record = record_of(X, run="run", time="t", max_gap=5)
    assert spans(record) == [(0, 20), (20, 30), (30, 40), (40, 50), (55, 60)] and record.skipped.tolist() == [45]
    assert [segment.run for segment in record.segments] == list("abbcc")
    X.loc[[19, 20, 39, 40], "temperature"] = np.nan  # no segment begins or ends with one, and none reaches over runs
    record = record_of(X, run="run", time="t", max_gap=5)
    assert spans(record) == [(0, 19), (21, 30), (30, 39), (41, 50), (55, 60)]


@pytest.mark.parametrize("max_gap", [None, 30.0])
def test_where_every_row_is_a_run_no_step_is_usual_and_none_is_a_gap(max_gap):
    X = pd.DataFrame({"temperature": temperatures(), "run": np.arange(N), "t": 15.0 * np.arange(N) ** 2})
    record = record_of(X, run="run", time="t", max_gap=max_gap)
    assert spans(record) == [(k, k + 1) for k in range(N)] and record.notes == ()


def test_runs_of_an_array_are_a_column_by_its_number():
    X = pd.DataFrame({"temperature": temperatures(), "run": np.repeat([3.0, 1.0, 2.0], 20)})
    for run in (1, np.int64(1)):
        record = record_of(X.to_numpy(), run=run, sampling_period=15.0)
        assert record.segments == record_of(X, run="run", sampling_period=15.0).segments
    assert [(segment.stop, segment.run) for segment in record.segments] == [(20, 3.0), (40, 1.0), (60, 2.0)]


def interleaved():
    """Two runs that were logged at the same time, and each of them alone."""
    rng = np.random.default_rng(4)
    t = np.cumsum(rng.uniform(1.0, 9.0, N))
    X = pd.DataFrame({"temperature": temperatures(), "run": rng.permutation(np.repeat(["b", "a"], N // 2)), "t": t})
    return X, dict(list(X.groupby("run")))


def test_interleaved_runs_are_put_in_order_by_their_times_and_rows_come_back_as_they_came():
    X, alone = interleaved()
    record = record_of(X, run="run", time="t")
    assert [(s.stop - s.start, s.run) for s in record.segments] == [(N // 2, run) for run in X["run"].unique()]
    for key, segment in enumerate(record.segments):
        blocks = [block for block in record.blocks(size=8) if block.segment == key]
        part = alone[segment.run]
        assert np.array_equal(np.concatenate([block.rows for block in blocks]), part.index)
        assert np.array_equal(np.concatenate([block.temperature for block in blocks]), part["temperature"])
        steps = np.concatenate([block.steps for block in blocks])
        assert np.array_equal(steps[1:], np.diff(part["t"]))
    model = DiffusiveFeatures([30.0], run="run", time="t", initial_state="equilibrium", reference_temperature=20.0)
    columns = model.fit_transform(X)
    for part in alone.values():
        assert np.array_equal(columns[part.index], model.fit_transform(part))
    assert np.array_equal(model.fit(X).transform(X), columns)

    with pytest.raises(RecordError, match="interleaved and rows have no times"):
        record_of(X, run="run")
    with pytest.raises(RecordError, match=r"run column 'run' is empty in row 3"):
        record_of(X.assign(run=X["run"].where(X.index != 3)), run="run", time="t")


@pytest.mark.parametrize("size", [1, 7, 64, BLOCK_ROWS])
def test_blocks_cover_every_row_of_the_segments_once(size):
    T, t = temperatures(), np.cumsum(np.random.default_rng(3).uniform(1.0, 20.0, N))
    T[[17, 18, 40]] = np.nan
    before, record = (X := pd.DataFrame({"temperature": T, "t": t})).copy(), record_of(X, time="t")
    blocks = list(record.blocks(size))
    pd.testing.assert_frame_equal(X, before)
    rows = np.concatenate([np.arange(N)[block.rows] for block in blocks])
    assert np.array_equal(rows, np.flatnonzero(np.isfinite(T)))
    assert all(len(block) <= size for block in blocks)
    for block in blocks:
        start, stop, _ = record.segments[block.segment]
        assert start <= block.start < block.stop <= stop
        assert block.begins == (block.start == start)
        known = np.flatnonzero(np.isfinite(T[: block.start]))
        expected = t[block.rows] - np.r_[t[block.start] - 1 if block.begins else t[known[-1]], t[block.rows][:-1]]
        # rtol: only the step of 1 s that stands for "none" is computed here, and rounds
        np.testing.assert_allclose(block.steps, expected, rtol=1e-12)
        assert np.array_equal(block.elapsed, t[block.rows] - t[start])
        assert np.array_equal(block.seconds, t[block.rows] - t[0])
        assert np.array_equal(block.temperature, T[block.rows])


WHOLE = np.arange(N) % 9 + 15
COLUMNS = {
    "int16": WHOLE.astype("int16"),
    "float32": WHOLE.astype("float32"),
    "Float64": pd.array(WHOLE, dtype="Float64"),
    "Int32": pd.array(WHOLE, dtype="Int32"),
    "int64[pyarrow]": pd.array(WHOLE, dtype="int64[pyarrow]"),
    "double[pyarrow]": pd.array(WHOLE, dtype="double[pyarrow]"),
    "objects": np.array(list(WHOLE), dtype=object),
    "text": WHOLE.astype(str),
    "categories": pd.Categorical(WHOLE),
}


@pytest.mark.parametrize("form", COLUMNS)
def test_columns_of_every_form_become_the_same_numbers(form):
    X = pd.DataFrame({"temperature": COLUMNS[form]})
    record = record_of(X, y=X["temperature"])
    block = next(record.blocks())
    assert block.temperature.dtype == np.float64
    assert np.array_equal(block.temperature, WHOLE)
    assert np.array_equal(np.asarray(record.reading, float), WHOLE)
    if form not in ("int16", "float32"):  # the other forms have a mark for missing values
        values = X["temperature"].mask(X.index.isin([4, 50]))
        assert record_of(values.to_frame()).skipped.tolist() == [4, 50]

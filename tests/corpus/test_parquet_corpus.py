"""Parquet files with columns of every type in every role: both readers and `correct` say the same of them."""

import csv
import io
import math

import numpy as np
import pandas as pd
import pytest

from corpus.clean_log import CLEAN, ROWS, frame_of
from thermocorr import DynamicBiasRegressor, RecordError, save_model
from thermocorr.command.cli import main
from thermocorr.effects import Covariate
from thermocorr.records.files import read_table
from thermocorr.records.read import Layout, read_record
from thermocorr.records.times import LATEST


def parquet_of(tmp_path, rows=7, **columns):
    """A log in a Parquet file, columns of Arrow in place of its own: (path, `ParquetLog`)."""
    pa = pytest.importorskip("pyarrow", reason="Parquet needs pyarrow: pip install '.[parquet]'")
    from pyarrow import parquet

    from thermocorr import ParquetLog

    frame = frame_of(CLEAN)
    table = pa.Table.from_pandas(frame, preserve_index=False)
    for name, values in columns.items():
        values = values(pa, frame) if callable(values) else values
        at = table.schema.get_field_index(name)
        table = table.append_column(name, values) if at < 0 else table.set_column(at, name, values)
    parquet.write_table(table, tmp_path / "log.parquet", row_group_size=rows)
    return tmp_path / "log.parquet", ParquetLog(tmp_path / "log.parquet")


def fit_both(path, log, run=None):
    """Coefficients by both readers; an error in the place of those of a reader that refuses."""
    found = []
    for read in (lambda: log, lambda: read_table(path)):
        try:
            X = read()
            model = DynamicBiasRegressor(
                "temperature", [600.0], 1, time="time", run=run, effects=[Covariate("humidity")]
            )
            found.append(model.fit(X, X["reading"]).coef_)
        except (RecordError, TypeError) as error:
            if not isinstance(error, RecordError) and "row 0 holds" not in str(error):
                raise
            found.append(error)
    return found


def both_refuse(path, log, run=None):
    return all(isinstance(found, Exception) for found in fit_both(path, log, run))


@pytest.mark.parametrize("bits", [8, 16, 32, 64])
def test_unsigned_times_that_go_back_are_refused(bits, tmp_path):
    ticks = np.arange(ROWS)
    ticks[[30, 31]] = ticks[[31, 30]]
    path, log = parquet_of(tmp_path, time=lambda pa, frame: pa.array(ticks, getattr(pa, f"uint{bits}")()))
    assert all("backward" in str(found) for found in fit_both(path, log))


NO_NUMBERS_OF_ARROW = {
    "durations": lambda pa, frame: pa.array(range(ROWS), pa.duration("s")),
    "dates with a clock": lambda pa, frame: pa.array(range(ROWS), pa.timestamp("ns")),
    "dates in a zone": lambda pa, frame: pa.array(range(ROWS), pa.timestamp("s", "Europe/Paris")),
    "days": lambda pa, frame: pa.array(range(ROWS), pa.int32()).view(pa.date32()),
    "times of day": lambda pa, frame: pa.array(range(ROWS), pa.time32("s")),
    "true and false": lambda pa, frame: pa.array([k % 2 == 0 for k in range(ROWS)]),
    "lists": lambda pa, frame: pa.array([[float(k)] for k in range(ROWS)]),
    "structs": lambda pa, frame: pa.array([{"a": float(k)} for k in range(ROWS)]),
    "infinity": lambda pa, frame: pa.array([*frame["temperature"][:-1], math.inf]),
    "a number beyond all instruments": lambda pa, frame: pa.array([*frame["temperature"][:-1], 1e160]),
    "nothing": lambda pa, frame: pa.nulls(ROWS),
}


@pytest.mark.parametrize("column", ["temperature", "reading"])
@pytest.mark.parametrize("name", NO_NUMBERS_OF_ARROW)
def test_columns_that_are_no_numbers_are_refused_by_both_readers(name, column, tmp_path):
    assert both_refuse(*parquet_of(tmp_path, **{column: NO_NUMBERS_OF_ARROW[name]}))


LOOKS = ["bytes", "bytes of a dictionary", "true, false and nothing"]


@pytest.mark.parametrize("name", LOOKS)
def test_columns_that_only_look_like_numbers_are_refused_by_both_readers(name, tmp_path):
    columns = {
        "bytes": lambda pa, frame: pa.array([str(value).encode() for value in frame["temperature"]]),
        "true, false and nothing": lambda pa, frame: pa.array([[True, False, None][k % 3] for k in range(ROWS)]),
        "bytes of a dictionary": lambda pa, frame: columns["bytes"](pa, frame).dictionary_encode(),
    }
    assert both_refuse(*parquet_of(tmp_path, temperature=columns[name]))


NUMBERS_OF_ARROW = [
    "int8", "uint8", "int16", "uint16", "int32", "uint32", "int64", "uint64", "float16", "float32", "float64",
]  # fmt: skip


@pytest.mark.parametrize("name", NUMBERS_OF_ARROW)
def test_numbers_of_every_width_are_the_same_for_both_readers_and_for_correct(name, tmp_path, capsys):
    """A number of few bits has a value of its own: that, and not its shortest digits, is corrected."""
    values = (np.arange(ROWS) % 13 * 1.1 + 1).astype(name)
    path, log = parquet_of(tmp_path, temperature=lambda pa, frame: pa.array(values))
    assert np.array_equal(log["temperature"][:], values.astype(float))
    a, b = fit_both(path, log)
    assert np.array_equal(a, b)
    frame = frame_of(CLEAN).assign(temperature=values.astype(float))
    model = DynamicBiasRegressor("temperature", [600.0], 1, time="time")
    model.fit(frame[["time", "temperature"]], frame["reading"])
    assert main(["correct", "--model", str(save_model(model, tmp_path / "m.json")), str(path)]) == 0
    rows = list(csv.DictReader(io.StringIO(capsys.readouterr().out)))
    expected = model.correct(frame[["time", "temperature"]], frame["reading"])
    np.testing.assert_allclose([float(row["corrected"]) for row in rows], expected, rtol=1e-12)


@pytest.mark.parametrize("zone", [None, "UTC", "+05:30"])
def test_dates_are_read_to_the_last_minute_and_no_further(zone, tmp_path):
    """Between 1880 and 2170 no difference wraps; a date of which its zone has none lies beyond."""
    last = [LATEST - 60_000_000_000 * (ROWS - 1 - k) for k in range(ROWS)]
    a, b = fit_both(*parquet_of(tmp_path, time=lambda pa, frame: pa.array(last, pa.timestamp("ns", zone))))
    assert np.array_equal(a, b)
    assert both_refuse(*parquet_of(tmp_path, time=lambda pa, frame: pa.array(LAST_DAY, pa.timestamp("ns", zone))))


FAR = ["the year 8024", "beyond the last day", "spans of 6000 years", "infinity"]


@pytest.mark.parametrize("name", FAR)
def test_times_that_are_none_are_refused_by_both_readers(name, tmp_path):
    seconds = [*range(ROWS - 1), 191_065_305_600]
    columns = {
        "infinity": lambda pa, frame: pa.array([*map(float, range(ROWS - 1)), math.inf]),
        "the year 8024": lambda pa, frame: pa.array(seconds, pa.timestamp("s")),
        "beyond the last day": lambda pa, frame: pa.array([*range(ROWS - 1), 106_752], pa.int32()).view(pa.date32()),
        "spans of 6000 years": lambda pa, frame: pa.array(seconds, pa.duration("s")),
    }
    assert both_refuse(*parquet_of(tmp_path, time=columns[name]))


ALTERNATING = list(range(0, ROWS, 2))
TURNS = [([20], 25), ([17], None), ([17], 25), (ALTERNATING, None), (ALTERNATING, 25)]


@pytest.mark.parametrize(("odd", "hole"), [([20], None), *TURNS])
def test_runs_that_take_turns_over_row_groups(odd, hole, tmp_path):
    run = ["b" if k in odd else "a" for k in range(ROWS)]
    temperature = [None if k == hole else float(row[1]) for k, row in enumerate(CLEAN)]
    columns = {"run": lambda pa, frame: pa.array(run), "temperature": lambda pa, frame: pa.array(temperature)}
    a, b = fit_both(*parquet_of(tmp_path, **columns), run="run")
    assert not isinstance(a, RecordError), a
    assert np.array_equal(a, b)


LABELS = {
    "lists": lambda pa, frame: pa.array([[float(k > 30)] for k in range(ROWS)]),
    "structs": lambda pa, frame: pa.array([{"a": k > 30} for k in range(ROWS)]),
    "bytes": lambda pa, frame: pa.array([b"ab"[k > 30 :][:1] for k in range(ROWS)]),
    "times of day": lambda pa, frame: pa.array([int(k > 30) for k in range(ROWS)], pa.time32("s")),
}


@pytest.mark.parametrize("name", LABELS)
def test_labels_that_are_none_are_refused_by_both_readers(name, tmp_path):
    assert both_refuse(*parquet_of(tmp_path, run=LABELS[name]), run="run")


FAR_LABELS = {
    "a day before the last, in a zone": (9_223_372_036, "s", "Europe/Paris"),
    "the first, in a zone": (-9_223_372_036, "s", "Europe/Paris"),
    "the year 1, in a zone": (-62_135_596_800, "s", "Europe/Paris"),
    "the year 9999, in a zone": (253_402_300_799, "s", "+05:30"),
    "the year 8024": (191_065_305_600_000_000, "us", None),
    "the last nanosecond, in a zone": ((1 << 63) - 1, "ns", "Europe/Paris"),
}


@pytest.mark.parametrize("name", [*FAR_LABELS, "a span of 6000 years"])
def test_dates_out_of_reach_label_no_run(name, tmp_path, capsys):
    """No file could keep them, nor another zone show them."""
    tick, unit, zone = FAR_LABELS.get(name, (191_065_305_600, "s", None))
    column = [0] * 30 + [tick] * (ROWS - 30)
    path, log = parquet_of(
        tmp_path,
        run=lambda pa, frame: pa.array(column, pa.timestamp(unit, zone) if name in FAR_LABELS else pa.duration("s")),
    )
    assert both_refuse(path, log, run="run")
    assert main(["analyze", str(path), "--reading", "reading", "--run", "run", "--time-constants", "10min"]) == 2
    said = capsys.readouterr().err.splitlines()[-1]
    assert said.startswith("thermocorr: error: The run column 'run' is ") and "in row 30. Times may lie" in said


def test_days_out_of_reach_label_no_run(tmp_path):
    """One reader has days of Python, the other those of numpy."""
    days = [0] * 30 + [106_752] * (ROWS - 30)
    assert both_refuse(
        *parquet_of(tmp_path, run=lambda pa, frame: pa.array(days, pa.int32()).view(pa.date32())), run="run"
    )


@pytest.mark.parametrize("kind", ["timestamp", "timestamp in a zone", "days", "span"])
def test_labels_that_pandas_cannot_hand_over_are_out_of_reach(kind):
    """A frame whose columns are those of Arrow: Python has no such date."""
    pa = pytest.importorskip("pyarrow", reason="labels of Arrow")
    ticks = pa.array([0, 0, 86_400_000 << 35, 86_400_000 << 35], pa.int64())
    kinds = {"timestamp": pa.timestamp("s"), "timestamp in a zone": pa.timestamp("us", "UTC"), "days": pa.date64()}
    labels = pd.arrays.ArrowExtensionArray(ticks.view(kinds.get(kind, pa.duration("s"))))
    X = pd.DataFrame({"temperature": [1.0, 2.0, 3.0, 4.0], "run": labels})
    with pytest.raises(RecordError, match=r"column 'run' holds dates out of reach\. Times may lie between"):
        read_record(X, Layout("temperature", run="run", sampling_period=1.0))


@pytest.mark.parametrize("kind", ["duration", "timestamp"])
@pytest.mark.parametrize("ends", [(0, -(2**63) + 1), (2**63 - 1, -(2**63) + 1), (-(2**63) + 1, 2**63 - 1)])
def test_steps_that_no_integer_holds(kind, ends, tmp_path):
    """Backward by so much that the difference would be forward; or more years than a clock has since the start."""
    low = ends[0] - ROWS if ends[0] > 0 else ends[0]
    ticks = [*(low + k for k in range(ROWS - 1)), ends[1]]
    column = lambda pa, frame: pa.array(ticks, getattr(pa, kind)("ns"))  # noqa: E731
    assert both_refuse(*parquet_of(tmp_path, time=column))


LAST_DAY = [s * 10**9 for s in (*range(ROWS - 1), 9_223_372_036)]


def test_a_date_that_its_zone_cannot_show_ends_analyze_in_a_sentence(tmp_path, capsys):
    """In a column that is not used."""
    path, _ = parquet_of(tmp_path, humidity=lambda pa, frame: pa.array(LAST_DAY, pa.timestamp("ns", "Europe/Paris")))
    options = ["--reading", "reading", "--time-constants", "10min", "--out", str(tmp_path / "out")]
    assert main(["analyze", str(path), *options]) == 2
    assert "The results cannot be written" in capsys.readouterr().err.splitlines()[-1]
    assert list((tmp_path / "out").iterdir()) == []


@pytest.mark.parametrize("value", [1e300, -1e41])
def test_seconds_that_no_clock_shows_are_no_times(value, tmp_path):
    seconds = [*map(float, range(ROWS))]
    seconds[0 if value < 0 else -1] = value
    assert both_refuse(*parquet_of(tmp_path, time=lambda pa, frame: pa.array(seconds)))


@pytest.mark.parametrize("value", [2**53 + 1, 2**63 - 1])
def test_large_integers_are_the_nearest_float_for_both_readers(value, tmp_path):
    values = [*range(ROWS - 1), value]
    path, log = parquet_of(tmp_path, humidity=lambda pa, frame: pa.array(values, pa.int64()))
    assert log["humidity"][ROWS - 1] == float(value)
    assert not any(isinstance(found, RecordError) for found in fit_both(path, log))

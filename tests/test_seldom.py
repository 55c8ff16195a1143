"""What seldom happens at the doors: systems that refuse, types at their edges, samples far beyond the fit."""

from __future__ import annotations

import errno
import json
import math
import os
import shutil
import sys
import threading
from datetime import datetime
from decimal import Decimal

import numpy as np
import pandas as pd
import pytest
from streams import one_by_one, stream

from thermocorr import DynamicBiasRegressor, OnlineCorrector, ParquetLog, RecordError, RecordWarning, save_model
from thermocorr.command import cli, lines, results
from thermocorr.command.stopping import StopSignal
from thermocorr.files import AppendedFile, OutputError, Outputs, drafts, write_file
from thermocorr.files.marks import TEXT_MARK
from thermocorr.records import Layout, files, read_record
from thermocorr.records.files import read_table
from thermocorr.records.numbers import as_numbers
from thermocorr.records.times import Times

OURS = f"{TEXT_MARK}\nold\n"


def refusing(number=errno.EACCES):
    """A function of the system that refuses."""

    def refuse(*_, **__):
        raise OSError(number, os.strerror(number))

    return refuse


# -------------------------------------------------------------------------------------------------- systems that refuse


def test_a_place_without_permission_is_said_before_the_work(tmp_path, monkeypatch):
    monkeypatch.setattr(os, "access", lambda path, mode: False)
    with pytest.raises(OutputError, match=r"f\.txt cannot be written: no permission"), Outputs() as outputs:
        outputs.claim(tmp_path / "f.txt")


def test_a_second_name_that_cannot_be_made_leaves_everything_as_it_was(tmp_path, monkeypatch):
    """A file system without links, and no space for a copy."""
    for name in "ab":
        (tmp_path / name).write_text(OURS)
    monkeypatch.setattr(os, "link", refusing(errno.EPERM))

    def half(source, target):
        shutil.copyfile(source, target)
        refusing(errno.ENOSPC)()

    monkeypatch.setattr(shutil, "copy2", half)
    outputs = Outputs()
    for name in "ab":
        outputs.write(tmp_path / name, "new")
    with pytest.raises(OutputError, match="No space left"):
        outputs.commit()
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == {"a": OURS, "b": OURS}


def test_file_systems_without_locks_give_all_what_they_want(tmp_path, monkeypatch):
    fcntl = pytest.importorskip("fcntl", reason="locks are those of Unix")
    monkeypatch.setattr(fcntl, "flock", refusing(errno.ENOLCK))
    assert drafts.lock(0)
    write_file(tmp_path / "f", "x")
    assert (tmp_path / "f").read_text() == "x"


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() != 0, reason="only root gives files away")
def test_a_file_keeps_its_owner(tmp_path):
    (tmp_path / "f").write_text(OURS)
    os.chown(tmp_path / "f", 1234, 2345)
    write_file(tmp_path / "f", "new")
    found = (tmp_path / "f").stat()
    assert (found.st_uid, found.st_gid) == (1234, 2345) and (tmp_path / "f").read_text() == "new"


def test_results_that_cannot_be_opened_or_brought_to_the_disk_are_said(tmp_path, monkeypatch):
    file = AppendedFile.new(tmp_path / "rows.csv", first=b"head\n")
    at = file.commit()
    with monkeypatch.context() as patched:
        patched.setattr(os, "fsync", refusing(errno.EIO))
        with pytest.raises(OutputError, match=r"rows\.csv cannot be written: Input/output error"):
            file.commit()
    file.close()
    monkeypatch.setattr(os, "open", refusing())
    with pytest.raises(OutputError, match=r"rows\.csv cannot be written: Permission denied"):
        AppendedFile.resumed(tmp_path / "rows.csv", at)


def test_a_reader_of_whole_results_that_has_gone_is_a_broken_pipe(tmp_path):
    """And no sentence of a file that could not be written."""
    reading, writing = os.pipe()
    os.close(reading)
    outputs = Outputs()
    with pytest.raises(BrokenPipeError):
        outputs.write(f"/dev/fd/{writing}", b"x")
    outputs.discard()
    os.close(writing)


# ------------------------------------------------------------------------------------------------------ logs and states


@pytest.fixture(scope="module")
def lab(tmp_path_factory):
    """Folder with a model and the log behind its rows."""
    folder = tmp_path_factory.mktemp("lab")
    X, y = stream(300, 3, holes=False)
    log = X.assign(reading=y, time=X.index.strftime("%Y-%m-%dT%H:%M:%S.%f")).reset_index(drop=True)
    model = DynamicBiasRegressor("temperature", [300.0], time="time")
    save_model(model.fit(log[:200], log["reading"][:200]), folder / "model.json")
    log[200:].to_csv(folder / "log.csv", index=False)
    return folder


def correct(lab, *more):
    return cli.main(["correct", "--model", str(lab / "model.json"), *map(str, more)])


def test_a_log_and_a_state_that_cannot_be_read_are_said(lab, tmp_path, monkeypatch, capsys):
    with monkeypatch.context() as patched:
        patched.setattr(lines, "FileLines", refusing())
        assert correct(lab, lab / "log.csv") == 2
    assert "log.csv cannot be read: Permission denied." in capsys.readouterr().err
    (tmp_path / "state.json").write_text("{}")
    monkeypatch.setattr(results, "read_bytes", refusing())
    assert correct(lab, lab / "log.csv", "--state", tmp_path / "state.json") == 2
    assert "state.json cannot be read: Permission denied. Remove it" in capsys.readouterr().err


@pytest.mark.parametrize("more", [(), ("--follow", "--idle", "0")])
def test_a_reader_that_has_gone_ends_the_command_as_one_of_standard_output_does(more, lab, capsys):
    reading, writing = os.pipe()
    os.close(reading)
    assert correct(lab, lab / "log.csv", "--out", f"/dev/fd/{writing}", *more) == 0
    os.close(writing)
    assert capsys.readouterr().err == ""


def test_a_table_that_cannot_be_read_is_said(lab, monkeypatch):
    with monkeypatch.context() as patched:
        patched.setattr(type(lab), "read_bytes", refusing())
        with pytest.raises(RecordError, match=r"log\.csv cannot be read: Permission denied"):
            read_table(lab / "log.csv")
    monkeypatch.setattr(files, "check_lines", lambda *given: (99, len(given[0])))
    with pytest.raises(RecordError, match="99 lines gave 100 rows"):
        read_table(lab / "log.csv")


def test_parquet_without_its_reader_says_what_to_install(lab, tmp_path, monkeypatch):
    (tmp_path / "log.parquet").write_bytes(b"PAR1")
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(RecordError, match=r"log\.parquet is Parquet.*pip install 'thermocorr\[parquet\]'"):
        read_table(tmp_path / "log.parquet")


def test_a_table_is_not_followed_and_its_rows_stop_where_they_are_told(lab, tmp_path, capsys):
    pytest.importorskip("pyarrow", reason="Parquet needs pyarrow: pip install 'thermocorr[parquet]'")
    pd.read_csv(lab / "log.csv").to_parquet(tmp_path / "log.parquet")
    assert correct(lab, tmp_path / "log.parquet", "--follow") == 2
    assert "is Parquet, which cannot be followed while it grows. Leave out --follow." in capsys.readouterr().err
    stop = StopSignal()
    rows = iter(lines.TableLines(tmp_path / "log.parquet", stop))
    assert next(rows).startswith(b"temperature,") and next(rows).count(b",") >= 2
    stop.number = 15
    assert list(rows) == []


def test_a_followed_log_that_is_being_replaced_is_looked_for_again_later(lab, tmp_path):
    shutil.copy(lab / "log.csv", tmp_path / "log.csv")
    with open(tmp_path / "log.csv", "rb") as file:
        file.read()
        assert not lines._replaced(file, tmp_path / "log.csv")
        (tmp_path / "log.csv").rename(tmp_path / "log.1")
        assert not lines._replaced(file, tmp_path / "log.csv")
        (tmp_path / "log.csv").write_text("new\n")
        assert lines._replaced(file, tmp_path / "log.csv")


def test_a_followed_log_that_is_replaced_by_one_of_other_columns_ends_the_command(lab, tmp_path, capsys):
    content = (lab / "log.csv").read_bytes()
    path = tmp_path / "log.csv"
    path.write_bytes(content)

    def replace():
        (tmp_path / "other.csv").write_bytes(content.replace(b"humidity", b"moisture", 1))
        os.replace(tmp_path / "other.csv", path)

    timer = threading.Timer(0.3, replace)
    timer.start()
    assert correct(lab, path, "--follow", "--idle", "3") == 2
    timer.join()
    assert "goes on in a file with other columns" in capsys.readouterr().err


def test_a_pipe_that_is_idle_ends(lab, capfd):
    reading, writing = os.pipe()
    os.write(writing, (lab / "log.csv").read_bytes()[:2000].rpartition(b"\n")[0] + b"\n")
    assert correct(lab, f"/dev/fd/{reading}", "--follow", "--idle", "0.2") == 0
    os.close(reading)
    os.close(writing)
    assert capfd.readouterr().out.count("\n") > 10


# ------------------------------------------------------------------------------------------------- types at their edges


def test_whole_numbers_beyond_all_floats_are_infinite_and_text_beside_them_is_none():
    with pytest.raises(RecordError, match="infinity in row 1"):
        as_numbers(np.array([1, 10**400, "3"], dtype=object), "It", "temperature")
    with pytest.raises(RecordError, match=r"not a number in row 2: 'warm' \(1 such row"):
        as_numbers(np.array([1, 10**400, "warm", None], dtype=object), "It", "temperature")


def test_bytes_are_no_times():
    X = pd.DataFrame({"temperature": [1.0, 2.0], "t": [b"2024-01-01", b"2024-01-02"]})
    with pytest.raises(RecordError, match="holds a bytes in row 0"):
        read_record(X, Layout("temperature", time="t"))


def test_a_sampling_period_beside_times_is_not_used():
    X = stream(60, 1, holes=False)[0]
    with pytest.warns(RecordWarning, match="times of their own: sampling_period is not used"):
        record = read_record(X, Layout("temperature", sampling_period=7.0))
    assert record.usual_step() == read_record(X, Layout("temperature")).usual_step() != 7.0


def test_a_record_of_more_than_three_centuries_is_refused():
    index = pd.date_range("1700-01-01", "2100-01-01", periods=60, unit="s")
    X = pd.DataFrame({"temperature": np.arange(60.0)}, index=index)
    with pytest.raises(RecordError, match=r"more than 292 years: from 1700-01-01.* in row 0 to 2100-01-01.* in row 59"):
        read_record(X, Layout("temperature"))
    read_record(X[:40], Layout("temperature"))


def test_rows_without_times_are_counted_in_seconds():
    assert Times(5, "rows", period=15.0).label(2) == "30 s"


def test_decimals_of_parquet_are_the_nearest_numbers(tmp_path):
    pa = pytest.importorskip("pyarrow", reason="Parquet needs pyarrow: pip install 'thermocorr[parquet]'")
    from pyarrow import parquet

    values = [Decimal("0.1"), None, Decimal("123456789012345678.90123456789"), Decimal("-7.3")]
    texts = pa.array(["a", "b", "c", "d"])
    table = pa.table({"x": pa.array(values, pa.decimal128(38, 11)), "t": texts})
    parquet.write_table(table, tmp_path / "t.parquet")
    log = ParquetLog(tmp_path / "t.parquet")
    expected = [math.nan if value is None else float(value) for value in values]
    np.testing.assert_array_equal(log["x"][:], expected)
    np.testing.assert_array_equal(as_numbers(read_table(tmp_path / "t.parquet")["x"], "x"), expected)
    assert log["x"].shape == (4,)
    with pytest.raises(RecordError, match=r"column 't' holds string\. Write dates, spans or seconds, not"):
        log.times("t")


# ----------------------------------------------------------------------------------------------------- live corrections


@pytest.mark.parametrize("T", [1e39, -1e39])
def test_a_temperature_whose_powers_are_no_numbers_has_no_result(T):
    X, y = stream(300, 3, holes=False)
    model = DynamicBiasRegressor(time_constants=[300.0], degree=9).fit(X[:200], y[:200])
    X = X.assign(temperature=X["temperature"].where(X.index != X.index[250], T))
    together = OnlineCorrector(model).update_many(X[200:], y[200:])
    single = one_by_one(OnlineCorrector(model), X[200:], y[200:])
    for k, sample in enumerate(single):
        assert (sample.flag, math.isnan(sample.corrected)) == (
            together["flag"].iloc[k], math.isnan(together["corrected"].iloc[k]),
        )  # fmt: skip
    assert (
        single[50].flag == "outside fitted range" and math.isnan(single[50].corrected) and math.isnan(single[50].bias)
    )


@pytest.mark.parametrize("track", [None, "1 h"])
def test_a_block_without_any_temperature_takes_up_its_rows(track):
    """In a record without times: what comes then has the place that it has in one block or sample by sample."""
    X, y = stream(300, 4, holes=False)
    X, y = X[["temperature"]].reset_index(drop=True), y.reset_index(drop=True)
    X.loc[100:104] = math.nan
    model = DynamicBiasRegressor(time_constants=[300.0], sampling_period=60.0).fit(X[:200], y[:200])
    X, y = X[100:], y[100:]
    live, single = OnlineCorrector(model, track=track), OnlineCorrector(model, track=track)
    parts = [live.update_many(X[:3], y[:3]), live.update_many(X[3:], y[3:])]
    together = pd.concat(parts)
    samples = [single.update(None, T, U) for T, U in zip(X["temperature"], y, strict=True)]
    assert parts[0]["flag"].eq("no temperature").all() and parts[0]["corrected"].isna().all()
    assert together["flag"].tolist() == [sample.flag for sample in samples]
    np.testing.assert_allclose(together["corrected"], [sample.corrected for sample in samples], rtol=1e-12)
    assert live.state()["next_row"] == single.state()["next_row"]
    if track is not None:
        np.testing.assert_allclose(together["reference"], [sample.reference for sample in samples], rtol=1e-12)


def test_a_first_row_is_for_records_without_times():
    X, y = stream(200, 5, holes=False)
    model = DynamicBiasRegressor(time_constants=[300.0]).fit(X, y)
    with pytest.raises(ValueError, match="'first_row' parameter is for records without times"):
        OnlineCorrector(model, first_row=3)


@pytest.mark.parametrize(
    ("kind", "bad", "wanted"),
    [
        ("rows", 5, r"None \(the next row\)"),
        ("rows", "2024-01-01", r"None \(the next row\)"),
        ("spans", "soon", "a time span or a number of seconds"),
        ("spans", None, "a time span or a number of seconds"),
        ("spans", [1], "a time span or a number of seconds"),
    ],
)
def test_times_of_no_kind_are_refused(kind, bad, wanted):
    X, y = stream(200, 5, holes=False)
    X = X.reset_index(drop=True) if kind == "rows" else X.set_axis(X.index - X.index[0])
    more = {"sampling_period": 60.0} if kind == "rows" else {}
    live = OnlineCorrector(DynamicBiasRegressor(time_constants=[300.0], **more).fit(X, y.to_numpy()))
    with pytest.raises(RecordError, match=f"A sample's time must be {wanted}"):
        live.update(bad, 23.0, 1.0)


@pytest.mark.parametrize(
    "far",
    [
        datetime(8024, 1, 1), pd.Timestamp("8024-01-01"), np.datetime64("8024-01-01"), "8024-01-01T00:00:00",
        np.datetime64("800024-01-01T00:00:00"),
    ],
    ids=repr,
)  # fmt: skip
def test_dates_that_no_clock_reaches_are_refused_in_a_sentence(far):
    X, y = stream(200, 5, holes=False)
    live = OnlineCorrector(DynamicBiasRegressor(time_constants=[300.0]).fit(X, y))
    with pytest.raises(RecordError, match=r"A sample's time is .*8\d*024-01-01.*\. Times may lie 292 years"):
        live.update(far, 23.0, 1.0)


def test_an_open_stream_without_a_last_time_is_no_state():
    X, y = stream(200, 5, holes=False)
    model = DynamicBiasRegressor(time_constants=[300.0]).fit(X[:150], y[:150])
    live = OnlineCorrector(model)
    live.update_many(X[150:], y[150:])
    state = json.loads(json.dumps(live.state()))
    state["state"]["last"] = None
    with pytest.raises(ValueError, match=r"\.last holds null where a time belongs"):
        OnlineCorrector.from_state(model, state)


def test_rows_between_the_fitted_ones_are_not_taken_for_theirs():
    """A log of another sensor, half a step later: what the model knows of its own rows tells nothing of these."""
    X, y = stream(200, 5, holes=False)
    X = X.set_axis(pd.date_range("2024-01-01", periods=200, freq="60s"))
    y = y.set_axis(X.index)
    model = DynamicBiasRegressor(time_constants=[300.0]).fit(X[:150], y[:150])
    late = X.index + pd.Timedelta("30s")
    found = model.evaluate(X[20:60].set_axis(late[20:60]), y[20:60].set_axis(late[20:60]))
    assert found["flag"].iloc[0] == "washout"
    fresh = model.evaluate(X[20:60].set_axis(late[20:60] - pd.Timedelta("90D")), y[20:60].to_numpy())
    np.testing.assert_allclose(found["corrected"], fresh["corrected"], rtol=1e-12)

"""Signals at the worst places, and logs that come again: nothing torn, nothing lost, nothing twice."""

from __future__ import annotations

import gc
import json
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pandas as pd
import pytest

import thermocorr
import thermocorr.command.correct as correcting
from thermocorr import DynamicBiasRegressor, OnlineCorrector, RecordError, save_model
from thermocorr.command import cli
from thermocorr.command.lines import FileLines
from thermocorr.command.results import Drafted
from thermocorr.command.stopping import StopSignal, Terminated
from thermocorr.datasets import make_record
from thermocorr.files import OutputError, Outputs
from thermocorr.files.drafts import Draft
from thermocorr.files.marks import TEXT_MARK
from thermocorr.files.uninterrupted import uninterrupted

unix = pytest.mark.skipif(not hasattr(os, "fork"), reason="signals and pipes are those of Unix")


@pytest.fixture(scope="module")
def lab(tmp_path_factory):
    """The model's file, and lines of a log behind the fitted rows, the header first."""
    log = make_record(300, seed=5).reset_index()
    log["time"] = log["time"].dt.strftime("%Y-%m-%dT%H:%M:%S")
    model = DynamicBiasRegressor(time="time", time_constants=[600.0]).fit(log[:200], log["reading"][:200])
    path = save_model(model, tmp_path_factory.mktemp("lab") / "model.json")
    return path, log[200:].to_csv(index=False).splitlines(keepends=True)


def piped(lab, lines, *more):
    """`correct` from a pipe that is fed with these lines, and then ends."""
    reading, writing = os.pipe()
    os.write(writing, "".join(lines).encode())
    os.close(writing)
    try:
        return cli.main(["correct", "--model", str(lab[0]), f"/dev/fd/{reading}", "--follow", *map(str, more)])
    finally:
        os.close(reading)


def rows_of(path):
    """Fields of the log in a file of results: those before the results."""
    return [line.rsplit(",", 3)[0] for line in path.read_text().splitlines()[1:]]


def plain(lines):
    return [line.rstrip("\n") for line in lines]


# ---------------------------------------------------------------------------------------------------------- signals


@unix
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_waits_for_the_end_of_the_block(number):
    came, before = [], signal.signal(number, lambda number, frame: came.append(number))
    try:
        with uninterrupted():
            with uninterrupted():
                os.kill(os.getpid(), number)
                time.sleep(0.01)
            assert came == []
        assert came == [number]
        os.kill(os.getpid(), number)
        time.sleep(0.01)
        assert came == [number, number]
    finally:
        signal.signal(number, before)


def test_other_threads_have_no_signals_to_wait_for():
    before, seen = signal.getsignal(signal.SIGINT), []

    def work():
        with uninterrupted():
            seen.append(signal.getsignal(signal.SIGINT))

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert seen == [before]


@unix
def test_an_interrupt_while_a_draft_is_made_leaves_none(tmp_path, monkeypatch):
    opened = Draft._opened

    def interrupted(draft):
        done = opened(draft)
        os.kill(os.getpid(), signal.SIGINT)
        return done

    monkeypatch.setattr(Draft, "_opened", interrupted)
    outputs = Outputs()
    with pytest.raises(KeyboardInterrupt), outputs:
        outputs.write(tmp_path / "a.txt", "new")
    assert list(tmp_path.iterdir()) == []


class Last:
    """Sends a signal where no exception can be raised: while it is destroyed."""

    def __init__(self, number):
        self.number = number

    def __del__(self):
        os.kill(os.getpid(), self.number)
        time.sleep(0.001)


@unix
@pytest.mark.parametrize(("number", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_signal_in_a_destructor_ends_the_command_all_the_same(number, status, lab, monkeypatch, capsys):
    def work(options, say, progress):
        one = Last(number)
        del one
        gc.collect()
        for _ in range(200):
            time.sleep(0.05)

    monkeypatch.setattr(correcting, "run", work)
    hook, handler = sys.unraisablehook, signal.getsignal(signal.SIGTERM)
    assert cli.main(["correct", "--model", str(lab[0])]) == status
    assert capsys.readouterr().err == "thermocorr: stopped\n"
    assert (sys.unraisablehook, signal.getsignal(signal.SIGTERM)) == (hook, handler)


@unix
def test_what_else_cannot_be_raised_is_shown_as_ever(lab, monkeypatch, capsys):
    class Broken:
        def __del__(self):
            raise ValueError("of a destructor")

    def work(options, say, progress):
        Broken()
        gc.collect()

    monkeypatch.setattr(correcting, "run", work)
    shown = []
    monkeypatch.setattr(sys, "unraisablehook", lambda what: shown.append(str(what.exc_value)))
    assert cli.main(["correct", "--model", str(lab[0])]) == 0
    assert shown == ["of a destructor"]


@unix
@pytest.mark.parametrize(("second", "error"), [(signal.SIGINT, KeyboardInterrupt), (signal.SIGTERM, Terminated)])
def test_a_second_signal_interrupts_at_once(second, error):
    with StopSignal() as stop:
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(0.01)
        assert stop.number == signal.SIGTERM
        with pytest.raises(error) as raised:
            signal.raise_signal(second)
    assert error is KeyboardInterrupt or raised.value.code == 143


@unix
def test_a_signal_at_the_last_moment_says_that_all_is_written(lab, tmp_path, monkeypatch, capsys):
    (tmp_path / "log.csv").write_text("".join(lab[1]))
    finish = Drafted.finish

    def late(results, stopped):
        said = finish(results, stopped)
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(0.01)
        return said

    monkeypatch.setattr(Drafted, "finish", late)
    out = tmp_path / "out.csv"
    assert cli.main(["correct", "--model", str(lab[0]), str(tmp_path / "log.csv"), "--out", str(out)]) == 143
    assert capsys.readouterr().err == f"thermocorr: stopped after row 100, {out} is written\n"
    assert len(rows_of(out)) == 100


# ------------------------------------------------------------------------------------------------- lines being written


def test_a_line_that_is_being_written_is_not_complained_of_when_the_command_stops(tmp_path, monkeypatch):
    monkeypatch.setattr("thermocorr.command.lines.POLL", 0.001)
    (tmp_path / "log.csv").write_bytes(b"a\nb\nhal")
    stop = StopSignal()
    source = FileLines(tmp_path / "log.csv", True, None, stop)
    lines = iter(source)
    assert [next(lines), next(lines), next(lines)] == [b"a\n", b"b\n", None] and source.rest == b"hal"
    stop.number = signal.SIGTERM
    assert list(lines) == [] and source.rest == b""  # the next run reads it whole
    source.close()


def test_a_torn_last_line_is_counted_once(lab, tmp_path, capsys):
    """It is read again, whole, where the state goes on: lines keep their numbers."""
    path, torn = tmp_path / "log.csv", lab[1][11]
    path.write_text("".join(lab[1][:11]) + torn[:-4])
    command = [
        "correct",
        "--model",
        str(lab[0]),
        str(path),
        "--follow",
        "--idle",
        "0",
        "--out",
        str(tmp_path / "o.csv"),
    ]
    command += ["--state", str(tmp_path / "state.json")]
    assert cli.main(command) == 1
    assert "line 12 is left out: it has no line end" in capsys.readouterr().err
    path.write_text("".join(lab[1][:13]) + "no row\n")
    assert cli.main(command) == 1
    assert "line 14 is left out: it has 1 field" in capsys.readouterr().err
    assert rows_of(tmp_path / "o.csv") == plain(lab[1][1:13])


# ----------------------------------------------------------------------------------------------- logs that come again


def back(line):
    """The row with a year that damages its time."""
    return "1924" + line[4:]


@unix
@pytest.mark.parametrize("time", ["of long ago", "of a row before"])
def test_a_row_with_a_false_time_is_no_row_that_was_there_before(time, lab, tmp_path, capsys):
    """The rest of a pipe begins with a row whose time lies before: it is a new one, and flagged."""
    head, *rows = lab[1]
    false = back(rows[20]) if time == "of long ago" else rows[3][:19] + rows[20][19:]
    options = ("--state", tmp_path / "state.json", "--out", tmp_path / "out.csv")
    assert piped(lab, [head, *rows[:20]], *options) == 0
    assert piped(lab, [head, false, *rows[21:30]], *options) == 1
    said = capsys.readouterr().err
    assert "were corrected before" not in said and "1 backward time" in said
    assert rows_of(tmp_path / "out.csv") == plain([*rows[:20], false, *rows[21:30]])


@unix
@pytest.mark.parametrize("start", [0, 7, 19])
def test_rows_that_come_again_are_passed_over_as_long_as_they_are_the_same(start, lab, tmp_path, capsys):
    head, *rows = lab[1]
    rows[9] = back(rows[9])
    options = ("--state", tmp_path / "state.json", "--out", tmp_path / "out.csv")
    assert piped(lab, [head, *rows[:20]], *options) == 1
    piped(lab, [head, *rows[start:40]], *options)
    assert f"{20 - start} lines were corrected before" in capsys.readouterr().err
    assert rows_of(tmp_path / "out.csv") == plain(rows[:40])


@unix
def test_rows_in_another_order_are_not_the_same_ones(lab, tmp_path):
    head, *rows = lab[1]
    options = ("--state", tmp_path / "state.json", "--out", tmp_path / "out.csv")
    assert piped(lab, [head, *rows[:20]], *options) == 0
    again = [rows[5], rows[7], rows[6], rows[20]]
    assert piped(lab, [head, *again], *options) == 1
    assert rows_of(tmp_path / "out.csv") == plain([*rows[:20], *again[1:]])  # the first one is the same


@unix
def test_a_file_of_results_that_began_later_leaves_it_to_the_times(lab, tmp_path, capsys):
    """It does not hold the rows that the state has seen: those before its last time are passed over."""
    head, *rows = lab[1]
    state, out = tmp_path / "state.json", tmp_path / "out.csv"
    assert piped(lab, [head, *rows[:20]], "--state", state, "--out", tmp_path / "first.csv") == 0
    assert piped(lab, [head, *rows[20:30]], "--state", state, "--out", out) == 0
    capsys.readouterr()
    assert piped(lab, [head, *rows[:40]], "--state", state, "--out", out) == 0
    assert "30 lines were corrected before" in capsys.readouterr().err
    assert rows_of(out) == plain(rows[20:40])


def test_a_file_that_grows_goes_on_with_a_false_time(lab, tmp_path, capsys):
    """It stands where the state was saved: its next row is new, whatever its time."""
    head, *rows = lab[1]
    path, out = tmp_path / "log.csv", tmp_path / "out.csv"
    command = ["correct", "--model", str(lab[0]), str(path), "--state", str(tmp_path / "s.json"), "--out", str(out)]
    path.write_text("".join([head, *rows[:20]]))
    assert cli.main(command) == 0
    path.write_text("".join([head, *rows[:20], back(rows[20]), *rows[21:30]]))
    assert cli.main(command) == 1
    assert "20 lines were corrected before" in capsys.readouterr().err
    assert rows_of(out) == plain([*rows[:20], back(rows[20]), *rows[21:30]])


def test_a_state_that_was_saved_without_a_file_of_results(lab, tmp_path, capsys):
    """Rows that were printed could come twice in a file that is there: it is begun anew, by force only."""
    path, out = tmp_path / "log.csv", tmp_path / "out.csv"
    command = ["correct", "--model", str(lab[0]), str(path), "--state", str(tmp_path / "s.json")]
    path.write_text("".join(lab[1][:21]))
    assert cli.main(command) == 0
    assert cli.main([*command[:4], "--out", str(out)]) == 0
    before = out.read_text()
    path.write_text("".join(lab[1][:31]))
    capsys.readouterr()
    assert cli.main([*command, "--out", str(out)]) == 2
    assert "was saved without it: rows could come twice" in capsys.readouterr().err
    assert out.read_text() == before
    assert cli.main([*command, "--out", str(out), "--force"]) == 0
    assert rows_of(out) == plain(lab[1][21:31])


def test_bad_lines_beyond_twenty_are_counted_only(lab, tmp_path, capsys):
    (tmp_path / "log.csv").write_text("".join([*lab[1][:5], *["no row\n"] * 30, *lab[1][5:10]]))
    assert cli.main(["correct", "--model", str(lab[0]), str(tmp_path / "log.csv")]) == 1
    said = capsys.readouterr().err.splitlines()
    assert len(said) == 22 and said[19].startswith("thermocorr: line 25 is left out")
    assert said[20:] == [
        "thermocorr: further lines that are left out are counted only",
        "thermocorr: 30 of 39 lines got no result: 30 lines left out",
    ]


def test_a_log_with_other_columns_does_not_go_on_in_the_file_of_results(lab, tmp_path, capsys):
    frame = pd.DataFrame(
        [line.rstrip("\n").split(",") for line in lab[1][1:]], columns=lab[1][0].rstrip("\n").split(",")
    )
    frame[:20].to_csv(tmp_path / "a.csv", index=False)
    frame[20:].assign(note="x").to_csv(tmp_path / "b.csv", index=False)
    command = [
        "correct",
        "--model",
        str(lab[0]),
        "--state",
        str(tmp_path / "s.json"),
        "--out",
        str(tmp_path / "out.csv"),
    ]
    assert cli.main([*command, str(tmp_path / "a.csv")]) == 0
    before = (tmp_path / "out.csv").read_bytes(), (tmp_path / "s.json").read_bytes()
    assert cli.main([*command, str(tmp_path / "b.csv")]) == 2
    assert "out.csv has other columns than the results of this log" in capsys.readouterr().err
    assert ((tmp_path / "out.csv").read_bytes(), (tmp_path / "s.json").read_bytes()) == before


# ------------------------------------------------------------------------------------------------------- full disks


def no_links(*given, **named):
    raise PermissionError(1, "Operation not permitted")


@pytest.mark.parametrize("failing", ["a.txt", "b.txt"])
def test_a_disk_that_is_full_when_the_old_files_are_kept(failing, tmp_path, monkeypatch):
    """A file system without links: the copies that would bring the old files back need space too."""
    for name in ("a.txt", "b.txt"):
        (tmp_path / name).write_text(f"{TEXT_MARK}\nold {name}\n")
    copy = shutil.copy2

    def half(source, target):
        if Path(source).name == failing:
            Path(target).write_text("hal")
            raise OSError(28, "No space left on device")
        copy(source, target)

    monkeypatch.setattr(os, "link", no_links)
    monkeypatch.setattr(shutil, "copy2", half)
    outputs = Outputs()
    for name in ("a.txt", "b.txt"):
        outputs.write(tmp_path / name, "new")
    with pytest.raises(OutputError, match=f"{failing} cannot be written: No space left"):
        outputs.commit()
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == {
        name: f"{TEXT_MARK}\nold {name}\n" for name in ("a.txt", "b.txt")
    }
    monkeypatch.undo()
    monkeypatch.setattr(os, "link", no_links)
    with Outputs() as outputs:
        for name in ("a.txt", "b.txt"):
            outputs.write(tmp_path / name, f"{TEXT_MARK}\nnew")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.txt", "b.txt"]
    assert (tmp_path / "b.txt").read_text() == f"{TEXT_MARK}\nnew"


@unix
def test_what_a_killed_process_kept_is_removed_when_it_is_old(tmp_path, monkeypatch):
    """Another process may be at work that keeps its own."""
    kept, foreign = tmp_path / f".a.txt.{'0' * 16}.before", tmp_path / f".b.txt.{'0' * 16}.before"
    for path in (kept, foreign):
        path.write_text("old")
    Draft(tmp_path / "a.txt").close()
    assert kept.exists()
    monkeypatch.setattr("thermocorr.files.drafts._OLD", 0.0)
    Draft(tmp_path / "a.txt").close()
    assert not kept.exists() and foreign.exists()


@unix
def test_sigterm_at_every_moment_of_a_start_is_quiet(lab, tmp_path):
    """Moments between the first import and the first row: nothing but the promised words."""
    environment = {**os.environ, "PYTHONPATH": str(Path(thermocorr.__file__).parents[1]), "OMP_NUM_THREADS": "1"}
    command = [sys.executable, "-m", "thermocorr", "correct", "--model", str(lab[0]), "-", "--follow"]
    for k in range(6):
        with subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE, env=environment) as process:
            time.sleep(0.2 * k)
            process.terminate()
            said = process.stderr.read().decode()
            assert (process.wait(30), said) in [
                (-15, ""), (143, "thermocorr: stopped\n"),
                (143, "thermocorr: stopped before the first line; nothing was written\n"),
            ]  # fmt: skip


def test_the_words_for_a_signal_need_no_import():
    """It may have come in the middle of one, whose half would be imported again."""
    code = "import sys; from thermocorr.command import cli; cli._ended('stopped', 143); print('pandas' in sys.modules)"
    environment = {**os.environ, "PYTHONPATH": str(Path(thermocorr.__file__).parents[1])}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=environment)
    assert (done.stdout, done.stderr) == ("False\n", "thermocorr: stopped\n")


def test_a_state_holds_every_label_of_a_run_that_a_stream_takes(lab):
    log = make_record(60, seed=5).reset_index()
    labels = pd.to_datetime(pd.Series(["1850-06-01T12:00", "1850-06-02T12:00"])).dt.tz_localize("Europe/Paris")
    X = log[["time", "temperature"]].assign(run=labels.take([int(k > 30) for k in range(60)]).to_numpy(dtype=object))
    model = DynamicBiasRegressor(time="time", time_constants=[600.0], run="run").fit(X, log["reading"])
    live = OnlineCorrector(model)
    live.update_many(X, log["reading"])
    again = OnlineCorrector.from_state(model, json.loads(json.dumps(live.state())))
    assert again.state() == live.state()
    far = pd.Timestamp("9999-12-31").as_unit("us")
    for update in (lambda: live.update(X["time"][59], 20.0, 1.0, run=far), lambda: live.update_many(X.assign(run=far))):
        with pytest.raises(RecordError, match=r"9999-12-31.* Times may lie 292 years from 1970 at most"):
            update()

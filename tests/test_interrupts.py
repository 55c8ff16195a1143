"""Signals at the worst places, lines being written, full disks: nothing torn, nothing left behind."""

import gc
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from importlib import import_module
from pathlib import Path

import pytest
from log_lines import model_and_lines, plain, rows_of

import thermocorr
import thermocorr.command.correct as correcting
from thermocorr.__main__ import start
from thermocorr.command import cli
from thermocorr.command.correct import Drafted
from thermocorr.command.lines import FileLines, open_lines
from thermocorr.command.stopping import Endings, StopSignal, Terminated
from thermocorr.files import OutputError, Outputs
from thermocorr.files.writer import TEXT_MARK, Draft, uninterrupted

pytestmark = pytest.mark.newest

unix = pytest.mark.skipif(not hasattr(os, "fork"), reason="signals and pipes are those of Unix")


@pytest.fixture(autouse=True)
def interrupts():
    """Interrupts are raised, also where the tests run in the background, which ignores them."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.fixture(scope="module")
def lab(tmp_path_factory):
    return model_and_lines(tmp_path_factory.mktemp("lab"))


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


def test_a_handler_that_is_not_of_python_stays(monkeypatch):
    """Python cannot name a handler that the process has from elsewhere, so it could not bring it back."""
    changed = []
    monkeypatch.setattr(signal, "getsignal", lambda number: None)
    monkeypatch.setattr(signal, "signal", lambda *given: changed.append(given))
    with uninterrupted():
        pass
    assert changed == []


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


@unix
@pytest.mark.parametrize("swept", [False, True])
def test_a_draft_that_cannot_resemble_its_target_leaves_nothing(swept, tmp_path, monkeypatch):
    """Another process may have swept it away in the meantime."""

    def interrupted(descriptor, target):
        for path in tmp_path.iterdir() if swept else ():
            path.unlink()
        raise KeyboardInterrupt

    monkeypatch.setattr("thermocorr.files.writer._resemble", interrupted)
    before = len(os.listdir("/dev/fd"))
    with pytest.raises(KeyboardInterrupt):
        Draft(tmp_path / "a.txt")
    assert list(tmp_path.iterdir()) == [] and len(os.listdir("/dev/fd")) == before


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
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_in_a_destructor_does_not_come_again_when_the_command_has_ended(number, monkeypatch):
    monkeypatch.setattr("thermocorr.command.stopping.AGAIN", 0.2)
    with Endings():
        one = Last(number)
        del one
    came = []
    before = signal.signal(number, lambda *given: came.append(given[0]))
    time.sleep(0.4)
    signal.signal(number, before)
    assert came == []


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


@unix
def test_a_stopped_command_leaves_no_draft(lab, tmp_path, monkeypatch):
    """The results' draft goes when the command does, not when the process does."""
    (tmp_path / "log.csv").write_text("".join(lab[1][:11]))
    write, kept = Drafted.write, []

    def stopped(results, rows):
        kept.append(results)
        os.kill(os.getpid(), signal.SIGTERM)
        return write(results, rows)

    monkeypatch.setattr(Drafted, "write", stopped)
    command = ["correct", "--model", str(lab[0]), str(tmp_path / "log.csv"), "--out", str(tmp_path / "o.csv")]
    assert cli.main(command) == 143
    assert [path.name for path in tmp_path.iterdir()] == ["log.csv"]


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
    monkeypatch.setattr("thermocorr.files.writer._OLD", 0.0)
    Draft(tmp_path / "a.txt").close()
    assert not kept.exists() and foreign.exists()


@unix
def test_a_signal_before_the_first_line_is_no_empty_log(lab, monkeypatch, capsys):
    def at_once(*given):
        os.kill(os.getpid(), signal.SIGTERM)
        return open_lines(*given)

    monkeypatch.setattr(correcting, "open_lines", at_once)
    reading, writing = os.pipe()
    assert cli.main(["correct", "--model", str(lab[0]), f"/dev/fd/{reading}"]) == 143
    assert capsys.readouterr().err == "thermocorr: stopped before the first line; nothing was written\n"
    os.close(reading)
    os.close(writing)


@unix
@pytest.mark.parametrize(("number", "status"), [(signal.SIGTERM, 143), (signal.SIGINT, 130)])
def test_a_signal_waits_until_the_modules_are_loaded(number, status, monkeypatch, capsys):
    """Raised in the middle of a module in C it would become an error of that module's."""
    loaded = []

    def load(name, package):
        os.kill(os.getpid(), number)
        time.sleep(0.05)
        loaded.append(name)
        return import_module(name, package)

    monkeypatch.setattr(cli, "import_module", load)
    assert cli.main(["correct", "--model", "model.json"]) == status
    assert loaded == [".correct"] and capsys.readouterr().err == "thermocorr: stopped\n"


@pytest.mark.long
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


def test_an_interrupt_while_the_first_modules_load(monkeypatch, capsys):
    class Interrupted:
        def __getattr__(self, name):
            raise KeyboardInterrupt

    monkeypatch.setitem(sys.modules, "thermocorr.command.cli", Interrupted())
    assert start() == 130 and capsys.readouterr().err == "thermocorr: stopped\n"


@pytest.mark.parametrize(("signal_itself", "status"), [(KeyboardInterrupt(), 130), (Terminated(143), 143)])
def test_a_signal_behind_another_error_is_the_signal(signal_itself, status, monkeypatch, capsys):
    """One that comes while a class is made; Python 3.11 says that setting a name has failed."""

    def fail(given):
        raise RuntimeError("Error calling __set_name__") from signal_itself

    monkeypatch.setattr(cli, "_options", fail)
    assert cli.main([]) == status and capsys.readouterr().err == "thermocorr: stopped\n"
    monkeypatch.setattr(cli, "_options", lambda given: (_ for _ in ()).throw(RuntimeError("a fault")))
    with pytest.raises(RuntimeError, match="a fault"):
        cli.main([])


def test_the_words_for_a_signal_need_no_import():
    """It may have come in the middle of one, whose half would be imported again."""
    code = "import sys; from thermocorr.command import cli; cli._ended('stopped', 143); print('pandas' in sys.modules)"
    environment = {**os.environ, "PYTHONPATH": str(Path(thermocorr.__file__).parents[1])}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=environment)
    assert (done.stdout, done.stderr) == ("False\n", "thermocorr: stopped\n")

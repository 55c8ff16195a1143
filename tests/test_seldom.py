"""What seldom happens at the doors: systems that refuse, logs and states that cannot be read."""

import errno
import os
import shutil
import sys
import threading

import pandas as pd
import pytest
from streams import stream

from thermocorr import DynamicBiasRegressor, RecordError, save_model
from thermocorr.command import cli
from thermocorr.command import correct as results
from thermocorr.command import lines as lines
from thermocorr.command import lines as table_lines
from thermocorr.command.stopping import StopSignal
from thermocorr.files import AppendedFile, OutputError, Outputs, write_file
from thermocorr.files import writer as drafts
from thermocorr.files.writer import TEXT_MARK
from thermocorr.records import files
from thermocorr.records.files import read_table

OURS = f"{TEXT_MARK}\nold\n"


def refusing(number=errno.EACCES):
    """A function of the system that refuses."""

    def refuse(*_, **__):
        raise OSError(number, os.strerror(number))

    return refuse


def test_a_place_without_permission_is_said_before_the_work(tmp_path, monkeypatch):
    monkeypatch.setattr(os, "access", lambda path, mode: False)
    with pytest.raises(OutputError, match=r"f\.txt cannot be written: no permission"), Outputs() as outputs:
        outputs.claim(tmp_path / "f.txt")


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


def test_the_name_of_appended_results_is_brought_to_the_disk_when_they_end(tmp_path, monkeypatch):
    file = AppendedFile.new(tmp_path / "rows.csv", first=b"head\n")
    synced, sync = [], os.fsync
    monkeypatch.setattr(os, "fsync", lambda fd: (synced.append(os.fstat(fd).st_ino), sync(fd)))
    file.close()
    assert synced == [tmp_path.stat().st_ino]


def test_a_reader_of_whole_results_that_has_gone_is_a_broken_pipe(tmp_path):
    """And no sentence of a file that could not be written."""
    reading, writing = os.pipe()
    os.close(reading)
    outputs = Outputs()
    with pytest.raises(BrokenPipeError):
        outputs.write(f"/dev/fd/{writing}", b"x")
    outputs.discard()
    os.close(writing)


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
        patched.setattr(table_lines, "FileLines", refusing())
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
    with pytest.raises(RecordError, match=r"log\.parquet is Parquet.*pip install pyarrow"):
        read_table(tmp_path / "log.parquet")


def test_a_table_is_not_followed_and_its_rows_stop_where_they_are_told(lab, tmp_path, capsys):
    pytest.importorskip("pyarrow", reason="Parquet needs pyarrow: pip install '.[parquet]'")
    pd.read_csv(lab / "log.csv").to_parquet(tmp_path / "log.parquet")
    assert correct(lab, tmp_path / "log.parquet", "--follow") == 2
    assert "is Parquet, which cannot be followed while it grows. Leave out --follow." in capsys.readouterr().err
    stop = StopSignal()
    rows = iter(table_lines.TableLines(tmp_path / "log.parquet", stop))
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

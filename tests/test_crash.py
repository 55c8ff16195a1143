"""Kills, full disks and inputs named as outputs: a small part of `benchmarks/crash.py`, and what it leaves out."""

import os
import stat
import subprocess
import sys
from pathlib import Path

import pytest

import thermocorr
from thermocorr import DynamicBiasRegressor, save_model
from thermocorr.command.cli import main
from thermocorr.datasets import make_record

ROOT = Path(__file__).parents[1]
ENVIRONMENT = {**os.environ, "PYTHONPATH": str(Path(thermocorr.__file__).parents[1]), "OMP_NUM_THREADS": "1"}
COMMAND = [sys.executable, "-m", "thermocorr"]
ANALYZE = ["--reading", "reading", "--time-constants", "10min,2h", "--blocks", "2", "--quiet"]

pytestmark = [
    pytest.mark.newest,
    pytest.mark.skipif(not hasattr(os, "fork"), reason="signals and locks are those of Unix"),
]


@pytest.fixture(scope="module")
def fitted():
    """A log as a frame, and a model of its first rows."""
    log = make_record(300, seed=5).reset_index()
    log["time"] = log["time"].dt.strftime("%Y-%m-%dT%H:%M:%S")
    return log, DynamicBiasRegressor(time="time", time_constants=[600.0, 7200.0]).fit(log[:200], log["reading"][:200])


@pytest.fixture
def folder(fitted, tmp_path, monkeypatch):
    """Where log.csv, model.json and a user's own files are; the commands run there."""
    log, model = fitted
    log.to_csv(tmp_path / "log.csv", index=False)
    save_model(model, tmp_path / "model.json")
    (tmp_path / "mine.c").write_text("int main(void) { return 0; }\n")
    (tmp_path / "mine.csv").write_text("a,b\n1,2\n")
    (tmp_path / "link.csv").symlink_to("log.csv")
    os.link(tmp_path / "log.csv", tmp_path / "hard.csv")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def contents(folder):
    """Everything in a folder: what is in a file, and which file it is."""
    files = [path for path in folder.rglob("*") if path.is_file()]
    return {str(path): (path.read_bytes(), os.lstat(path).st_ino, path.stat().st_mtime_ns) for path in files}


def run(text):
    return main(text.split())


@pytest.mark.long
def test_kills_and_full_disks():
    """Every fault that the benchmark counts is 0: signals at six calls each, full disks at each call of `--out`."""
    names = ["file -> --out, disk full", "file -> --out --state, SIG", "fed from the start again, SIG"]
    command = [sys.executable, str(ROOT / "benchmarks" / "crash.py"), "--moments", "6", "--calls", "--only", *names]
    done = subprocess.run(command, capture_output=True, text=True, env=ENVIRONMENT, timeout=300)
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.count("\n") >= 10


REFUSED = {
    "correct --model model.json log.csv --out log.csv": "log.csv is read by this command",
    "correct --model model.json log.csv --out model.json": "model.json is read by this command",
    "correct --model model.json log.csv --out link.csv": "link.csv is read by this command",
    "correct --model model.json log.csv --out hard.csv": "hard.csv is read by this command",
    "correct --model model.json link.csv --out log.csv": "log.csv is read by this command",
    "correct --model model.json log.csv --out out.csv --state log.csv": "log.csv",
    "correct --model model.json log.csv --out out.csv --state model.json": "model.json",
    "correct --model model.json log.csv --out s.json --state s.json": "s.json would be written twice by this command",
    "correct --model model.json log.csv --follow --idle 0 --out log.csv": "log.csv is read by this command",
    "analyze log.csv --report log.csv": "log.csv is read by this command",
    "analyze log.csv --out . --report corrected.csv": "corrected.csv would be written twice by this command",
    "analyze log.csv --report hard.csv": "hard.csv is read by this command",
    "export-c --model model.json --out model.json/x.c": "cannot be written",
}


@pytest.mark.parametrize("force", ["", " --force"])
@pytest.mark.parametrize("command", REFUSED)
def test_no_input_is_ever_an_output(command, force, folder, capsys):
    before = contents(folder)
    more = f" {' '.join(ANALYZE)}" if command.startswith("analyze") else ""
    assert run(command + more + force) == 2
    said = capsys.readouterr().err.splitlines()
    assert said[-1].startswith("thermocorr: error: ") and REFUSED[command] in said[-1]
    assert not [line for line in said[:-1] if not line.startswith("Loading")]
    assert contents(folder) == before


def test_a_corrected_log_is_not_analysed_into_itself(folder, capsys):
    options = " ".join(ANALYZE)
    assert run(f"analyze log.csv {options} --out out") == 0
    before = contents(folder)
    capsys.readouterr()
    assert run(f"analyze out/corrected.csv {options} --out out") == 2
    said = capsys.readouterr()
    assert "out/corrected.csv is read by this command" in said.err and said.out == ""
    assert contents(folder) == before


FOREIGN = {
    "export-c --model model.json --out mine.c": ("mine.c", "Made by thermocorr"),
    "correct --model model.json log.csv --out mine.csv": ("mine.csv", "corrected,bias,flag"),
    "correct --model model.json log.csv --state s.json --out mine.csv": ("mine.csv", "corrected,bias,flag"),
    f"analyze log.csv {' '.join(ANALYZE)} --report mine.csv": ("mine.csv", "<!DOCTYPE html>"),
}


@pytest.mark.parametrize("command", FOREIGN)
def test_a_users_own_file_is_overwritten_by_force_only(command, folder, capsys):
    name, mark = FOREIGN[command]
    before = contents(folder)
    assert run(command) == 2
    assert f"{name} is there already and was not written by thermocorr" in capsys.readouterr().err
    assert contents(folder) == before
    assert run(f"{command} --force") == 0
    assert mark in (folder / name).read_text()
    now = contents(folder)
    assert all(now[path] == seen for path, seen in before.items() if not path.endswith(name))
    assert run(command) == 0  # it is thermocorr's own now


def test_links_stay_links_and_modes_stay(folder):
    os.makedirs("elsewhere")
    os.symlink("elsewhere/out.csv", "out.csv")
    for options, new in (
        ("", "elsewhere/out.csv"),
        (" --average 3", ""),
        (" --state s.json", "s.json"),
        (" --state s.json", ""),
    ):
        assert run(f"correct --model model.json log.csv --out out.csv{options}") == 0
        assert os.path.islink("out.csv") and len(Path("elsewhere/out.csv").read_text().splitlines()) == 301
        if new:
            os.chmod(new, 0o600)
    assert [stat.S_IMODE(os.stat(name).st_mode) for name in ("s.json", "elsewhere/out.csv")] == [0o600, 0o600]
    assert [path.name for path in Path("elsewhere").iterdir()] == ["out.csv"]


@pytest.mark.long
@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="there is no /dev/full")
@pytest.mark.parametrize("follow", ["", " --follow --idle 0", " --state s.json"])
def test_standard_output_on_a_full_disk(follow, folder):
    with open("/dev/full", "w") as full:
        command = [*COMMAND, *f"correct --model model.json log.csv{follow}".split()]
        done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, env=ENVIRONMENT)
    assert done.returncode == 2
    assert done.stderr.startswith("thermocorr: error: ") and "No space left on device" in done.stderr
    assert done.stderr.count("\n") == 1


@pytest.mark.long
def test_analyze_whose_reader_goes_away(folder):
    """`analyze | head -1`: what is to be written is written."""
    command = [*COMMAND, "analyze", "log.csv", *ANALYZE, "--out", "out", "--report"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, env=ENVIRONMENT) as process:
        process.stdout.readline()
        process.stdout.close()
        assert process.wait(60) == 0 and process.stderr.read() == b""
    names = ["corrected.csv", "model.json", "model.txt", "report.html"]
    assert sorted(path.name for path in (folder / "out").iterdir()) == names

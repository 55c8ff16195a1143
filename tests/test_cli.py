"""The command `thermocorr analyze`: good runs, and bad ones that end with one sentence."""

import os
import subprocess
import sys

import numpy as np
import pandas as pd
import pytest

from thermocorr import __version__, load_model
from thermocorr.__main__ import start
from thermocorr.command.cli import main
from thermocorr.datasets import make_record
from thermocorr.output.results import result_columns


@pytest.fixture
def log(tmp_path):
    record = make_record(1500, seed=5).reset_index()
    record["time"] = record["time"].dt.strftime("%Y-%m-%dT%H:%M:%S")
    record.to_csv(tmp_path / "log.csv", index=False)
    return tmp_path / "log.csv"


def analyze(log, *more):
    reading = [] if "--reading" in more else ["--reading", "reading"]
    return main(["analyze", str(log), *reading, "--time-constants", "10min,2h", *more])


def test_corrected_log_has_the_same_rows_and_the_model_loads(log, tmp_path, capsys):
    out = tmp_path / "result"
    assert analyze(log, "--out", str(out)) == 0
    printed = capsys.readouterr()
    assert "dynamic linear *" in printed.out
    assert printed.err == ""
    before, after = pd.read_csv(log), pd.read_csv(out / "corrected.csv", keep_default_na=False)
    before["time"], after["time"] = pd.to_datetime(before["time"]), pd.to_datetime(after["time"])
    pd.testing.assert_frame_equal(after[before.columns], before, rtol=1e-15)
    assert list(after.columns[-5:]) == ["corrected", "model", "residual", "flag", "u"]
    model = load_model(out / "model.json")
    np.testing.assert_allclose(
        model.predict(before.set_index("time").drop(columns="reading")), after["model"], rtol=1e-12
    )
    assert "lag[600 s]" in (out / "model.txt").read_text()


def test_the_package_is_a_command_too():
    said = subprocess.run([sys.executable, "-m", "thermocorr", "--version"], capture_output=True, text=True, check=True)
    assert said.stdout == f"thermocorr {__version__}\n"


def test_parquet_and_runs(log, tmp_path, capsys):
    pytest.importorskip("pyarrow", reason="Parquet needs pyarrow: pip install '.[parquet]'")
    frame = pd.read_csv(log, parse_dates=["time"])
    frame["run"] = np.where(np.arange(len(frame)) < 700, "a", "b")
    frame.to_parquet(tmp_path / "log.parquet")
    assert analyze(tmp_path / "log.parquet", "--run", "run", "--out", str(tmp_path / "r")) == 0
    assert "decay[600 s, a]" in (tmp_path / "r" / "model.txt").read_text()


def test_progress_goes_to_standard_error_where_that_is_a_terminal(log, capsys, monkeypatch):
    command = ["analyze", str(log), "--reading", "reading", "--time-constants", "10min"]
    monkeypatch.setattr("thermocorr.command.analyze.has_bars", lambda: False)
    assert main(command) == 0 and capsys.readouterr().err == ""
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    assert main(command) == 0 and "held-out block" in capsys.readouterr().err


def changed(log, **columns):
    frame = pd.read_csv(log).assign(**columns)
    path = log.with_name("changed.csv")
    frame.to_csv(path, index=False)
    return path


def written(log, text):
    path = log.with_name("written.csv")
    path.write_text(text)
    return path


BAD = {
    "no such file": (lambda log: (log.with_name("none.csv"),), "no file"),
    "a folder": (lambda log: (log.parent,), "is a folder"),
    "empty file": (lambda log: (written(log, ""),), "is empty"),
    "header only": (lambda log: (written(log, "time,temperature,reading\n"),), "no rows"),
    "semicolons": (lambda log: (written(log, "time;temperature;reading\n1;2;3\n"),), "too short"),
    "ragged lines": (lambda log: (written(log, "a,b\n1,2\n1,2,3\n"),), "are rows"),
    "not parquet": (lambda log: (log.rename(log.with_suffix(".parquet")),), "cannot be read as .parquet"),
    "unknown temperature": (lambda log: (log, "--temperature", "oven"), "no column 'oven'"),
    "unknown reading": (lambda log: (log, "--reading", "ohms"), "no column 'ohms'"),
    "unknown time": (lambda log: (log, "--time", "when"), "no column 'when'"),
    "unknown run": (lambda log: (log, "--run", "run"), "no column 'run'"),
    "reading is temperature": (
        lambda log: (log, "--reading", "temperature", "--temperature", "temperature"),
        "both name",
    ),
    "time and period": (lambda log: (log, "--time", "time", "--sampling-period", "1s"), "not both"),
    "text in reading": (
        lambda log: (changed(log, reading="n/v"),),
        "not a number in row 0: 'n/v' (1500 such rows in all). Remove units and text from the file",
    ),
    "no readings": (lambda log: (changed(log, reading=np.nan),), "readings are missing"),
    "constant temperature": (lambda log: (changed(log, temperature=20.0),), "never changes"),
    "a time twice": (
        lambda log: (changed(log, time=pd.read_csv(log)["time"].mask(lambda t: t.index == 1).bfill()),),
        "--skip-bad-rows keeps the first",
    ),
    "same time in all rows": (lambda log: (changed(log, time="2024-01-01T00:00:00"),), "same time"),
    "unreadable time": (
        lambda log: (changed(log, time="yesterday"),),
        "Which column is the time? Say it with --time; ",
    ),
    "bad time constants": (lambda log: (log, "--time-constants", "fast"), "positive time"),
    "bad gap": (lambda log: (log, "--max-gap", "wide"), "'max_gap' parameter"),
    "folder that is a file": (lambda log: (log, "--out", str(log)), "cannot be written"),
}


@pytest.mark.parametrize("case", BAD)
@pytest.mark.filterwarnings("ignore:Mean of empty slice", "ignore:Degrees of freedom")
def test_bad_input_ends_with_one_sentence(case, log, capsys):
    make, message = BAD[case]
    path, *more = make(log)
    assert analyze(path, *more) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err.count("\n") == 1
    assert printed.err.startswith("thermocorr: error: ")
    assert message in printed.err


def test_columns_without_a_log_are_refused(capsys):
    assert main(["analyze", "--reading", "x"]) == 2
    assert "no log is given" in capsys.readouterr().err


@pytest.mark.parametrize("command", [["analyze"], ["workbench"], ["correct", "--model", "model.json"]])
@pytest.mark.parametrize("option", ["--reading", "--time"])
def test_two_columns_for_one_role_are_refused(command, option, log, capsys):
    with pytest.raises(SystemExit) as end:
        main([*command, str(log), option, "reading", option, "room"])
    assert end.value.code == 2
    said = f"argument {option}: one column, not 'reading' and 'room'. Run the command once for each"
    assert said in " ".join(capsys.readouterr().err.split())


def test_uncertainties_of_a_corrected_log(log, tmp_path, capsys):
    """`correct --uncertainty` writes what `analyze` wrote, and what Python says."""
    out = tmp_path / "result"
    assert analyze(log, "--out", str(out)) == 0
    files = "--model", str(out / "model.json"), "--out", str(tmp_path / "again.csv")
    assert main(["correct", str(log), *files, "--uncertainty", "--average", "5"]) == 0
    again, before = pd.read_csv(tmp_path / "again.csv"), pd.read_csv(out / "corrected.csv")
    assert list(again.columns[-2:]) == ["u", "u_smoothed"]
    np.testing.assert_allclose(again["u"], before["u"], rtol=1e-12)
    raw = pd.read_csv(log, dtype=str)  # old parsers miss a last digit, and that may put a row into another bin
    raw = raw.astype({name: float for name in raw.columns if name != "time"})
    raw = raw.set_index(pd.to_datetime(raw.pop("time")))
    stated = load_model(out / "model.json").correct(raw.drop(columns="reading"), raw["reading"], return_std=True)[1]
    np.testing.assert_allclose(again["u"], stated, rtol=1e-12)
    assert main(["correct", str(log), *files, "--uncertainty", "--force"]) == 0


def test_runs_have_levels_of_their_own(log, tmp_path):
    frame = pd.read_csv(log)
    run = np.where(np.arange(1500) < 700, "a", "b")
    path = changed(log, reading=frame["reading"] + 30.0 * (run == "b"), run=run)
    assert analyze(path, "--run", "run", "--variant", "dynamic-linear", "--out", str(tmp_path / "out")) == 0
    assert pd.read_csv(tmp_path / "out" / "corrected.csv")["residual"].std() < 1.0


GERMAN = {"sep": ";", "decimal": ",", "date_format": "%d.%m.%Y %H:%M:%S"}


@pytest.mark.long
@pytest.mark.parametrize(
    ("stamped", "written", "options", "first"),
    [
        ("", GERMAN, (), "2024-03-04 00:00:00"),
        ("", GERMAN, ("--timezone", "Europe/Berlin"), "2024-03-03 23:00:00+00:00"),
        ("Europe/Berlin", {}, (), "2024-03-03 23:00:00+00:00"),
    ],
)
def test_a_corrected_log_is_plain_csv_that_both_commands_read_again(tmp_path, capsys, stamped, written, options, first):
    """The same corrected readings; columns of the first result are neither suspects nor other thermometers."""
    frame = make_record(1500, seed=5).reset_index()[["time", "temperature", "humidity", "reading"]]
    frame["time"] = frame["time"].dt.tz_localize(stamped or None)
    frame.to_csv(tmp_path / "log.csv", index=False, **written)
    assert analyze(tmp_path / "log.csv", *options, "--out", str(tmp_path / "one")) == 0
    before = capsys.readouterr().out.replace("\n  ", " ")
    lines = (tmp_path / "one" / "corrected.csv").read_text().splitlines()
    assert lines[0] == "time,temperature,humidity,reading,corrected,model,residual,flag,u"
    assert lines[1].startswith(f"{first},") and not any(";" in line for line in lines)
    wanted = pd.read_csv(tmp_path / "one" / "corrected.csv")
    np.testing.assert_allclose(wanted["reading"], frame["reading"], rtol=1e-15)  # as the oldest pandas reads them

    again = ["correct", str(tmp_path / "one" / "corrected.csv"), "--model", str(tmp_path / "one" / "model.json")]
    assert main([*again, "--out", str(tmp_path / "again.csv")]) == 0
    corrected = pd.read_csv(tmp_path / "again.csv")
    assert list(corrected.columns[-3:]) == ["corrected_thermocorr", "bias", "flag_thermocorr"]
    np.testing.assert_allclose(corrected["corrected_thermocorr"], wanted["corrected"], rtol=1e-12)

    capsys.readouterr()
    for number, name in enumerate((tmp_path / "one" / "corrected.csv", tmp_path / "again.csv")):
        assert analyze(name, "--out", str(tmp_path / f"two{number}")) == 0
        said = capsys.readouterr().out.replace("\n  ", " ")
        assert "Data: 'corrected', 'model', 'residual', 'flag', 'u'" in said and "no suspects" in said
        judged = [text[text.index("Verdict") : text.index("Data")] for text in (before, said)]
        assert judged[0] == judged[1]
        second = pd.read_csv(tmp_path / f"two{number}" / "corrected.csv")
        newest = "corrected" + (number + 1) * "_thermocorr"
        np.testing.assert_allclose(second[newest], wanted["corrected"], rtol=1e-12)
        np.testing.assert_allclose(second[["corrected", "model"]], wanted[["corrected", "model"]], rtol=1e-15)


def test_columns_that_only_look_like_results_stay_suspects():
    assert result_columns(["time", "model", "flag", "corrected", "residual"]) == []
    assert result_columns(["time", "model", "flag", "reading"]) == []
    assert result_columns(["u", "corrected", "bias", "flag", "pressure", "u_thermocorr"]) == [
        "corrected", "bias", "flag", "u_thermocorr",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("given", "threads"), [({}, "1"), ({"OMP_NUM_THREADS": "3"}, None), ({"OPENBLAS_NUM_THREADS": "2"}, "2")]
)
def test_the_command_keeps_openblas_to_one_thread_unless_told_otherwise(monkeypatch, given, threads):
    monkeypatch.setattr("os.environ", dict(given))
    monkeypatch.setattr("thermocorr.command.cli.main", lambda: os.environ.get("OPENBLAS_NUM_THREADS"))
    assert start() == threads


def test_the_built_in_record_heeds_the_longest_gap(capsys):
    assert main(["analyze", "--max-gap", "1,5h"]) == 2
    assert "'max_gap' parameter" in capsys.readouterr().err

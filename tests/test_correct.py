"""The command `thermocorr correct`: whole logs, lines, logs that grow, and what is wrong with them."""

import io
import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import thermocorr
from thermocorr import DynamicBiasRegressor, save_model
from thermocorr.command.cli import main
from thermocorr.datasets import make_record
from thermocorr.effects import LaggedCovariate


@pytest.fixture(scope="module")
def lab(tmp_path_factory):
    """Folder with model.json and log.csv, the model, and the log as a frame; the model knows the first 600 rows."""
    folder = tmp_path_factory.mktemp("lab")
    log = make_record(900, seed=5).reset_index()
    log["time"] = log["time"].dt.strftime("%Y-%m-%dT%H:%M:%S")
    model = DynamicBiasRegressor(
        time="time", time_constants=[600.0, 7200.0], effects=[LaggedCovariate("humidity", ["20 min"])]
    )
    model.fit(log[:600], log["reading"][:600])
    save_model(model, folder / "model.json")
    log.to_csv(folder / "log.csv", index=False)
    return folder, model, log


def correct(lab, *more):
    return main(["correct", "--model", str(lab[0] / "model.json"), *map(str, more)])


def piped(lab, content, monkeypatch, tmp_path, *more):
    """`thermocorr correct -` with these lines on standard input."""
    (tmp_path / "in").write_bytes(content if isinstance(content, bytes) else content.encode())
    with (tmp_path / "in").open() as file:
        monkeypatch.setattr("sys.stdin", file)
        return correct(lab, "-", *more)


def lines_of(log):
    return log.to_csv(index=False).splitlines(keepends=True)


def same(text, model, log):
    """Whether the output is the log, and what the model says about it."""
    got = pd.read_csv(io.StringIO(text), keep_default_na=False, na_values={"corrected": "", "bias": ""})
    times = pd.to_datetime(got.pop("time"))
    assert times.tolist() == pd.to_datetime(log["time"]).tolist()
    columns = log.columns.drop("time")
    pd.testing.assert_frame_equal(got[columns], log[columns].reset_index(drop=True), rtol=1e-15)
    assert list(got.columns[-3:]) == ["corrected", "bias", "flag"]
    expected = model.evaluate(log, log["reading"])
    np.testing.assert_allclose(got["corrected"], expected["corrected"], rtol=1e-13)
    np.testing.assert_allclose(got["bias"], model.bias(log), rtol=0, atol=1e-13 * abs(log["reading"]).max())
    assert got["flag"].tolist() == expected["flag"].tolist()


@pytest.mark.parametrize("way", ["whole", "piped"])
@pytest.mark.parametrize("rows", [slice(0, 900), slice(600, 900)])
def test_a_log_gets_what_the_model_says(lab, way, rows, tmp_path, capsys, monkeypatch):
    _, model, log = lab
    log[rows].to_csv(tmp_path / "part.csv", index=False)
    if way == "whole":
        assert correct(lab, tmp_path / "part.csv") == 0
    else:
        assert piped(lab, (tmp_path / "part.csv").read_bytes(), monkeypatch, tmp_path) == 0
    printed = capsys.readouterr()
    same(printed.out, model, log[rows])
    assert way == "piped" or f"247 of {len(log[rows])} rows are flagged: 247 outside" in printed.err
    if way == "whole":
        assert correct(lab, tmp_path / "part.csv", "--out", tmp_path / "out.csv") == 0
        assert (tmp_path / "out.csv").read_text() == printed.out
        assert correct(lab, tmp_path / "part.csv", "--out", tmp_path / "out.csv") == 2
        assert "out.csv is there already. Name another file, or overwrite it with --force." in capsys.readouterr().err


def test_a_table_whose_index_has_no_name_has_its_times_in_a_column_time(lab, tmp_path, capsys):
    pytest.importorskip("pyarrow", reason="Parquet needs pyarrow: pip install '.[parquet]'")
    log = lab[2].assign(time=pd.to_datetime(lab[2]["time"])).set_index("time").rename_axis(None)
    log[600:].to_parquet(tmp_path / "log.parquet")
    assert correct(lab, tmp_path / "log.parquet") == 0
    printed = capsys.readouterr()
    assert printed.out.startswith("time,")


@pytest.mark.parametrize("way", ["whole", "piped"])
def test_columns_in_any_order_under_other_names(lab, way, tmp_path, capsys, monkeypatch):
    _, model, log = lab
    renamed = log[600:].rename(columns={"temperature": "oven, left", "reading": "R", "time": "stamp"})
    renamed[[*renamed.columns[::-1]]].assign(flag="x").to_csv(tmp_path / "r.csv", index=False)
    options = ("--temperature", "oven, left", "--reading", "R", "--time", "stamp", "--average", 3, "--track", "2h")
    if way == "whole":
        assert correct(lab, tmp_path / "r.csv", *options) == 0
    else:
        assert piped(lab, (tmp_path / "r.csv").read_bytes(), monkeypatch, tmp_path, *options) == 0
    got = pd.read_csv(io.StringIO(capsys.readouterr().out))
    assert list(got.columns[-5:]) == ["corrected", "bias", "flag_thermocorr", "smoothed", "reference"]
    expected = model.correct(log[600:], log["reading"][600:])
    np.testing.assert_allclose(got["corrected"], expected, rtol=1e-13)
    mean = pd.Series(got["corrected"]).rolling(3, min_periods=1).mean()
    np.testing.assert_allclose(got["smoothed"], mean, rtol=1e-12)
    np.testing.assert_allclose(got["oven, left"], log["temperature"][600:], rtol=1e-15)


def test_bad_lines_of_a_stream_are_named_and_left_out(lab, tmp_path, capsys, monkeypatch):
    _, model, log = lab
    header, *rows = lines_of(log[600:640])
    fields = rows[19].rstrip().split(",")
    rows[19] = ",".join([fields[0], "warm", *fields[2:]]) + "\n"
    spoiled = {2: "one,two\n", 5: ",".join(["now", *fields[1:]]) + "\n", 12: '"never closed\n', 20: "\xff\xfe,,\n"}
    text = [header, *rows]
    for place, line in spoiled.items():
        text.insert(place, line)
    text.insert(30, "\n")
    text.insert(33, header)
    assert log.columns[1] == "temperature"
    assert piped(lab, "".join([*text, "2024-03-04T"]).encode("latin-1"), monkeypatch, tmp_path) == 1
    printed = capsys.readouterr()
    shown = pd.read_csv(io.StringIO(printed.out), keep_default_na=False)
    assert shown["flag"].tolist()[19] == "no temperature"  # a cell that is none is no value
    lines = printed.out.splitlines(keepends=True)
    same("".join(lines[:20] + lines[21:]), model, log[600:640].drop(index=619))
    for words in (
        "3 lines left out, no rows, the first is line 3: it has 2 fields", "line 6 is left out: 'now' is no time",
        "line 25: 'warm' in 'temperature' is no number", "the last line is left out: it has no line end",
        "1 rows got no result: 1 no temperature",
    ):  # fmt: skip
        assert f"thermocorr: {words}" in printed.err


@pytest.mark.parametrize(
    ("lines", "said"),
    [
        ("", "The log is empty"),
        ("time,temperature\n", "The log has no column 'humidity', 'reading'"),
        ("time;temperature;humidity;reading\n1;2;3;4\n", "Give it as a whole file to read another form"),
    ],
)
def test_a_stream_that_is_no_such_log_is_refused_when_it_ends(lab, lines, said, tmp_path, capsys, monkeypatch):
    assert piped(lab, lines, monkeypatch, tmp_path) == 2
    printed = capsys.readouterr()
    assert said in printed.err and printed.out == ""


def test_a_word_in_a_file_is_asked_back_with_an_option_that_works(lab, tmp_path, capsys):
    _, _, log = lab
    path = tmp_path / "words.csv"
    log[600:640].astype({"reading": object}).replace({"reading": {log["reading"][610]: "lost"}}).to_csv(
        path, index=False
    )
    assert correct(lab, path) == 2
    assert "'reading' holds 'lost'" in capsys.readouterr().err
    for option in ("--na=lost", "--skip-bad-rows"):
        assert correct(lab, path, option) == 0
        assert "1 no reading" in capsys.readouterr().err


def test_bad_rows_of_a_file_are_refused_or_passed_over(lab, tmp_path, capsys):
    _, model, log = lab
    header, *rows = lines_of(log[600:640])
    (tmp_path / "bad.csv").write_text("".join([header, *rows[:5], "one,two\n", *rows[5:], rows[0]]))
    assert correct(lab, tmp_path / "bad.csv") == 2
    assert "--skip-bad-rows" in capsys.readouterr().err
    assert correct(lab, tmp_path / "bad.csv", "--skip-bad-rows") == 0
    printed = capsys.readouterr()
    same(printed.out, model, log[600:640])
    assert "line 7" in printed.err and "1 row" in printed.err


@pytest.mark.parametrize("way", ["whole", "piped"])
def test_missing_numbers_and_times_out_of_order_are_flagged(lab, way, tmp_path, capsys, monkeypatch):
    _, _, log = lab
    part = log[600:620].reset_index(drop=True).astype(object)
    part.loc[3, "reading"], part.loc[6, "temperature"], part.loc[8, "humidity"] = "", "NaN", None
    part = pd.concat([part, part[4:6]])
    part.to_csv(tmp_path / "m.csv", index=False)
    if way == "whole":
        assert correct(lab, tmp_path / "m.csv") == 1  # damaged times
    else:
        assert piped(lab, (tmp_path / "m.csv").read_bytes(), monkeypatch, tmp_path) == 1
    printed = capsys.readouterr()
    got = pd.read_csv(io.StringIO(printed.out), keep_default_na=False)
    flags = got["flag"].tolist()
    assert [flags[k] for k in (3, 6, 8, 9)] == ["no reading", "no temperature", "no temperature", ""]
    assert flags[-2:] == ["backward time"] * 2
    assert got["corrected"].tolist()[3] == got["corrected"].tolist()[6] == got["corrected"].tolist()[-1] == ""
    assert "got no result: " in printed.err and "2 backward time" in printed.err


BAD = {
    "no such log": (["none.csv"], "There is no file"),
    "empty log": ("", "is empty"),
    "no column": ("time,a,b\n2024-01-01,1,2\n", "no column 'temperature'"),
    "no model": (["log.csv", "--model", "none.json"], "cannot be read"),
    "not a model": (["log.csv", "--model", "log.csv"], "no model that can be loaded"),
    "bad average": (["log.csv", "--average", "0"], "'average' parameter"),
    "bad track": (["log.csv", "--track", "soon"], "'track' parameter"),
    "out is a folder": (["log.csv", "--out", "."], "is a directory and cannot be written"),
    "out is the log": (["log.csv", "--out", "log.csv", "--force"], "is read by this command"),
    "followed to a file": (["log.csv", "--follow", "--out", "x.csv"], "write thermocorr correct ... > FILE"),
    "followed in another way": (["log.csv", "--follow", "--sep", ";"], "Lines are read as the model's log was written"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_input_ends_with_one_sentence(case, lab, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(lab[0])
    arguments, words = BAD[case]
    if isinstance(arguments, str):
        (tmp_path / "bad.csv").write_text(arguments)
        arguments = [tmp_path / "bad.csv"]
    assert correct(lab, *arguments) == 2
    printed = capsys.readouterr()
    assert printed.out == "" and printed.err.startswith("thermocorr: error: ") and printed.err.count("\n") == 1
    assert words in printed.err


def test_the_model_must_be_named(lab, capsys):
    with pytest.raises(SystemExit) as end:
        main(["correct", str(lab[0] / "log.csv")])
    assert end.value.code == 2
    assert "the following arguments are required: --model" in capsys.readouterr().err


def test_a_fault_is_a_traceback_that_asks_for_a_report(lab, monkeypatch):
    monkeypatch.setattr("thermocorr.command.correct._whole", lambda *_: [].pop())
    with pytest.raises(IndexError) as fault:
        correct(lab, lab[0] / "log.csv")
    assert "fault of thermocorr" in fault.value.__notes__[0]


def started(lab, *more, stdin=None):
    environment = {**os.environ, "PYTHONPATH": str(Path(thermocorr.__file__).parents[1]), "PYTHONUNBUFFERED": ""}
    model = str(lab[0] / "model.json")
    command = [sys.executable, "-m", "thermocorr", "correct", "--model", model, *map(str, more)]
    return subprocess.Popen(
        command, stdin=stdin, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment
    )


def test_standard_input_is_answered_line_by_line_until_an_interrupt(lab):
    _, model, log = lab
    answers = []
    with started(lab, "-", stdin=subprocess.PIPE) as process:
        for line in lines_of(log[600:620]):
            process.stdin.write(line)
            process.stdin.flush()
            answers.append(process.stdout.readline())
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=60)
        assert process.returncode == 130 and "thermocorr: stopped" in err and "Traceback" not in err and out == ""
    same("".join(answers), model, log[600:620])


def test_a_growing_file_is_followed_and_what_is_cut_is_said(lab, tmp_path):
    _, model, log = lab
    header, *rows = lines_of(log[600:620])
    path = tmp_path / "grow.csv"
    path.write_text(header + rows[0])
    with started(lab, path, "--follow") as process:
        answers = [process.stdout.readline(), process.stdout.readline()]
        with path.open("a") as file:
            for line in rows[1:]:
                file.write(line[:9])  # half a line first
                file.flush()
                file.write(line[9:])
                file.flush()
                answers.append(process.stdout.readline())
        path.write_text(header)
        out, err = process.communicate(timeout=60)
        assert process.returncode == 2 and out == "" and "was cut or replaced" in err
    same("".join(answers), model, log[600:620])


def test_a_reader_that_goes_away(lab):
    folder, *_ = lab
    with started(lab, folder / "log.csv", "--follow") as process:
        process.stdout.readline()
        process.stdout.close()
        assert process.wait(timeout=20) == 0
        assert process.stderr.read() == ""

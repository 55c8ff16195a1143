"""The command `thermocorr correct`: whole logs, streams of lines, logs that grow, and what is wrong with them."""

import io
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import thermocorr
from thermocorr import DynamicBiasRegressor, save_model
from thermocorr.command.cli import main
from thermocorr.command.lines import FileLines
from thermocorr.command.stopping import StopSignal
from thermocorr.datasets import make_record
from thermocorr.effects import LaggedCovariate
from thermocorr.records.files import EVERY_DIGIT


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


def lines_of(log):
    return log.to_csv(index=False).splitlines(keepends=True)


def same(text, model, log):
    """Whether the output is the log, and what the model says about it."""
    got = pd.read_csv(io.StringIO(text), keep_default_na=False, na_values={"corrected": "", "bias": ""})
    pd.testing.assert_frame_equal(got[log.columns], log.reset_index(drop=True))
    assert list(got.columns[-3:]) == ["corrected", "bias", "flag"]
    expected = model.evaluate(log, log["reading"])
    np.testing.assert_allclose(got["corrected"], expected["corrected"], rtol=1e-13)
    np.testing.assert_allclose(got["bias"], model.bias(log), rtol=0, atol=1e-13 * abs(log["reading"]).max())
    assert got["flag"].tolist() == expected["flag"].tolist()


@pytest.mark.parametrize("rows", [slice(0, 900), slice(600, 900)])
def test_a_whole_log(lab, rows, tmp_path, capsys):
    _, model, log = lab
    log[rows].to_csv(tmp_path / "part.csv", index=False)
    assert correct(lab, tmp_path / "part.csv") == 0
    printed = capsys.readouterr()
    same(printed.out, model, log[rows])
    assert printed.err == ""
    assert correct(lab, tmp_path / "part.csv", "--out", tmp_path / "out.csv") == 0
    assert (tmp_path / "out.csv").read_text() == printed.out
    assert capsys.readouterr().out == ""


def test_a_table_whose_index_has_no_name_has_its_times_in_a_column_time(lab, tmp_path, capsys):
    pytest.importorskip("pyarrow", reason="Parquet needs pyarrow: pip install '.[parquet]'")
    log = lab[2].assign(time=pd.to_datetime(lab[2]["time"])).set_index("time").rename_axis(None)
    log[600:].to_parquet(tmp_path / "log.parquet")
    assert correct(lab, tmp_path / "log.parquet") == 0
    printed = capsys.readouterr()
    assert printed.out.startswith("time,") and printed.err == ""


def test_columns_in_any_order_under_other_names(lab, tmp_path, capsys):
    _, model, log = lab
    renamed = log[600:].rename(columns={"temperature": "oven, left", "reading": "R", "time": "stamp"})
    renamed[[*renamed.columns[::-1]]].assign(flag="x").to_csv(tmp_path / "r.csv", index=False)
    options = ("--temperature", "oven, left", "--reading", "R", "--time", "stamp", "--average", 3, "--track", "2h")
    assert correct(lab, tmp_path / "r.csv", *options) == 0
    got = pd.read_csv(io.StringIO(capsys.readouterr().out), **EVERY_DIGIT)
    assert list(got.columns[-5:]) == ["corrected", "bias", "flag_thermocorr", "smoothed", "reference"]
    expected = model.correct(log[600:], log["reading"][600:])
    np.testing.assert_allclose(got["corrected"], expected, rtol=1e-13)
    np.testing.assert_allclose(
        got["smoothed"], pd.Series(got["corrected"]).rolling(3, min_periods=1).mean(), rtol=1e-12
    )
    assert got["oven, left"].equals(log["temperature"][600:].reset_index(drop=True))


def test_bad_lines_are_named_and_left_out(lab, tmp_path, capsys):
    _, model, log = lab
    header, *rows = lines_of(log[600:640])
    fields = rows[7].rstrip().split(",")
    at = list(log.columns).index
    spoiled = {
        2: "one,two\n",
        5: ",".join(["now", *fields[1:]]) + "\n",
        9: ",".join("warm" if i == at("temperature") else f for i, f in enumerate(fields)) + "\n",
        12: '"never closed\n',
        20: "\xff\xfe,,\n",
    }
    text = [header, *rows]
    for place, line in spoiled.items():
        text.insert(place, line)
    text.insert(30, "\n")
    text.insert(33, header)
    (tmp_path / "bad.csv").write_text("".join(text), encoding="latin-1")
    assert correct(lab, tmp_path / "bad.csv") == 1
    printed = capsys.readouterr()
    same(printed.out, model, log[600:640])
    said = printed.err.splitlines()
    assert [line.split()[2] for line in said[:-1]] == [str(place + 1) for place in sorted(spoiled)]
    assert "it has 2 fields" in said[0] and "'now'" in said[1] and "'warm', no number" in said[2]
    assert said[-1] == f"thermocorr: 5 of {len(text) - 1} lines got no result: 5 lines left out"


@pytest.mark.parametrize("twice", [slice(1, None), slice(5, 9)])
def test_a_time_that_comes_again_is_said_to_be_that_of_the_row_before(twice, lab, tmp_path, capsys):
    lines = lines_of(lab[2])
    again = [line for k, line in enumerate(lines) for _ in range(1 + (k in range(len(lines))[twice]))]
    (tmp_path / "twice.csv").write_text("".join(again))
    assert correct(lab, tmp_path / "twice.csv") == 1
    rows, more = len(again) - 1, len(again) - len(lines)
    each = ": the log has each row twice" if 2 * more == rows else ""
    said = f"{more} of {rows} lines got no result: {more} stale time. Stale is the time of the row before{each}\n"
    assert capsys.readouterr().err.endswith(said)


def test_missing_numbers_and_times_out_of_order_are_flagged(lab, tmp_path, capsys):
    _, _, log = lab
    part = log[600:620].reset_index(drop=True).astype(object)
    part.loc[3, "reading"], part.loc[6, "temperature"], part.loc[8, "humidity"] = "", "NaN", None
    part = pd.concat([part, part[4:6]])
    part.to_csv(tmp_path / "m.csv", index=False)
    assert correct(lab, tmp_path / "m.csv") == 1  # damaged times
    got = pd.read_csv(io.StringIO(capsys.readouterr().out), keep_default_na=False)
    flags = got["flag"].tolist()
    assert [flags[k] for k in (3, 6, 7, 8, 9)] == [
        "no reading",
        "no temperature",
        "outside fitted range",
        "no temperature",
        "",
    ]
    assert got["flag"].tolist()[-2:] == ["backward time"] * 2
    assert got["corrected"].tolist()[3] == got["corrected"].tolist()[6] == got["corrected"].tolist()[-1] == ""


def test_a_saved_state_goes_on(lab, tmp_path, capsys):
    _, model, log = lab
    rows = lines_of(log[600:])
    first, second = tmp_path / "a.csv", tmp_path / "b.csv"
    first.write_text("".join(rows[:120]))
    options = ("--state", tmp_path / "state.json", "--out", tmp_path / "out.csv")
    assert correct(lab, first, *options) == 0
    second.write_text("".join([rows[0], *rows[100:]]))  # the next file begins with rows that were there before
    assert correct(lab, second, *options) == 0
    assert "20 lines were corrected before" in capsys.readouterr().err
    same((tmp_path / "out.csv").read_text(), model, log[600:])
    (tmp_path / "state.json").write_text("{}")
    assert correct(lab, second, *options) == 2
    assert "Remove the file to start afresh" in capsys.readouterr().err


@pytest.mark.parametrize("to", ["a file", "standard output"])
def test_a_log_without_times_goes_on_by_its_rows(to, tmp_path, capfd):
    log = make_record(700, seed=6).reset_index(drop=True)[["temperature", "reading"]]
    model = DynamicBiasRegressor(time_constants=[600.0], sampling_period=60.0)
    save_model(model.fit(log[["temperature"]][:400], log["reading"][:400]), tmp_path / "model.json")
    log = log[400:].reset_index(drop=True)
    options = ("--state", tmp_path / "state.json", *(("--out", tmp_path / "out.csv") if to == "a file" else ()))
    texts = []
    for n in (100, 300):
        log[:n].to_csv(tmp_path / "log.csv", index=False)
        assert correct((tmp_path,), tmp_path / "log.csv", *options) == 0
        texts.append(capfd.readouterr())
    assert "100 lines were corrected before" in texts[1].err
    text = texts[0].out + texts[1].out.partition("\n")[2]  # the header comes each time
    got = pd.read_csv(tmp_path / "out.csv" if to == "a file" else io.StringIO(text))
    np.testing.assert_allclose(got["corrected"], model.correct(log[["temperature"]], log["reading"]), rtol=1e-13)


BAD = {
    "no such log": (["none.csv"], "There is no file"),
    "empty log": ["", "is empty"],
    "no column": ["a,b\n1,2\n", "no column 'temperature'"],
    "no model": (["log.csv", "--model", "none.json"], "cannot be read"),
    "not a model": (["log.csv", "--model", "log.csv"], "this is not JSON"),
    "bad average": (["log.csv", "--average", "0"], "'average' parameter"),
    "bad track": (["log.csv", "--track", "soon"], "'track' parameter"),
    "out is a folder": (["log.csv", "--out", "."], "is a directory and cannot be written"),
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


def started(lab, *more, stdin=None):
    environment = {**os.environ, "PYTHONPATH": str(Path(thermocorr.__file__).parents[1]), "PYTHONUNBUFFERED": ""}
    model = str(lab[0] / "model.json")
    command = [sys.executable, "-m", "thermocorr", "correct", "--model", model, *map(str, more)]
    return subprocess.Popen(
        command, stdin=stdin, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment
    )


def test_standard_input_line_by_line_and_an_interrupt(lab, tmp_path):
    """Every line is answered before the next is sent; an interrupt saves the state, and the next process goes on."""
    _, model, log = lab
    header, *rows = lines_of(log[600:630])
    state = tmp_path / "state.json"
    answers = []
    for part in (rows[:15], rows[15:]):
        with started(lab, "-", "--follow", "--state", state, stdin=subprocess.PIPE) as process:
            for line in (header, *part):
                process.stdin.write(line)
                process.stdin.flush()
                answers.append(process.stdout.readline())
            if len(answers) == 16:
                process.send_signal(signal.SIGINT)
                out, err = process.communicate(timeout=60)
                assert process.returncode == 130 and "thermocorr: stopped" in err and "Traceback" not in err
            else:
                out, err = process.communicate(timeout=60)  # the end of the input is a good end
                assert process.returncode == 0 and err == ""
            assert out == ""
    same(answers[0] + "".join(line for line in answers if line != answers[0]), model, log[600:630])


@pytest.mark.skipif(not Path("/dev/fd").is_dir(), reason="no names for descriptors here")
def test_a_pipe_that_is_not_followed_is_waited_for(lab, capfd, monkeypatch):
    """Nothing comes for fifty looks; what comes then is read."""
    _, model, log = lab
    monkeypatch.setattr("thermocorr.command.lines.POLL", 0.001)
    reading, writing = os.pipe()
    header, *rows = lines_of(log[600:602])
    os.write(writing, (header + rows[0]).encode())

    def late():
        time.sleep(0.05)
        os.write(writing, rows[1].encode())
        os.close(writing)

    writer = threading.Thread(target=late)
    writer.start()
    status = correct(lab, f"/dev/fd/{reading}")
    writer.join()
    os.close(reading)
    assert status == 0
    same(capfd.readouterr().out, model, log[600:602])


def test_a_growing_file_that_is_replaced_until_the_process_is_ended(lab, tmp_path):
    _, model, log = lab
    header, *rows = lines_of(log[600:640])
    path = tmp_path / "grow.csv"
    path.write_text(header + rows[0])
    with started(lab, path, "--follow", "--state", tmp_path / "state.json") as process:
        answers = [process.stdout.readline(), process.stdout.readline()]
        with path.open("a") as file:
            for line in rows[1:20]:
                file.write(line[:9])  # half a line first
                file.flush()
                file.write(line[9:])
                file.flush()
                answers.append(process.stdout.readline())
        (tmp_path / "new.csv").write_text(header + "".join(rows[20:]))
        os.replace(tmp_path / "new.csv", path)
        answers += [process.stdout.readline() for _ in rows[20:]]
        process.terminate()
        out, err = process.communicate(timeout=60)
        assert process.returncode == 143 and out == "" and "Traceback" not in err
    same("".join(answers), model, log[600:640])
    assert (tmp_path / "state.json").exists()


def test_following_ends_when_nothing_comes(tmp_path, monkeypatch):
    monkeypatch.setattr("thermocorr.command.lines.POLL", 0.001)
    path = tmp_path / "f.csv"
    path.write_bytes(b"a\nb\nc")
    source = FileLines(path, True, 0.05, StopSignal())
    assert [line for line in source if line is not None] == [b"a\n", b"b\n"]
    assert source.rest == b"c"  # the line that is being written is no line yet
    source.close()
    source = FileLines(path, True, 5.0, StopSignal())
    lines = iter(source)
    assert [next(lines), next(lines), next(lines)] == [b"a\n", b"b\n", None]
    path.write_bytes(b"d\n")  # cut and begun anew, shorter than before
    assert next(line for line in lines if line is not None) == b"d\n"
    assert source.restarted
    source.close()


def test_a_reader_that_goes_away(lab):
    folder, *_ = lab
    with started(lab, folder / "log.csv", "--follow") as process:
        process.stdout.readline()
        process.stdout.close()
        assert process.wait(timeout=20) == 0
        assert process.stderr.read() == ""

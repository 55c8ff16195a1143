"""Foreign logs through `correct`: whole, and line by line while they grow."""

import functools
import io
import re

import numpy as np
import pandas as pd
import pytest
from corpus.first_files import FIRST
from corpus.foreign_logs import GOOD, N, plain, semicolons, understood

from thermocorr import DynamicBiasRegressor, save_model
from thermocorr.command.cli import main

pytestmark = pytest.mark.newest

FOLLOWED = [
    "semicolons with decimal commas", "a German header in Latin-1", "tabs", "blanks", "a preamble as wide as the table",
    "units below the header", "a semicolon at every end", "thousands with points", "month/day/year, AM and PM",
    "date and time in two columns", "time and date in two columns", "a fraction of a second behind a comma",
    "comments in front", "the header in a comment", "names of months", "LabVIEW", "Unix times in ms",
]  # fmt: skip


@pytest.fixture(scope="module")
def analyzed(tmp_path_factory):
    """Function that analyzes a log, once for each text and options, and returns the folder of results."""

    @functools.cache
    def of(text, *options):
        folder = tmp_path_factory.mktemp("analyzed")
        (folder / "fitted.csv").write_text(text, encoding="utf-8")
        command = [
            "analyze",
            str(folder / "fitted.csv"),
            *options,
            "--time-constants",
            "5min",
            "--variant",
            "dynamic-linear",
            "--quiet",
        ]
        assert main([*command, "--out", str(folder)]) == 0
        return folder

    return of


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.long] if number % 3 else []) for number, name in enumerate(FOLLOWED)]
)
def test_a_foreign_log_is_followed_while_it_grows(name, written, tmp_path, capsys):
    """Read whole and line by line, from a saved state on: the same results."""
    content = GOOD[name] if isinstance(GOOD[name], bytes) else GOOD[name].encode()
    path, out = written(content), tmp_path / "out"
    names = understood(path)[0].frame.columns
    options = [
        f"--{role}={next(c for c in names if str(c).lower().startswith(begins))}"
        for role, begins in (("temperature", "temp"), ("reading", ("read", "mess")))
    ]
    assert (
        main(
            [
                "analyze",
                str(path),
                *options,
                "--time-constants",
                "5min",
                "--variant",
                "dynamic-linear",
                "--out",
                str(out),
                "--quiet",
            ]
        )
        == 0
    )
    model = ["--model", str(out / "model.json"), *options]
    assert main(["correct", str(path), *model, "--out", str(tmp_path / "whole.csv")]) == 0
    lines = content.splitlines(keepends=True)
    state = ["--state", str(tmp_path / "state.json"), "--out", str(tmp_path / "grown.csv"), "--follow", "--idle", "0"]
    for rows in (len(lines) - 15, len(lines)):
        path.write_bytes(b"".join(lines[:rows]))
        assert main(["correct", str(path), *model, *state]) == 0
    whole, grown = (pd.read_csv(tmp_path / f"{name}.csv") for name in ("whole", "grown"))
    assert list(whole.columns) == list(grown.columns)
    np.testing.assert_allclose(grown["corrected"], whole["corrected"], rtol=0, atol=1e-9)
    capsys.readouterr()


def test_a_line_in_another_way_of_writing_is_left_out_and_named(written, tmp_path, capsys):
    path, out = written(semicolons()), tmp_path / "out"  # as many lines as tell the dialect
    assert (
        main(
            [
                "analyze",
                str(path),
                "--time-constants",
                "5min",
                "--variant",
                "dynamic-linear",
                "--out",
                str(out),
                "--quiet",
            ]
        )
        == 0
    )
    follow = ["--model", str(out / "model.json"), "--follow", "--idle", "0"]
    with path.open("ab") as file:
        file.write(
            b"31.05.2024 00:20:00;1.234;22,1\n05/31/2024 00:21:00;22,1;1000,1\n31.05.2024 00:22:00;22,1;1000,1\n"
        )
    capsys.readouterr()
    assert main(["correct", str(path), *follow]) == 1
    shown = capsys.readouterr()
    assert len(shown.out.splitlines()) == 1 + N + 1 and shown.err.count("is left out") == 2
    lines = path.read_text(encoding="latin-1").splitlines()
    numbers = [int(said.split()[2]) for said in shown.err.splitlines() if "is left out" in said]
    assert [lines[number - 1].startswith(("31.05.2024 00:20", "05/31")) for number in numbers] == [True, True]
    assert main(["correct", "-", "--model", str(out / "model.json"), "--sep", ";"]) == 2
    assert "line by line, as plain CSV" in capsys.readouterr().err
    for content, name, words in (
        ("time;temperature;reading\n", "log.csv", "once it has some rows"),
        (plain().encode("utf-16"), "log.csv", "UTF-16"),
        (GOOD["gz"], "log.csv.gz", "is .gz, which cannot be followed"),
    ):
        assert main(["correct", str(written(content, name)), *follow]) == 2
        assert re.search(words, capsys.readouterr().err)
    for said in (["--timezone", "UTC"], ["--time-format", "excel"], ["--na", "x"], ["--time-format", "%d"]):
        assert main(["correct", str(written(semicolons())), *follow, *said]) == 2
        assert ("is a row with times as '%d'" if "%d" in said else "need") in capsys.readouterr().err


def test_correct_says_how_it_has_read_a_log(written, tmp_path, capsys):
    path, out = written(semicolons()), tmp_path / "out"
    assert (
        main(
            [
                "analyze",
                str(path),
                "--time-constants",
                "5min",
                "--variant",
                "dynamic-linear",
                "--out",
                str(out),
                "--quiet",
            ]
        )
        == 0
    )
    capsys.readouterr()
    assert main(["correct", str(path), "--model", str(out / "model.json")]) == 0
    assert capsys.readouterr().err == (
        "thermocorr: read as: separated by semicolons, decimal comma, dates as day, month, year\n"
    )


@pytest.mark.long
@pytest.mark.parametrize(("before", "place"), [("", "line 7"), ("Logger 5\nNo. 3, lab\n\n", "line 10")])
def test_a_damaged_line_is_called_by_its_number_in_the_file(before, place, tmp_path, capsys):
    text = "time;temperature;reading\n" + "".join(
        f"2024-03-04T00:{k // 60:02d}:{k % 60:02d};{22 + 0.01 * (k % 37)};{1000 + k % 7}\n" for k in range(400)
    )
    path = tmp_path / "log.csv"
    path.write_text(before + text)
    assert (
        main(
            [
                "analyze",
                str(path),
                "--time-constants",
                "5",
                "--variant",
                "dynamic-linear",
                "--out",
                str(tmp_path / "out"),
                "--quiet",
            ]
        )
        == 0
    )
    lines = text.splitlines(keepends=True)
    lines[6] = lines[6].replace(";22", ";abc22")
    path.write_text(before + "".join(lines))
    capsys.readouterr()
    assert main(["correct", str(path), "--model", str(tmp_path / "out" / "model.json")]) == 1
    assert f"{place} is left out: the temperature" in capsys.readouterr().err


@pytest.mark.parametrize("way", ["whole", "followed", "a pipe"])
@pytest.mark.parametrize(
    ("header", "units", "said"),
    [
        ("time,temperature,reading", ",°C,V", ""),
        ("time,temperature,reading", ",°C,mV", "'reading' is in mV, and the model was fitted to 'reading' in V"),
        ("time,temperature,reading", ",°F,V", "'temperature' is in degF, and the model was fitted to"),
        ("time,temperature,reading", ",K,V", "'temperature' is in K, and the model was fitted to"),
        ("time,T_C,dmm_V", ",°C,mV", "'dmm_V' is in mV, and the model was fitted to 'dmm_V' in V"),
    ],
)
def test_units_below_the_header_are_asked(way, header, units, said, analyzed, tmp_path, capsys, monkeypatch):
    """The log that the model was fitted to has the units of the first case below its header, or in it."""
    rows = "".join(
        f"2024-03-04 00:{k // 60:02d}:{k % 60:02d},{22 + 0.01 * (k % 37)},{10 + 1e-4 * (k % 7)}\n" for k in range(400)
    )
    path = tmp_path / "log.csv"
    path.write_text(f"{header}\n{units}\n{rows}", encoding="utf-8")
    named = [f"--temperature={header.split(',')[1]}", f"--reading={header.split(',')[2]}"]
    out = analyzed(f"{header}\n{'' if 'dmm' in header else ',°C,V' + chr(10)}{rows}", *named)
    capsys.readouterr()
    with path.open() as stream:
        monkeypatch.setattr("sys.stdin", stream)
        log = {"whole": [str(path)], "followed": [str(path), "--follow", "--idle", "0"], "a pipe": ["-"]}[way]
        status = main(["correct", *log, "--model", str(out / "model.json")])
    shown = capsys.readouterr()
    if not said:
        assert status == 0 and len(shown.out.splitlines()) == 1 + 400 and "left out" not in shown.err
        return
    assert status == 2 and said in shown.err and "or mend the unit that the file gives" in shown.err
    assert len(shown.out.splitlines()) <= 1


WAYS = ["whole", "followed", "a pipe"]


def corrected(way, path, model, monkeypatch, *more):
    """Exit status of `correct` on a log that is read in this way."""
    log = {"whole": [str(path)], "followed": [str(path), "--follow", "--idle", "0"], "a pipe": ["-"]}[way]
    with path.open() as stream:
        monkeypatch.setattr("sys.stdin", stream)
        return main(["correct", *log, "--model", str(model), *more])


def dated_rows(unit, header="time,temperature,reading", n=400):
    """A log of a row a minute, with dates, or with Unix times in a unit."""
    per = {"s": 1, "ms": 1000, "us": 10**6, "ns": 10**9}
    begin = 1_717_112_400
    times = [begin + 60 * k for k in range(n)]
    said = [f"{pd.Timestamp(t, unit='s'):%Y-%m-%dT%H:%M:%S}" if unit == "dates" else str(t * per[unit]) for t in times]
    rows = (f"{t},{22 + 0.01 * (k % 37):.4f},{10 + 1e-4 * (k % 7):.5f}\n" for k, t in enumerate(said))
    return f"{header}\n{''.join(rows)}"


@pytest.fixture
def minutes(analyzed):
    """The file of a model that is fitted to a row a minute, with Unix times in seconds."""
    return analyzed(dated_rows("s")) / "model.json"


def test_comments_before_the_header_of_a_pipe_are_passed_over(tmp_path, capsys, monkeypatch):
    """As in a file; the lines that are left out are called by their number in the stream."""
    path, model = tmp_path / "log.csv", tmp_path / "out" / "model.json"
    rows = dated_rows("dates").splitlines(keepends=True)
    path.write_text("# Counter 5, gate 10 s\n  # lab 3\n" + "".join(rows))
    assert (
        main(
            [
                "analyze",
                str(path),
                "--time-constants",
                "5min",
                "--variant",
                "dynamic-linear",
                "--out",
                str(tmp_path / "out"),
                "--quiet",
            ]
        )
        == 0
    )
    rows[7] = rows[7].replace(",22", ",?!22")
    path.write_text("# Counter 5, gate 10 s\n  # lab 3\n" + "".join(rows))
    found = []
    for way in WAYS:
        capsys.readouterr()
        assert corrected(way, path, model, monkeypatch) == 1
        shown = capsys.readouterr()
        found.append(pd.read_csv(io.StringIO(shown.out))["corrected"])
        assert "line 10 is left out: the temperature is" in shown.err
    np.testing.assert_allclose(found[1], found[0], rtol=0, atol=1e-9)
    np.testing.assert_allclose(found[2], found[0], rtol=0, atol=1e-9)


@pytest.mark.parametrize("units", ["", ",°C,V\n"])
def test_a_header_that_begins_with_a_mark_of_comments_stays_the_header_of_a_pipe(units, tmp_path, capsys, monkeypatch):
    """As pandas reads it, and a model is fitted to it in Python."""
    path = tmp_path / "log.csv"
    header, rows = dated_rows("dates", "#time,temperature,reading").split("\n", 1)
    path.write_text(f"# lab 3, gate 10 s, meter 2\n{header}\n{units}{rows}", encoding="utf-8")
    log = pd.read_csv(io.StringIO(f"{header}\n{rows}"))
    model = DynamicBiasRegressor("temperature", ["5 min"], time="#time").fit(log, log["reading"])
    save_model(model, tmp_path / "model.json")
    assert corrected("a pipe", path, tmp_path / "model.json", monkeypatch) == 0
    frame = pd.read_csv(io.StringIO(capsys.readouterr().out))
    np.testing.assert_allclose(frame["corrected"], model.correct(log, log["reading"]), rtol=0, atol=1e-9)


@pytest.mark.long
@pytest.mark.parametrize("units", ["", ",°C,V\n"])
@pytest.mark.parametrize("comment", ["# logger 7, room 5, serial 33", "# 7, 5, 33", "#temperature,reading,time"])
def test_a_comment_with_as_many_commas_as_the_header_is_passed_over(comment, units, tmp_path, capsys, monkeypatch):
    """The same bytes as a file and through a pipe, with units below the header or not."""
    path, model = tmp_path / "log.csv", tmp_path / "out" / "model.json"
    header, rows = dated_rows("dates").split("\n", 1)
    path.write_text(f"{comment}\n{header}\n{units}{rows}", encoding="utf-8")
    assert (
        main(
            [
                "analyze",
                str(path),
                "--time-constants",
                "5min",
                "--variant",
                "dynamic-linear",
                "--out",
                str(tmp_path / "out"),
                "--quiet",
            ]
        )
        == 0
    )
    found = []
    for way in WAYS:
        capsys.readouterr()
        assert corrected(way, path, model, monkeypatch) == 0
        found.append(pd.read_csv(io.StringIO(capsys.readouterr().out))["corrected"])
    np.testing.assert_allclose(found[1], found[0], rtol=0, atol=1e-9)
    np.testing.assert_allclose(found[2], found[0], rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    ("begin", "said"),
    [
        ("\n", "Line 1 is empty"),
        ("# logger 7\n\n", "Line 2 is empty"),
        ('# logger 7\n# lab 3\n"time,temperature\n', "The header, line 3, cannot be read"),
    ],
)
def test_a_line_that_is_no_header_is_called_by_its_number_in_the_stream(
    begin, said, minutes, tmp_path, capsys, monkeypatch
):
    path = tmp_path / "log.csv"
    path.write_text(begin + dated_rows("s"))
    assert corrected("a pipe", path, minutes, monkeypatch) == 2
    assert said in capsys.readouterr().err


def test_a_growing_log_is_read_in_the_form_of_the_models_own(analyzed, tmp_path, capsys):
    """Its first row can be read as May or June; the log that was learned from went through midnight."""
    text = GOOD["day and month told by midnight"].replace(",", ";").replace(".", ",")
    folder = analyzed(text)
    head, *rows = text.splitlines(keepends=True)
    log, out = tmp_path / "log.csv", tmp_path / "out.csv"
    log.write_text(head + rows[-1].replace(" 00:", " 01:"))
    follow = ["--model", str(folder / "model.json"), "--follow", "--idle", "0", "--out", str(out)]
    assert main(["correct", str(log), *follow]) == 0
    assert pd.read_csv(out)["time"].tolist() == ["2024-05-07T01:19:00"]
    capsys.readouterr()
    assert main(["correct", str(log), *follow, "--force", "--time-format", "%m/%d/%Y %H:%M:%S"]) == 0
    assert pd.read_csv(out)["time"].tolist() == ["2024-07-05T01:19:00"]


@pytest.mark.parametrize("name", ["AM and PM apart", "hhmm", "hhmm without a date", "midnight as 24:00, day first"])
def test_what_only_the_whole_log_tells_is_not_followed(name, analyzed, written, capsys):
    """Or its times are those of the whole log: never others."""
    content = FIRST[name]
    model = ["--model", str(analyzed(content) / "model.json")]
    path = written(content)
    capsys.readouterr()
    assert main(["correct", str(path), *model]) == 0
    whole = pd.read_csv(io.StringIO(capsys.readouterr().out))
    status = main(["correct", str(path), *model, "--follow", "--idle", "0"])
    shown = capsys.readouterr()
    if status:
        assert "need the whole log: leave out --follow" in shown.err
    else:
        followed = pd.read_csv(io.StringIO(shown.out))
        np.testing.assert_allclose(followed["corrected"], whole["corrected"], rtol=0, atol=1e-9)


def test_a_pipe_without_a_header_gets_its_names(analyzed, capsys, monkeypatch, tmp_path):
    text = GOOD["commas"]
    folder = analyzed(text)
    bare = tmp_path / "bare.csv"
    bare.write_text("# logger 7\n" + text.split("\n", 1)[1])
    capsys.readouterr()
    for names, status in (([], 2), (["--names", "time,temperature,reading"], 0)):
        with bare.open() as stream:
            monkeypatch.setattr("sys.stdin", stream)
            assert main(["correct", "-", "--model", str(folder / "model.json"), *names]) == status
        shown = capsys.readouterr()
        assert "--names" in shown.err if status else len(shown.out.splitlines()) == 1 + N

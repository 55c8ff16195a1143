"""Logs that come again, from a pipe or another file: nothing lost, nothing twice."""

import json
import os

import pandas as pd
import pytest
from log_lines import model_and_lines, plain, rows_of

from thermocorr import DynamicBiasRegressor, OnlineCorrector, RecordError
from thermocorr.command import cli
from thermocorr.datasets import make_record

unix = pytest.mark.skipif(not hasattr(os, "fork"), reason="pipes are those of Unix")


@pytest.fixture(scope="module")
def lab(tmp_path_factory):
    return model_and_lines(tmp_path_factory.mktemp("lab"))


def piped(lab, lines, *more):
    """`correct` from a pipe that is fed with these lines, and then ends."""
    reading, writing = os.pipe()
    os.write(writing, "".join(lines).encode())
    os.close(writing)
    try:
        return cli.main(["correct", "--model", str(lab[0]), f"/dev/fd/{reading}", "--follow", *map(str, more)])
    finally:
        os.close(reading)


@unix
def test_a_pipe_for_the_results_begins_with_the_header_each_time(lab, tmp_path):
    """It holds no rows that could come twice."""
    head, *rows = lab[1]
    options = ("--state", tmp_path / "state.json", "--out")
    for part in (rows[:10], rows[10:15]):
        reading, writing = os.pipe()
        assert piped(lab, [head, *part], *options, f"/dev/fd/{writing}") == 0
        os.close(writing)
        with open(reading) as results:
            named, *lines = results.read().splitlines()
        assert named.startswith(head.rstrip()) and [line.rsplit(",", 3)[0] for line in lines] == plain(part)


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
@pytest.mark.parametrize(
    ("start", "passed_over"), [(0, "20 lines were"), (7, "13 lines were"), (19, "thermocorr: 1 line was")]
)
def test_rows_that_come_again_are_passed_over_as_long_as_they_are_the_same(start, passed_over, lab, tmp_path, capsys):
    head, *rows = lab[1]
    rows[9] = back(rows[9])
    options = ("--state", tmp_path / "state.json", "--out", tmp_path / "out.csv")
    assert piped(lab, [head, *rows[:20]], *options) == 1
    piped(lab, [head, *rows[start:40]], *options)
    assert f"{passed_over} corrected before" in capsys.readouterr().err
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
@pytest.mark.parametrize("first", [1, 20])
def test_a_file_of_results_that_began_later_leaves_it_to_the_times(first, lab, tmp_path, capsys):
    """It does not hold the rows that the state has seen: those before its last time are passed over."""
    head, *rows = lab[1]
    state, out = tmp_path / "state.json", tmp_path / "out.csv"
    assert piped(lab, [head, *rows[:first]], "--state", state, "--out", tmp_path / "first.csv") == 0
    assert piped(lab, [head, *rows[first:30]], "--state", state, "--out", out) == 0
    capsys.readouterr()
    assert piped(lab, [head, *rows[:40]], "--state", state, "--out", out) == 0
    assert "30 lines were corrected before" in capsys.readouterr().err
    assert rows_of(out) == plain(rows[first:40])


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


def test_lines_left_out_and_rows_without_a_result_are_counted_together(lab, tmp_path, capsys):
    row = lab[1][5].rstrip("\n").split(",")
    row[lab[1][0].rstrip("\n").split(",").index("reading")] = ""
    (tmp_path / "log.csv").write_text("".join([*lab[1][:5], "no row\n", ",".join(row) + "\n", *lab[1][6:9]]))
    assert cli.main(["correct", "--model", str(lab[0]), str(tmp_path / "log.csv")]) == 1
    said = capsys.readouterr().err.splitlines()[-1]
    assert said == "thermocorr: 2 of 9 lines got no result: 1 line left out, 1 no reading"


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


def test_a_state_holds_every_label_of_a_run_that_a_stream_takes(lab):
    log = make_record(60, seed=5).reset_index()
    labels = pd.to_datetime(pd.Series(["1885-06-01T12:00", "1885-06-02T12:00"])).dt.tz_localize("Europe/Paris")
    X = log[["time", "temperature"]].assign(run=labels.take([int(k > 30) for k in range(60)]).to_numpy(dtype=object))
    model = DynamicBiasRegressor(time="time", time_constants=[600.0], run="run").fit(X, log["reading"])
    live = OnlineCorrector(model)
    live.update_many(X, log["reading"])
    again = OnlineCorrector.from_state(model, json.loads(json.dumps(live.state())))
    assert again.state() == live.state()
    far = pd.Timestamp("9999-12-31").as_unit("us")
    for update in (lambda: live.update(X["time"][59], 20.0, 1.0, run=far), lambda: live.update_many(X.assign(run=far))):
        with pytest.raises(RecordError, match=r"9999-12-31.* Times may lie between 1880 and 2170"):
            update()

"""The most telling logs that random ones have led to; model files and states are in `corpus`.

Every case says what must come of it: a sentence, a line that is named, or the very number that Python's `float` reads.
Line by line and as a whole file, nothing else than what a log says is taken for a number, a time or a row.
"""

import time

import numpy as np
import pandas as pd
import pytest
from corpus.clean_log import CLEAN, HEADER, ROWS, Shown, check, frame_of, save_fitted, text_of

from thermocorr import DynamicBiasRegressor, RecordError, load_model, read_log, save_model
from thermocorr.command.cli import main
from thermocorr.equations.outliers import OVERLOAD


@pytest.fixture(scope="module")
def model_path(tmp_path_factory):
    return save_fitted(tmp_path_factory.mktemp("model") / "m.json")


@pytest.fixture
def correct(model_path, tmp_path, capsys):
    """Function that gives a log to `correct -`."""
    return lambda content, *options, model=model_path: Shown(tmp_path, content, options, model, capsys)


@pytest.fixture
def read(written):
    """Function that reads a log as `analyze` does: temperature and reading are numbers, times rise."""

    def run(content):
        log = read_log(written(content))
        assert log.index.is_monotonic_increasing and log.index.is_unique and isinstance(log.index, pd.DatetimeIndex)
        if words := {"temperature", "reading"} & set(log.attrs["words"]):
            raise RecordError(f"{words} hold words")
        return log

    return run


NO_NUMBERS = [
    "1_000", "0x10", "2,5", "1.2.3", "\uff12\uff11.\uff15", "\u0662\u0661", "2\uff11", "\u00b2\u00b9",
    "\ufeff21", "e5", "1e", ".", "--1", "21 C", "1j", "yes", "True", "1.#INF", "warm",
]  # fmt: skip


@pytest.mark.parametrize("column", ["temperature", "reading"])
@pytest.mark.parametrize("cell", NO_NUMBERS)
def test_a_cell_that_is_no_number_is_none_line_by_line_and_refused_in_a_file(cell, column, correct, read, model_path):
    rows = [list(row) for row in CLEAN[:30]]
    rows[12][HEADER.index(column)] = cell
    shown = correct(text_of(rows))
    assert shown.status == 1 and "thermocorr: line 14" in shown.err
    with pytest.raises(RecordError, match=f"'{column}'|byte"):
        read(text_of(rows))
    rows[12][3] = "nan"  # without a reading the temperature still counts
    check(shown, rows if column == "reading" else rows[:12] + rows[13:], model_path)


@pytest.mark.parametrize("cell", ["1e400", "1e160", "-1e308"])
def test_a_number_that_no_instrument_shows_gets_no_result(cell, correct):
    for column in (1, 3):
        rows = [list(row) for row in CLEAN[:30]]
        rows[12][column] = cell
        shown = correct(text_of(rows))
        assert shown.rows[12][4] == "" and [k for k, row in enumerate(shown.rows) if not row[4]] == [12]


MISSING = [
    "", " ", "NA", " NA ", "N/A", "n/a", "#N/A", "<NA>", "NULL", "null", "None", "NaN", "nan", "-nan", "OVLD", "---",
]  # fmt: skip


@pytest.mark.parametrize("cell", MISSING)
def test_a_missing_number_is_one_for_both_commands(cell, correct, read):
    rows = [list(row) for row in CLEAN[:30]]
    rows[7][1], rows[20][3] = cell, cell
    shown = correct(text_of(rows))
    assert shown.status == 0 and [row[-1] for row in shown.rows][7] == "no temperature"
    assert [row[-1] for row in shown.rows][20] == "no reading"
    log = read(text_of(rows))
    assert np.flatnonzero(np.isnan(log["temperature"])).tolist() == [7]
    assert np.flatnonzero(np.isnan(log["reading"])).tolist() == [20]


NUMBERS = [
    "21.5", " 21.5 ", "\t21.5", "+21.5", "2.15e1", "2.15E+01", "21.", "0021.5", "20.100000000000000000000000000001",
    "20.10000000000000142108547152020037174224853515625", "20.1000000000000014210854715202003717422485351562500001",
    "-0", "5e-324", "1e-400", "9007199254740993", "18446744073709551616", "1e40", "2.15d1",
]  # fmt: skip


@pytest.mark.newest
@pytest.mark.parametrize("cell", NUMBERS)
def test_a_number_keeps_every_digit(cell, read, correct):
    rows = [list(row) for row in CLEAN[:30]]
    value = float(cell.replace("d", "e"))
    rows[12][1] = cell
    assert read(text_of(rows))["temperature"].iloc[12] == value
    assert float(correct(text_of(rows)).rows[12][1]) == value
    rows[12][3], rows[12][1] = cell, CLEAN[12][1]
    row = correct(text_of(rows)).rows[12]
    if value >= OVERLOAD:
        assert row[4] == "" and "sentinel" in row
    else:
        assert float(row[4]) == value - float(row[5])  # corrected is the reading less the bias


LINES = {
    "a field more": lambda line: line.replace(b",", b",7,", 1),
    "an empty field more": lambda line: line + b",",
    "a field less": lambda line: line.split(b",", 1)[1],
    "two fields": lambda line: b"one,two",
    "commas and a letter": lambda line: b",x" + b"," * 7,
    "semicolons": lambda line: line.replace(b",", b";"),
    "an open quote": lambda line: b'"' + line,
    "a quote over two lines": lambda line: line.replace(b",", b',"', 1).replace(b"T", b"\n", 1),
    "two lines with only a carriage return between": lambda line: b"7\r" + line[20:],
    "Latin-1": lambda line: line.replace(b",", b"\xb0,", 1),
    "UTF-16": lambda line: line.decode().encode("utf-16"),
    "a long field in quotes": lambda line: b'"' + b"y" * 140_000 + b'",1,2,3',
    "text": lambda line: b"no comment",
}


@pytest.mark.parametrize("name", LINES)
def test_a_line_that_is_no_row_is_named_and_moves_no_other(name, correct, read, model_path):
    content = text_of(CLEAN[:30]).splitlines()
    content[13] = LINES[name](content[13])
    spoiled = b"\n".join(content) + b"\n"
    shown = correct(spoiled)
    assert shown.status == 1 and "line 14" in shown.err
    check(shown, CLEAN[:12] + CLEAN[13:30], model_path)
    with pytest.raises(RecordError, match=r"line 14|zero byte"):
        read(spoiled)


@pytest.mark.parametrize("change", [-1, 1])
def test_rows_that_all_differ_from_the_header_are_no_index_in_front(change, correct, read):
    rows = [["7", *row] if change > 0 else row[:-1] for row in CLEAN[:30]]
    shown = correct(text_of(rows))
    assert shown.status == 1 and shown.rows == [] and "30 lines left out" in shown.err
    with pytest.raises(RecordError, match=r"one field (more|less) than the header|are not rows|No two lines"):
        read(text_of(rows))


GOOD_FILES = {
    "line ends of Windows": lambda text: text.replace(b"\n", b"\r\n"),
    "a byte-order mark": lambda text: b"\xef\xbb\xbf" + text,
    "empty lines": lambda text: text.replace(b"\n", b"\n\n").replace(b"\n\n", b"\n", 1),
    "a comment": lambda text: text.replace(b"\n", b"\n# a comment, with a comma\n", 7),
    "a header that comes again": lambda text: text.replace(b"2024-03-04T00:10", text_of([]) + b"2024-03-04T00:10", 1),
    "everything in quotes": lambda text: b'"' + text.replace(b",", b'","').replace(b"\n", b'"\n"').removesuffix(b'"'),
}


@pytest.mark.parametrize("name", GOOD_FILES)
def test_what_is_no_damage_is_read(name, correct, read, model_path):
    content = GOOD_FILES[name](text_of(CLEAN[:30]))
    shown = correct(content)
    assert shown.status == 0 and shown.err == ""
    check(shown, CLEAN[:30], model_path)
    assert read(content)["temperature"].tolist() == [float(row[1]) for row in CLEAN[:30]]


BAD_FILES = {
    "nothing": b"",
    "line ends": b"\n\n\n",
    "blanks": b" \n \n",
    "a byte-order mark alone": b"\xef\xbb\xbf",
    "a name twice": text_of(CLEAN, ["time", "temperature", "temperature", "reading"]),
    "no header": text_of(CLEAN[1:], CLEAN[0]),
    "an open quote in the header": b'"' + text_of(CLEAN),
    "no line end": b"time,temperature,humidity,reading",
    "a header of a megabyte": b"time," + b"x," * 600_000 + b"\n" + text_of(CLEAN),
}


@pytest.mark.parametrize("name", BAD_FILES)
def test_a_file_that_is_no_log_is_refused_in_a_sentence(name, correct, tmp_path, capsys):
    shown = correct(BAD_FILES[name])
    assert shown.status == 2 and shown.rows == [] and shown.err.count("\n") == 1 and len(shown.err) < 900
    begin = time.process_time()
    assert main(["analyze", str(tmp_path / "log.csv"), "--reading", "reading"]) == 2
    printed = capsys.readouterr()
    assert printed.out == "" and printed.err.startswith("thermocorr: error: ") and printed.err.count("\n") == 1
    assert time.process_time() - begin < 5.0


def test_a_file_cut_anywhere_gives_its_whole_lines(correct, read, model_path):
    content = text_of(CLEAN[:4])
    for cut in range(len(text_of([])), len(content) + 1, 17):
        whole = content[:cut].count(b"\n") - 1
        shown = correct(content[:cut])
        torn = not content[:cut].endswith(b"\n")
        assert shown.status == 0 and ("the last line is left out" in shown.err) == torn
        if whole > 1:
            check(shown, CLEAN[:whole], model_path)
            log = read(content[:cut])
            assert len(log) == whole and any("is left out" in note for note in log.attrs["notes"]) == torn


NO_TIMES = [
    "8024-03-04T00:20:30", "2262-04-12T00:00:00", "1677-01-01T00:00:00", "9999-12-31T23:59:59", "10000-01-01T00:00:00",
    "2024-03-04T24:20:30", "2024-02-30T00:00:00", "2024-13-01T00:00:00", "now", "today", "NaT",
    "2024-W10-1", "00:20:30", "04.03.2024 00:20", "1709512800", "", "NA", "nan", "0 days 00:20:30",
    "2024-03-04T00:20:30+01:00", "2024-03-04T00:20:30 Europe/Paris", "2024-03-04T00:20:30Z",
]  # fmt: skip


@pytest.mark.parametrize("cell", NO_TIMES)
def test_a_time_that_is_none_is_left_out_line_by_line_and_refused_in_a_file(cell, correct, read, model_path):
    rows = [list(row) for row in CLEAN[:30]]
    rows[20][0] = cell
    shown = correct(text_of(rows))
    assert shown.status == 1 and "thermocorr: line 22 is left out" in shown.err
    check(shown, rows[:20] + rows[21:], model_path)
    with pytest.raises(RecordError, match="line 22"):
        read(text_of(rows))


def test_zones_that_change_with_the_season_are_one_clock(read):
    rows = [[f"2024-10-27T02:{k % 60:02}:00{'+02:00' if k < 60 else '+01:00'}", *CLEAN[k % 60][1:]] for k in range(120)]
    assert read(text_of(rows)).index.equals(pd.date_range("2024-10-27", periods=120, freq="min", tz="UTC"))


def test_two_damaged_years_do_not_end_a_stream(correct, model_path):
    """2094 is believed until the next row tells; 8024 is no time at all."""
    rows = [list(row) for row in CLEAN]
    rows[45][0], rows[50][0] = rows[45][0].replace("2024", "2094"), rows[50][0].replace("2024", "8024")
    shown = correct(text_of(rows))
    assert "line 52 is left out" in shown.err and shown.rows[45][-1] == "suspect time"
    good = [k for k in range(ROWS) if k not in (45, 50)]
    frame = frame_of([CLEAN[k] for k in good])
    expected = load_model(model_path).correct(frame[HEADER[:3]], frame["reading"])
    got = [float(row[4]) for k, row in enumerate(shown.rows) if k != 45]
    np.testing.assert_allclose(got, expected, rtol=1e-12)


@pytest.mark.parametrize("spans", [False, True])
def test_a_stream_of_seconds_survives_a_time_that_none_can_be(spans, correct, tmp_path):
    frame = frame_of(CLEAN).assign(time=60.0 * np.arange(ROWS))
    known = frame.assign(time=pd.to_timedelta(frame["time"], unit="s")) if spans else frame
    model = DynamicBiasRegressor("temperature", [600.0], time="time").fit(known[HEADER[:2]][:40], known["reading"][:40])
    path = save_model(model, tmp_path / "s.json")
    rows = [[str(60 * k), *row[1:]] for k, row in enumerate(CLEAN)]
    shown = correct(text_of([["1e40", *rows[40][1:]], *rows[41:]]), model=path)
    assert shown.status in (0, 1), shown.err
    assert [row[-1] for row in shown.rows][-1] == ""
    expected = model.correct(known[HEADER[:2]][41:], known["reading"][41:])
    np.testing.assert_allclose([float(row[4]) for row in shown.rows[-19:]], expected, rtol=1e-12)


@pytest.mark.parametrize("cell", ["-1e400", "1e309", "9" * 400])
def test_a_column_that_is_not_used_may_hold_what_no_number_holds(cell, tmp_path, capsys):
    rows = [[*row, cell if k == 12 else "1.50" if k % 2 else "NA"] for k, row in enumerate(CLEAN)]
    (tmp_path / "log.csv").write_bytes(text_of(rows, [*HEADER, "more"]))
    options = ["--reading", "reading", "--time-constants", "10min", "--out", str(tmp_path)]
    assert main(["analyze", str(tmp_path / "log.csv"), *options]) == 0


def test_a_log_with_a_tenth_of_its_temperatures_missing_is_analysed(tmp_path, capsys):
    rows = [[row[0], "" if k % 10 == 3 else row[1], *row[2:]] for k, row in enumerate(CLEAN)]
    (tmp_path / "log.csv").write_bytes(text_of(rows))
    assert main(["analyze", str(tmp_path / "log.csv"), "--reading", "reading", "--time-constants", "10min"]) == 0
    assert "6 rows of 60 have a missing value" in capsys.readouterr().out

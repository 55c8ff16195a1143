"""The most telling logs that random ones have led to; model files, states and Parquet files are in `corpus`.

`benchmarks/fuzz.py` looks for more. Every case says what must come of it: a sentence, a row that is named, or the very
number that Python's own `float` reads.
"""

import time
from contextlib import nullcontext

import numpy as np
import pandas as pd
import pytest
from corpus.clean_log import CLEAN, HEADER, ROWS, Shown, check, frame_of, save_fitted, text_of

from thermocorr import DynamicBiasRegressor, RecordError, RecordWarning, load_model, save_model
from thermocorr.command.cli import main
from thermocorr.equations.sensor_artefacts import OVERLOAD
from thermocorr.foreign import read_log
from thermocorr.records.read import Layout, read_record


@pytest.fixture(scope="module")
def model_path(tmp_path_factory):
    return save_fitted(tmp_path_factory.mktemp("model") / "m.json")


@pytest.fixture
def correct(model_path, tmp_path, capsys):
    """Function that gives a log to `correct`."""
    return lambda content, *options, model=model_path: Shown(tmp_path, content, options, model, capsys)


@pytest.fixture
def read(tmp_path):
    """Function that reads a log as `analyze` does: temperature, reading and times."""

    def run(content):
        (tmp_path / "log.csv").write_bytes(content)
        frame = read_log(tmp_path / "log.csv").frame
        return read_record(frame.drop(columns="reading"), Layout("temperature", "time"), y=frame["reading"])

    return run


NO_NUMBERS = [
    "1_000", "0x10", "1e400", "1e160", "-1e308", "1.0000001e40", "9" * 41, "2,5", "1.2.3",
    "\uff12\uff11.\uff15", "\u0662\u0661", "2\uff11", "\u00b2\u00b9", "\x1d3.1", "3.1\x1d", "\u20093.1",
    "\ufeff21", "e5", "1e", ".", "--1", "1d5", "21 C", "1j", "yes", "True", "none", "1.#INF",
]  # fmt: skip


@pytest.mark.parametrize("column", ["temperature", "reading"])
@pytest.mark.parametrize("cell", NO_NUMBERS)
def test_a_cell_that_is_no_number_is_refused_by_both_commands(cell, column, correct, read, model_path):
    rows = [list(row) for row in CLEAN[:30]]
    rows[12][HEADER.index(column)] = cell
    shown = correct(text_of(rows))
    assert shown.status == 1 and shown.named == [14]
    check(shown, rows[:12] + rows[13:], model_path)
    with pytest.raises(RecordError, match="row 12"):
        read(text_of(rows))


@pytest.mark.parametrize("cell", ["\x0b21", "21\x0c", "21\n", "\r21"])
@pytest.mark.parametrize("dtype", [object, "string"])
def test_text_in_a_frame_has_the_grammar_of_a_file(cell, dtype):
    """Pandas reads a number behind a vertical tab; a line of a file that holds one is left out."""
    X = pd.DataFrame({"temperature": pd.Series(["20.5", " 21", "20.8", cell, *map(str, range(40))], dtype=dtype)})
    with pytest.raises(RecordError, match="not a number in row 3"):
        DynamicBiasRegressor("temperature", ["5 min"]).fit(X, np.arange(44.0))


@pytest.mark.parametrize("cell", ["\x0b21", "\x0c21"])
def test_only_blanks_and_tabs_are_blanks(cell, correct, read):
    rows = [list(row) for row in CLEAN[:30]]
    rows[12][1] = cell
    assert correct(text_of(rows)).named == [14]
    with pytest.raises(RecordError, match="line 14"):
        read(text_of(rows))


@pytest.mark.parametrize("cell", ["1_000", "\uff12\uff11", "1e160", "True"])
def test_a_whole_column_of_them_is_refused_too(cell, read):
    """A reader that guesses types may take a column for what it takes no cell for."""
    with pytest.raises(RecordError):
        read(text_of([[row[0], cell, *row[2:]] for row in CLEAN]))


MISSING = [
    "", " ", "\t", "NA", " NA ", "N/A", "n/a", "#N/A", "#N/A N/A", "#NA", "<NA>", "NULL", "null", "None", "NaN", "nan",
    "-nan", "-NaN", "1.#IND", "-1.#IND", "1.#QNAN", "-1.#QNAN",
]  # fmt: skip


@pytest.mark.parametrize("cell", MISSING)
def test_a_missing_number_is_one_for_both_commands(cell, correct, read):
    rows = [list(row) for row in CLEAN[:30]]
    rows[7][1], rows[20][3] = cell, cell
    shown = correct(text_of(rows))
    assert shown.status == 0 and [row[-1] for row in shown.rows][7] == "no temperature"
    assert [row[-1] for row in shown.rows][20] == "no reading"
    record = read(text_of(rows))
    assert np.flatnonzero(np.isnan(record.columns["temperature"])).tolist() == [7]
    assert np.flatnonzero(np.isnan(record.reading)).tolist() == [20]
    assert [(segment.start, segment.stop) for segment in record.segments] == [(0, 30)]
    assert record.skipped.tolist() == [7]


@pytest.mark.parametrize("cell", ["-1e400", "1e309", "9" * 400])
def test_a_column_that_is_not_used_keeps_a_cell_that_no_number_holds(cell, tmp_path, capsys):
    rows = [[*row, cell if k == 12 else "1.50" if k % 2 else "NA"] for k, row in enumerate(CLEAN)]
    (tmp_path / "log.csv").write_bytes(text_of(rows, [*HEADER, "more"]))
    options = ["--reading", "reading", "--time-constants", "10min", "--out", str(tmp_path)]
    assert main(["analyze", str(tmp_path / "log.csv"), *options]) == 0
    shown = pd.read_csv(tmp_path / "corrected.csv", dtype=str, keep_default_na=False)["more"]
    assert shown[12] == cell and set(shown[[0, 1]]) == {"", "1.50"}


def test_a_log_with_a_tenth_of_its_temperatures_missing_is_analysed(tmp_path, capsys):
    rows = [[row[0], "" if k % 10 == 3 else row[1], *row[2:]] for k, row in enumerate(CLEAN)]
    (tmp_path / "log.csv").write_bytes(text_of(rows))
    options = ["--reading", "reading", "--time-constants", "10min"]
    assert main(["analyze", str(tmp_path / "log.csv"), *options]) == 0
    assert "6 rows of 60 have a missing value" in capsys.readouterr().out


NUMBERS = [
    "21.5", " 21.5 ", "\t21.5", "+21.5", "2.15e1", "2.15E+01", "21.", "0021.5", "20.100000000000000000000000000001",
    "20.10000000000000142108547152020037174224853515625", "20.1000000000000014210854715202003717422485351562500001",
    "-0", "5e-324", "1e-400", "9007199254740993", "18446744073709551615", "18446744073709551616", "1e40",
    "123456789012345678901234567890",
]  # fmt: skip


@pytest.mark.parametrize("cell", NUMBERS)
def test_a_number_keeps_every_digit(cell, read, correct):
    rows = [list(row) for row in CLEAN[:30]]
    rows[12][1] = cell
    assert read(text_of(rows)).columns["temperature"][12] == float(cell)
    shown = correct(text_of(rows))
    assert shown.status == 0 and shown.rows[12][1] == cell
    rows[12][3], rows[12][1] = cell, CLEAN[12][1]
    row = correct(text_of(rows)).rows[12]
    if float(cell) >= OVERLOAD:
        assert row[4] == "" and "sentinel" in row
    else:
        assert float(row[4]) == float(cell) - float(row[5])  # corrected is the reading less the bias


LINES = {
    "a field more": lambda line: line.replace(b",", b",7,", 1),
    "a field more, at the end": lambda line: line + b",7",
    "an empty field more": lambda line: line + b",",
    "a field less": lambda line: line.split(b",", 1)[1],
    "two fields": lambda line: b"one,two",
    "a blank": lambda line: b" ",
    "commas": lambda line: b"," * 7,
    "semicolons": lambda line: line.replace(b",", b";"),
    "an open quote": lambda line: b'"' + line,
    "a quote over two lines": lambda line: line.replace(b",", b',"', 1).replace(b"T", b"\n", 1),
    "text behind a quote": lambda line: line.replace(b",", b'"x",', 1).replace(b"2024", b'"2024', 1),
    "a zero byte": lambda line: line + b"\x00",
    "a carriage return": lambda line: line.replace(b",", b"\r,", 1),
    "two lines with only a carriage return between": lambda line: line + b"\r" + line,
    "Latin-1": lambda line: line.replace(b",", b"\xb0,", 1),
    "half a character": lambda line: line + b"\xc3",
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
    assert shown.status == 1 and shown.named[0] == 14 and len(shown.named) == 1 + content[13].count(b"\n")
    check(shown, CLEAN[:12] + CLEAN[13:30], model_path)
    with pytest.raises(RecordError, match="line 14: "):
        read(spoiled)


@pytest.mark.parametrize("change", [-1, 1])
def test_rows_that_all_differ_from_the_header_are_no_index_in_front(change, correct, read):
    rows = [["7", *row] if change > 0 else row[:-1] for row in CLEAN[:30]]
    shown = correct(text_of(rows))
    assert shown.status == 1 and shown.rows == [] and shown.named == list(range(2, 22))  # then they are counted
    with pytest.raises(RecordError, match="line 2: it has"):
        read(text_of(rows))


def test_a_time_that_is_none_behind_the_lines_that_are_named_is_counted(correct, model_path):
    rows = [[row[0] + "+01:00" * (5 <= k < 35), *row[1:]] for k, row in enumerate(CLEAN)]
    rows[40][0] = "2024-W10-1"
    shown = correct(text_of(rows))
    assert shown.status == 1 and shown.named == list(range(7, 27)) and "31 lines left out" in shown.err
    check(shown, [*rows[:5], *rows[35:40], *rows[41:]], model_path)


GOOD_FILES = {
    "line ends of Windows": lambda text: text.replace(b"\n", b"\r\n"),
    "a byte-order mark": lambda text: b"\xef\xbb\xbf" + text,
    "empty lines": lambda text: text.replace(b"\n", b"\n\n").replace(b"\n\n", b"\n", 1),
    "a comment": lambda text: text.replace(b"\n", b"\n# a comment, with a comma\n", 7),
    "everything in quotes": lambda text: b'"' + text.replace(b",", b'","').replace(b"\n", b'"\n"').removesuffix(b'"'),
}


@pytest.mark.parametrize("name", GOOD_FILES)
def test_what_is_no_damage_is_read(name, correct, read, model_path):
    content = GOOD_FILES[name](text_of(CLEAN[:30]))
    shown = correct(content)
    assert shown.status == 0 and shown.err == ""
    check(shown, CLEAN[:30], model_path)
    assert read(content).columns["temperature"].tolist() == [float(row[1]) for row in CLEAN[:30]]


BAD_FILES = {
    "nothing": b"",
    "line ends": b"\n\n\n",
    "blanks": b" \n \n",
    "a byte-order mark alone": b"\xef\xbb\xbf",
    "a name twice": text_of(CLEAN, ["time", "temperature", "temperature", "reading"]),
    "the time twice": text_of([[*row, "1"] for row in CLEAN], [*HEADER, "time"]),
    "no header": text_of(CLEAN[1:], CLEAN[0]),
    "an open quote in the header": b'"' + text_of(CLEAN),
    "a zero byte in the header": b"\x00" + text_of(CLEAN),
    "no line end": b"time,temperature,humidity,reading",
}


@pytest.mark.parametrize("name", BAD_FILES)
def test_a_file_that_is_no_log_is_refused_in_a_sentence(name, correct, tmp_path, capsys):
    shown = correct(BAD_FILES[name])
    assert shown.status == 2 and shown.rows == [] and shown.err.count("\n") == 1 and len(shown.err) < 500
    assert main(["analyze", str(tmp_path / "log.csv"), "--reading", "reading"]) == 2
    printed = capsys.readouterr()
    assert printed.out == "" and printed.err.startswith("thermocorr: error: ") and printed.err.count("\n") == 1


def test_a_header_that_comes_again_is_passed_over(correct, read, model_path):
    content = text_of(CLEAN[:10]) + text_of(CLEAN[10:30])
    shown = correct(content)
    assert shown.status == 0
    check(shown, CLEAN[:30], model_path)
    assert read(content).n_rows == 30


def test_a_file_cut_anywhere_gives_its_whole_lines(correct, read, model_path):
    content = text_of(CLEAN[:4])
    start = len(text_of([]))
    for cut in range(start, len(content) + 1, 17):
        whole = content[:cut].count(b"\n") - 1
        shown = correct(content[:cut])
        torn = not content[:cut].endswith(b"\n")
        assert shown.status == 0 and ("the last line is left out" in shown.err) == torn
        if whole > 1:
            check(shown, CLEAN[:whole], model_path)
            with pytest.warns(RecordWarning, match="is left out") if torn else nullcontext():
                assert len(read(content[:cut]).reading) == whole


def test_empty_names_beside_the_names_they_get(read):
    rows = [[*row, "", "x"] for row in CLEAN]
    with pytest.raises(RecordError, match="name"):
        read(text_of(rows, [*HEADER, "", "Unnamed: 4"]))


def test_a_header_of_many_names_takes_no_long_time(read):
    names = [f"c{k}" for k in range(30_000)]
    begin = time.process_time()
    with pytest.raises(RecordError):
        read(text_of([], [*HEADER, *names]))
    assert time.process_time() - begin < 5.0  # a look at every pair of names takes longer


@pytest.mark.parametrize("names", [b"x," * 600_000, b"y" * 1_200_000])
def test_a_header_of_a_megabyte_is_none(names, correct, read):
    content = b"time," + names + b"\n" + text_of(CLEAN)
    shown = correct(content)
    assert shown.status == 2 and "more than 1048576 bytes" in shown.err
    with pytest.raises(RecordError, match="The header, line 1, has more than 1048576 bytes"):
        read(content)


NO_TIMES = [
    "8024-03-04T00:20:30", "2262-04-12T00:00:00", "1677-01-01T00:00:00", "9999-12-31T23:59:59", "10000-01-01T00:00:00",
    "2024-03-04T24:20:30", "2024-03-04T00:20:60", "2024-02-30T00:00:00", "2024-13-01T00:00:00", "now", "today", "NaT",
    "2024", "2024-03", "2024-W10-1", "00:20:30", "04.03.2024 00:20", "1709512800", "", "NA", "nan", "0 days 00:20:30",
    "2024-03-04T00:20:30+01:00", "2024-03-04T00:20:30 Europe/Paris", "2024-03-04T00:20:30.",
    "\uff12\uff10\uff12\uff14-03-04T00:20:30", "2024-03-04T00:2\u0660:30", "2024-03-04_00:20:30", "+2024-03-04T00:20",
]  # fmt: skip


@pytest.mark.parametrize("cell", [*NO_TIMES, "2024-03-04T00:20:30Z"])
def test_a_time_that_is_none_is_refused_by_both_commands(cell, correct, read, model_path):
    rows = [list(row) for row in CLEAN[:30]]
    rows[20][0] = cell
    shown = correct(text_of(rows))
    assert shown.status == 1 and shown.named == [22]
    check(shown, rows[:20] + rows[21:], model_path)
    with pytest.raises(RecordError):
        read(text_of(rows))


def test_times_with_and_without_a_zone_do_not_mix(read):
    """A time without a zone could be any hour: it is not taken for one in UTC."""
    for zone in ("Z", "+02:00"):
        rows = [[row[0] + zone * (k > 20), *row[1:]] for k, row in enumerate(CLEAN)]
        with pytest.raises(RecordError):
            read(text_of(rows))


def test_zones_that_change_with_the_season_are_one_clock(read):
    rows = [[f"2024-10-27T02:{k % 60:02}:00{'+02:00' if k < 60 else '+01:00'}", *CLEAN[k % 60][1:]] for k in range(120)]
    record = read(text_of(rows))
    assert np.diff([record.times.stamp(k) for k in range(120)]).tolist() == [60_000_000_000] * 119
    with pytest.raises(RecordError, match="Time goes backward"):
        read(text_of([[row[0][:-6], *row[1:]] for row in rows]))


def test_two_damaged_years_do_not_end_a_stream(correct, model_path):
    """2094 is believed until the next row tells; 8024 is no time at all."""
    rows = [list(row) for row in CLEAN]
    rows[45][0], rows[50][0] = rows[45][0].replace("2024", "2094"), rows[50][0].replace("2024", "8024")
    shown = correct(text_of(rows))
    assert shown.named == [52] and shown.rows[45][-1] == "suspect time"
    good = [k for k in range(ROWS) if k not in (45, 50)]
    frame = frame_of([CLEAN[k] for k in good])
    expected = load_model(model_path).correct(frame[HEADER[:3]], frame["reading"])
    got = [float(row[4]) for k, row in enumerate(shown.rows) if k != 45]
    np.testing.assert_allclose(got, expected, rtol=1e-12)


def test_a_first_time_of_all_seconds_there_are_does_not_end_a_stream(correct, tmp_path):
    """1e40 less one is 1e40: the first row was called stale, and the second ended the command."""
    frame = frame_of(CLEAN).assign(time=60.0 * np.arange(ROWS))
    model = DynamicBiasRegressor("temperature", [600.0], time="time").fit(frame[HEADER[:2]][:40], frame["reading"][:40])
    path = save_model(model, tmp_path / "s.json")
    rows = [[str(60 * k), *row[1:]] for k, row in enumerate(CLEAN)]
    shown = correct(text_of([["1e40", *rows[40][1:]], *rows[41:]]), model=path)
    assert (shown.status, [row[-1] for row in shown.rows][:2]) == (0, ["suspect time", ""])
    expected = model.correct(frame[HEADER[:2]][41:], frame["reading"][41:])
    np.testing.assert_allclose([float(row[4]) for row in shown.rows[1:]], expected, rtol=1e-12)


def test_spans_in_a_column_of_seconds_are_seconds(correct, tmp_path):
    """A model whose times are spans, and a log that counts seconds."""
    frame = frame_of(CLEAN).assign(time=pd.to_timedelta(60.0 * np.arange(ROWS), unit="s"))
    model = DynamicBiasRegressor("temperature", [600.0], time="time").fit(frame[HEADER[:2]][:40], frame["reading"][:40])
    shown = correct(
        text_of([[str(60 * k), *row[1:]] for k, row in enumerate(CLEAN)]), model=save_model(model, tmp_path / "s.json")
    )
    if shown.status == 0:  # or the rows are left out
        expected = model.correct(frame[HEADER[:2]], frame["reading"])
        np.testing.assert_allclose([float(row[4]) for row in shown.rows], expected, rtol=1e-12)

"""Cells, lines and files of tables: one grammar for every reader, and nothing that does not fit it is guessed at.

Also: Dates are read, and tables written, by pyarrow: what comes out is, cell by cell, what pandas makes of them.
"""

import csv
import io
from unittest.mock import patch

import numpy as np
import pandas as pd
import pytest
from examples import examples
from hypothesis import example, given
from hypothesis import strategies as st

from thermocorr import ParquetLog, RecordError
from thermocorr.records import files as csvlines
from thermocorr.records import times
from thermocorr.records.errors import existing_file
from thermocorr.records.files import check_lines, fields_of, header_of, read_table, require_column
from thermocorr.records.grammar import LARGEST, MISSING, label, number
from thermocorr.records.numbers import as_numbers
from thermocorr.records.times import dates_once
from thermocorr.records.types import kind_of, kind_of_arrow, require_role


def test_the_marks_are_those_of_pandas():
    assert set(pd._libs.parsers.STR_NA_VALUES) == MISSING


def test_switches_are_numbers_of_columns_only():
    for on, off in (("True", "False"), ("TRUE", " FALSE "), ("true", "false"), ("1", " 0 ")):
        assert [number(text, "it", switch=True) for text in (on, off)] == [1, 0]
    switch = pd.Series([True, False])
    assert as_numbers(switch, "The column").tolist() == [True, False]
    for role in ("temperature", "reading"):
        with pytest.raises(RecordError, match="holds true/false where numbers are needed"):
            as_numbers(switch, "It", role)


def test_labels_are_those_of_the_fitted_record():
    assert label("7", [1, 2]) == 7.0 and label("7", ["a"]) == "7" and label("x", [1.5]) == "x"
    assert label("True", [True, False]) is True and label("yes", [True]) == "yes"
    assert label("1_0", [1, 10]) == "1_0" and label("7", []) == "7"
    for text in ("", " NA ", "NULL"):
        with pytest.raises(RecordError, match="no label of its run"):
            label(text, ["a"])


@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_absurd_numbers_are_refused_by_row():
    for value, words in ((1e160, "is 1e\\+160 in row 70000: no measurement"), (-np.inf, "infinity in row 70000")):
        values = np.zeros(80_000)
        values[[3, 70_000]] = np.nan, value
        with pytest.raises(RecordError, match=words):
            as_numbers(values, "The reading y", "reading")
    with pytest.raises(RecordError, match="infinity in row 0"):
        as_numbers(np.array([np.inf, 1.0]), "It")
    assert as_numbers(np.array([LARGEST, -LARGEST, np.nan]), "It")[0] == LARGEST
    assert as_numbers(np.array([3e38, np.nan], np.float32), "It").dtype == np.float32
    with pytest.raises(RecordError, match="infinity in row 1"):
        as_numbers(np.array([1, np.inf], np.float32), "It")


@pytest.mark.parametrize(
    ("line", "fields"),
    [
        (b"1,2\n", ["1", "2"]), (b"1,2\r\n", ["1", "2"]), (b"1,2", ["1", "2"]), (b"\n", []), (b"\r\n", []), (b"", []),
        (b" \n", [" "]), (b",\n", ["", ""]), (b'"a,b",2\n', ["a,b", "2"]), (b'"a""b",2\n', ['a"b', "2"]),
        ("Ω,µ\n".encode(), ["Ω", "µ"]), (b'a"b,c\n', ['a"b', "c"]),
    ],
)  # fmt: skip
def test_fields_of_a_line(line, fields):
    assert fields_of(line) == fields


def test_headers():
    assert header_of(b"\xef\xbb\xbfa,b\r\n") == ["a", "b"]
    assert header_of(b",a,\n") == ["", "a", ""]
    assert header_of(b"a,b,a\n") == ["a (column 1)", "b", "a (column 3)"]
    for line, words in (
        (b"\n", "Line 1 is empty"), (b"1.5,2\n", "is a row already.*Write a line with the names"),
        (b"a;b\n", "semicolons or tabs"), (b"a\tb\n", "tabs"),
        (b"\xff\xfea\x00\n", "The header, line 1, cannot be read"),
    ):  # fmt: skip
        with pytest.raises(RecordError, match=words):
            header_of(line)


@examples(300)
@given(
    st.lists(st.text(alphabet='1,."\r\n a', max_size=8) | st.sampled_from(["1,2", "3,4\r"]), min_size=1, max_size=8),
    st.booleans(),
    st.sampled_from([1, 8, csvlines.BLOCK]),
)
@example(["1,2", "3,4,5"], True, 1)
@example(["1,2", "3"], True, 1)
@example(["1,2", '"3,4"'], True, 8)
@example(["1,2", "", "3,4"], False, 8)
@example(["1,2", "\r", "3,4"], True, 8)
@example(["1,2\r", "3,\r4"], True, 8)
@example(["1,2,3", "4"], True, 8)
def test_lines_are_counted_as_by_the_csv_module(lines, ended, block):
    """Where every line has two fields for Python's csv module, all are rows; else the first other one is named."""
    lines = [part for line in lines for part in line.split("\n")]
    content = "a,b\n" + "\n".join(lines) + ("\n" if ended else "")
    whole = lines if ended else lines[:-1]
    wrong = None
    for k, line in enumerate(whole):
        text = line.removesuffix("\r")
        try:
            fields = next(csv.reader([text], strict=True), []) if "\r" not in text else None
        except csv.Error:
            fields = None
        if fields is None or len(fields) not in (0, 2):
            wrong = k + 2
            break
    with patch.object(csvlines, "BLOCK", block):
        if wrong is None:
            rows, end = check_lines(content.encode(), 2, 4)
            assert rows == sum(bool(line.removesuffix("\r")) for line in whole)
            assert content[:end] == "a,b\n" + "".join(f"{line}\n" for line in whole)
        else:
            with pytest.raises(RecordError, match=rf"^line {wrong}:"):
                check_lines(content.encode(), 2, 4)


def written(tmp_path, text):
    path = tmp_path / "t.csv"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def test_a_table_is_what_its_lines_say(tmp_path):
    frame = read_table(written(tmp_path, '\ufefft,a,\r\n1,0.1,x\r\n\r\n2,,"y,z"\r\n'))
    assert list(frame.columns) == ["t", "a", "Unnamed: 2"]
    assert frame["a"].iloc[0] == 0.1 and np.isnan(frame["a"].iloc[1]) and frame.iloc[1, 2] == "y,z"


def test_files_that_are_none(tmp_path):
    for path, words in ((tmp_path, "is a folder"), (tmp_path / "none.csv", "There is no file"), ("a\0b", "cannot be")):
        with pytest.raises(RecordError, match=words):
            existing_file(path)
    with pytest.raises(RecordError, match="no column 'z' for --time; there are 'x'"):
        require_column(["x"], "z", "time")


@pytest.mark.parametrize(
    ("values", "kind", "roles"),
    [
        (pd.Series([1.0]), "number", {"temperature", "reading", "column", "time", "label"}),
        (np.array([1], np.uint8), "number", {"temperature", "reading", "column", "time", "label"}),
        (pd.Series([True]), "switch", {"column", "label"}),
        (pd.Series(["a"]), "text", {"temperature", "reading", "column", "time", "label"}),
        (pd.Series(pd.to_datetime(["2024-01-01"])), "date", {"time", "label"}),
        (pd.Series(pd.to_timedelta(["1 s"])), "span", {"time", "label"}),
        (np.array([1j]), "complex", set()),
    ],
    ids=["float", "uint8", "bool", "text", "date", "span", "complex"],
)
def test_the_table_of_types(values, kind, roles):
    assert kind_of(values) == kind
    for role in ("temperature", "reading", "column", "time", "label"):
        if role in roles:
            require_role(kind, role, "It", str(values.dtype))
        else:
            with pytest.raises(RecordError, match=r"^It holds"):
                require_role(kind, role, "It", str(values.dtype))


def test_arrow_types_are_named_as_arrow_names_them():
    pa = pytest.importorskip("pyarrow", reason="Parquet needs pyarrow: pip install '.[parquet]'")
    kinds = {
        "number": [pa.int8(), pa.uint64(), pa.float16(), pa.float32(), pa.float64(), pa.decimal128(9, 2), pa.null()],
        "switch": [pa.bool_()],
        "date": [pa.timestamp("us"), pa.timestamp("ns", "UTC"), pa.date32(), pa.date64()],
        "span": [pa.duration("ms")],
        "text": [pa.string(), pa.large_string(), pa.dictionary(pa.int32(), pa.string())],
        "other": [pa.list_(pa.int8()), pa.struct([("a", pa.int8())]), pa.binary(), pa.time32("s")],
    }
    for kind, types in kinds.items():
        assert {kind_of_arrow(str(of)) for of in types} == {kind}


@pytest.mark.parametrize("unit", ["s", "ms", "us", "ns"])
def test_both_readers_of_parquet_agree(tmp_path, unit):
    pytest.importorskip("pyarrow", reason="Parquet needs pyarrow: pip install '.[parquet]'")
    frame = pd.DataFrame(
        {
            "t": pd.date_range("2024-01-01", periods=4, freq="1s").as_unit(unit),
            "u": np.array([5, 4, 3, 2], np.uint64),
            "x": np.array([1.5, np.nan, 3.5, 4.5], np.float32),
            "on": [True, False, True, None],
            "run": ["a", "a", "b", "b"],
        }
    )
    frame.to_parquet(tmp_path / "t.parquet")
    log, table = ParquetLog(tmp_path / "t.parquet"), read_table(tmp_path / "t.parquet")
    for name in ("u", "x", "on"):
        np.testing.assert_array_equal(np.asarray(log[name]), as_numbers(table[name], name))
    assert log["run"][:].tolist() == table["run"].tolist()
    assert (np.diff(np.asarray(log.times("u").ticks[:])) == -1.0).all()  # unsigned steps do not wrap
    assert log.times("t").stamp(2) == pd.Timestamp("2024-01-01 00:00:02").value
    with pytest.raises(RecordError, match="holds times"):
        as_numbers(log["t"], "It", "temperature")
    for name in ("on",):
        with pytest.raises(RecordError, match="true/false"):
            log.times(name)


pytest.importorskip("pyarrow", reason="long CSV files are read by pyarrow: pip install '.[parquet]'")
pandas_3 = pytest.mark.skipif(int(pd.__version__.split(".")[0]) < 3, reason="pandas before 3 keeps text otherwise")

FORMS = (
    "2024-01-01", "2024-01-01 10", "2024-01-01T10:20", "2024-01-01 10:20:30.1", "2024-01-01T10:20:30.123456",
    "2024-01-01 10:20:30.123456789", "2024-01-01T10:20:30Z", "2024-01-01T10:20:30+02:00", "2024-01-01T10:20:30+0200",
    "2024-01-01T10Z", "2024-01-01Z", "2024-01-01 10:20:30 Z", "20240101T102030", "2024-01", "2024-1-1", "2024-02-30",
    "2024-01-01 24:00", "0001-01-01", "9999-12-31", "2024-01-01t10:20:30", "2024-W01-1", "2024-01-01T10:20:30+24:00",
)  # fmt: skip


@pandas_3
@pytest.mark.parametrize("form", FORMS)
def test_dates_are_those_of_pandas(form, monkeypatch):
    for usual in ("2024-01-01 00:00:00", "2024-01-01T00:00:00Z"):
        text = pd.Series([usual, None, form, usual], index=[3, 4, 7, 9], name="time")
        monkeypatch.setattr(times, "MANY", 1 << 60)
        want = dates_once(text)
        monkeypatch.setattr(times, "MANY", 1)
        got = dates_once(text)
        pd.testing.assert_series_equal(got, want, check_exact=True)


def table_to_write(n=12_000):
    """Numbers of every size, whole ones, gaps, switches and text."""
    rng = np.random.default_rng(0)
    return pd.DataFrame(
        {
            "time": pd.Series([f"2024-01-01 00:{k // 60 % 60:02d}:{k % 60:02d}" for k in range(n)]),
            "any, size": rng.integers(0, 2**64, n, dtype=np.uint64).view(float),
            "whole": np.where(rng.uniform(size=n) < 0.1, np.nan, np.round(1e3 * rng.normal(size=n))),
            "small": 1e-5 * rng.normal(size=n),
            "count": np.arange(n) - 5,
            "on": rng.uniform(size=n) < 0.5,
            "flag": np.where(rng.uniform(size=n) < 0.1, "spike", ""),
        }
    )


@pandas_3
def test_what_is_written_reads_back_to_the_last_bit():
    frame, file = table_to_write(), io.BytesIO()
    assert times.written_by_arrow(frame, file)
    again = pd.read_csv(io.BytesIO(file.getvalue()), keep_default_na=False, na_values=[""])
    by_pandas = pd.read_csv(io.StringIO(frame.to_csv(index=False)), keep_default_na=False, na_values=[""])
    pd.testing.assert_frame_equal(again, by_pandas, check_exact=True)
    known = np.isfinite(frame["any, size"])
    assert (again["any, size"] == frame["any, size"])[known].all()
    assert file.getvalue().splitlines()[0] == b'time,"any, size",whole,small,count,on,flag'


@pandas_3
@pytest.mark.parametrize("cell", ["a,b", 'say "no"', "two\nlines"])
def test_text_that_needs_quotes_is_left_to_pandas(cell):
    frame, file = table_to_write(), io.BytesIO()
    frame.loc[7, "flag"] = cell
    assert not times.written_by_arrow(frame, file)
    assert not file.getvalue()

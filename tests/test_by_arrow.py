"""Long CSV files are read by pyarrow: what comes out is, cell by cell, what pandas makes of them."""

import io
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from thermocorr import RecordError
from thermocorr.records import by_arrow, files
from thermocorr.records.times import dates_once

pytest.importorskip("pyarrow", reason="long CSV files are read by pyarrow: pip install '.[parquet]'")
pandas_3 = pytest.mark.skipif(int(pd.__version__.split(".")[0]) < 3, reason="pandas before 3 keeps text otherwise")

ODD = (
    "1", "2.5", "+4", "+4.5", "1e5", ".5", "5.", "0x1A", "0X1A", "NaN", "nan", "NAN", "Nan", "nan(1)", "inf", "-inf",
    "Infinity", "INF", "1e400", "1e-400", "007", " 5", " 5.5", "5 ", "5.5\t", "", " ", "NA", "null", "True", "true",
    "FALSE", "1_000", "1d5", "1e", "--5", "9223372036854775808", "18446744073709551615", "99999999999999999999",
    "0.1234567890123456789", "123456789012345678", "4.9406564584124654e-324", "1.7976931348623159e308", '"5"', '"5.5"',
    '"a,b"', '"a""b"', "é", "2024-01-01", "12:30", "-0", "-0.0", "1.5.2", "1.#IND", "\u22125", "\u0663",
)  # fmt: skip
FORMS = (
    "2024-01-01", "2024-01-01 10", "2024-01-01T10:20", "2024-01-01 10:20:30.1", "2024-01-01T10:20:30.123456",
    "2024-01-01 10:20:30.123456789", "2024-01-01T10:20:30Z", "2024-01-01T10:20:30+02:00", "2024-01-01T10:20:30+0200",
    "2024-01-01T10Z", "2024-01-01Z", "2024-01-01 10:20:30 Z", "20240101T102030", "2024-01", "2024-1-1", "2024-02-30",
    "2024-01-01 24:00", "0001-01-01", "9999-12-31", "2024-01-01t10:20:30", "2024-W01-1", "2024-01-01T10:20:30+24:00",
)  # fmt: skip


def found(content, long, monkeypatch):
    """The table or the refusal, and whether pyarrow read it."""
    taken = []

    def noted(*given):
        taken.append(by_arrow.table_by_arrow(*given))
        return taken[-1]

    monkeypatch.setattr(files, "LONG", 1 if long else 1 << 60)
    monkeypatch.setattr(files, "HEAD", 400)
    monkeypatch.setattr(files, "table_by_arrow", noted)
    try:
        return files.csv_table(content, Path("log.csv")), any(frame is not None for frame in taken)
    except RecordError as error:
        return str(error), False


@pandas_3
@pytest.mark.parametrize("usual", ["1", "2.5", "text", ""])
def test_whatever_stands_in_a_cell_is_read_as_by_pandas(usual, monkeypatch):
    by_it = 0
    for odd in ODD:
        rows = [f"t{i},{usual},{i}" for i in range(100)] + [f"tx,{odd},7"] + [f"t{i},{usual},{i}" for i in range(5)]
        content = ("time,a,b\n" + "\n".join(rows) + "\n").encode()
        (got, fast), (want, _) = found(content, True, monkeypatch), found(content, False, monkeypatch)
        by_it += fast
        if isinstance(want, str):
            assert got == want, odd
            continue
        pd.testing.assert_frame_equal(got, want, check_exact=True, obj=odd)
        assert all(np.array_equal(np.signbit(got[c]), np.signbit(want[c])) for c in got.select_dtypes(float)), odd
    assert by_it > 5


@pytest.mark.parametrize("ends", ["\n", "\r\n"])
def test_line_ends_empty_lines_and_quotes(ends, monkeypatch):
    rows = [f'2024-01-01 00:{i % 60:02d},"{i}.5",{i}' for i in range(200)]
    rows[120:120] = ["", ""]
    content = ends.join(["time,a,b", *rows, ""]).encode()
    (got, _), (want, _) = found(content, True, monkeypatch), found(content, False, monkeypatch)
    pd.testing.assert_frame_equal(got, want)


@pandas_3
@pytest.mark.parametrize("form", FORMS)
def test_dates_are_those_of_pandas(form, monkeypatch):
    for usual in ("2024-01-01 00:00:00", "2024-01-01T00:00:00Z"):
        text = pd.Series([usual, None, form, usual], index=[3, 4, 7, 9], name="time")
        monkeypatch.setattr(by_arrow, "MANY", 1 << 60)
        want = dates_once(text)
        monkeypatch.setattr(by_arrow, "MANY", 1)
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
    assert by_arrow.written_by_arrow(frame, file)
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
    assert not by_arrow.written_by_arrow(frame, file)
    assert not file.getvalue()

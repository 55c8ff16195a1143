"""Dates are read, and tables written, by pyarrow: what comes out is, cell by cell, what pandas makes of them."""

import io

import numpy as np
import pandas as pd
import pytest

from thermocorr.records import times
from thermocorr.records.times import dates_once

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

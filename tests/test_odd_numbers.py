"""Cells among numbers that are written oddly: words for no value, minus signs of typesetters, dates of sheets."""

from __future__ import annotations

import io

import numpy as np
import pandas as pd
import pytest
from corpus.foreign_logs import TIMES, N, T, U, comma, understood

from thermocorr.command.cli import main


@pytest.mark.parametrize("word", ["OVLD", "O.L", "-OVER", "Out of range", "---", "unavailable", "\u2212"])
def test_words_for_no_value_are_said_and_leave_a_gap(word, written, capsys):
    rows = "".join(f"{60 * k},{T[k]},{word if k in (5, 6) else U[k]}\n" for k in range(N))
    path = written("time,temperature,reading\n" + rows)
    table, _, reading, _ = understood(path)
    assert table.said == (f"2 cells of 'reading' without a value, such as {word!r}",)
    assert np.flatnonzero(np.isnan(reading)).tolist() == [5, 6]
    out = path.parent / "out"
    assert main(["analyze", str(path), "--time-constants", "5min", "--out", str(out), "--quiet"]) == 0
    capsys.readouterr()
    assert main(["correct", str(path), "--model", str(out / "model.json")]) == 0
    shown, analysed = pd.read_csv(io.StringIO(capsys.readouterr().out)), pd.read_csv(out / "corrected.csv")
    assert shown["flag"].fillna("").tolist() == analysed["flag"].fillna("").tolist()
    assert set(shown["flag"][5:7]) == {"no reading"}


@pytest.mark.parametrize("sign", ["\u2212", "\u2013"])
def test_minus_signs_of_typesetters_are_minus_signs(sign, written, capsys):
    cold = np.round(T - 23.1, 3)
    rows = "".join(f"{60 * k},{str(cold[k]).replace('-', sign)},{U[k]}\n" for k in range(N))
    path = written("time,temperature,reading\n" + rows)
    np.testing.assert_array_equal(understood(path)[1], cold)
    out = path.parent / "out"
    assert main(["analyze", str(path), "--time-constants", "5min", "--out", str(out), "--quiet"]) == 0
    capsys.readouterr()
    assert main(["correct", str(path), "--model", str(out / "model.json")]) == 0
    shown, analysed = pd.read_csv(io.StringIO(capsys.readouterr().out)), pd.read_csv(out / "corrected.csv")
    np.testing.assert_allclose(shown["corrected"], analysed["corrected"], rtol=0, atol=1e-9)
    german = "".join(f"{60 * k};{comma(cold[k]).replace('-', sign)};{comma(U[k])}\n" for k in range(N))
    np.testing.assert_array_equal(understood(written("time;temperature;reading\n" + german))[1], cold)


def test_a_sheet_may_have_dates_and_times_in_two_columns(tmp_path):
    pytest.importorskip("openpyxl", reason="spreadsheets need openpyxl: pip install '.[excel]'")
    for date in (TIMES.date, TIMES.normalize()):
        sheet = pd.DataFrame({"Date": date, "Time": TIMES.time, "temperature": T, "reading": U})
        sheet.to_excel(tmp_path / "log.xlsx", index=False)
        _, temperature, reading, seconds = understood(tmp_path / "log.xlsx")
        np.testing.assert_array_equal(seconds, 60.0 * np.arange(N))
        assert (temperature == T).all() and (reading == U).all()

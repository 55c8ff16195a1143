"""Times of logs: what is asked back, what is proposed then, and a model of several files.

Also: Cells among numbers that are written oddly: words for no value, minus signs of typesetters, dates of sheets.
"""

import io

import numpy as np
import pandas as pd
import pytest
from corpus.foreign_logs import TIMES, N, T, U, comma, understood

from thermocorr import DynamicBiasRegressor, RecordError, diagnose
from thermocorr.command.cli import main
from thermocorr.datasets import make_record
from thermocorr.displays import ResidualsDisplay
from thermocorr.effects import Step
from thermocorr.foreign import ForeignTable, HowToRead, with_times
from thermocorr.foreign.clocks import understood as read_times


@pytest.mark.parametrize(
    "cells",
    [
        ("05/03/2024 10:00 AM", "05/03/2024 10:01 PM"),
        ("05/03/2024 10:00", "05/04/2024 10:01"),
        ("05/03/2024", "05/04/2024"),
        ("05/03/2024 10:00:00.250", "05/03/2024 10:00:00.500"),
        ("05/03/2024 10:00:00:000", "05/03/2024 10:00:00:500"),
        ("05/03/2024 10:00:00:000 AM", "05/03/2024 10:00:00:500 AM"),
        ("05/03/2024, 10:00:00 pm", "05/03/2024, 10:01:00 pm"),
    ],
)
def test_the_format_that_is_proposed_reads_the_cells(cells):
    """Whatever the time of day looks like."""
    values = pd.Series(cells, name="time")
    with pytest.raises(RecordError) as told:
        read_times(values)
    form = str(told.value).rsplit("'", 2)[1]
    first = cells[0].replace(":000", "")  # which pandas does not know
    assert read_times(values, form).times.iloc[0] == pd.to_datetime(first, dayfirst=True)


@pytest.mark.parametrize(
    ("name", "unit"),
    [
        ("time_ms", 1e-3), ("Stunden", 3600.0), ("elapsed minutes", 60.0), ("elapsed_min", 60.0), ("time_min", 60.0),
        ("Min", 60.0), ("t/min", 60.0), ("time/min", 60.0), ("t_h", 3600.0), ("elapsed_hr", 3600.0), ("h", 3600.0),
        ("elapsed_d", 86_400.0),
    ],
)  # fmt: skip
def test_a_unit_at_the_end_of_the_name_of_times_counts(name, unit):
    frame = pd.DataFrame({name: [0.0, 10.0, 20.0], "temperature": 1.0})
    read = with_times(ForeignTable(frame=frame), name, HowToRead())
    np.testing.assert_allclose(read.frame[name], unit * frame[name])
    assert "times in" in read.said[0]


@pytest.mark.parametrize("name", ["t", "time", "elapsed", "time_s", "t [s]", "elapsed_sec", "admin", "time/width"])
def test_other_names_of_times_have_seconds(name):
    frame = pd.DataFrame({name: [0.0, 10.0, 20.0], "temperature": 1.0})
    read = with_times(ForeignTable(frame=frame), name, HowToRead())
    assert read.frame[name].equals(frame[name]) and not read.said


@pytest.mark.parametrize("step", [0.5, 1.0, 7.0])
def test_days_of_a_spreadsheet_in_whole_days_are_asked_back(step):
    values = pd.Series(45_442.0 + step * np.arange(50), name="time")
    with pytest.raises(RecordError, match="seconds, or days of a spreadsheet"):
        read_times(values)
    assert read_times(values, "excel").times.iloc[0] == pd.Timestamp("2024-05-30")
    assert read_times(values, "seconds").times.iloc[0] == 45_442.0


def test_seconds_since_1904_are_asked_back():
    values = pd.Series([3.8e9, 3.8e9 + 1.25], name="time")
    with pytest.raises(RecordError, match="--time-format labview"):
        read_times(values)
    assert read_times(values, "labview").times.iloc[1] == pd.Timestamp("2024-05-31T11:33:21.250")


def test_a_model_of_several_files_corrects_one_more(tmp_path, capsys):
    """Each file was a run; the new one is one more, though it has no column of runs."""
    paths = []
    for number, level in enumerate((1000.0, 7000.0)):
        record = make_record(1500, seed=number, start=f"2024-03-{1 + 5 * number:02d}")[["temperature", "reading"]]
        record["reading"] += level
        paths.append(str(tmp_path / f"run{number}.csv"))
        record.to_csv(paths[-1], index_label="time")
    assert main(["analyze", *paths, "--time-constants", "5min,90min", "--out", str(tmp_path / "out")]) == 0
    assert capsys.readouterr().out.count("different levels") <= 1
    analysed = pd.read_csv(tmp_path / "out" / "corrected.csv")
    assert main(["correct", paths[1], "--model", str(tmp_path / "out" / "model.json")]) == 0
    shown = pd.read_csv(io.StringIO(capsys.readouterr().out))
    np.testing.assert_allclose(shown["corrected"], analysed["corrected"][1500:], rtol=0, atol=1e-6)


def test_unix_times_in_seconds_are_shown_as_dates():
    """In pictures, in places of failure and in causes; columns of effects can be named by dates too."""
    record = make_record(3000, seed=4, start="2024-03-04")[["temperature", "reading"]].reset_index(names="time")
    record["time"] = record["time"].astype("datetime64[s]").astype("int64").astype(float)
    record.loc[1500:, "reading"] += 1.0
    X, y = record.drop(columns="reading"), record["reading"]
    model = DynamicBiasRegressor("temperature", ["5 min", "90 min"], time="time").fit(X, y)
    found = diagnose(model, X, y)
    assert found.where.query("aspect == 'time'")["unit"].eq("date").all()
    assert "It happened between 2024-03-05 00:59:00 and 2024-03-05 01:00:00" in " ".join(str(found).split())
    assert ResidualsDisplay.from_estimator(model, X, y).frame()["time"].iloc[0] == pd.Timestamp("2024-03-04")
    by_date = model.set_params(effects=[Step("2024-03-05 01:00:00")]).fit(X, y)
    assert by_date.residual_std_ == pytest.approx(0.2, rel=0.05)
    seconds = X.assign(time=X["time"] - X["time"].iloc[0])
    plain = DynamicBiasRegressor("temperature", ["5 min", "90 min"], time="time").fit(seconds, y)
    assert ResidualsDisplay.from_estimator(plain, seconds, y).frame()["time"].iloc[0] == 0.0


@pytest.mark.parametrize("form", ["%Y-%m-%d %H:%M:%S UTC", "%d.%m.%Y %H:%M GMT"])
def test_utc_behind_times_is_understood(form):
    times = pd.date_range("2024-12-30 10:00", periods=3, freq="min")
    read = pd.to_datetime(read_times(pd.Series(times.strftime(form), name="time")).times)
    assert (read == times.tz_localize("UTC")).all()
    with pytest.raises(RecordError, match="leave out --timezone"):
        read_times(pd.Series(times.strftime(form), name="time"), zone="Europe/Berlin")
    with pytest.raises(RecordError, match="row 1, has no UTC behind it"):
        read_times(pd.Series([times[0].strftime(form), form[:8]], name="time"))


def times_in(form, seconds):
    """Times of a log: numbers of a unit, or text."""
    if form == "clock":
        return pd.to_timedelta(seconds, unit="s").astype(str).str.slice(7)
    if form == "days":
        return pd.to_timedelta(seconds, unit="s").astype(str)
    return seconds // 60.0 if form == "min" else (1_714_982_400_000 + 1000 * seconds).astype("int64")


@pytest.mark.parametrize(
    ("name", "form"), [("time [min]", "min"), ("epoch_ms", "ms"), ("time", "clock"), ("elapsed", "days")]
)
def test_what_is_written_has_the_times_of_the_log_and_is_read_again(name, form, tmp_path, capsys, monkeypatch):
    """The corrected log is analysed as the log was, and corrected alike whole and line by line."""
    record = make_record(1200, seed=2)[["temperature", "reading"]].reset_index(drop=True)
    record.insert(0, name, times_in(form, 60.0 * np.arange(1200)))
    log, out = tmp_path / "log.csv", tmp_path / "out"
    record.to_csv(log, index=False)

    def analysed(path):
        options = ["--time", name, "--time-constants", "5min,90min", "--out", str(out), "--force"]
        assert main(["analyze", str(path), *options]) == 0
        return capsys.readouterr().out.split("readings of")[1].split("Written")[0]

    first, written = analysed(log), tmp_path / "corrected.csv"
    written.write_bytes((out / "corrected.csv").read_bytes())
    assert pd.read_csv(written)[name].equals(pd.read_csv(log)[name])
    for path in (log, written):
        found = []
        for way in ([str(path)], ["-"]):
            if form in ("clock", "ms") and way != [str(path)]:
                continue  # such times are understood from the whole log
            with path.open() as stream:
                monkeypatch.setattr("sys.stdin", stream)
                assert main(["correct", *way, "--model", str(out / "model.json"), "--time", name]) == 0
            shown = capsys.readouterr()
            frame = pd.read_csv(io.StringIO(shown.out))
            found.append(frame["corrected" if path == log else "corrected_thermocorr"])
            assert frame["flag" if path == log else "flag_thermocorr"].isna().all()
            assert ("times in" in shown.err) == (form in ("min", "ms") and way != ["-"])
            assert form == "clock" or pd.read_csv(log)[name].equals(frame[name])
        for other in found:
            np.testing.assert_allclose(other, pd.read_csv(written)["corrected"], rtol=0, atol=1e-9)
    assert analysed(written).split("\n", 1)[0] == first.split("\n", 1)[0]


@pytest.mark.long
@pytest.mark.parametrize("name", [None, "elapsed"])
@pytest.mark.parametrize("spans", [False, True])
def test_the_index_of_a_parquet_log_is_read_again(name, spans, tmp_path, capsys):
    pytest.importorskip("pyarrow", reason="Parquet needs pyarrow: pip install '.[parquet]'")
    record = make_record(1200, seed=2)[["temperature", "reading"]]
    index = record.index - record.index[0] if spans else record.index
    record.set_axis(index).rename_axis(name).to_parquet(tmp_path / "log.parquet")
    again, out = tmp_path / "again.csv", tmp_path / "out"
    options = ["--time-constants", "5min,90min", "--out", str(out), "--force"]
    assert main(["analyze", str(tmp_path / "log.parquet"), *options]) == 0
    again.write_bytes((out / "corrected.csv").read_bytes())
    named = [] if name is None else ["--time", name]
    assert main(["analyze", str(again), *options, *named]) == 0
    assert "1200 readings of 'reading', temperature 'temperature' (degC by their size), a row every 1 min" in (
        capsys.readouterr().out
    )
    assert main(["correct", str(again), "--model", str(out / "model.json"), *named]) == 0
    shown = pd.read_csv(io.StringIO(capsys.readouterr().out))
    np.testing.assert_allclose(shown["corrected_thermocorr"], shown["corrected"], rtol=0, atol=1e-9)


def test_times_of_several_files_are_written_as_they_came(tmp_path, capsys):
    paths = []
    for number in range(2):
        record = make_record(800, seed=number)[["temperature", "reading"]].reset_index(drop=True)
        record.insert(0, "time [min]", 0.1 + np.arange(800.0))
        paths.append(str(tmp_path / f"run{number}.csv"))
        record.to_csv(paths[-1], index=False)
    assert main(["analyze", *paths, "--time-constants", "5min", "--out", str(tmp_path / "out")]) == 0
    written = pd.read_csv(tmp_path / "out" / "corrected.csv")["time [min]"]
    assert written.tolist() == 2 * (0.1 + np.arange(800.0)).tolist()


@pytest.mark.long
@pytest.mark.parametrize("separator", [";", ","])
@pytest.mark.parametrize("behind", ["", "Z", " UTC"])
def test_a_comma_before_the_fraction_of_a_second_is_a_point(separator, behind, tmp_path, capsys):
    """As ISO 8601 allows, and Python's logging writes; quoted where commas stand between the columns."""
    record = make_record(1200, seed=2)[["temperature", "reading"]]
    times = record.index + pd.to_timedelta(37 * (np.arange(1200) % 20), unit="ms")
    record.index = [f"{time:%Y-%m-%d %H:%M:%S},{time.microsecond // 1000:03d}{behind}" for time in times]
    log, out = str(tmp_path / "log.csv"), tmp_path / "out"
    record.to_csv(log, index_label="time", sep=separator)
    assert main(["analyze", log, "--time-constants", "5min", "--out", str(out)]) == 0
    written = pd.read_csv(out / "corrected.csv", parse_dates=["time"])
    assert (written["time"].dt.tz_localize(None).to_numpy() == times.to_numpy()).all()
    capsys.readouterr()
    assert main(["correct", log, "--model", str(out / "model.json")]) == 0
    shown = pd.read_csv(io.StringIO(capsys.readouterr().out))
    np.testing.assert_allclose(shown["corrected"], written["corrected"], rtol=0, atol=1e-9)


@pytest.mark.parametrize("word", ["OVLD", "O.L", "-OVER", "Out of range", "---", "unavailable", "\u2212"])
def test_words_for_no_value_are_said_and_leave_a_gap(word, written, capsys):
    rows = "".join(f"{60 * k},{T[k]},{word if k in (5, 6) else U[k]}\n" for k in range(N))
    path = written("time,temperature,reading\n" + rows)
    table, _, reading, _ = understood(path)
    assert table.said == (f"2 cells of 'reading' without a value, such as {word!r}",)
    assert np.flatnonzero(np.isnan(reading)).tolist() == [5, 6]
    out = path.parent / "out"
    assert main(["analyze", str(path), "--time-constants", "5min", "--out", str(out)]) == 0
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
    assert main(["analyze", str(path), "--time-constants", "5min", "--out", str(out)]) == 0
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

"""What a newcomer meets in the first hour, in Python and on the command line: read as it is meant, or one sentence."""

import warnings

import numpy as np
import pandas as pd
import pytest

from thermocorr import DynamicBiasRegressor, OnlineCorrector, RecordError, RecordWarning, load_model, save_model
from thermocorr.command.cli import main
from thermocorr.datasets import make_record
from thermocorr.effects.grids import since_start
from thermocorr.records import Layout, read_record, seconds_of

ROWS = 1200


@pytest.fixture(scope="module")
def record():
    """A record of a row a minute, with dates as its index."""
    return make_record(ROWS, seed=3)


def as_csv(folder, frame, name="log.csv"):
    path = folder / name
    frame.to_csv(path, index=False)
    return str(path)


def analyze(path, *more):
    return main(["analyze", path, "--time-constants", "5min,90min", *more])


def test_a_column_that_is_named_as_something_else_is_not_the_time(record, tmp_path, capsys):
    log = record.reset_index()[["time", "temperature", "reading"]]
    path, out = as_csv(tmp_path, log.set_axis(["stamp", "T", "t"], axis=1)), tmp_path / "out"
    assert analyze(path, "--temperature", "T", "--reading", "t", "--out", str(out)) == 0
    assert load_model(out / "model.json").form_.clock.columns == ["stamp"]
    named = ("--temperature", "T", "--reading", "reading")
    path = as_csv(tmp_path, log.set_axis(["Time", "T", "reading"], axis=1))
    assert analyze(path, *named, "--out", str(out), "--force") == 0
    assert load_model(out / "model.json").form_.clock.columns == ["Time"]


def test_a_model_whose_temperature_is_called_t_corrects_a_log(record, tmp_path, capsys):
    """The model has its times from an index, and names no column of them."""
    frame = record.rename(columns={"temperature": "t"})
    model = DynamicBiasRegressor("t", ["5 min", "90 min"]).fit(frame[["t"]], frame["reading"])
    save_model(model, tmp_path / "model.json")
    path = as_csv(tmp_path, frame.reset_index()[["t", "time", "reading"]].rename(columns={"time": "stamp"}))
    assert main(["correct", "--model", str(tmp_path / "model.json"), path]) == 0
    corrected = capsys.readouterr().out.splitlines()
    assert len(corrected) == ROWS + 1


@pytest.mark.parametrize("time_constants", ["auto", ["5 min"]])
@pytest.mark.parametrize("timed", [True, False])
def test_a_gap_shorter_than_the_step_is_refused(record, time_constants, timed):
    data, own = (record, {}) if timed else (record.reset_index(drop=True), {"sampling_period": 60})
    said = r"longer than the usual step between rows, which is 1 min: .* Got 10 s. Leave it out, or pass max_gap=180"
    model = DynamicBiasRegressor("temperature", time_constants, max_gap="10 s", **own)
    with pytest.raises(ValueError, match=said):
        model.fit(data[["temperature"]], data["reading"])


def test_temperatures_in_a_few_rows_have_a_step_of_their_own(record):
    """A temperature in every sixth row only: rows that are learned from are six minutes apart."""
    X = record[["temperature"]].where((np.arange(ROWS) % 6 == 0)[:, None])
    with pytest.raises(ValueError, match=r"is 6 min: .* Got 2 min"):
        DynamicBiasRegressor("temperature", ["30 min"], max_gap="2 min").fit(X, record["reading"])


def test_rows_that_are_far_apart_can_be_corrected(record):
    X, y = record[["temperature"]], record["reading"]
    model = DynamicBiasRegressor("temperature", ["5 min"], max_gap="3 min").fit(X, y)
    assert np.isfinite(model.correct(X[::10], y[::10])).all()


@pytest.mark.parametrize(
    ("names", "options", "said"),
    [
        (("no", "a", "b"), (), "columns are the time, the temperature and the reading? Say it with --time, --temp"),
        (("time", "a", "b"), (), "columns are the temperature and the reading? Say it with --temperature, --reading; "),
        (("time", "a", "b"), (), "as likely are 'a', 'b'."),
        (("no", "T_C", "u"), (), "Which column is the time? Say it with --time; there are 'no', 'T_C', 'u'."),
        (("time", "room_degC", "case_degC"), (), "Which column is the reading? Say it with --reading"),
    ],
)
def test_all_columns_that_are_to_be_named_are_asked_for_at_once(names, options, said, record, tmp_path, capsys):
    log = record.reset_index()[["time", "temperature", "reading"]].set_axis(names, axis=1)
    log = log.assign(no="") if names[0] == "no" else log
    assert analyze(as_csv(tmp_path, log), *options) == 2
    assert said in capsys.readouterr().err


@pytest.mark.parametrize("name", ["Datum/Uhrzeit", "ts", "Date and Time"])
def test_more_names_of_times_are_known(name, record, tmp_path):
    log = record.reset_index()[["time", "temperature", "reading"]].rename(columns={"time": name})
    assert analyze(as_csv(tmp_path, log), "--out", str(tmp_path / "out")) == 0
    assert load_model(tmp_path / "out" / "model.json").form_.clock.columns == [name]


def with_unix_times(record, unit):
    ticks = record.index.astype(f"datetime64[{unit}]").astype("int64")
    return record[["temperature"]].reset_index(drop=True).assign(t=ticks), record["reading"].to_numpy()


@pytest.mark.parametrize("unit", ["ms", "us", "ns"])
def test_unix_times_that_are_no_seconds_are_told_from_them(record, tmp_path, unit):
    """The command reads them; Python, which is given times, says how to make dates of them. Both know them alike."""
    X, y = with_unix_times(record, unit)
    model = DynamicBiasRegressor("temperature", ["5 min"], time="t")
    with pytest.raises(RecordError, match=rf"Unix times in {unit}, .* pandas.to_datetime\(..., unit='{unit}'\)"):
        model.fit(X, y)
    dated = model.fit(X.assign(t=pd.to_datetime(X["t"], unit=unit)), y).coef_
    out = tmp_path / "out"
    assert analyze(as_csv(tmp_path, X.assign(reading=y)), "--time", "t", "--reading", "reading", "--out", str(out)) == 0
    assert load_model(out / "model.json").features_.history_.kind == "datetime with time zone"
    seconds, _ = with_unix_times(record, "s")
    np.testing.assert_allclose(model.fit(seconds, y).coef_, dated, rtol=1e-6)  # seconds since 1970 are seconds


def test_numbers_too_large_for_seconds_are_refused(record):
    X, y = with_unix_times(record, "ms")
    X.loc[7, "t"] = 5  # one damaged time, and they are no Unix times by their range
    with pytest.raises(RecordError, match="no seconds, and no Unix times of this century"):
        DynamicBiasRegressor("temperature", ["5 min"], time="t").fit(X, y)


def told(frame, y, **own):
    """What is said of a fit, and the fit."""
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        model = DynamicBiasRegressor("temperature", ["5 min", "90 min"], **own).fit(frame, y)
    return " ".join(str(w.message) for w in said), model


@pytest.mark.parametrize(
    "make",
    [
        lambda index: index.to_period("min"),
        lambda index: index.astype(str),
        lambda index: pd.Index(index.strftime("%Y-%m-%dT%H:%M:%SZ"), dtype="string"),
        lambda index: pd.Index(list(index.to_pydatetime()), dtype=object),
    ],
    ids=["periods", "text", "text with a zone", "datetime objects"],
)
def test_an_index_that_holds_times_is_taken(record, make):
    X, y = record[["temperature"]], record["reading"]
    wanted = told(X, y)[1]
    index = make(record.index)
    said, model = told(X.set_axis(index), y.set_axis(index))
    assert "no times" not in said
    np.testing.assert_array_equal(model.coef_, wanted.coef_)  # the same times
    corrected = model.correct(X.set_axis(index)[700:], y.set_axis(index)[700:])
    np.testing.assert_array_equal(corrected, wanted.correct(X[700:], y[700:]))


def test_an_index_of_dates_with_a_damaged_one_is_refused_by_row(record):
    index = record.index.astype(str).to_list()
    index[5] = "2024-03-04 24:61"
    X = record[["temperature"]].set_axis(pd.Index(index))
    with pytest.raises(RecordError, match="The index cannot be read as a time in row 5: '2024-03-04 24:61'"):
        DynamicBiasRegressor("temperature", ["5 min"]).fit(X, record["reading"].to_numpy())


@pytest.mark.parametrize(
    ("index", "what"),
    [
        (60.0 * np.arange(ROWS), "numbers, 0 to 71940, which are not taken as times: if they are seconds"),
        (
            [f"04.03.2024 {k // 60:02d}:{k % 60:02d}" for k in range(ROWS)],
            "holds '04.03.2024 00:00' and so on, no dates",
        ),
        ([str(20_240_101 + k) for k in range(ROWS)], "holds '20240101' and so on"),
        (pd.MultiIndex.from_product([["a"], range(ROWS)]), "has 2 levels: make columns of them"),
    ],
)
def test_an_index_that_holds_no_times_is_said(record, index, what):
    said, _ = told(record[["temperature"]].set_axis(index), record["reading"].to_numpy())
    assert "The data have no times: rows are taken as 1 s apart" in said and what in said
    assert told(record[["temperature"]].set_axis(index), record["reading"].to_numpy(), sampling_period=60)[0] == ""


def test_numbers_of_rows_are_no_news(record):
    said, _ = told(record[["temperature"]].set_axis(range(40, 40 + ROWS)), record["reading"].to_numpy())
    assert "The data have no times" in said and "The index" not in said


def moved(record, rows, by):
    times = record.index.to_series()
    times.iloc[rows] += pd.Timedelta(by)
    return record[["temperature"]].set_axis(pd.DatetimeIndex(times))


@pytest.mark.parametrize(
    ("rows", "by", "said"),
    [
        (
            slice(-1, None),
            "3650D",
            r"Row 1199 stands far apart .* follows 2024-03-04 19:58:00 in row 1198 after 9.99 y",
        ),
        (slice(-3, None), "3650D", r"Rows 1197 to 1199 stand far apart .* Are their times damaged\? Correct them"),
        (
            slice(0, 1),
            "-3650D",
            r"Row 0 stands far apart .*, and all the others lie within 20 h. Is its time damaged\?",
        ),
    ],
)
@pytest.mark.filterwarnings("ignore::thermocorr.RecordWarning")
def test_rows_whose_time_is_years_away_are_named(record, rows, by, said):
    with pytest.raises(RecordError, match=said):
        DynamicBiasRegressor("temperature").fit(moved(record, rows, by), record["reading"].to_numpy())


@pytest.mark.parametrize("interleaved", [False, True])
def test_a_row_far_ahead_is_named_and_not_the_one_behind_it(record, interleaved):
    X, y = moved(record, slice(58, 59), "3650D"), record["reading"].to_numpy()
    own, row = {}, 58
    if interleaved:  # with a second run, row by row
        X, y = X.loc[X.index.repeat(2)].assign(run=["a", "b"] * ROWS), np.repeat(y, 2)
        own, row = {"run": "run"}, 116
    said = f"Row {row} stands far ahead of the others: 2034-03-02 00:58:00 between 2024-03-04 00:57:00 in row"
    with pytest.raises(RecordError, match=said):
        DynamicBiasRegressor("temperature", ["5 min"], **own).fit(X, y)


def test_a_run_behind_another_is_no_row_far_ahead(record):
    """The times of a second run that is not named begin anew: the last row of the first one is not damaged."""
    X = pd.concat([record[["temperature"]][:700], record[["temperature"]][:500]])
    with pytest.raises(RecordError, match="Time goes backward at row 700"):
        DynamicBiasRegressor("temperature", ["5 min"]).fit(X, np.zeros(ROWS))


@pytest.mark.parametrize(
    ("text", "seconds"),
    [("1 d", 86_400), ("1d 2h", 93_600), ("1.5 D", 129_600), ("2 w", 1_209_600), ("3 H", 10_800), ("4 S", 4),
     ("2 days", 172_800), ("5 min", 300), ("P1DT2H", 93_600), ("1 day 02:00:00", 93_600)],
)  # fmt: skip
def test_spans_are_read_without_a_warning_of_pandas(record, text, seconds):
    """Warnings are errors in tests: pandas 3 warns of "d", "w", "H" and "S"."""
    assert seconds_of(text, "span") == seconds
    read = read_record(record, Layout("temperature"), quiet=True)
    assert since_start(text, read) == seconds
    model = DynamicBiasRegressor("temperature", ["5 min"])
    spans = record[["temperature"]].set_axis(record.index - record.index[0])
    live = OnlineCorrector(model.fit(spans, record["reading"].to_numpy()))
    assert live._stream.clock.stamp(text) == seconds * 10**9


@pytest.mark.parametrize("text", ["5 T", "3 L", "1 d 2 U"])
def test_units_that_only_some_versions_of_pandas_know_are_refused(text):
    with pytest.raises(ValueError, match="must be a positive time: seconds, or a span such as '15 min'"):
        seconds_of(text, "span")


def test_missing_values_are_told_with_column_and_time(record):
    X = record[["temperature", "humidity", "pressure"]].copy()
    X.loc[X.index[[5, 9]], "humidity"] = X.loc[X.index[5], "pressure"] = np.nan
    needed = ["humidity", "pressure"]
    two = (
        "2 rows of 1200 have a missing value, the first is row 5 ('humidity', 'pressure' at 2024-03-04 00:05:00). They"
    )
    assert read_record(X, Layout("temperature"), needed=needed, quiet=True).notes[0].startswith(two)
    seconds = X.reset_index(drop=True).assign(s=60.0 * np.arange(ROWS)).drop(index=9)
    (note,) = read_record(seconds, Layout("temperature", "s"), needed=needed, quiet=True).notes
    one = "1 row of 1199 has a missing value, the first is row 5 ('humidity', 'pressure' at 300 s). It is passed"
    assert note.startswith(one) and "To use its reading too" in note
    rows = read_record(X.reset_index(drop=True), Layout("temperature", sampling_period=60), needed=needed, quiet=True)
    assert "the first is row 5 ('humidity', 'pressure')." in rows.notes[0]


@pytest.mark.parametrize("lost", ["temperature", "humidity"])
def test_of_two_thermometers_the_empty_one_is_named(record, lost):
    X = record[["temperature", "humidity"]].assign(**{lost: np.nan})
    said = f"No row has a number in '{lost}': all 1200 values are missing. Check the column's name"
    with pytest.raises(RecordError, match=said):
        DynamicBiasRegressor(["temperature", "humidity"], ["5 min"]).fit(X, record["reading"])


def test_columns_that_are_known_in_different_rows_are_named_all(record):
    X = record[["temperature", "humidity"]].copy()
    X.iloc[::2, 0] = X.iloc[1::2, 1] = np.nan
    with pytest.raises(RecordError, match=r"in every needed column \('temperature', 'humidity'\): all 1200 rows have"):
        read_record(X, Layout("temperature"), needed=["humidity"])


def test_a_column_of_dates_is_pointed_at():
    """A warning alone, and all time constants were in samples."""
    X = pd.DataFrame(
        {"when": pd.date_range("2024-05-01", periods=300, freq="min"), "temperature": np.sin(np.arange(300.0))}
    )
    with pytest.warns(RecordWarning, match="The column 'when' holds dates: take them with time='when'"):
        DynamicBiasRegressor("temperature", ["5 min"]).fit(X, np.arange(300.0) % 7)


def test_moments_by_clocks_of_two_zones_are_the_same():
    index = pd.date_range("2024-05-01", periods=300, freq="min", tz="UTC")
    X = pd.DataFrame({"temperature": np.sin(np.arange(300.0))}, index)
    y = pd.Series(np.arange(300.0) % 7, index.tz_convert("Europe/Berlin"))
    model = DynamicBiasRegressor("temperature", ["5 min"])
    np.testing.assert_array_equal(model.fit(X, y).coef_, model.fit(X, y.to_numpy()).coef_)

"""Logs as other programs write them: right numbers, or a sentence that says what to pass; nothing silently wrong."""

import contextlib
import gzip
import io
import random
import warnings
import zipfile

import numpy as np
import pandas as pd
import pytest
from corpus.foreign_logs import (
    DAY,
    ENDINGS,
    GOOD,
    LONGER,
    REFUSED,
    TIMES,
    N,
    T,
    U,
    comma,
    plain,
    semicolons,
    understood,
)

from thermocorr import RecordError, RecordWarning
from thermocorr.command.cli import main
from thermocorr.foreign import HowToRead, as_runs, joined, read_log, read_logs
from thermocorr.foreign.values import SOME, nearly_numbers
from thermocorr.records.files import FORMATS, Format
from thermocorr.records.units import unit_of


@pytest.mark.parametrize("name", GOOD)
def test_a_file_is_read_with_its_numbers(name, written):
    content, names = GOOD[name] if isinstance(GOOD[name], tuple) else (GOOD[name], None)
    _, temperature, reading, seconds = understood(written(content, ENDINGS.get(name, "log.csv")), names)
    np.testing.assert_array_equal(temperature, T)
    np.testing.assert_array_equal(reading, U)
    step = 10.0 if name == "seconds" else 60.0
    np.testing.assert_allclose(seconds, step * np.arange(N), atol=2e-3)  # days of a spreadsheet have eight digits


@pytest.mark.newest
@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=[pytest.mark.long] if number % 3 else [])
        for number, name in enumerate(name for name in GOOD if not isinstance(GOOD[name], tuple))
    ],
)
def test_both_commands_read_it_alike(name, written, capsys):
    """`correct` gives the rows of `analyze` whatever program wrote the log."""
    path = written(GOOD[name], ENDINGS.get(name, "log.csv"))
    columns = understood(path)[0].frame.columns
    options = [
        f"--{role}={next(c for c in columns if str(c).lower().startswith(begins))}"
        for role, begins in (("temperature", "temp"), ("reading", ("read", "mess")))
    ]
    out = path.parent / "out"
    assert main(["analyze", str(path), *options, "--time-constants", "5min", "--out", str(out)]) == 0
    assert "Read as:" in capsys.readouterr().out or table_is_plain(name)
    assert main(["correct", str(path), "--model", str(out / "model.json"), *options]) in (0, 1)
    shown = pd.read_csv(io.StringIO(capsys.readouterr().out))
    analysed = pd.read_csv(out / "corrected.csv")
    np.testing.assert_allclose(shown["corrected"], analysed["corrected"], rtol=0, atol=1e-9)


def table_is_plain(name):
    """Whether there is nothing to be said of a file."""
    return name in {
        "commas", "T between date and time", "seconds", "line ends of Windows", "line ends of old Macs",
        "a byte-order mark", "capitals in the header", "units in the header", "a unit behind a slash",
        "comments between rows", "everything in quotes", "a zone in every time",
        "the header again, when the logger restarts", "thousands with commas, in quotes",
    }  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_a_file_that_can_be_read_in_two_ways_or_none_is_refused(name, written):
    content, words = REFUSED[name]
    with pytest.raises(RecordError, match=words):
        understood(written(content, ENDINGS.get(name, "log.csv")))


def test_what_was_understood_is_said(written):
    path = written(semicolons(head="My log\nDatum;Temperatur [°C];Messwert [mV]\n").encode("latin-1"))
    table = understood(path)[0]
    assert table.said == (
        "Windows-1252, as far as one can tell", "separated by semicolons", "decimal comma",
        "1 line before the header", "dates as day, month, year",
    )  # fmt: skip


def test_day_and_month_are_told_apart_by_the_order_of_the_rows(written):
    """Twelve-hour steps through May: read the other way, the rows would step back."""
    seconds = understood(written(plain(DAY, times=LONGER)))[3]
    np.testing.assert_allclose(seconds, 43_200.0 * np.arange(N))


@pytest.mark.parametrize(
    ("name", "said", "first"),
    [
        ("day and month in doubt", {"time_format": "%d/%m/%Y %H:%M:%S"}, "2024-05-06 03:40"),
        ("day and month in doubt", {"time_format": "%m/%d/%Y %H:%M:%S"}, "2024-06-05 03:40"),
    ],
)
def test_the_user_says_which_is_the_day(name, said, first, written):
    table = understood(written(REFUSED[name][0]), **said)[0]
    assert table.frame["time"].iloc[0] == pd.Timestamp(first)


def test_the_user_says_how_numbers_are_written(written):
    path = written(plain().replace(",", ";"))
    np.testing.assert_array_equal(understood(path, separator=";", decimal=".")[1], T)
    path = written("time;temperature;reading\n" + "".join(f"{60 * k};{comma(T[k])};7\n" for k in range(N)))
    np.testing.assert_array_equal(understood(path, separator="semicolon", decimal=",")[1], T)
    for said in ({"separator": "x"}, {"decimal": "'"}):
        with pytest.raises(RecordError, match=r"--sep|--decimal"):
            HowToRead(**said)


def test_numbers_that_are_seconds_stay_seconds(written):
    """A log of seconds that happens to lie where days of a spreadsheet lie says so by its name or its steps."""
    rows = "".join(f"{40_000 + 60 * k},{T[k]},{U[k]}\n" for k in range(N))
    np.testing.assert_allclose(understood(written("time,temperature,reading\n" + rows))[3], 60.0 * np.arange(N))
    rows = "".join(f"{40_000 + k / 10},{T[k]},{U[k]}\n" for k in range(N))
    table, *_, seconds = understood(written("time [s],temperature,reading\n" + rows))
    np.testing.assert_allclose(seconds, np.arange(N) / 10, atol=1e-9)
    assert table.said == ()
    with pytest.raises(RecordError, match="seconds, or days of a spreadsheet"):
        understood(written("time,temperature,reading\n" + rows))
    seconds = understood(written("time,temperature,reading\n" + rows), time_format="seconds")[3]
    np.testing.assert_allclose(seconds, np.arange(N) / 10, atol=1e-9)


def local(zone, first, rows=N, step="10min"):
    """A log in local time."""
    moments = pd.date_range(first, periods=rows, freq=step, tz="UTC").tz_convert(zone)
    values = zip(moments, T, U, strict=False)
    return "time,temperature,reading\n" + "".join(f"{t:%Y-%m-%d %H:%M:%S},{a},{b}\n" for t, a, b in values)


@pytest.mark.parametrize(
    ("zone", "first"),
    [("Europe/Berlin", "2024-10-26 22:00"), ("America/New_York", "2024-11-03 04:00"),
     ("Europe/Berlin", "2024-03-30 23:00"), ("Australia/Lord_Howe", "2024-04-06 13:00"),
     ("Asia/Kolkata", "2024-05-01 00:00")],
)  # fmt: skip
def test_local_times_become_utc_over_the_change_of_summer_time(zone, first, written):
    table, *_, seconds = understood(written(local(zone, first)), timezone=zone)
    np.testing.assert_allclose(seconds, 600.0 * np.arange(N))
    assert table.frame["time"].iloc[0] == pd.Timestamp(first, tz="UTC")


def test_hours_that_clocks_leave_out_or_repeat_are_explained(written):
    for times, words in (
        (["01:50", "02:10", "03:10"], "No clock in Europe/Berlin showed 2024-03-31 02:10"),
        (["2024-10-27 01:50", "2024-10-27 02:10", "2024-10-27 03:10"], "twice, when summer time ended"),
    ):
        dated = [t if " " in t else f"2024-03-31 {t}" for t in times]
        path = written("time,temperature,reading\n" + "".join(f"{t}:00,21,{k}\n" for k, t in enumerate(dated)))
        with pytest.raises(RecordError, match=words):
            understood(path, timezone="Europe/Berlin")
    path = written(local("Europe/Berlin", "2024-10-27 01:10", 6))  # begins in the second of the two hours
    assert understood(path, timezone="Europe/Berlin")[0].frame["time"].iloc[0] == pd.Timestamp(
        "2024-10-27 01:10", tz="UTC"
    )
    for zone, words in (("Mars/Olympus", "not known"), ("UTC", None)):
        if words:
            with pytest.raises(RecordError, match=words):
                understood(path, timezone=zone)
        else:
            assert understood(path, timezone=zone)[0].said == ("local time of UTC",)
    with pytest.raises(RecordError, match="is for dates"):
        understood(written(GOOD["seconds"]), timezone="UTC")
    with pytest.raises(RecordError, match="zone of their own"):
        understood(written(GOOD["Home Assistant"]), timezone="UTC")


def test_rows_are_sorted_where_that_is_asked_for(written):
    head, *rows = plain().splitlines()
    path = written("\n".join([head, *rows[20:], *rows[:20]]) + "\n")
    with pytest.raises(RecordError, match="Time goes backward"):
        understood(path)
    table, temperature, *_ = understood(path, sort=True)
    np.testing.assert_array_equal(temperature, T)
    assert table.said == ("sorted by time: 40 rows moved",)


def test_a_spreadsheet_is_read(tmp_path):
    openpyxl = pytest.importorskip("openpyxl", reason="spreadsheets need openpyxl: pip install '.[excel]'")
    book = openpyxl.Workbook()
    sheet = book.active
    sheet.append(["Log of room 5"])
    sheet.append(["time", "temperature", "reading"])
    for row in zip(TIMES, T, U, strict=True):
        sheet.append([row[0].to_pydatetime(), float(row[1]), float(row[2])])
    book.create_sheet("empty")
    book.save(tmp_path / "log.xlsx")
    _, temperature, reading, seconds = understood(tmp_path / "log.xlsx")
    np.testing.assert_array_equal(temperature, T)
    np.testing.assert_array_equal(reading, U)
    np.testing.assert_allclose(seconds, 60.0 * np.arange(N))
    book.create_sheet("other").append(["a"])
    book["other"].append(["b"])
    book.save(tmp_path / "log.xlsx")
    with pytest.raises(RecordError, match=r"several sheets: 'Sheet', 'other'. Save the right one as a file of its own"):
        read_log(tmp_path / "log.xlsx")
    with pytest.raises(RecordError, match="no sheet 'x'"):
        read_log(tmp_path / "log.xlsx", HowToRead(sheet="x"))
    np.testing.assert_array_equal(understood(tmp_path / "log.xlsx", sheet="Sheet")[1], T)
    (tmp_path / "log.xlsx").write_bytes(b"no book")
    with pytest.raises(RecordError, match="cannot be read as a spreadsheet"):
        read_log(tmp_path / "log.xlsx")


def test_feather_is_read(tmp_path):
    pytest.importorskip("pyarrow", reason="Feather needs pyarrow: pip install '.[parquet]'")
    pd.DataFrame({"time": TIMES, "temperature": T, "reading": U}).to_feather(tmp_path / "log.feather")
    np.testing.assert_array_equal(understood(tmp_path / "log.feather")[1], T)
    (tmp_path / "log.feather").write_bytes(b"none")
    with pytest.raises(RecordError, match="cannot be read as Feather"):
        read_log(tmp_path / "log.feather")


def test_files_of_one_table_are_runs(written):
    paths = [written(plain(), "a.csv"), written(plain(times=TIMES + pd.Timedelta("1D")), "b.csv")]
    table = as_runs(paths, None, HowToRead())
    assert table.frame["file"].tolist() == ["a.csv"] * N + ["b.csv"] * N and table.said == ("2 files, a run each",)
    with pytest.raises(RecordError, match="--join"):
        as_runs([paths[0], written("time,oven\n0,1\n60,2\n", "c.csv")], None, HowToRead())


def test_files_of_a_logger_that_begins_a_new_one_each_day_are_one_log(written):
    span, places = N * (TIMES[1] - TIMES[0]), (1, 2, 0)
    table = read_logs([written(plain(times=TIMES + k * span), f"{k}.csv") for k in places], HowToRead())
    assert "file" not in table.frame and table.said == ("3 files that follow on one another, one log",)
    assert len(table.frame) == 3 * N and table.frame["time"].is_monotonic_increasing
    stamps = [(TIMES + k * span).as_unit("ms").asi8 for k in places]
    rows = ["epoch_ms,T,U\n" + "".join(f"{t},{a},{b}\n" for t, a, b in zip(at, T, U, strict=True)) for at in stamps]
    paths = [written(text, f"{k}.csv") for k, text in enumerate(rows)]
    came = read_logs(paths, HowToRead(), time="epoch_ms").as_it_came()["epoch_ms"]
    np.testing.assert_array_equal(came.astype(float), np.sort(np.concatenate(stamps)))


@pytest.mark.parametrize("later", ["20 min", f"-{N} min"])
def test_files_with_a_pause_between_them_or_of_one_time_are_runs(written, later):
    after = plain(times=TIMES + N * (TIMES[1] - TIMES[0]) + pd.Timedelta(later))
    assert read_logs([written(plain(), "a.csv"), written(after, "b.csv")], HowToRead()).said == ("2 files, a run each",)


def test_files_of_two_loggers_are_joined_in_time(written):
    """A room's thermometer every three minutes, and a voltmeter: straight lines between its values."""
    room = written(
        "Zeit;Temperatur\n"
        + "".join(f"{t:%d.%m.%Y %H:%M:%S};{comma(a)}\n" for t, a in zip(TIMES[::3], T[::3], strict=True)),
        "room.csv",
    )
    meter = written(
        "time,dmm\n" + "".join(f"{t:%Y-%m-%d %H:%M:%S},{b}\n" for t, b in zip(TIMES, U, strict=True)), "meter.csv"
    )
    table = joined([room, meter], None, HowToRead(reading="dmm"))
    np.testing.assert_array_equal(table.frame["dmm"], U)
    np.testing.assert_allclose(
        table.frame["Temperatur"], np.interp(np.arange(N), np.arange(0, N, 3), T[::3]), atol=1e-12
    )
    assert "2 files joined on the times of meter.csv" in table.said
    with pytest.raises(RecordError, match="In which file is the reading"):
        joined([room, room], None, HowToRead())
    np.testing.assert_array_equal(
        joined([room, meter], None, HowToRead()).frame["dmm"], U
    )  # the only one with a reading
    with pytest.raises(RecordError, match="cannot be joined"):
        joined([written(GOOD["seconds"], "s.csv"), meter], None, HowToRead())


def test_files_of_two_forms_are_joined_each_with_its_own(written):
    """Days first with decimal commas, and ISO 8601 in UTC; the file with the reading is told."""
    rows = [(f"{t:%d.%m.%Y %H:%M:%S};{comma(U[k])}\n", f"{t.isoformat()}Z,{T[k]}\n") for k, t in enumerate(TIMES)]
    meter = written("Datum;Messwert [mV]\n" + "".join(row for row, _ in rows), "m.csv")
    room = written("timestamp,room_degC\n" + "".join(row for _, row in rows), "r.csv")
    with pytest.raises(RecordError, match="say --timezone"):
        joined([meter, room], None, HowToRead())
    table = joined([meter, room], None, HowToRead(timezone="UTC"))
    np.testing.assert_allclose(table.frame["room_degC"], T, atol=1e-12)
    np.testing.assert_array_equal(table.frame["Messwert [mV]"], U)


def test_units_of_names():
    for name, unit in (
        ("Temp. [°C]", "degC"), ("T (F)", "degF"), ("U / mV", "mV"), ("R [kΩ]", "kohm"), ("reading (raw)", ""),
        ("R [k\u2126]", "kohm"), ("x", ""), ("oven_temp_degC", "degC"), ("p [hPa]", "hPa"), ("a/b", ""),
        ("f [mHz]", "mHz"), ("f [MHz]", "MHz"), ("f_uHz", "uHz"), ("R [M\u03a9]", "Mohm"), ("R [mOhm]", "mohm"),
        ("I_pA", "pA"), ("B [nT]", "nT"), ("g [\u00b5Gal]", "uGal"), ("pH [pH]", ""), ("m [mg]", "mg"),
        ("t [min]", "min"), ("tilt [\u00b5m/m]", "um/m"), ("alpha [1/K]", "1/K"), ("c [kg/m3]", "kg/m3"),
        ("x [n/a]", ""), ("y [b/a]", ""),
        ("Temp (\u00baF)", "degF"), ("Temp (\u00baC)", "degC"), ("T/\u00b0C", "degC"), ("room temp/degC", "degC"),
        ("temperature_F", "degF"), ("T_F", "degF"), ("cap_F", ""), ("R (Ohm)", "ohm"), ("R_kOhm", "kohm"),
        ("f/Hz", "Hz"), ("tilt/\u00b5m/m", "um/m"), ("km/h", ""), ("wind_m/s", ""), ("wind m/s", ""), ("A/C", ""),
        ("on/off", ""), ("date/time", ""), ("A/D", ""), ("um/m", ""), ("R/\u03a9", "ohm"), ("/V", ""),
    ):  # fmt: skip
        assert unit_of(name, None) == unit


@pytest.mark.parametrize("seed", range(4))
def test_a_damaged_file_is_refused_or_its_numbers_are_right(seed, written):
    """Bytes changed, cut, moved and added at random: whatever is read without a word is what the file said."""
    draw = random.Random(seed)
    true, names = set(zip(T.tolist(), U.tolist(), strict=True)), list(GOOD)
    for _ in range(100):
        name = draw.choice(names)
        given, columns = GOOD[name] if isinstance(GOOD[name], tuple) else (GOOD[name], None)
        content = bytearray(given if isinstance(given, bytes) else given.encode())
        place = draw.randrange(len(content) - 60)
        change = draw.randrange(4)
        if change == 0:
            content[place] = draw.randrange(256)
        elif change == 1:
            del content[place : place + draw.choice([1, 2, 10, 60])]
        elif change == 2:
            content[place:place] = draw.choice([b",", b";", b"\n", b"\t", b'"', b"#", b"1", b".", b"-", b"\r", b" "])
        else:
            content[place : place + 20], content[:20] = content[:20], content[place : place + 20]
        try:
            _, temperature, reading, _ = understood(written(bytes(content), ENDINGS.get(name, "log.csv")), columns)
        except (RecordError, StopIteration, KeyError):  # the latter two: a column has lost its name
            continue
        rows = zip(temperature.tolist(), reading.tolist(), strict=True)
        wrong = sum(row not in true for row in rows if row[0] == row[0] and row[1] == row[1])
        assert wrong <= 3, (name, place, change)


def test_a_whole_date_in_a_number_is_read_as_it_is_said(written):
    seconds = understood(written(REFUSED["a whole date in a number"][0]), time_format="%Y%m%d%H%M%S")[3]
    np.testing.assert_allclose(seconds, 60.0 * np.arange(N))


def test_unix_times_have_no_zone_and_cells_that_are_words_are_said(written):
    with pytest.raises(RecordError, match="Unix times, which are UTC"):
        understood(written(GOOD["Unix times in ms"]), timezone="Europe/Berlin")
    rows = "".join(f"{60 * k},{T[k]},{'wet' if k == 5 else 40 + k},{U[k]}\n" for k in range(N))
    table = understood(written("time,temperature,humidity,reading\n" + rows))[0]
    assert table.said == ("'humidity' as text, for 1 cell without a number, such as 'wet'",)


def test_words_in_a_long_column_are_counted_all_of_them():
    cells = {"a": ["wet", "1"], "b": ["wet", "OL", "2"], "c": ["on", "off"], "d": ["1", "2"]}
    frame = pd.DataFrame({name: (some * SOME)[: 2 * SOME] for name, some in cells.items()})
    same, said = nearly_numbers(frame)
    assert same is frame and said == [f"'a' as text, for {SOME} cells without a number, such as 'wet'"]


def test_files_in_other_units_or_at_other_times_are_not_put_together(written):
    cold, warm = (written(plain(head=f"time,temperature [{u}],reading\n"), f"{u}.csv") for u in ("C", "F"))
    with pytest.raises(RecordError, match=r"columns|unit"):
        as_runs([cold, warm], None, HowToRead())
    late = written(plain(times=TIMES + pd.Timedelta("9D")).replace("reading", "oven"), "late.csv")
    with pytest.raises(RecordError, match="at any time of"):
        joined([written(plain(), "now.csv"), late], None, HowToRead())


@pytest.mark.parametrize("cut", range(20, 90))
def test_a_file_that_was_cut_anywhere_raises_nothing_but_sentences(cut, written):
    """Dots and commas of a row that has no line end among them."""
    content = semicolons(head="Zeit;Temperatur;Messwert\n")[:cut]
    with warnings.catch_warnings(), contextlib.suppress(RecordError, StopIteration):
        warnings.simplefilter("ignore", RecordWarning)
        assert len(understood(written(content))[1]) <= 2


def test_a_state_that_is_no_number_is_not_bridged(written):
    """A sensor that was unavailable has no temperature until its next value; values at their own times stay."""
    moments = [f"2024-05-30T22:{k:02d}:00.000Z" for k in range(20)]
    rows = [f"sensor.reading,{k},{moment}" for k, moment in enumerate(moments)]
    states = {0: 20, 6: 26, 9: "unavailable", 15: 30, 19: 34}
    rows += [f"sensor.temperature,{value},{moments[k]}" for k, value in states.items()]
    frame = read_log(written("entity_id,state,last_changed\n" + "\n".join(rows) + "\n")).frame
    expected = [*range(20, 27), *[np.nan] * 8, 30, 31, 32, 33, 34]
    np.testing.assert_allclose(frame["temperature"], expected)


@pytest.mark.parametrize("ending", ["csv.gz", "zip", "xlsx"])
def test_a_file_that_unpacks_without_end_is_refused(written, monkeypatch, ending):
    monkeypatch.setattr("thermocorr.foreign.containers.MOST_UNPACKED", 100_000)
    if ending == "xlsx":
        pytest.importorskip("openpyxl", reason="openpyxl is not installed: pip install '.[excel]'")
    out = io.BytesIO()
    if ending == "csv.gz":
        out.write(gzip.compress(b"0" * 200_000))
    else:
        with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as packed:
            packed.writestr("log.csv", b"0" * 200_000)
    with pytest.raises(RecordError, match="becomes larger than"):
        read_log(written(out.getvalue(), f"bomb.{ending}"))


def test_a_line_of_commas_is_no_log(written):
    with pytest.raises(RecordError, match="more than 10000 columns"):
        read_log(written("a" + "," * 1_000_000 + "\n1\n"))


def test_a_format_of_its_own_is_one_entry(tmp_path, monkeypatch):
    """The recipe of CONTRIBUTING: an ending, a name and a function that reads a whole file."""
    table = pd.DataFrame({"time": [0, 60, 120], "temperature": [20.0, 21.0, 22.5], "reading": [1.5, 2.25, 4.5]})
    table.to_json(tmp_path / "log.ods", orient="records", lines=True)
    monkeypatch.setitem(FORMATS, ".ods", Format("JSON lines", lambda path: pd.read_json(path, lines=True)))
    pd.testing.assert_frame_equal(read_log(tmp_path / "log.ods").frame, table)

"""Logs as programs write them: right numbers, or a sentence that says what to pass; nothing silently wrong."""

import contextlib
import gzip
import io
import random
import tracemalloc
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from corpus.first_files import ASKED, FIRST
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
    lines,
    plain,
    semicolons,
    understood,
)

from thermocorr import DynamicBiasRegressor, RecordError, load_model, read_log, save_model
from thermocorr.command.cli import main
from thermocorr.readers import guess
from thermocorr.readers.growing import Growing
from thermocorr.readers.text import unpacked
from thermocorr.records.errors import as_command
from thermocorr.records.units import unit_of

CASES = Path(__file__).parents[2] / "shared" / "cases"
TENS = ("seconds", "no header, blanks", "temperature and resistance by letters", "LabVIEW, first")
"""Logs with a row every ten seconds; others have one a minute."""


def kind_of_log(group, name):
    """Content, ending, keywords of `read_log`, and names of columns of a log of the corpus."""
    if group is GOOD:
        content, columns = GOOD[name] if isinstance(GOOD[name], tuple) else (GOOD[name], {})
        return content, ENDINGS.get(name, "log.csv"), {}, columns
    content, options = FIRST[name] if isinstance(FIRST[name], tuple) else (FIRST[name], [])
    pairs = dict(option.removeprefix("--").partition("=")[::2] for option in options)
    columns = {role: pairs.pop(role) for role in ("temperature", "reading") if role in pairs}
    return content, "log.csv", {key.replace("-", "_"): value or True for key, value in pairs.items()}, columns


EVERY = [(GOOD, name) for name in GOOD] + [(FIRST, name) for name in FIRST]


def seconds_of(group, name):
    step = 10.0 if name in TENS[:3] or (group is FIRST and name == "LabVIEW") else 60.0
    return step * np.arange(N) + (np.arange(N) / 100.0 if "fractions" in name else 0.0)


@pytest.mark.parametrize(("group", "name"), EVERY, ids=[name for _, name in EVERY])
def test_a_file_is_read_with_its_numbers_and_as_it_grows(group, name, written):
    """In one piece, and in pieces cut anywhere by the form that the whole has shown."""
    content, ending, said, columns = kind_of_log(group, name)
    path = written(content, ending)
    if said and name != "a number for no value":  # the model finds such ones by itself
        with pytest.raises(RecordError):
            understood(path, columns)
    log, temperature, reading, seconds = understood(path, columns, **said)
    np.testing.assert_array_equal(temperature, T)
    np.testing.assert_array_equal(reading, U)
    np.testing.assert_allclose(seconds, seconds_of(group, name), atol=2e-3)  # days of a spreadsheet have eight digits
    form = log.attrs["form"]
    if form.long:
        return
    numbers = [column for column in form.numbers if column in log]
    growing, content, parts = Growing(form, numbers), unpacked(path.read_bytes(), path), []
    draw = random.Random(name)
    while content:
        piece, content = content[: (size := draw.choice([1, 7, 40, 200, 1000]))], content[size:]
        parts.append(growing.feed(piece)[0])
    rows = pd.concat([part for part in parts if part is not None])
    rows = rows[~rows.index.duplicated()] if said.get("skip_bad_rows") else rows
    pd.testing.assert_frame_equal(rows[numbers], log[numbers], check_dtype=False)


@pytest.mark.newest
@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.long] if k % 4 else []) for k, name in enumerate(GOOD)]
)
def test_both_commands_read_it_alike(name, written, capsys, monkeypatch):
    """`correct` gives the rows of `analyze` whatever program wrote the log: whole, its own result, and as it comes."""
    content, ending, _, columns = kind_of_log(GOOD, name)
    path, out = written(content, ending), written("", "x").parent / "out"
    options = [f"--{role}={column}" for role, column in columns.items()]
    assert main(["analyze", str(path), *options, "--time-constants", "5min", "--out", str(out)]) == 0
    analysed = pd.read_csv(out / "corrected.csv")
    shown = []
    for log in (path, out / "corrected.csv", "-"):
        capsys.readouterr()
        piped = path.parent / "piped"
        piped.write_bytes(unpacked(path.read_bytes(), path))
        with piped.open() as file:
            monkeypatch.setattr("sys.stdin", file)
            status = main(["correct", str(log), "--model", str(out / "model.json")])
        if log == "-" and load_model(out / "model.json").form_.long:
            assert status == 2  # one value a line
            return
        assert status in (0, 1)
        shown.append(capsys.readouterr().out)
        frame = pd.read_csv(io.StringIO(shown[-1]))
        newest = [column for column in frame if column.startswith("corrected")][-1]
        np.testing.assert_allclose(frame[newest], analysed["corrected"], rtol=0, atol=1e-9)
    assert shown[0] == shown[2]  # to the last digit


@pytest.mark.parametrize("name", REFUSED)
def test_a_file_that_can_be_read_in_two_ways_or_none_is_refused(name, written):
    content, words = REFUSED[name]
    with pytest.raises(RecordError, match=words):
        understood(written(content, ENDINGS.get(name, "log.csv")))


@pytest.mark.parametrize("name", ASKED)
def test_what_a_first_file_does_not_tell_is_asked(name, written):
    content, words = ASKED[name]
    with as_command(), pytest.raises(RecordError, match=words):
        understood(written(content))


@pytest.mark.parametrize("seed", range(6))
def test_a_damaged_file_is_refused_or_its_numbers_are_right(seed, written):
    """Bytes, fields and lines changed at random: what is read without a word is what the file said, but for a digit."""
    draw = random.Random(seed)
    for _ in range(100):
        group, name = draw.choice(EVERY)
        given, ending, said, columns = kind_of_log(group, name)
        if said.get("skip_bad_rows") or ending != "log.csv" or name == "two thermometers":
            continue
        content = bytearray(given if isinstance(given, bytes) else given.encode())
        place, change = draw.randrange(len(content) - 60), draw.randrange(5)
        if change == 0:
            content[place] = draw.randrange(256)
        elif change == 1:
            del content[place : place + draw.choice([1, 2, 10, 60])]
        elif change == 2:
            content[place:place] = draw.choice([b",", b";", b"\n", b"\t", b'"', b"#", b"1", b".", b"-", b"\r", b" "])
        elif change == 3:
            content[place : place + 40] = content[place + 20 : place + 40] + content[place : place + 20]
        else:
            end = content.find(b"\n", place)
            content[place:end] = draw.choice([b"", b"x", b"-9", b"99999", b"23.0 C", b"\xc3\xa9"])
        try:
            log, temperature, reading, seconds = understood(written(bytes(content)), columns, **said)
        except RecordError:
            continue
        starts = [seconds + offset for offset in seconds_of(group, name)[:4]]
        places = [np.searchsorted(seconds_of(group, name), start - 0.004).clip(0, N - 1) for start in starts]
        wrong = [np.sum((temperature != T[at]) | (reading != U[at])) for at in places]
        if "one value a line" not in str(log.attrs["notes"]):  # a series may get another name, and none is left out
            assert min(wrong) <= 1 and (len(seconds) >= N - 4 or log.attrs["notes"]), (name, place, change)


@pytest.mark.parametrize("cut", range(20, 90))
def test_a_file_that_was_cut_anywhere_raises_nothing_but_sentences(cut, written):
    content = semicolons(head="Zeit;Temperatur;Messwert\n")[:cut]
    with contextlib.suppress(RecordError):
        assert len(understood(written(content))[1]) <= 2


def test_what_was_understood_is_noted(written):
    path = written(semicolons(head="My log\nDatum;Temperatur [°C];Messwert [mV]\n").encode("latin-1"))
    log = read_log(path)
    assert log.attrs["notes"] == [
        "probably in Windows-1252", "separated by semicolons", "decimal comma",
        "1 line above the header", "times from 'Datum' as %d.%m.%Y %H:%M:%S",
    ]  # fmt: skip
    assert log.attrs["units"] == {} and unit_of("Messwert [mV]", log) == "mV"
    below = read_log(written("time;T;U\n[s];[°C];[mV]\n1;20,5;3\n2;20,6;4\n"))
    assert below.attrs["units"] == {"T": "degC", "U": "mV"}


def test_names_that_pandas_counted_are_no_row_and_a_first_row_is_no_name(written):
    rows = "\n".join(f"{k}.5,{a},{b},3" for k, (a, b) in enumerate(zip(T, U, strict=True))) + "\n"
    log = read_log(written("0,1,2,3\n" + rows))
    assert list(log) == list("0123") and len(log) == N
    log = read_log(written("0,1\n" + "".join(f"{10 * k},{b}\n" for k, b in enumerate(U, 1))))
    assert log["2"].tolist() == [1.0, *U]


def test_what_is_left_out_is_counted_and_named(written):
    rows = plain().splitlines()
    rows[5:7] = ["x", "2024-05-30 23:44:00,wet,1000.1", "garbage,1,2", rows[7], rows[7]]
    path = written("\n".join(rows) + "\n")
    with pytest.raises(RecordError, match=r"line 6: it has 1 field.*skip_bad_rows=True"):
        read_log(path)
    log = read_log(path, skip_bad_rows=True)
    notes = " / ".join(log.attrs["notes"])
    for words in (
        "1 line left out",
        "1 cell of 'temperature' left out, such as 'wet'",
        "1 row without a time",
        "2 rows with a repeated time",
    ):
        assert words in notes
    head, *rows = plain().splitlines()
    log = read_log(written("\n".join([head, *rows[20:], *rows[:20]]) + "\n"), skip_bad_rows=True)
    np.testing.assert_array_equal(log["temperature"], T)
    assert log.attrs["notes"] == ["sorted by time: 40 rows moved"]


def test_rows_of_runs_stay_with_their_run(written):
    """Two runs at the same times of day: none of their rows is one of the other's for the second time."""
    rows = [f"{run},{k}:00,{20 + k},{k}" for run in "ab" for k in range(10)]
    log = read_log(written("run,time,temperature,reading\n" + "\n".join([*rows, rows[-1]]) + "\n"), skip_bad_rows=True)
    assert log["run"].tolist() == ["a"] * 10 + ["b"] * 10


def test_day_and_month_are_told_apart_by_the_order_of_the_rows_or_by_the_user(written):
    """Twelve-hour steps through May: read the other way, the rows would step back."""
    np.testing.assert_allclose(understood(written(plain(DAY, times=LONGER)))[3], 43_200.0 * np.arange(N))
    path = written(REFUSED["day and month in doubt"][0])
    for form, first in (("%d/%m/%Y %H:%M:%S", "2024-05-06 03:40"), ("%m/%d/%Y %H:%M:%S", "2024-06-05 03:40")):
        assert read_log(path, time_format=form).index[0] == pd.Timestamp(first)


def test_the_user_says_how_the_file_is_written(written):
    np.testing.assert_array_equal(understood(written(plain().replace(",", ";")), sep=";", decimal=".")[1], T)
    path = written("time;temperature;reading\n" + "".join(f"{60 * k};{comma(T[k])};7\n" for k in range(N)))
    np.testing.assert_array_equal(read_log(path, sep="semicolon", decimal=",")["temperature"], T)
    path = written(lines("", lambda k, t, a, b: f"{t},{a},{b}"))
    assert list(read_log(path)) == ["2", "3"]
    assert list(read_log(path, names=["when", "T", "R"])) == ["T", "R"]
    for said in ({"sep": "x"}, {"decimal": "'"}, {"names": ["a", "b"]}, {"time": "when"}, {"timezone": "Mars/Olympus"}):
        with pytest.raises(RecordError, match=next(iter(said))):
            read_log(path, **said)


def test_numbers_that_are_seconds_stay_seconds(written):
    """A log of seconds that happens to lie where days of a spreadsheet lie says so by its name or its steps."""
    rows = "".join(f"{40_000 + 60 * k},{T[k]},{U[k]}\n" for k in range(N))
    np.testing.assert_allclose(understood(written("time,temperature,reading\n" + rows))[3], 60.0 * np.arange(N))
    rows = "".join(f"{40_000 + k / 10},{T[k]},{U[k]}\n" for k in range(N))
    np.testing.assert_allclose(understood(written("time [s],temperature,reading\n" + rows))[3], np.arange(N) / 10)
    with pytest.raises(RecordError, match=r"either way: say time_format='excel' or time_format='seconds'"):
        read_log(written("time,temperature,reading\n" + rows))
    log = read_log(written("time,temperature,reading\n" + rows), time_format="seconds")
    np.testing.assert_allclose(log.index.total_seconds(), 40_000 + np.arange(N) / 10, atol=1e-9)


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
    log = read_log(written(local(zone, first)), timezone=zone)
    assert log.index.equals(pd.date_range(first, periods=N, freq="10min", tz="UTC"))


def test_hours_that_clocks_leave_out_or_repeat_are_explained(written):
    for times, words in (
        (["01:50", "02:10", "03:10"], "No clock in Europe/Berlin showed 2024-03-31 02:10"),
        (["2024-10-27 01:50", "2024-10-27 02:10", "2024-10-27 03:10"], "twice, when summer time ended"),
    ):
        dated = [t if " " in t else f"2024-03-31 {t}" for t in times]
        path = written("time,temperature,reading\n" + "".join(f"{t}:00,21,{k}\n" for k, t in enumerate(dated)))
        with pytest.raises(RecordError, match=words):
            read_log(path, timezone="Europe/Berlin")
    path = written(local("Europe/Berlin", "2024-10-27 01:10", 6))  # begins in the second of the two hours
    assert read_log(path, timezone="Europe/Berlin").index[0] == pd.Timestamp("2024-10-27 01:10", tz="UTC")
    with pytest.raises(RecordError, match=r"timezone=... is for dates"):
        read_log(written(GOOD["seconds"]), timezone="UTC")
    for name in ("Home Assistant", "Unix times in ms", "a zone in every time"):
        assert "zone of their own" in str(read_log(written(GOOD[name]), timezone="Asia/Tokyo").attrs["notes"])


@pytest.mark.parametrize("zone", ["Z", "+02:00"])
@pytest.mark.parametrize("lacks", [lambda k: k > 20, lambda k: k < 20, lambda k: k == 20])
def test_times_with_and_without_a_zone_do_not_mix(zone, lacks, written):
    """A time without a zone could be any hour: it is not taken for one in UTC."""
    with pytest.raises(RecordError, match="is no date or time as the others are"):
        read_log(
            written(lines("time,temperature,reading\n", lambda k, t, a, b: f"{t}{'' if lacks(k) else zone},{a},{b}"))
        )


def test_a_spreadsheet_is_read(tmp_path):
    openpyxl = pytest.importorskip("openpyxl", reason="spreadsheets need openpyxl: pip install '.[excel]'")
    book, path = openpyxl.Workbook(), tmp_path / "log.xlsx"
    sheet = book.active
    sheet.append(["Log of room 5"])
    sheet.append(["time", "temperature", "reading"])
    for row in zip(TIMES, T, U, strict=True):
        sheet.append([row[0].to_pydatetime(), float(row[1]), float(row[2])])
    book.create_sheet("empty")
    book.save(path)
    _, temperature, reading, seconds = understood(path)
    np.testing.assert_array_equal([temperature, reading], [T, U])
    np.testing.assert_allclose(seconds, 60.0 * np.arange(N))
    for row in (["a", "b"], [1, 2], [2, 3]):
        book["empty"].append(row)
    book.save(path)
    with pytest.raises(RecordError, match=r"2 sheets with rows: 'Sheet', 'empty'. Save the right one"):
        read_log(path)
    with pytest.raises(RecordError, match="no sheet 'x'"):
        read_log(path, sheet="x")
    np.testing.assert_array_equal(understood(path, sheet="Sheet")[1], T)


@pytest.mark.parametrize("ending", ["parquet", "feather"])
@pytest.mark.parametrize("indexed", [False, True])
def test_parquet_and_feather_are_read(tmp_path, ending, indexed):
    pytest.importorskip("pyarrow", reason="Parquet and Feather need pyarrow: pip install '.[parquet]'")
    frame, path = pd.DataFrame({"time": TIMES, "temperature": T, "reading": U}), tmp_path / f"log.{ending}"
    getattr(frame.set_index("time") if indexed and ending == "parquet" else frame, f"to_{ending}")(path)
    np.testing.assert_array_equal(understood(path)[1], T)
    path.write_bytes(b"none")
    with pytest.raises(RecordError, match=f"cannot be read as .{ending}"):
        read_log(path)


def test_files_of_one_table_are_runs_or_one_log(written):
    span = N * (TIMES[1] - TIMES[0])
    paths = [written(plain(times=TIMES + k * span), f"{k}.csv") for k in (1, 2, 0)]
    log = read_log(paths)
    assert "file" not in log and log.attrs["notes"] == ["3 files that follow on one another, one log"]
    assert len(log) == 3 * N and log.index.is_monotonic_increasing
    for later in ("1D", f"-{N} min"):  # with a pause between them, and of one time
        runs = read_log([paths[2], written(plain(times=TIMES + span + pd.Timedelta(later)), "b.csv")])
        assert runs["file"].tolist() == ["0.csv"] * N + ["b.csv"] * N
        assert runs.attrs["notes"] == ["2 files, a run each"]
    assert set(read_log(paths, run="file")["file"]) == {"0.csv", "1.csv", "2.csv"}
    cold, warm = (written(plain(head=f"time,temperature,reading\ns,{u},mV\n"), f"{u}.csv") for u in ("°C", "°F"))
    with pytest.raises(RecordError, match="is in degF in"):
        read_log([cold, warm])


def test_files_of_two_loggers_are_joined_in_time(written):
    """Days first with decimal commas every three minutes, and a voltmeter in UTC: each in its own form and zone."""
    values = zip(TIMES[::3], T[::3], strict=True)
    room = written("Zeit;Temperatur\n" + "".join(f"{t:%d.%m.%Y %H:%M:%S};{comma(a)}\n" for t, a in values), "room.csv")
    meter = written("time,dmm\n" + "".join(f"{t.isoformat()}Z,{b}\n" for t, b in zip(TIMES, U, strict=True)), "m.csv")
    with pytest.raises(RecordError, match=r"say timezone=...: it is for them alone"):
        read_log([room, meter])
    log = read_log([room, meter], timezone="UTC")
    np.testing.assert_array_equal(log["dmm"], U)
    straight = np.interp(np.arange(N), np.arange(0, N, 3), T[::3])
    np.testing.assert_allclose(log["Temperatur"], straight, atol=1e-12)
    assert "2 files joined on the times of m.csv" in log.attrs["notes"]
    with pytest.raises(RecordError, match="In which file is the reading"):
        read_log(
            [room, written("time;Temperatur;oven [°C]\n01.01.2024 00:00:00;1;2\n01.01.2024 00:01:00;1;3\n", "x.csv")]
        )
    late = written(plain(times=TIMES + pd.Timedelta("9D")).replace("reading", "oven"), "late.csv")
    with pytest.raises(RecordError, match="at any time of"):
        read_log([written(plain(), "now.csv"), late])


def test_a_header_of_other_names_below_is_refused_however_one_insists(written):
    content = plain() + "time,temperature [°F],reading\n2024-05-31 01:00:00,73,1000\n"
    for skip in (False, True):
        with pytest.raises(RecordError, match="A header comes again with other names"):
            read_log(written(content), skip_bad_rows=skip)
    form = read_log(written(plain())).attrs["form"]
    with pytest.raises(RecordError, match="A header comes again with other names"):
        Growing(form, ["reading"]).feed(content.encode())


def test_a_model_of_a_log_with_thousands_of_columns_is_loaded_again(written):
    names = [f"column of the logger number {k}" for k in range(600)]
    rows = "".join(f"{t},{a},{b}{',1' * 600}\n" for t, a, b in zip(TIMES, T, U, strict=True))
    log = read_log(path := written(f"time,temperature,reading,{','.join(names)}\n{rows}"))
    model = DynamicBiasRegressor("temperature", ["5 min"]).fit(log[["temperature"]], log["reading"])
    form = load_model(save_model(model, path.with_suffix(".json"))).form_
    whole = path.read_bytes()
    assert len(Growing(form, ["reading"]).feed(whole + whole[: whole.index(b"\n") + 1])[0]) == N


def test_a_forged_form_is_known(written):
    """Of a model file, which anybody may have written."""
    form = read_log(written(plain())).attrs["form"]
    assert form.is_sound() and form.clock is not None
    clocks = [replace(form.clock, zone="Mars/Olympus"), replace(form.clock, columns=["when"])]
    for wrong in (
        {"encoding": "utf-99"}, {"separator": "x"}, {"decimal": ";"}, {"names": ["time", "time"]}, {"numbers": ["x"]},
        {"columns": ["x"]}, {"clock": clocks[0]}, {"clock": clocks[1]},
    ):  # fmt: skip
        assert not replace(form, **wrong).is_sound(), wrong


def test_a_growing_log_whose_columns_change_places_is_followed(written):
    form = read_log(written(plain())).attrs["form"]
    turned = "reading,time,temperature\n1000.5,2024-05-31 01:00:00,23.5\n"
    for content in (turned, plain() + turned):
        row = Growing(form, ["reading"]).feed(content.encode())[0].iloc[-1]
        assert (row["temperature"], row["reading"]) == (23.5, 1000.5)


def test_a_state_that_is_no_number_is_not_bridged(written):
    """A sensor that was unavailable has no temperature until its next value; values at their own times stay."""
    moments = [f"2024-05-30T22:{k:02d}:00.000Z" for k in range(20)]
    rows = [f"sensor.reading,{k},{moment}" for k, moment in enumerate(moments)]
    states = {0: 20, 6: 26, 9: "unavailable", 15: 30, 19: 34}
    rows += [f"sensor.temperature,{value},{moments[k]}" for k, value in states.items()]
    frame = read_log(written("entity_id,state,last_changed\n" + "\n".join(rows) + "\n"))
    np.testing.assert_allclose(frame["temperature"], [*range(20, 27), *[np.nan] * 8, 30, 31, 32, 33, 34])


@pytest.mark.parametrize("ending", ["csv.gz", "zip"])
def test_a_file_that_unpacks_without_end_is_refused(written, monkeypatch, ending):
    monkeypatch.setattr("thermocorr.readers.text.MOST", 100_000)
    out = io.BytesIO()
    if ending == "csv.gz":
        out.write(gzip.compress(b"0" * 200_000))
    else:
        with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as packed:
            packed.writestr("log.csv", b"0" * 200_000)
    with pytest.raises(RecordError, match="becomes larger than"):
        read_log(written(out.getvalue(), f"bomb.{ending}"))


@pytest.mark.parametrize("word", ["now", "today", "NOW"])
@pytest.mark.parametrize("date", ["2024-05-31 10:0{}:00", "31.05.2024 10:0{}"])
def test_words_for_the_present_are_no_times(written, word, date):
    lines = [f"{date.format(k) if k != 3 else word},20.{k},5.{k}" for k in range(9)]
    with pytest.raises(RecordError, match=f"'{word}' in 'time', line 5"):
        read_log(written("\n".join(["time,temperature,reading", *lines, ""]).encode(), "log.csv"))


@pytest.mark.newest  # older ones copy columns
def test_a_log_in_parts_is_fitted_like_the_whole_in_less_memory():
    n = 1_000_000
    t = np.arange(n, dtype=float)
    index = pd.date_range("2024-01-01", periods=n, freq="s", tz="Asia/Tokyo")
    whole = pd.DataFrame({"temperature": 23 + np.sin(t / 3000), "reading": np.sin(t / 3000 - 0.1)}, index)
    DynamicBiasRegressor("temperature", [100.0]).fit(whole[["temperature"]][:100], whole["reading"][:100])  # imports
    tracemalloc.start()
    log = read_log(whole[start : start + 50_000] for start in range(0, n, 50_000))
    X, y = log.drop(columns="reading"), log["reading"]
    model = DynamicBiasRegressor("temperature", [100.0, 3000.0]).fit(X, y)
    worst = max(block["residual"].abs().max() for block in model.evaluate_blocks(X, y))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert worst < 1.0 and peak < 16 * 2**20
    pd.testing.assert_frame_equal(log, whole, check_freq=False, check_index_type=False)
    with pytest.raises(RecordError, match="Parts of a log have other columns"):
        read_log(iter([whole[:10], whole[10:20].drop(columns="reading")]))
    with pytest.raises(RecordError, match=r"'note' holds .*, no numbers"):
        read_log(iter([whole[:10].assign(note="x")]))
    with pytest.raises(RecordError, match="say 'sep' where these are read"):
        read_log(iter([whole]), sep=";")
    with pytest.raises(RecordError, match="Give paths in a list"):
        read_log(iter([Path("log.csv")]))
    for wrong in ([], whole, [whole]):
        with pytest.raises(RecordError, match="needs paths of files, or an iterator of frames"):
            read_log(wrong)


@pytest.mark.parametrize(
    ("names", "temperature", "reading"),
    [
        (["join_zone_meter.csv", "join_zone_room.csv"], "temp_c", "value"),
        (["panel_temps.csv"], "Tair_Avg", "LC_1_Avg"),
        (["slash_comments.txt"], "asked", "asked"),
        (["short_header.csv"], "names=", "names="),
    ],
)
def test_logs_that_failed_once(names, temperature, reading):
    if not CASES.is_dir():
        pytest.skip("the folder of cases is not there")
    paths = [CASES / name for name in names]
    if temperature == "names=":
        for skip in (False, True):
            with pytest.raises(RecordError, match=r"Every row has one field more than the header.*names="):
                read_log(paths, skip_bad_rows=skip)
        return
    log = read_log(paths, timezone="Etc/GMT+5" if len(paths) > 1 else None)
    roles = guess(log)
    if temperature == "asked":
        assert list(log) == list("123456") and log.index[1] - log.index[0] == pd.Timedelta("66s")
        with pytest.raises(RecordError, match=r"names=... calls them otherwise"):
            roles.ask(list(log), True)
    else:
        assert (roles.temperature, roles.reading) == (temperature, reading)


def test_units_of_names():
    for name, unit in (
        ("Temp. [°C]", "degC"), ("T (F)", "degF"), ("U / mV", "mV"), ("R [kΩ]", "kohm"), ("reading (raw)", ""),
        ("R [k\u2126]", "kohm"), ("x", ""), ("oven_temp_degC", "degC"), ("p [hPa]", "hPa"), ("a/b", ""),
        ("f [mHz]", "mHz"), ("f [MHz]", "MHz"), ("f_uHz", "uHz"), ("R [M\u03a9]", "Mohm"), ("R [mOhm]", "mohm"),
        ("I_pA", "pA"), ("B [nT]", "nT"), ("g [\u00b5Gal]", "uGal"), ("pH [pH]", ""), ("m [mg]", "mg"),
        ("t [min]", "min"), ("tilt [\u00b5m/m]", "um/m"), ("alpha [1/K]", "1/K"), ("c [kg/m3]", "kg/m3"),
        ("x [n/a]", ""), ("Temp (\u00baF)", "degF"), ("T/\u00b0C", "degC"), ("room temp/degC", "degC"),
        ("temperature_F", "degF"), ("cap_F", ""), ("R (Ohm)", "ohm"), ("R_kOhm", "kohm"), ("f/Hz", "Hz"),
        ("tilt/\u00b5m/m", "um/m"), ("km/h", ""), ("wind_m/s", ""), ("A/C", ""), ("on/off", ""), ("date/time", ""),
    ):  # fmt: skip
        assert unit_of(name, None) == unit

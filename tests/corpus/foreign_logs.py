"""One record, as sixty programs and countries write it, and what must not be guessed; made by hand."""

import gzip
import io
import zipfile

import numpy as np
import pandas as pd

from thermocorr import RecordError, read_log
from thermocorr.readers import guess
from thermocorr.readers.clocks import as_seconds

N = 40
TIMES = pd.Timestamp("2024-05-30 23:40:00") + pd.to_timedelta(np.arange(N) * 60, unit="s")
T = np.round(23 + 0.5 * np.sin(np.arange(N) / 5), 3)
U = np.round(1000.5 + 0.25 * np.cos(np.arange(N) / 7), 3)


def comma(value, digits=3):
    """A number with a decimal comma."""
    return f"{value:.{digits}f}".replace(".", ",")


def lines(head, row, end="\n", times=TIMES):
    """A file: its head, then ``row(number, time, temperature, reading)`` for each row."""
    rows = [row(k, t, a, b) for k, (t, a, b) in enumerate(zip(times, T, U, strict=True))]
    return head.replace("\n", end) + end.join(rows) + end


def plain(time="{t:%Y-%m-%d %H:%M:%S}", head="time,temperature,reading\n", end="\n", times=TIMES):
    """Comma-separated, with times in some form."""
    return lines(head, lambda k, t, a, b: f"{time.format(t=t, k=k)},{a},{b}", end, times)


def semicolons(time="{t:%d.%m.%Y %H:%M:%S}", head="time;temperature;reading\n", end="\n"):
    """As spreadsheets write it where the decimal sign is a comma."""
    return lines(head, lambda k, t, a, b: f"{time.format(t=t, k=k)};{comma(a)};{comma(b)}", end)


def zipped(*names):
    """An archive."""
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as archive:
        for name in names:
            archive.writestr(name, plain())
    return out.getvalue()


ISO = "{t:%Y-%m-%dT%H:%M:%S}"
INFLUX_HEAD = (
    "#group,false,false,true,true,false,false,true,true\n"
    "#datatype,string,long,dateTime:RFC3339,dateTime:RFC3339,dateTime:RFC3339,double,string,string\n"
    "#default,_result,,,,,,,\n,result,table,_start,_stop,_time,_value,_field,_measurement\n"
)
SPAN = "2024-05-30T00:00:00Z,2024-06-01T00:00:00Z"


def influx():
    """Annotated CSV with a table for each field."""
    first = lines(INFLUX_HEAD, lambda k, t, a, b: f",,0,{SPAN},{t.isoformat()}Z,{a},temperature,lab", "\r\n")
    return (
        first + "\r\n" + lines(INFLUX_HEAD, lambda k, t, a, b: f",,1,{SPAN},{t.isoformat()}Z,{b},reading,lab", "\r\n")
    )


def home_assistant():
    """The history's download: every change of every sensor on its own line."""
    head = "entity_id,state,last_changed\n"

    def row(k, t, a, b):
        late = (t + pd.Timedelta("20s")).isoformat()
        gone = f"\nsensor.reading,unavailable,{late}.500Z" if k == 7 else ""
        return f"sensor.temperature,{a},{t.isoformat()}.000Z\nsensor.reading,{b},{t.isoformat()}.000Z{gone}"

    return lines(head, row)


LABVIEW = (
    "LabVIEW Measurement\t\nWriter_Version\t2\nSeparator\tTab\nDecimal_Separator\t.\nDate\t2024/05/31\n"
    "***End_of_Header***\t\n\t\nChannels\t2\t\t\nSamples\t40\t40\t\nX_Dimension\tTime\tTime\nX0\t0\t0\n"
    "Delta_X\t60\t60\n***End_of_Header***\nX_Value\ttemperature\treading\tComment\n"
)
KEYSIGHT = (
    "Name:,lab\nOwner:,me\nAcquisition Date:,5/30/2024 23:40:00\nInstrument:,34970A\n\n"
    "Scan,Time,101 <temperature> (C),102 <reading> (VDC),Alarm 102\n"
)
KEYSIGHT_COLUMNS = {"temperature": "101 <temperature> (C)", "reading": "102 <reading> (VDC)"}
DAY = "{t:%d/%m/%Y %H:%M:%S}"
LONGER = pd.Timestamp("2024-05-05 23:40:00") + pd.to_timedelta(np.arange(N) * 43_200, unit="s")  # days beyond the 12th

ONE_DAY = TIMES - pd.Timedelta("24D20h")
"""5 May, and no midnight."""

GOOD = {
    "day and month told by midnight": plain(DAY, times=TIMES - pd.Timedelta("24D")),
    "a year of two digits in front, told by midnight": plain("{t:%y/%m/%d %H:%M:%S}"),
    "times of day through midnight": plain("{t:%H:%M:%S}"),
    "a date and a time in whole numbers": plain("{t:%Y%m%d,%H%M%S}", "date,time,temperature,reading\n"),
    "commas": plain(),
    "T between date and time": plain(ISO),
    "seconds": plain("{k}0"),
    "line ends of Windows": plain(end="\r\n"),
    "line ends of old Macs": plain(end="\r").encode(),
    "a byte-order mark": "\ufeff" + plain(),
    "capitals in the header": plain(head="Time,Temperature,Reading\n"),
    "units in the header": plain(head="Time,Temperature [°C],Reading (mV)\n"),
    "a unit behind a slash": plain(head="time,temperature / K,reading / mV\n"),
    "semicolons with decimal points": plain().replace(",", ";"),
    "semicolons with decimal commas": semicolons(),
    "a German header in Latin-1": semicolons(head="Zeit;Temperatur [°C];Messwert [mV]\n").encode("latin-1"),
    "tabs": plain().replace(",", "\t"),
    "tabs with decimal commas": semicolons().replace(";", "\t"),
    "bars": plain().replace(",", "|"),
    "blanks": plain(ISO).replace(",", "   "),
    "UTF-16": plain().encode("utf-16"),
    "UTF-16 without its mark": plain().encode("utf-16-le"),
    "UTF-16, big end first, without its mark": plain().encode("utf-16-be"),
    "UTF-32": plain().encode("utf-32"),
    "comments in front": "# logger 7\n# Kim, in May\n" + plain(),
    "comments between rows": plain().replace("\n", "\n# door open, window shut\n", 9),
    "the header in a comment": "# made by numpy\n# " + plain(ISO).replace(",", " "),
    "a preamble": "Instrument: DMM 7\nSerial,1234\nOperator,Kim\n\n" + plain(),
    "a preamble as wide as the table": "My log;;\nroom 5;;\n" + semicolons(),
    "a preamble of pairs": "Name;Wert\nSerial;1234\nKalibriert;2023\nBemerkung;keine\n" + semicolons(),
    "units below the header": plain(head="time,temperature,reading\ns,°C,mV\n"),
    "units in brackets below": semicolons(head="time;temperature;reading\n[dd.mm.yyyy hh:mm:ss];[°C];[V]\n"),
    "a semicolon at every end": semicolons().replace("\n", ";\n"),
    "two semicolons at every end": semicolons().replace("\n", ";;\n"),
    "decimal commas in quotes": lines(
        "time,temperature,reading\n", lambda k, t, a, b: f'{t},"{comma(a)}","{comma(b)}"'
    ),
    "everything in quotes": '"' + plain().replace(",", '","').replace("\n", '"\n"').removesuffix('"'),
    "thousands with points": lines("time;temperature;reading\n", lambda k, t, a, b: f"{t};{comma(a)};1.{comma(b)[1:]}"),
    "thousands with commas, in quotes": lines(
        "time,temperature,reading\n", lambda k, t, a, b: f'{t},{a},"1,{str(b)[1:]}"'
    ),
    "the header again, when the logger restarts": plain().replace(
        "\n2024-05-31 00:00", "\ntime,temperature,reading\n2024-05-31 00:00", 1
    ),
    "day.month.year": plain("{t:%d.%m.%Y %H:%M:%S}"),
    "day.month.year of two digits": plain("{t:%d.%m.%y %H:%M:%S}"),
    "day/month/year, beyond the 12th": plain(DAY),
    "month/day/year, AM and PM": plain("{t:%m/%d/%Y %I:%M:%S %p}"),
    "month/day/year of two digits": plain("{t:%m/%d/%y %H:%M}"),
    "day-month-year": plain("{t:%d-%m-%Y %H:%M:%S}"),
    "year/month/day": plain("{t:%Y/%m/%d %H:%M:%S}"),
    "names of months": plain("{t:%d-%b-%Y %H:%M:%S}"),
    "a fraction of a second behind a comma": semicolons("{t:%d.%m.%Y %H:%M:%S},000"),
    "milliseconds behind a colon": plain("{t:%m/%d/%Y %H:%M:%S}:000"),
    "date and time in two columns": semicolons("{t:%d.%m.%Y;%H:%M:%S}", "Datum;Uhrzeit;temperature;reading\n"),
    "time and date in two columns": plain("{t:%H:%M:%S,%Y-%m-%d}", "time,date,temperature,reading\n"),
    "hours since a start": lines(
        "time,temperature,reading\n", lambda k, t, a, b: f"{(1420 + k) // 60}:{(1420 + k) % 60:02d}:00,{a},{b}"
    ),
    "hundreds of hours since a start": lines(
        "time,temperature,reading\n", lambda k, t, a, b: f"{(59_980 + k) // 60}:{(59_980 + k) % 60:02d}:00.000,{a},{b}"
    ),
    "days of a spreadsheet": lines(
        "time,temperature,reading\n", lambda k, t, a, b: f"{45_442 + (23 * 60 + 40 + k) / 1440:.9f},{a},{b}"
    ),
    "Unix times": lines("time,temperature,reading\n", lambda k, t, a, b: f"{1_717_112_400 + 60 * k},{a},{b}"),
    "Unix times in ms": lines(
        "time,temperature,reading\n", lambda k, t, a, b: f"{1_717_112_400_000 + 60_000 * k},{a},{b}"
    ),
    "Unix times in us": lines(
        "ts,temperature,reading\n".replace("ts", "timestamp"),
        lambda k, t, a, b: f"{(1_717_112_400 + 60 * k) * 10**6},{a},{b}",
    ),
    "Unix times in ns": lines(
        "time,temperature,reading\n", lambda k, t, a, b: f"{(1_717_112_400 + 60 * k) * 10**9},{a},{b}"
    ),
    "a zone in every time": plain("{t:%Y-%m-%d %H:%M:%S}+02:00"),
    "InfluxDB": influx(),
    "Home Assistant": home_assistant(),
    "Grafana": lines('"Time","temperature","reading"\n', lambda k, t, a, b: f"{t},{a:.3f} °C,{b:.3f} mV"),
    "LabVIEW": lines(LABVIEW, lambda k, t, a, b: f"{60 * k:.6f}\t{a:.6f}\t{b:.6f}"),
    "Keysight": (
        lines(KEYSIGHT, lambda k, t, a, b: f"{k + 1},{t:%m/%d/%Y %H:%M:%S}:000,{a},{b},0", "\r\n").encode("utf-16"),
        KEYSIGHT_COLUMNS,
    ),
    "gz": gzip.compress(plain().encode()),
    "zip": zipped("log.csv"),
}
"""Files that are read, with right numbers: content, or content and the columns' names in it."""

REFUSED = {
    "day and month in doubt": (plain(DAY, times=ONE_DAY), "either way.*time_format"),
    "day and month in doubt, with dashes": (plain("{t:%d-%m-%Y %H:%M:%S}", times=ONE_DAY), "either way.*time_format"),
    "thousands in doubt": (
        lines("time;temperature;reading\n", lambda k, t, a, b: f"{t};{comma(a, 1)};1.{k:03d}"),
        "decimal=",
    ),
    "points and commas": (lines("time;temperature;reading\n", lambda k, t, a, b: f"{t};{comma(a, 1)};{b}"), "decimal="),
    "a row with a field less": (semicolons() + "1;2\n", "line 42: it has 2 fields where the header has 3"),
    "a row with a field less, behind a preamble": ("My log\n\n" + semicolons() + "1;2\n", "line 44: it has 2 fields"),
    "a date that is none": (
        plain("{t:%d.%m.%Y %H:%M:%S}").replace("30.05.2024 23:50", "31.13.2024 23:50"),
        "line 12, is no date or time",
    ),
    "times of day that begin anew": (
        plain("{t:%H:%M:%S}").replace(" 00:0", " 12:0").replace("\n00:0", "\n12:0"),
        "does not follow on",
    ),
    "a byte of Latin-1 in a row": (plain().encode().replace(b"23.0,", b"23.0\xb0,"), "line 2: byte"),
    "UTF-16 that was cut": (plain().encode("utf-16")[:-1], "does not fit"),
    "two files in a zip": (zipped("a.csv", "b.csv"), "holds 2 files"),
    "an old spreadsheet": (
        b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1" + bytes(99),
        "another package|cannot be read.*CSV, .xlsx",
    ),
    "an OpenDocument": (zipped("content.xml"), "another package|cannot be read.*CSV, .xlsx"),
    "a spreadsheet that is called CSV": (zipped("xl/workbook.xml"), "document of Office.*Save it as"),
    "hours since a start that step back": (
        lines("time,temperature,reading\n", lambda k, t, a, b: f"{30 - k % 2}:00:00,{a},{b}"),
        "does not follow on",
    ),
    "a gz that was cut": (gzip.compress(plain().encode())[:-20], "cannot be unpacked"),
}
"""Files that are refused, and with which words."""

GOOD |= {
    "a whole date in a number": plain("{t:%Y%m%d%H%M%S}"),
    "minutes": lines("time [min],temperature,reading\n", lambda k, t, a, b: f"{k},{a},{b}"),
    "minutes, said below": lines(
        "time;temperature;reading\nmin;°C;mV\n", lambda k, t, a, b: f"{k};{comma(a)};{comma(b)}"
    ),
    "kinds below the units": lines(
        "TOA5;x;y\nTIMESTAMP;Temp_Avg;Reading\nTS;Deg C;mV\n;Avg;Smp\n", lambda k, t, a, b: f"{t};{a};{b}"
    ),
    "rows of nothing": semicolons().replace("\n", "\n;;\n", 12),
    "seconds without their zero": plain("{t:%d.%m.%Y %H:%M}:{t.second}"),
}

REFUSED |= {
    "a quote that is not closed": (
        lines("time;temperature;reading;note\n", lambda k, t, a, b: f"{t};{comma(a)};{comma(b)};{chr(34) * (k == 7)}x"),
        "line 9: a quoted field is not closed",
    ),
    "rows above the header": (
        "2024-05-30 23:39:00,22.9,1000.1\n" + plain(),
        "Line 1 is a row, and the columns' names stand below it",
    ),
    "ticks of another clock": (
        lines("time,temperature,reading\n", lambda k, t, a, b: f"{638_527_092_000_000_000 + k * 600_000_000},{a},{b}"),
        "Which column",
    ),
    "a year of two digits, perhaps in front": (
        plain("{t:%y/%m/%d %H:%M:%S}", times=ONE_DAY),
        "either way.*time_format",
    ),
    "whole thousands with commas": (
        lines("time,temperature,reading\n", lambda k, t, a, b: f'{t},23,"{990 + k:,}"'),
        "a thousandfold",
    ),
    "whole thousands with points": (
        lines("time;temperature;reading\n", lambda k, t, a, b: f"{t};23;{990 + k:,}".replace(",", ".")),
        "a thousandfold",
    ),
    "two series of one name": (
        influx().replace(",0,2024", ",1,2024").replace("reading,lab", "temperature,lab"),
        "Which column|follow on",
    ),
}

ENDINGS = {
    "an old spreadsheet": "log.xls",
    "an OpenDocument": "log.ods",
    "gz": "log.csv.gz",
    "zip": "log.zip",
    "two files in a zip": "log.zip",
    "a gz that was cut": "log.csv.gz",
}


def understood(path, names=None, **said):
    """The log, temperatures, readings and seconds since the first row, where both are known."""
    log = read_log(path, **said)
    roles = guess(log, **(names or {}))
    roles.ask(list(log), not isinstance(log.index, pd.RangeIndex))
    seconds = as_seconds(log.index)
    known = log[[roles.temperature, roles.reading]].notna().all(axis=1).to_numpy()
    if (np.diff(seconds) <= 0).any():
        raise RecordError("a row does not follow on the one before")
    T_, U_ = (log[name].to_numpy(float)[known] for name in (roles.temperature, roles.reading))
    return log, T_, U_, seconds[known] - seconds[known][0]

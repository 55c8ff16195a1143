"""Files as users first give them to the command, with no role named; made by hand after what loggers write."""

import numpy as np
import pandas as pd

from .foreign_logs import DAY, SPAN, TIMES, N, comma, home_assistant, lines, semicolons

LATE = np.round(23 + 0.5 * np.sin((np.arange(N) - 4) / 5), 3)
"""A thermometer that follows the other one."""
BEFORE_MIDNIGHT = TIMES - pd.Timedelta("24D")
"""5 to 6 May: days and months that can be either."""


def hobo():
    head = (
        '"Plot Title: lab 7"\n"#","Date Time, GMT-07:00","Temp, °F (LGR S/N: 12, SEN S/N: 12)",'
        '"Load, kg (LGR S/N: 12)",'
        '"Host Connected (LGR S/N: 12)","End Of File (LGR S/N: 12)"\n'
    )
    rows = lines(head, lambda k, t, a, b: f"{k + 1},{t:%m/%d/%y %I:%M:%S %p},{a},{b},,")
    return rows + f"{N + 1},05/31/24 12:20:00 AM,,,Logged,Logged\n"


def toa5():
    head = (
        '"TOA5","CR1000","CR1000","1234","CR1000.Std.31","CPU:lab.CR1","999","Table1"\n'
        '"TIMESTAMP","RECORD","BattV_Min","AirT_C_Avg","Strain_Avg"\n"TS","RN","Volts","Deg C","ustrain"\n'
        '"","","Min","Avg","Avg"\n'
    )
    return lines(head, lambda k, t, a, b: f'"{t}",{k},{12.5 + k % 2},{a},{b}')


def rows(head, form, times=TIMES):
    """A file whose rows are a format of k, t, a, b and the later thermometer c."""
    return lines(head, lambda k, t, a, b: form.format(k=k, t=t, a=a, b=b, c=LATE[k], h=int(f"{t:%H%M}")), times=times)


ISO = "{t:%Y-%m-%d %H:%M:%S}"
FIRST = {
    "three columns": rows("time,temp,weight\n", ISO + ",{a},{b}"),
    "a zone in the name of the times": rows("Datetime[UTC+8],TEMP (°C),load cell\n", ISO + ",{a},{b}"),
    "TOA5": toa5(),
    "one garbled line": (
        rows("time,temp,weight\n", ISO + ",{a},{b}") + "2024-05-31 00:2#,,2\x07\n2024-05-31 00:20:00,23.1\n",
        ["--skip-bad-rows"],
    ),
    "a double name of an unused column": rows("time,temp,weight,note,note\n", ISO + ",{a},{b},x,y"),
    "month first": rows("time,temp,weight\n", "{t:%m/%d/%Y %H:%M},{a},{b}", BEFORE_MIDNIGHT),
    "AM and PM apart": rows("date,time,am/pm,temp,weight\n", "{t:%Y-%m-%d},{t:%I:%M:%S},{t:%p},{a},{b}"),
    "HOBO": hobo(),
    "HOBOware of today": rows(
        '#,"Date-Time (EDT)","Ch: 1 - Temperature   (°C)","Ch: 2 - Load   (kg)"\n', "{k},{t:%m/%d/%Y %H:%M:%S},{a},{b}"
    ),
    "Testo": semicolons("{k};{t:%d.%m.%Y %H:%M:%S}", "Id;Datum Zeit;1:°C;2:mV\n"),
    "Testo with blanks": semicolons("{t:%d.%m.%Y %H:%M:%S}", ";°C Temperatur;mV Brücke\n"),
    "PicoLog": rows(",Channel 1 Ave. (C),Bridge Ave. (mV)\n", "{t:%Y-%m-%dT%H:%M:%S+00:00},{a},{b}"),
    "PicoLog of old": rows(
        "PicoLog\nSample interval\t1\tMinutes\n\nTime\tOven\tBridge\nMinutes\t°C\tmV\n", "{k}\t{a}\t{b}"
    ),
    "DataTaker": rows(
        '"Timestamp","TZ","Oven (degC)","Bridge (mV)"\n', "{t:%Y/%m/%d %H:%M:%S}.000,n,{a},{b}"
    ),
    "BenchVue": rows(
        "Instrument,DAQ970A\nSerial,MY5\nStart,5/30/2024 11:40:00 PM\n\nScan,Time,101 (C),102 (VDC),Alarm 101\n",
        "{k},{t:%m/%d/%Y %I:%M:%S:000 %p},{a},{b},0",
    ),
    "LabVIEW": rows(
        "LabVIEW Measurement\t\nWriter_Version\t2\nSeparator\tTab\n***End_of_Header***\t\n\t\nChannels\t2\t\t\n"
        "Samples\t40\t40\t\nX_Dimension\tTime\tTime\nX0\t0\t0\nDelta_X\t60\t60\n***End_of_Header***\n"
        "X_Value\tTemperature\tVoltage\tComment\n",
        "{k}0\t{a}\t{b}",
    ),
    "Home Assistant": home_assistant().replace("sensor.temperature", "sensor.lab_temperature").replace(
        "sensor.reading", "sensor.scale"
    ),
    "InfluxDB, one column each": rows(
        "#group,false,false,true,true,false,false,false\n#datatype,string,long,dateTime:RFC3339,dateTime:RFC3339,"
        "dateTime:RFC3339,double,double\n#default,_result,,,,,,\n,result,table,_start,_stop,_time,temp_c,force\n",
        f",,0,{SPAN}," + "{t:%Y-%m-%dT%H:%M:%SZ},{a},{b}",
    ),
    "no header": (rows("", ISO + ",{a},{b}"), ["--temperature=2", "--reading=3"]),
    "columns that pandas has counted": (
        rows(",0,1,2\n", "{k}," + ISO + ",{a},{b}"), ["--temperature=1", "--reading=2"],
    ),
    "no header, semicolons": (semicolons(head=""), ["--temperature=2", "--reading=3"]),
    "no header, blanks": (rows("", "{k}0  {a}  {b}"), ["--temperature=2", "--reading=3"]),
    "hhmm": rows("date,time,temp,weight\n", "{t:%Y-%m-%d},{h},{a},{b}"),
    "yyyymmdd, a colon and hhmm": rows("time,temp,weight\n", "{t:%Y%m%d}:{t:%H%M},{a},{b}"),
    "yyyymmdd and hhmm": rows("date,time,temp,weight\n", "{t:%Y%m%d},{h},{a},{b}"),
    "yyyymmdd and hhmmss": rows("date,time,temp,weight\n", "{t:%Y%m%d},{t:%H%M%S},{a},{b}"),
    "hhmm without a date": rows("hhmm,temp,weight\n", "{h},{a},{b}", TIMES - pd.Timedelta("3h30min")),
    "day first, through midnight": rows("time,temp,weight\n", DAY + ",{a},{b}", BEFORE_MIDNIGHT),
    "days of MATLAB": rows("datenum,temp,weight\n", "{k:.0f},{a},{b}").replace("\n", "\n", 1),
    "midnight as 24:00:00": rows("time,temp,weight\n", ISO + ",{a},{b}").replace(
        "2024-05-31 00:00:00", "2024-05-30 24:00:00"
    ),
    "midnight as 24:00, day first": rows("time,temp,weight\n", "{t:%d.%m.%Y %H:%M},{a},{b}").replace(
        "31.05.2024 00:00", "30.05.2024 24:00"
    ),
    "a broken formula in another column": rows("time,temp,weight,dew\n", ISO + ",{a},{b},1.5").replace(
        "1.5\n", "#VALUE!\n", 1
    ),
    "an infinity in another column": rows("time,temp,weight,dew\n", ISO + ",{a},{b},1.5").replace("1.5\n", "Inf\n", 1),
    "a broken formula and infinities in the columns that are used": rows(
        "time,temp,weight\n", ISO + ",{a},{b}"
    ) + "2024-05-31 00:20:00,#VALUE!,1000.0\n2024-05-31 00:21:00,23.0,Inf\n2024-05-31 00:22:00,-inf,1000.0\n",
    "totals below": rows("time,temp,weight\n", ISO + ",{a},{b}") + "Average,23.0,1000.5\nTotal,,40020.0\n",
    "totals below, semicolons": semicolons(head="Datum;Temp;Gewicht\n") + "Summe;;40020,0\n",
    "a number for no value": (
        rows("time,temp,weight\n", ISO + ",{a},{b}") + "2024-05-31 00:20:00,-9999,1000.0\n",
        ["--na=-9999"],
    ),
    "a word for no value": (
        rows("time,temp,weight\n", ISO + ",{a},{b}") + "2024-05-31 00:20:00,sensor lost,1000.0\n",
        ["--na=sensor lost"],
    ),
    "rows that come twice": (
        rows("time,temp,weight\n", ISO + ",{a},{b}\n" + ISO + ",{a},{b}"),
        ["--skip-bad-rows"],
    ),
    "two thermometers": rows("time,case_degC,room_degC,bridge\n", ISO + ",{c},{a},{b}"),
    "two thermometers and humidity": rows("time,T1,T2,rh,weight\n", ISO + ",{a},{c},45,{b}"),
    "temperature and resistance by letters": rows("t,T,R\n", "{k}0,{a},{b}"),
    "French": rows("Horodatage;Température (°C);Tension (V)\n", "{t:%d/%m/%Y %H:%M};{a};{b}").replace(".", ","),
    "Chinese": rows("时间,温度,电压\n", ISO + ",{a},{b}"),
    "Spanish": rows("Fecha,Temperatura,Peso\n", ISO + ",{a},{b}"),
    "degrees at the end of the name": rows("No.,Time,Temperature°C,Weight\n", "{k}," + ISO + ",{a},{b}"),
    "degrees behind a blank": rows("Date,Temperature °C,Humidity %rh,mV\n", ISO + ",{a},45.1,{b}"),
    "blanks behind commas": rows("time, temp, weight\n", ISO + ", {a}, {b}"),
    "sep= in the first line": rows("sep=;\ntime;temp;weight\n", ISO + ";{a};{b}"),
    "an unnamed column of rows": rows(",time,temp,weight\n", "{k}," + ISO + ",{a},{b}"),
    "a name that nobody would call a time": rows("stamp_of_sample,amb,dmm\n", ISO + ",{a},{b}"),
    "an epoch": rows("epoch,temp_c,force_N\n", "{k},{a},{b}"),
    "humidity, pressure and supply beside": rows(
        "time,ambient_temp,humidity,pressure,supply_V,output\n", ISO + ",{a},45,1013,5.0,{b}"
    ),
    "date and clock in columns, blanks": rows("date time temp weight\n", "{t:%Y-%m-%d %H:%M:%S} {a} {b}"),
    "a clock with seconds apart from the date, month first": rows(
        "Date;Time;Temp;Weight\n", "{t:%m/%d/%Y};{t:%I:%M:%S %p};{a};{b}", BEFORE_MIDNIGHT
    ),
    "percent signs before the comments": "% logger 7\n% lab\n" + rows("time,temp,weight\n", ISO + ",{a},{b}"),
    "ThingSpeak": (
        rows("created_at,entry_id,field1,field2\n", ISO + " UTC,{k},{a},{b}"),
        ["--temperature=field1", "--reading=field2"],
    ),
}  # fmt: skip
"""Name -> content, or content and the options that its refusal names."""
FIRST["days of MATLAB"] = lines(
    "datenum,temp,weight\n", lambda k, t, a, b: f"{739_037.986111111 + k / 1440:.9f},{a},{b}"
)
FIRST["an epoch"] = lines("epoch,temp_c,force_N\n", lambda k, t, a, b: f"{1_717_112_400 + 60 * k},{a},{b}")

SET = np.where(np.arange(N) < 20, 20.0, 40.0)
"""Set points of an oven."""


def long_history():
    """A thermometer every 10 s and a scale every minute, each value on its own line: the readings keep their times."""

    def row(k, t, a, b):
        between = [f"sensor.oven_temperature,{a},{(t + pd.Timedelta(10 * j, 's')).isoformat()}Z" for j in range(6)]
        return "\n".join([f"sensor.scale,{b},{t.isoformat()}Z", *between])

    return lines("entity_id,state,last_changed\n", row)


FIRST |= {
    "milliseconds below the header": lines(
        "Time\tTC1\tADC1\nMilliseconds\tdegC\tVolts\n", lambda k, t, a, b: f"{60_000 * k}\t{a}\t{b}"
    ),
    "msec in brackets": lines("Time [msec],temp,weight\n", lambda k, t, a, b: f"{60_000 * k},{a},{b}"),
    "minutes as R names them": lines("Time.min.,temp,weight\n", lambda k, t, a, b: f"{k},{a},{b}"),
    "minutes and seconds by their name": lines("time [mm:ss],temp,weight\n", lambda k, t, a, b: f"{k}:00,{a},{b}"),
    "a counter that is called a reading": rows("Reading,Time,Value (V),Temp (C)\n", "{k}," + ISO + ",{b},{a}"),
    "a counter that is called an oven": rows("Oven 3,Time,Celsius(°C),Voltage(V)\n", "{k}," + ISO + ",{a},{b}"),
    "a spread beside the mean": lines(
        "time,Temp Std,Ambient °C,weight\n", lambda k, t, a, b: f"{t},{0.03 + 0.01 * (k % 2)},{a},{b}"
    ),
    "a set point that leads": lines(
        "time,Sollwert °C,Kammer °C,Kraft [N]\n", lambda k, t, a, b: f"{t},{SET[k]},{a},{b}"
    ),
    "a constant thermometer": rows("time,temp_a,temp_b,load\n", ISO + ",20.0,{a},{b}"),
    "times of receipt beside those of measurement": lines(
        "received_at,measured_at,temp,weight\n",
        lambda k, t, a, b: f"{t + pd.Timedelta(7 + k * k % 13, 's')},{t},{a},{b}",
    ),
    "a series that comes more often than the readings": long_history(),
    "fractions of a second in a column": rows(
        "Date,Time,Fractional Seconds,Temp,Weight\n", "{t:%Y-%m-%d},{t:%H:%M:%S},0.{k:02d},{a},{b}"
    ),
    "a date of another name": rows("Prüfdatum;Uhrzeit;Temp;Kraft\n", "{t:%d.%m.%Y};{t:%H:%M:%S};{a};{b}"),
    "NAN, as Campbell writes it": toa5() + '"2024-05-31 00:20:00",40,12.5,NAN,1000.0\n',
    "an empty column beside": rows("time,temp2,temp,weight\n", ISO + ",,{a},{b}"),
    "UTC beside the local time": lines(
        "Local Time,UTC Time,Temp,Weight\n", lambda k, t, a, b: f"{t + pd.Timedelta('2h')},{t},{a},{b}"
    ),
}

FIRST |= {
    "R, the header one name shorter": lines(
        '"time" "temp" "weight"\n', lambda k, t, a, b: f'"{k + 1}" "{t.isoformat()}" {a} {b}'
    ),
    "a comma at the end of the rows alone": rows("time,temp,weight\n", ISO + ",{a},{b},"),
    "dates in parts": lines(
        "Year,Month,Day,Hour,Minute,Second,Temp,Weight\n",
        lambda k, t, a, b: f"{t.year},{t.month},{t.day},{t.hour},{t.minute},{t.second},{a},{b}",
    ),
    "time, sensor, value": lines("time,sensor,value\n", lambda k, t, a, b: f"{t},oven_temp,{a}\n{t},scale,{b}"),
    "Swiss thousands": lines("time;temp;weight\n", lambda k, t, a, b: f"{t};{a};{b:,.3f}".replace(",", "'")),
    "Swiss thousands between commas": lines(
        "time,temp,weight\n", lambda k, t, a, b: f"{t};{a};{b:,.3f}".replace(",", "\u2019").replace(";", ",")
    ),
    "French thousands": lines(
        "time;temp;weight\n",
        lambda k, t, a, b: f"{t};{comma(a)};1\u202f{comma(b)[1:]}" if b >= 1000 else f"{t};{comma(a)};{comma(b)}",
    ),
    "modified Julian dates": lines(
        "MJD,Temp_C,Freq_Hz\n", lambda k, t, a, b: f"{60_460.986111111 + k / 1440:.9f},{a},{b}"
    ),
    "a weekday in front": rows("Time,Temp,Weight\n", "{t:%a %d/%m/%Y %H:%M:%S},{a},{b}"),
    "dates at midnight beside times of day": rows(
        "Date,Time,Temp,Weight\n", "{t:%Y-%m-%d} 00:00:00,{t:%H:%M:%S},{a},{b}"
    ),
    "days and times of day": lines(
        "doy,hhmm,temp,weight\n", lambda k, t, a, b: f"{t.day_of_year},{int(f'{t:%H%M}')},{a},{b}"
    ),
    "constants beside": rows("time,DIO,Ch1 (C),Ch2 (V),Totalizer\n", ISO + ",255,{a},{b},0"),
    "p. m., with a blank": lines(
        "Time,Temp,Weight\n", lambda k, t, a, b: f"{t:%m/%d/%Y %I:%M:%S} {'a. m.' if t.hour < 12 else 'p. m.'},{a},{b}"
    ),
    "fractions of a second without a date": rows("time,ms,temp,weight\n", "{t:%H:%M:%S},{k}0,{a},{b}"),
    "a coarse reading beside what nobody knows": lines(
        "time,temp,weight,co2\n", lambda k, t, a, b: f"{t},{a},{b},{400 + k * 7 % 13}"
    ),
    "relative time": lines("Relative Time (s),Temp (C),Value (V)\n", lambda k, t, a, b: f"{60 * k}.0,{a},{b}"),
}

ASKED = {
    "a unit of time that is not known": (
        lines("Time (weeks),temp,weight\n", lambda k, t, a, b: f"{k},{a},{b}"), "'weeks' in .* is no unit of time"
    ),
    "dates beside decimal hours": (
        lines("Date,Time,temp,weight\n", lambda k, t, a, b: f"{t:%Y-%m-%d},{8 + k / 60:.5f},{a},{b}"),
        "does not follow on",
    ),
    "hours as hhmm, or seconds": (
        lines("time,temp,weight\n", lambda k, t, a, b: f"{100 + 50 * k},{a},{b}", times=TIMES).replace("150,", "200,"),
        "--time-format|does not follow on",
    ),
    "two names alike for the temperature": (rows("time,temp,temp,weight\n", ISO + ",{a},{c},{b}"), "temp .column 2."),
    "a word in the reading, and another column": (
        rows("time,temp,weight,co2\n", ISO + ",{a},{b},400") + "2024-05-31 00:20:00,23.1,sensor lost,401\n", "--na="
    ),
    "a word in one of two thermometers": (
        rows("time,room_temp,case_temp,weight\n", ISO + ",{a},{c},{b}") + "2024-05-31 00:20:00,lost,23.1,1000.0\n",
        "--na=lost",
    ),
    "two readings": (rows("time,temp,u1,u2\n", ISO + ",{a},{b},{b}"), "Which column is the reading"),
    "no times": (lines("temp,weight\n", lambda k, t, a, b: f"{a},{b}"), "--sampling-period"),
    "another header below": (
        rows("time,temp (°C),weight\n", ISO + ",{a},{b}") + "time,temp (°F),weight\n2024-05-31 01:00,73,1000\n",
        "temp|header",
    ),
}  # fmt: skip
"""Name -> content, and the words of the question."""

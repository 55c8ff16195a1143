"""InfluxDB's line protocol: ``scale,room=lab temperature=23.1,weight=1000.5 1717112400000000000``.

Source: https://docs.influxdata.com/influxdb/v2/reference/syntax/line-protocol/
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

import pandas as pd

from ...records import RecordError
from ...records.times import EPOCHS, unix_unit
from ..long_form import wide

_SET = r'[^,= ]+=(?:"[^"]*"|[^,= ]+)'
_LINE = re.compile(rf"(?P<name>[^,= ]+)(?P<tags>(?:,{_SET})*) (?P<fields>{_SET}(?:,{_SET})*) (?P<time>\d+)")
_FIELD = re.compile(r'([^,= ]+)=("[^"]*"|[^,= ]+)')
PLACE = 3.0


def recognises(lines: Sequence[str]) -> bool:
    """True if the first lines are of the protocol, with their times."""
    return all(_LINE.fullmatch(line.strip()) for line in lines[:5] if not line.startswith("#"))


def read(lines: Sequence[str], reading: str | None) -> tuple[pd.DataFrame, str]:
    """A column for each field of each series; a series is told by its name and tags, where there are several."""
    found = []
    for number, line in enumerate(lines, 1):
        if not line.strip() or line.startswith("#"):
            continue
        parts = _LINE.fullmatch(line.strip())
        if parts is None:
            raise RecordError(f"line {number} is no line of the line protocol: {line[:60]!r}")
        series = parts["name"] + parts["tags"]
        found += [(int(parts["time"]), series, field, value) for field, value in _FIELD.findall(parts["fields"])]
    frame = pd.DataFrame(found, columns=["time", "series", "field", "value"])
    unit: Any = unix_unit(frame["time"].min(), frame["time"].max())
    if unit not in ("s", *EPOCHS):
        raise RecordError(f"{frame['time'].iloc[0]}, a time in the first lines, is no Unix time of this century")
    names = frame["field"] if frame["series"].nunique() == 1 else frame["series"] + " " + frame["field"]
    values: Any = pd.to_numeric(frame["value"].str.replace(r"(?<=\d)[iu]$", "", regex=True), errors="coerce")
    times = pd.to_datetime(frame["time"], unit=unit, utc=True)
    result, lead = wide(times, names, values, reading)
    return result, f"line protocol: {len(result.columns) - 1} series on the times of {lead!r}"

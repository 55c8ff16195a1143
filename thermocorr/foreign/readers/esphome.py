"""The log of an ESPHome device: ``[12:34:56][D][sensor:094]: 'Room': Sending state 23.1 °C with 1 decimals ...``."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np
import pandas as pd

from ...records import RecordError
from ...records.units import unit_of_text
from ..clocks import times_of_day
from ..long_form import wide

_HEAD = re.compile(r"(?:\x1b\[[\d;]*m)?\[(?P<clock>\d\d:\d\d:\d\d(?:\.\d+)?)\]\[[A-Z]+\]\[(?P<kind>[\w.]+)")
_STATE = re.compile(
    r".*\[sensor(?::\d+)?\]: '(?P<name>[^']+)'(?:: Sending state| >>) (?P<value>\S+) ?(?P<unit>\S*?)"
    r"(?:\x1b\[[\d;]*m)?(?: with \d+ dec.*)?\s*"
)
PLACE = 2.0


def recognises(lines: Sequence[str]) -> bool:
    """True if the first lines begin as ESPHome's do."""
    return all(_HEAD.match(line) for line in lines[:5])


def read(lines: Sequence[str], reading: str | None) -> tuple[pd.DataFrame, str]:
    """A column for each sensor, on the times of one of them."""
    found = []
    for line in lines:
        head, state = _HEAD.match(line), _STATE.fullmatch(line)
        if head and state:
            found.append((head["clock"], state["name"], state["value"], unit_of_text(state["unit"])))
    if not found:
        raise RecordError("no line says what a sensor sends. Set the logger's level to DEBUG (logger: level: DEBUG)")
    frame = pd.DataFrame(found, columns=["time", "name", "value", "unit"])
    values = pd.to_numeric(frame["value"], errors="coerce").astype(np.float64)
    result, lead = wide(times_of_day(frame["time"]), frame["name"], values, reading)
    units = frame[frame["unit"] != ""].groupby("name")["unit"].first()
    result.attrs["units"] = {name: unit for name, unit in units.items() if name in result.columns}
    return result, f"a log of ESPHome: {len(result.columns) - 1} sensors on the times of {lead!r}"

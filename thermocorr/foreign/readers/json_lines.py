"""One JSON object a line, as MQTT bridges and services write it."""

from __future__ import annotations

import json
from collections.abc import Sequence

import pandas as pd

from ...records import RecordError

PLACE = 1.0


def recognises(lines: Sequence[str]) -> bool:
    """True if the first lines are objects of JSON."""
    return all(line.lstrip().startswith("{") and line.rstrip().endswith("}") for line in lines[:5])


def read(lines: Sequence[str], reading: str | None) -> tuple[pd.DataFrame, str]:
    """A column for each name; names of objects in objects are joined by points."""
    objects = []
    for number, line in enumerate(lines, 1):
        try:
            objects.append(json.loads(line) if line.strip() else None)
        except ValueError:
            raise RecordError(f"line {number} is no object of JSON: {line[:60]!r}") from None
    return pd.json_normalize([one for one in objects if isinstance(one, dict)]), "one JSON object a line"

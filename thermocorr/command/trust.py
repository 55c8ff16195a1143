"""What rows that are corrected tell of their log: another unit than the fitted one, and how few deserve trust."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from ..estimators import DynamicBiasRegressor
from ..estimators.reading import check_median, check_temperature, check_unit
from ..records.numbers import span_text
from ..records.units import ENOUGH, unit_of

MANY = 0.1
"""Share of flagged rows from which it is said how many there are."""


class RowTrust:
    """Looks at the rows of a log as they are corrected.

    Parameters
    ----------
    model : DynamicBiasRegressor
    """

    def __init__(self, model: DynamicBiasRegressor):
        self.model = model
        reading, features = model.reading_, model.features_
        self._first_thermometer = features.history_.record.temperature_name
        self._ranges: dict[Any, tuple[float, float]] = {self._first_thermometer: reading.temperature_range}
        self._ranges |= {
            one.column: one.range for one in features.filling_.stand_ins if one.column in model.thermometers_
        }
        self._first: dict[Any, list[float]] = {name: [] for name in self._ranges}
        self._flags: Counter[str] = Counter()
        self._called: dict[Any, str] = {}
        self._stated: dict[Any, str] = {}

    def read_from(self, reading: str, columns: Mapping[Any, str], units: Mapping[str, str]) -> None:
        """Say which columns of the log are read; RecordError where they are in another unit than the fitted ones.

        Parameters
        ----------
        reading : str
        columns : mapping
            Column of each thermometer that goes by another name than in the fitted record.
        units : mapping
            Units of columns that stand elsewhere than in their names.
        """
        self._called = dict(columns)
        fitted = self.model.reading_
        check_unit("reading", reading, fitted.name, units.get(reading), fitted.unit)
        for thermometer in self.model.thermometers_:
            column = columns.get(thermometer, str(thermometer))
            if thermometer == self._first_thermometer:
                self._stated[thermometer] = units.get(column) or unit_of(column, None)
                check_temperature(fitted, column, str(thermometer), self._stated[thermometer], None)
            else:
                check_unit("temperature", column, str(thermometer), units.get(column))

    def look(self, values: Mapping[Any, Any]) -> None:
        """Look at the temperatures of a row, or of several; RecordError where they are in another unit."""
        for name in list(self._first):
            given = np.atleast_1d(np.asarray(values[name], float))
            self._first[name] += given[np.isfinite(given)].tolist()
            if len(self._first[name]) >= ENOUGH:
                median, called = float(np.median(self._first.pop(name))), self._called.get(name, name)
                if name in self._stated:
                    check_temperature(self.model.reading_, str(called), str(name), self._stated[name], median)
                check_median(median, called, *self._ranges[name])

    def count(self, flags: Iterable[str]) -> None:
        """Count rows by their flags."""
        self._flags.update(flags)

    def summary(self) -> str:
        """How many rows have which flag, and what to do; empty where nearly all have none."""
        flagged, rows = Counter({flag: n for flag, n in self._flags.items() if flag}), sum(self._flags.values())
        if sum(flagged.values()) <= MANY * rows:
            return ""
        by_flag = [f"{count} {flag}" for flag, count in flagged.most_common()]
        head = f"{sum(flagged.values())} of {rows} lines are flagged"
        if len(by_flag) == 1:
            (only,) = flagged
            return f"{head} {only}{self._advice(only, ': ')}."
        advice = "".join(self._advice(flag, f". {flag}: ") for flag, n in flagged.most_common() if n > MANY * rows)
        return f"{head}: {', '.join(by_flag)}{advice}."

    def _advice(self, flag: str, before: str) -> str:
        if flag == "washout":
            return (
                f"{before}the log lacks the time before them, which the model remembers for about "
                f"{span_text(self.model.washout_)}. No uncertainty is given for them. Go on from a saved state "
                "(--state), or begin the log earlier"
            )
        if flag == "outside fitted range":
            low, high = self.model.reading_.temperature_range
            return (
                f"{before}the model was fitted to temperatures of {low:.4g} to {high:.4g} "
                f"{self.model.reading_.temperature_unit}, and nothing is known beyond. Fit it to a record that "
                "reaches further"
            )
        return ""

"""What a log's columns are, by unit, name and values."""

from __future__ import annotations

import re
import shlex
from collections.abc import Sequence
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from ..records import RecordError
from ..records.errors import listing, option, quoted, way
from ..records.types import kind_of
from ..records.units import DEGREES, TEMPERATURES, name_and_unit, unit_of

READINGS = re.compile(
    r"reading|measur|dmm|bridge|brücke|messwert|anzeige|spannung|widerstand|tension|voltage|volt|resist|value|output"
    r"|frequency|freq|weight|gewicht|load|force|kraft|strain|tilt|mass|poids|peso|level|(?<![a-z])(?:head|dut)(?![a-z])"
    r"|^lc[_ ]?\d*|^[uvr]$",
    re.IGNORECASE,
)
"""Names that readings go by."""
SURROUNDINGS = re.compile(
    r"humid|feucht|^rh|pressure|druck|baro|suppl|batt|panel|^setp|set[_ ]?point|target|rssi|quality|serial|logged"
    r"|connected|attached|detached|stopped|end of file|signal|status|alarm"
    r"|^(ms|msec|sub|lat|lon|elevation|ele)$|(?<![a-z])(dew|wind(?!ing)|solar|rain|state|flag|error)",
    re.IGNORECASE,
)
"""Names of what is recorded with a reading."""
SPREADS = re.compile(r"(?<![a-z])(std|stdev|stddev|sd|sigma|var|variance)(?![a-z])", re.IGNORECASE)
"""Names of what says how much a quantity varied, and not how large it was."""
RUN = "file"
"""Column of the names of files, each a run."""
RUNS = ("run", "run_id", "run id", RUN)
"""Names, in small letters, that labels of runs go by."""
FEWEST = 10
"""Rows that a column must count."""


class Roles(NamedTuple):
    """Columns of a log by role; None where unknown."""

    temperature: str | None
    reading: str | None
    run: str | None
    in_doubt: dict[str, tuple[str, ...]]
    """Role that is in doubt -> columns that it may be."""
    why: dict[str, str]
    """Role found by more than a name -> how."""

    def sentence(self) -> str:
        """Sentence on roles that were guessed."""
        return ", ".join(f"{quoted(getattr(self, role))} as the {role} ({why})" for role, why in self.why.items())

    def ask(self, columns: Sequence[Any], timed: bool) -> None:
        """Raise RecordError for what a person must say."""
        unknown = [*(() if timed else ("time",)), *(r for r in ("temperature", "reading") if getattr(self, r) is None)]
        if not unknown:
            return
        *first, last = unknown
        which = f"columns are the {', the '.join(first)} and the {last}" if first else f"column is the {last}"
        between = list(dict.fromkeys(name for role in unknown for name in self.in_doubt.get(role, ())))
        headless = f"; the file has no header: {option('names')} calls them otherwise" if str(columns[0]) == "1" else ""
        without = f". Rows without times: {option('sampling_period', '15s')}" if "time" in unknown else ""
        of = f"as likely are {listing(between, 20)}" if len(between) > 1 else f"there are {listing(columns, 20)}"
        raise RecordError(f"Which {which}? Say it with {', '.join(map(option, unknown))}; {of}{headless}{without}.")


def guess(
    frame: pd.DataFrame,
    *,
    temperature: str | None = None,
    reading: str | None = None,
    reference: str | None = None,
    run: str | None = None,
) -> Roles:
    """Guess the roles of a log's columns.

    `frame` (DataFrame): As `read_log` gives it. `temperature`, `reading`, `reference`, `run` (str, optional): What the
    user says; a reference, which the reading is compared with, is never guessed. Raises RecordError where the
    temperature or the reading has cells that are words.
    """
    why: dict[str, str] = {}
    in_doubt: dict[str, tuple[str, ...]] = {}
    given = {name for name in (temperature, reading, reference, run) if name}
    run = run or run_among([str(name) for name in frame.columns if str(name) not in given])
    words = frame.attrs.get("words", {})
    numbers = [str(c) for c in frame.columns if kind_of(frame[c]) == "number" or str(c) in words]
    numbers = [
        name for name in numbers if name not in {*given, run} and not is_counter(frame[name]) and frame[name].count()
    ]
    thermometers = [name for name in numbers if _is_temperature(name, frame)]
    others = [name for name in numbers if name not in thermometers and unit_of(name, frame) not in DEGREES]
    others = [name for name in others if name not in thermometers and not _stands(frame[name])] or others
    stated = [name for name in _moving(frame, thermometers) if unit_of(name, frame) in DEGREES]
    thermometers = stated or thermometers  # a unit that stands there says more than a name
    measured = [name for name in others if not _is_surrounding(name)]
    if reference is not None:
        own = thermometers if _is_temperature(reference, frame) and thermometers else numbers
        if reading is None and own:
            reading, why["reading"] = _closest(frame, own, reference), f"closest to {quoted(reference)}"
        thermometers = [name for name in thermometers if name != reading]
        measured, others = ([name for name in some if name != reading] for some in (measured, others))
        if temperature is None and reading is not None and not thermometers:
            temperature, why["temperature"] = reading, "its own"
    if temperature is None:
        exact = [name for name in thermometers if _bare(name) in ("temperature", "ambient_temperature", "temperatur")]
        found = exact[:1] or _moving(frame, thermometers)
        if len(found) > 1:
            temperature = _leading(frame, found)
            why["temperature"] = f"it leads {listing([name for name in found if name != temperature], 3)}"
        elif found:
            temperature = found[0]
        elif len(others) == 1 and reading is not None:
            temperature, why["temperature"] = others[0], "the only other column"
        in_doubt["temperature"] = tuple(measured or others)
    if reading is None:
        called = called_readings(measured)
        exact = [name for name in numbers if _bare(name) == "reading" and name != temperature]
        found = next((names for names in (exact, called, measured) if len(names) == 1), [])
        if found:
            reading = found[0]
            if found not in (exact, called):
                why["reading"] = "the only other column" if len(others) == 1 else "the others are of its surroundings"
        in_doubt["reading"] = tuple(called if len(called) > 1 else measured or others)
    if temperature is None and reading is not None:
        rest = [name for name in others if name != reading]
        if len(rest) == 1 and not _is_surrounding(rest[0]) and not _stands(frame[rest[0]]):
            temperature, why["temperature"] = rest[0], "the only other column"
    chosen = {"temperature": temperature, "reading": reading}
    for role, name in chosen.items():
        alike = [] if name is None else [str(c) for c in frame.columns if _plain(str(c)) == _plain(name)]
        if name is not None and name not in given and len(alike) > 1 and name != _plain(name):  # one name for several
            chosen[role], in_doubt[role] = None, tuple(alike)
            why.pop(role, None)
    for name in chosen.values():
        refuse_words(frame, name)
    return Roles(chosen["temperature"], chosen["reading"], run, in_doubt, why)


def refuse_words(frame: pd.DataFrame, name: str | None) -> None:
    """Raise RecordError for a column that has words in some cells."""
    word = frame.attrs.get("words", {}).get(name)
    if word is not None:
        raise RecordError(
            f"{quoted(name)} holds {word!r} in some rows, and no number. If it says that there is no value, pass "
            f"{way(f'--na={shlex.quote(word)}', f'na={word!r}')}; if these rows are damaged, pass over them with "
            f"{option('skip_bad_rows', 'True')}."
        )


def run_among(names: Sequence[str]) -> str | None:
    """The column of labels of runs, by its name."""
    return next((name for name in names if name.strip().lower() in RUNS), None)


def called_readings(names: Sequence[str]) -> list[str]:
    """Those of some columns that are called like readings."""
    others = [name for name in names if not TEMPERATURES.search(name) and not _is_surrounding(name)]
    return [name for name in others if READINGS.search(name_and_unit(name)[0].strip())]


def is_counter(column: pd.Series[Any]) -> bool:
    """True if a column counts the rows."""
    if kind_of(column) != "number" or len(column) < FEWEST:
        return False
    values = column.to_numpy(float)
    return bool((values[0] % 1 == 0) and (np.diff(values) == 1).mean() > 0.9)


def _is_surrounding(name: str) -> bool:
    """True if a name is of what surrounds a measurement."""
    return bool(SURROUNDINGS.search(name) or SPREADS.search(name.replace("_", " ")))


def _closest(frame: pd.DataFrame, names: Sequence[str], reference: str) -> str:
    """The column that differs least from the reference."""
    true = _values(frame[reference])
    return min(names, key=lambda name: float(np.nanmedian(np.abs(_values(frame[name]) - true))))


def _moving(frame: pd.DataFrame, names: Sequence[str]) -> list[str]:
    """Thermometers that move; set points do not."""
    moved = {name: float(np.sum(np.abs(np.diff(_values(frame[name]))) > 0)) for name in names}
    # What moves in less than a tenth of the steps of the liveliest thermometer is a set point.
    return [name for name in names if moved[name] > 0.1 * max(moved.values(), default=0.0)] or list(names)


def _leading(frame: pd.DataFrame, names: Sequence[str]) -> str:
    """The thermometer that the others follow.

    Two are compared by the change over k rows of one against that over the k rows behind it of the other, and the other
    way round, where k (1, 2, 4, ...) tells them apart most.
    """
    rows = np.column_stack([_values(frame[name].iloc[:20_000]) for name in names])
    rows = rows[np.isfinite(rows).all(axis=1)]
    middle = np.median(rows, axis=0)
    reach = 6.0 * np.median(np.abs(rows - middle), axis=0)
    rows = np.clip(rows, middle - reach, middle + reach)  # one damaged row decides nothing
    ahead = np.zeros(len(names))
    for a, b in combinations(range(len(names)), 2):
        lead = _lead(rows[:, a], rows[:, b])
        ahead[a] += lead > 0
        ahead[b] += lead < 0
    return names[int(ahead.argmax())]


def _lead(x: np.ndarray, y: np.ndarray) -> float:
    """Lead of x over y, from -1 to 1."""
    most, k = 0.0, 1
    while 8 * k <= len(x):
        dx, dy = x[k:] - x[:-k], y[k:] - y[:-k]
        size = float(np.std(dx) * np.std(dy))
        lead = float(np.mean(dx[:-k] * dy[k:]) - np.mean(dx[k:] * dy[:-k])) / size if size > 0 else 0.0
        most = lead if abs(lead) > abs(most) else most
        k *= 2
    return most


def _plain(name: str) -> str:
    """A name without the number of its copy."""
    return re.sub(r" \(column \d+\)$", "", name)


def _bare(name: str) -> str:
    """A column's name without its unit, in small letters."""
    return name_and_unit(name)[0].strip().lower()


def _is_temperature(name: str, frame: pd.DataFrame) -> bool:
    unit = unit_of(name, frame)
    called = not unit and bool(TEMPERATURES.search(name_and_unit(name)[0].strip()))
    return (unit in DEGREES or called) and not _is_surrounding(name)


def _values(column: Any) -> np.ndarray:
    """Numbers of a column, NaN for its words."""
    return np.asarray(pd.to_numeric(column, errors="coerce"), float)


def _stands(column: pd.Series[Any]) -> bool:
    """True if a column has one value alone."""
    return len(column) > 1 and column.nunique() == 1

"""Cells of a table, and the user's options."""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
import pandas as pd

from ..records import RecordError
from ..records.errors import option, quoted

SEPARATORS = {",": ",", ";": ";", "\t": "\t", "|": "|", " ": " ", "comma": ",", "semicolon": ";", "tab": "\t",
              "\\t": "\t", "bar": "|", "blanks": " ", "space": " "}  # fmt: skip
"""What a separator may be called -> the separator."""


@dataclass(frozen=True, kw_only=True)
class Options:
    """What the user says of a file; see `read_log`."""

    sep: str | None = None
    decimal: str | None = None
    encoding: str | None = None
    names: Sequence[str] = ()
    na: Sequence[str] = ()
    sheet: str | None = None
    skip_bad_rows: bool = False
    time: str | None = None
    time_format: str | None = None
    timezone: str | None = None
    reading: str | None = None
    run: str | None = None
    others: tuple[str, ...] = ()
    """Columns that are something else than the times."""

    def __post_init__(self) -> None:
        if self.sep is not None:
            if self.sep not in SEPARATORS:
                raise RecordError(f"{option('sep', repr(self.sep))} is not one of: comma, semicolon, tab, bar, blanks.")
            object.__setattr__(self, "sep", SEPARATORS[self.sep])
        if self.decimal not in (None, ".", ","):
            raise RecordError(f"{option('decimal', repr(self.decimal))} is neither . nor a comma.")
        for name in ("names", "na", "others"):
            given = getattr(self, name)
            object.__setattr__(self, name, (given,) if isinstance(given, str) else tuple(map(str, given)))
        named = [name for name in (self.reading, self.run) if name]
        object.__setattr__(self, "others", tuple(dict.fromkeys((*self.others, *named))))

    def given(self) -> dict[str, object]:
        """What differs from the defaults: the keywords of `read_log`."""
        pairs = {one.name: getattr(self, one.name) for one in fields(self) if one.name != "others"}
        return {name: value for name, value in pairs.items() if value not in (None, False, ())}


NO_VALUE = (
    "-", "--", "---", "----", "-----", "*", "***", "?", "OL", "O.L", "0L", "OVLD", "OVL", "OVER", "-OVER", "+OVER",
    "OVERLOAD", "OVERFLOW", "OVERRANGE", "Over range", "Out of range", "UNDER", "UNDERRANGE", "NAN", "none",
    "undefined", "unavailable", "unknown", "No data", "NoData", "open", "fault", "error", "err", "bad", "invalid",
    "timeout", "offline", "#VALUE!", "#REF!", "#DIV/0!", "#NUM!", "#NAME?", "#NV", "#WERT!", "\u2212", "\u2013",
)  # fmt: skip
"""What instruments and programs write in place of a number, and pandas does not know."""
SAID_EMPTY = {word.lower() for word in (*NO_VALUE, "", "null", "n/a", "#n/a", "na", "nan", "inf", "-inf")}
_SIGN = r"[-+\u2212\u2013]?"
NUMBER = {
    ".": _SIGN + r"(?:\d[\d'\u2019\u00a0\u202f]*\.?\d*|\.\d+|\d{1,3}(?:,\d{3})+(?:\.\d*)?)(?:[eEdD][-+]?\d+)?",
    ",": _SIGN + r"(?:\d[\d'\u2019\u00a0\u202f.]*,?\d*|,\d+)(?:[eEdD][-+]?\d+)?",
}
"""Decimal sign -> pattern of a number, with signs between thousands."""
OF_DAY = r"\d+:\d{1,2}(?::\d{1,2})?(?:[.,:]\d+)?(?: ?[apAP]\.? ?[mM]\.?)?"
ZONE = r"(?: ?(?:Z|UTC|GMT)| ?[-+]\d\d:?(?:\d\d)?)"
_DATE = (
    r"(?:[A-Za-z]{2,3},? )?(?:\d{4}([-/.])\d{1,2}\1\d{1,2}|\d{4}-W\d\d-\d|\d{1,2}([-/. ])\d{1,2}\2(?:\d{4}|\d\d)"
    r"|\d{1,2}\.?[- ]?[^\W\d_]{3,}\.?[- ,.]+\d{2,4}|[^\W\d_]{3,9} \d{1,2},? \d{4}|\d{8}|\d{6})"
)
_CTIME = r"(?:[A-Za-z]{3} )?[A-Za-z]{3} {1,2}\d{1,2} \d\d:\d\d:\d\d \d{4}"
COMMENTS = ("#", "%", "//")
"""Marks at the beginning of a comment line."""
MOMENT = re.compile(
    rf"{_DATE}(?:[T ,_:]*(?:{OF_DAY}|\d{{6}}|\d{{4}}|\d\d?\.\d\d\.\d\d)?{ZONE}?)?|{OF_DAY}{ZONE}?|{_CTIME}"
    r"|-?\d+ ?d(?:ays?)?\b.*"
)
"""A date, a time of day, or both."""
_SIGNS = str.maketrans({"\u2212": "-", "\u2013": "-", "'": "", "\u2019": "", "\u00a0": "", "\u202f": ""})


def is_typed(cell: str, decimal: str) -> bool:
    """True if a cell is a number or a time."""
    return bool(re.fullmatch(NUMBER[decimal] + r"(?: ?[°%\w/²³µμ℃Ω]{1,6})?", cell) or MOMENT.fullmatch(cell))


def split(line: str, separator: str) -> list[str]:
    """The cells of a line, bare."""
    if '"' in line:
        text = line.strip() if separator == " " else line
        try:
            cells = next(csv.reader([text], delimiter=separator, skipinitialspace=True), [])
        except csv.Error:  # a cell of more than 128 KiB
            return []
    else:
        cells = line.split() if separator == " " else line.split(separator)
    return [cell.strip() for cell in cells]


def is_number(column: pd.Series) -> bool:
    """True for a column of numbers; switches do not count."""
    return pd.api.types.is_numeric_dtype(column) and not pd.api.types.is_bool_dtype(column)


def varies(column: pd.Series) -> bool:
    """True if a column has more than one value."""
    return column.head(1000).nunique() > 1 or column.nunique() > 1


def as_numbers(column: pd.Series, decimal: str, unit: str | None = None) -> tuple[pd.Series, str] | None:
    """Text as numbers, and their unit; None for other text.

    Signs between thousands, exponents after D and a unit behind every number are ways of writing. `unit` (str,
    optional): What is behind them, if that is known: then nothing is asked, and None is for no number at all. Raises
    RecordError where whole thousands may be fractions, or where some numbers have points and others commas.
    """
    known, sure = column.dropna(), unit is None
    bare = len(known) and decimal == "." and re.fullmatch(NUMBER["."], str(known.iloc[0]))
    if bare:  # asked before times, which may be written in digits alone
        plain = pd.to_numeric(known, errors="coerce")
        if plain.notna().all():
            return plain.reindex(column.index).astype(float), ""
    if not len(known) or not _likely(known.iloc[_spread(len(known))]).mean() > (0.5 if sure else 0.0):
        return None
    known = known.astype(str).str.strip()
    text = known[_likely(known)].map(lambda cell: cell.translate(_SIGNS))
    behind = r"^([-+]?[.,\d]*\d(?:[eE][-+]?\d+)?)\s*([^\d\s.,:+-][^\d:]*)$"
    if unit is None:
        some = text.iloc[_spread(len(text))].str.extract(behind)[1]
        unit = str(some.mode().iloc[0]) if some.notna().mean() > 0.5 else ""
    if unit:
        parts = text.str.extract(behind)
        text = parts[0][parts[1] == unit]
        decimal = "," if text.str.contains(",").any() and not text.str.contains(".", regex=False).any() else decimal
    other = "." if decimal == "," else ","
    grouped = text.str.fullmatch(rf"[-+]?\d{{1,3}}(?:\{other}\d{{3}})+(?:\{decimal}\d*)?")
    if grouped.any():
        whole = text[grouped & ~text.str.contains(decimal, regex=False)]
        if len(whole) and sure:
            raise RecordError(
                f"{whole.iloc[0]!r} in {quoted(column.name)} may be a thousandfold, or a fraction. Say the sign of "
                f"decimals with {option('decimal')}."
            )
        text = text.where(~grouped, text.str.replace(other, "", regex=False)).drop(whole.index)
    if decimal == ",":
        points = text[text.str.contains(".", regex=False)]
        if len(points) and sure:
            raise RecordError(
                f"{points.iloc[0]!r} in {quoted(column.name)} has a point, and other numbers have commas. Say the "
                f"sign of decimals with {option('decimal')}."
            )
        text = text.drop(points.index).str.replace(",", ".", regex=False)
    values = pd.to_numeric(text.str.replace(r"(?<=\d)[dD](?=[-+]?\d)", "e", regex=True), errors="coerce")
    if not values.notna().any():
        return None
    return values.reindex(column.index).astype(float), unit


def _spread(n: int) -> np.ndarray:
    """Numbers of up to 200 rows of n."""
    return np.unique(np.linspace(0, n - 1, 200).astype(int))


def _likely(cells: pd.Series) -> pd.Series:
    """Mask of cells that may be numbers."""
    text = cells.astype(str).str.strip()
    return text.str.match(rf"{_SIGN}[.,]?\d") & ~text.str.fullmatch(MOMENT)


def says_something(cells: pd.Series) -> pd.Series:
    """Mask of cells that hold a value."""
    return cells.notna() & ~cells.astype(str).str.strip().str.lower().isin(SAID_EMPTY)


def refuse_thousands(values: pd.Series, name: str) -> None:
    """Raise RecordError for thousands read as fractions."""
    size = np.abs(values.to_numpy(float))
    few = size[:1000]
    if not np.nanmax(size, initial=0.0) >= 100 or (few[(few >= 100) & np.isfinite(few)] % 1).any():
        return
    large, small = size[(size >= 100) & np.isfinite(size)], size[(size < 100) & (size > 0)]
    if not len(large) or not len(small) or large.max() >= 1000 or (large % 1).any() or not (small % 1).any():
        return
    whole = np.allclose(small * 1000, np.round(small * 1000))
    if whole and 0 <= small.min() * 1000 - large.max() < 0.5 * large.max():
        raise RecordError(
            f"{quoted(name)} has {large[-1]:g} and {small[0]:g}: a thousandfold, or a fraction? Say the sign of "
            f"decimals with {option('decimal')}."
        )

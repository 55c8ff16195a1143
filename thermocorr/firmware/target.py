"""Target of a program: precision, steps, names."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Collection
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from ..records import History
from .statements import Kind

DEFAULT_PREFIX = "thermal_bias"
_SIGNS = str.maketrans({"\u00b0": "deg", "\u03bc": "u", "\u03a9": "Ohm", "\u00df": "ss", "\u2206": "D", "\u0394": "D"})
"""Signs of units and names as ASCII has them, once others are taken apart: degree, micro, ohm, sharp s, delta."""


def one_line(text: object, apart: Collection[tuple[str, str]] = ()) -> str:
    """Text of the user for a comment: one line, ASCII, no backslash; a blank parts marks that must stand `apart`.

    Examples
    --------
    >>> one_line("Wägezelle [µV/°C]")
    'Wagezelle [uV/degC]'
    """
    parted = (c for c in unicodedata.normalize("NFKD", str(text)) if not unicodedata.combining(c))  # no accents
    plain = "".join(parted).translate(_SIGNS).encode("ascii", "replace").decode()
    plain = "".join(c if c.isprintable() else " " for c in plain).replace("\\", "/")
    between = "|".join(f"(?<={re.escape(one)})(?={re.escape(other)})" for one, other in apart)
    return re.sub(between, " ", plain) if apart else plain


def identifier(text: object, keywords: Collection[str], taken: set[str] | None = None, fallback: str = "x") -> str:
    """An identifier close to a text of the user's, no keyword, none of those in `taken` (to which it is added)."""
    plain = unicodedata.normalize("NFKD", str(text)).encode("ascii", "ignore").decode()
    name = re.sub(r"[^0-9A-Za-z]+", "_", plain).strip("_") or fallback
    if name[0].isdigit() or name.lower() in keywords:
        name = f"{fallback}_{name}"
    taken = set() if taken is None else taken
    result, count = name, 1
    while result.lower() in taken:
        count += 1
        result = f"{name}_{count}"
    taken.add(result.lower())
    return result


def prefix(text: object, keywords: Collection[str], unfit: Collection[str]) -> str:
    """The user's name for an export: prefix of all that the code shows outside, and name of its files.

    It never stands alone in the code, and no text of the code is replaced. So it can hit no name of a library and none
    of the code's own, but for those in `unfit`.
    """
    name = identifier(text, keywords, fallback=DEFAULT_PREFIX)
    return f"{DEFAULT_PREFIX}_{name}" if name.lower() in unfit else name


Dtype = Literal["float", "double"]
"""Precision of the numbers on the device: single or double."""
MICROSECONDS = 1_000_000
LONGEST_STEP_US = 10**14
"""A longer step between samples cannot be true: three years."""


@dataclass(frozen=True)
class Target:
    """Choices of an export that every part of the code depends on."""

    name: str
    """Prefix of every name that the code shows outside."""
    dtype: Dtype
    period: float | None
    """Fixed time between samples [s]; None where each update is told its step."""
    reference_temperature: float
    """Temperature from which the code counts, exact in `dtype`."""
    temperature_name: Any
    degree: str
    """Unit of a difference of temperatures."""
    history: History
    """Fitted record."""

    @property
    def longest_step(self) -> float | None:
        """Steps longer than this start a new segment [s], as `max_gap` does in Python; None: no step does."""
        return None if self.fixed else self.history.max_gap

    @property
    def single(self) -> bool:
        """True if numbers are of single precision."""
        return self.dtype == "float"

    @property
    def fixed(self) -> bool:
        """True if the time between samples is known now."""
        return self.period is not None

    def held(self, value: float) -> float:
        """A number as the device holds it."""
        return float(np.float32(value)) if self.single else float(value)

    def bytes_of(self, kind: Kind) -> int:
        """Size of a value on the device."""
        if kind == "number":
            return 4 if self.single else 8
        return 8 if kind in ("int64", "uint64") else 4

    def absolute_zero(self) -> float:
        """Absolute time of the first fitted row [s], from which phases of periods count."""
        return self.history.between(self.history.zero, 0)

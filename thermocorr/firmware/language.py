"""C as text: numbers with all their digits, names, comments, and the count of operations in a statement."""

from __future__ import annotations

import re
import unicodedata
from dataclasses import dataclass, fields
from typing import Literal

import numpy as np

Dtype = Literal["float", "double"]

_KEYWORDS = frozenset(
    """
    auto break case char const continue default do double else enum extern float for goto if inline int long register
    restrict return short signed sizeof static struct switch typedef union unsigned void volatile while main
    """.split()  # noqa: SIM905
)
_HEADERS = frozenset(
    """
    assert complex ctype errno features fenv float inttypes iso646 limits locale math setjmp signal stdalign stdarg
    stdatomic stdbool stddef stdint stdio stdlib stdnoreturn string tgmath threads time uchar wchar wctype
    """.split()  # noqa: SIM905
)
"""A file of such a name would be found in the place of the library's where the include path holds its folder."""
_WITH_INIT = frozenset(
    """
    atomic cnd mtx posix_spawn_file_actions posix_spawnattr pthread_attr pthread_barrier pthread_barrierattr
    pthread_cond pthread_condattr pthread_mutex pthread_mutexattr pthread_rwlock pthread_rwlockattr pthread_spin sem
    """.split()  # noqa: SIM905
)
"""Prefixes that C11 and POSIX use for an ``..._init`` of their own."""
DEFAULT_PREFIX = "thermal_bias"


def number(value: float, dtype: Dtype) -> str:
    """A constant in C that reads back as the same float (9 digits) or double (17 digits).

    Raises ValueError for a number that the type cannot hold.
    """
    value = float(value)
    if dtype == "double":
        text = f"{value:.17g}"
        held = np.isfinite(value)
    else:
        with np.errstate(over="ignore", under="ignore"):
            single = np.float32(value)
        text = f"{single:.9g}"
        smallest = float(np.finfo(np.float32).tiny)
        held = bool(np.isfinite(single)) and (value == 0.0 or abs(value) >= smallest)
    if not held:
        raise ValueError(f"The constant {value!r} has no place in a C {dtype}. Export with dtype='double'.")
    if not any(mark in text for mark in ".e"):
        text += ".0"
    return text + ("f" if dtype == "float" else "")


def comment(text: object) -> str:
    """Text of the user that may stand in a C comment: one line, ASCII, and no end of the comment in it."""
    plain = unicodedata.normalize("NFKD", str(text)).encode("ascii", "replace").decode()
    plain = "".join(c if c.isprintable() else " " for c in plain).replace("\\", "/")
    return re.sub(r"(?<=\*)(?=/)|(?<=/)(?=\*)|(?<=\?)(?=\?)", " ", plain)  # no comment begins or ends, no trigraph


def identifier(text: object, taken: set[str] | None = None, fallback: str = "x") -> str:
    """A C identifier close to a text of the user's, none of those in `taken` (to which it is added)."""
    plain = unicodedata.normalize("NFKD", str(text)).encode("ascii", "ignore").decode()
    name = re.sub(r"[^0-9A-Za-z]+", "_", plain).strip("_") or fallback
    if name[0].isdigit() or name.lower() in _KEYWORDS:
        name = f"{fallback}_{name}"
    taken = set() if taken is None else taken
    result, count = name, 1
    while result.lower() in taken:
        count += 1
        result = f"{name}_{count}"
    taken.add(result.lower())
    return result


def prefix(text: object) -> str:
    """The user's name for an export: prefix of all that the C code shows outside, and name of its files.

    It never stands alone in the code, but before ``_state``, ``_init`` or a flag's name (as a column's name stands
    behind ``..._COLUMN_``), and no text of the code is replaced. So it can hit no keyword, macro or function of a
    library, and no name of the code's own, but for the headers and functions that are listed above.
    """
    name = identifier(text, fallback=DEFAULT_PREFIX)
    return f"{DEFAULT_PREFIX}_{name}" if name.lower() in _HEADERS | _WITH_INIT else name


@dataclass(frozen=True)
class Operations:
    """Floating-point operations of some code."""

    multiply_adds: int = 0
    """Multiplications, each with the addition that takes its product, if there is one in its statement."""
    adds: int = 0
    """Additions and subtractions beside those."""
    divisions: int = 0
    calls: int = 0
    """Calls of libm: exp, sin, ..."""

    def __add__(self, other: Operations) -> Operations:
        return Operations(*(getattr(self, f.name) + getattr(other, f.name) for f in fields(self)))

    def __mul__(self, times: int) -> Operations:
        return Operations(*(times * getattr(self, f.name) for f in fields(self)))

    @property
    def total(self) -> int:
        """Operations of every kind together."""
        return self.multiply_adds + self.adds + self.divisions + self.calls

    @classmethod
    def of(cls, products: int = 0, sums: int = 0, divisions: int = 0, calls: int = 0) -> Operations:
        """Operations of one statement: each product takes an addition with it, as long as there are any."""
        return cls(products, max(0, sums - products), divisions, calls)

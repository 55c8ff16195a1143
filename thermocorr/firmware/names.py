"""Names and comments of C from texts of the user's."""

from __future__ import annotations

import re
import unicodedata

DEFAULT = "thermal_bias"
_UNFIT = frozenset(
    """
    assert complex ctype errno features fenv float inttypes iso646 limits locale math setjmp signal stdalign stdarg
    stdatomic stdbool stddef stdint stdio stdlib stdnoreturn string tgmath threads time uchar wchar wctype
    atomic cnd mtx posix_spawn_file_actions posix_spawnattr pthread_attr pthread_barrier pthread_barrierattr
    pthread_cond pthread_condattr pthread_mutex pthread_mutexattr pthread_rwlock pthread_rwlockattr pthread_spin sem
    """.split()  # noqa: SIM905
)
"""Headers of C's library, which a file of that name would hide, and what has an ``..._init`` of its own there."""
_SIGNS = str.maketrans({"\u00b0": "deg", "\u03bc": "u", "\u03a9": "Ohm", "\u00df": "ss", "\u2206": "D", "\u0394": "D"})
"""Signs of units and names as ASCII has them, once others are taken apart: degree, micro, ohm, sharp s, delta."""


def comment(text: object) -> str:
    """Text of the user's for a comment: one line of ASCII that neither ends the comment nor goes on behind its line.

    Examples
    --------
    >>> comment("Wägezelle */ [µV/°C]")
    'Wagezelle * / [uV/degC]'
    """
    parted = (c for c in unicodedata.normalize("NFKD", str(text)) if not unicodedata.combining(c))  # no accents
    plain = "".join(parted).translate(_SIGNS).encode("ascii", "replace").decode()
    plain = "".join(c if c.isprintable() else " " for c in plain).replace("\\", "/")
    return re.sub(r"(?<=\*)(?=/)|(?<=/)(?=\*)|(?<=\?)(?=\?)", " ", plain)  # ends, beginnings, trigraphs


def identifier(text: object, taken: set[str], fallback: str) -> str:
    """An identifier close to a text of the user's that is not in `taken`, to which it is added."""
    plain = unicodedata.normalize("NFKD", str(text)).encode("ascii", "ignore").decode()
    name = re.sub(r"[^0-9A-Za-z]+", "_", plain).strip("_") or fallback
    name = f"{fallback}_{name}" if name[0].isdigit() else name
    result, count = name, 1
    while result.lower() in taken:
        count += 1
        result = f"{name}_{count}"
    taken.add(result.lower())
    return result


def prefix(text: object) -> str:
    """The user's name for an export: prefix of all that the code shows outside, and name of its files."""
    name = identifier(text, set(), DEFAULT)
    return f"{DEFAULT}_{name}" if name.lower() in _UNFIT else name

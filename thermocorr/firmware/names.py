"""Texts of the user as languages can hold them: identifiers, lines of comments, the name of an export."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Collection

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

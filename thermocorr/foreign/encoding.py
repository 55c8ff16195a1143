"""Bytes of a file to text: what its marks say, else what fits."""

from __future__ import annotations

import codecs
from typing import NamedTuple

import numpy as np

from ..records import RecordError

_MARKS = (
    (codecs.BOM_UTF8, "utf-8-sig", "UTF-8"),
    (codecs.BOM_UTF32_LE, "utf-32", "UTF-32"),
    (codecs.BOM_UTF16_LE, "utf-16", "UTF-16"),
    (codecs.BOM_UTF16_BE, "utf-16", "UTF-16"),
)
"""What a file may begin with, the codec that reads it, and its name."""
_LOOKED_AT = 4000
_PRINTED = 0xA0
"""From here on, bytes of Latin-1 are characters that are printed: letters with accents, degrees, micro."""


class Decoded(NamedTuple):
    """Text of a file."""

    text: str
    name: str
    """Name of its encoding, for people."""
    doubt: int | None = None
    """The first character that the encoding was guessed from; None where nothing had to be guessed."""


def decoded(content: bytes, named: str | None = None) -> Decoded | None:
    """The text of a file, in an encoding that is named, marked, or fits; None for one that is damaged UTF-8.

    Without a mark it is UTF-8; UTF-16 where every other byte of the beginning is zero; else Windows-1252 (Latin-1)
    where no byte is a control character of it. Then `doubt` says where that began: if it is no header that has degrees
    and accents, the file is more likely damaged.

    Raises RecordError for an encoding that is not known, or does not fit.
    """
    if named is not None:
        try:
            return Decoded(content.decode(named).removeprefix("\ufeff"), named)
        except LookupError:
            raise RecordError(
                f"--encoding {named!r} is not known. Python's names are such as utf-8, latin-1."
            ) from None
        except UnicodeDecodeError as error:
            raise RecordError(f"byte {error.start + 1} does not fit the encoding {named}") from None
        except ValueError as error:
            raise RecordError(f"--encoding {named!r} cannot be used: {error}") from None
    codec, name = next(((codec, name) for mark, codec, name in _MARKS if content.startswith(mark)), ("", ""))
    if not codec and (wide := _without_mark(content)):
        codec, name = wide, "UTF-16"
    try:
        return Decoded(content.decode(codec or "utf-8"), name or "UTF-8")
    except UnicodeDecodeError as error:
        if codec:
            raise RecordError(f"byte {error.start + 1} does not fit its encoding, {name}") from None
        beyond = np.frombuffer(content, np.uint8)
        if ((beyond >= _PRINTED) | (beyond < 128)).all():
            return Decoded(content.decode("cp1252"), "Windows-1252", error.start)
        return None


def _without_mark(content: bytes) -> str:
    """UTF-16 whose mark is missing: text of Latin letters has a zero in every other byte."""
    head = content[:_LOOKED_AT]
    half = len(head) // 2
    if half < 4:
        return ""
    even, odd = (sum(byte == 0 for byte in head[first::2]) for first in (0, 1))
    if odd > 0.7 * half and not even:
        return "utf-16-le"
    return "utf-16-be" if even > 0.7 * half and not odd else ""

"""What a user may say of a log's file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

from ..records import RecordError
from ..records.errors import option

SEPARATORS = {",": ",", ";": ";", "\t": "\t", "|": "|", " ": " ", "comma": ",", "semicolon": ";", "tab": "\t",
              "\\t": "\t", "bar": "|", "blanks": " ", "space": " "}  # fmt: skip
"""What a separator may be called -> the separator."""


@dataclass(frozen=True, kw_only=True)
class Options:
    """What is said of a file; None, or nothing, where the file tells it. See `read_log`."""

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

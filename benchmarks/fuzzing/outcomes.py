"""How one input ends: the kinds of outcomes, and a command run with everything watched that it does."""

import contextlib
import io
import linecache
import resource
import signal
import sys
import traceback
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from unittest import mock

import thermocorr
from thermocorr.command import cli

RIGHT = "accepted and right"
REFUSED = "refused in one sentence"
NAMED = "right, bad rows named"
OTHER = "accepted as another file"
WRONG, CRASH, HANG, MEMORY = "silently wrong", "traceback", "hang", "memory"
UNHELPFUL = "refused in foreign words"
REFUSED_GOOD = "good input refused"
NOISE = "stray output"
BAD = (WRONG, CRASH, HANG, MEMORY, UNHELPFUL, REFUSED_GOOD, NOISE)
ALL = (RIGHT, NAMED, REFUSED, OTHER, *BAD)

SECONDS = 5.0  # an input that takes more of the processor hangs
MEGABYTES = 500  # an input that takes more memory takes too much
PACKAGE = str(Path(thermocorr.__file__).parent)
_OWN_CHECKS = ("_param_validation.py",)  # files outside of the package whose sentences are meant for its users


class Found(Exception):
    """An input came to a bad end; `kind` is one of `BAD`."""

    def __init__(self, kind: str, text: str):
        super().__init__(text)
        self.kind = kind


class TooLong(BaseException):
    """The alarm went off; nothing in the package catches it."""


@dataclass
class Room:
    """Where a case works: a folder of its own, and notes of what it did."""

    folder: Path
    subjects: dict[str, Any]
    said: list[str] = field(default_factory=list)

    def write(self, name: str, content: bytes) -> Path:
        """A file in the folder."""
        path = self.folder / name
        path.write_bytes(content)
        return path


@dataclass
class Done:
    """What a command did."""

    status: int
    out: bytes
    said: list[str]  # lines of standard error


def run(*arguments: object) -> Done:
    """`thermocorr` with these arguments, in this process; Found where its standard error is not what it should be."""
    out, err = io.TextIOWrapper(io.BytesIO(), "utf-8", newline=""), io.StringIO()
    cause: list[BaseException | None] = []
    ended = cli._ended

    def noted(text: str, status: int) -> int:
        cause.append(sys.exc_info()[1])
        return ended(text, status)

    with (
        contextlib.redirect_stdout(out),
        contextlib.redirect_stderr(err),
        mock.patch.object(cli, "_ended", noted),
        warnings.catch_warnings(record=True) as caught,
    ):
        warnings.simplefilter("always")
        status = cli.main([str(argument) for argument in arguments])
        out.flush()
    said = err.getvalue().splitlines()
    _check_words(status, said, cause, list(caught))
    return Done(status, out.buffer.getvalue(), said)  # type: ignore[attr-defined]


def _check_words(status: int, said: list[str], cause: list[BaseException], caught: list[Any]) -> None:
    strange = [line for line in said if not line.startswith("thermocorr: ") or not line.isprintable()]
    if strange:
        raise Found(NOISE, f"standard error has the line {strange[0][:200]!r}")
    if caught:
        first = caught[0]
        where = Path(first.filename).name
        raise Found(NOISE, f"{first.category.__name__} on standard error from {where}:{first.lineno}: {first.message}")
    if status not in (0, 1, 2):
        raise Found(CRASH, f"exit status {status}")
    if (status == 2) != bool(said and said[-1].startswith("thermocorr: error: ")):
        raise Found(NOISE, f"exit status {status} with {said[-1:]!r}")
    if cause:
        refused(cause[0])


def refused(error: BaseException) -> str:
    """The outcome for an error: a sentence of the package's own, or Found."""
    kept = traceback.extract_tb(error.__traceback__)
    last = kept[-1]
    words = f"{type(error).__name__}: {str(error)[:300]}"
    place = f"{Path(last.filename).name}:{last.lineno}"
    if not isinstance(error, ValueError | TypeError | OSError | MemoryError):
        raise Found(CRASH, f"{words} ({place})") from None
    own = type(error).__module__.startswith("thermocorr") or (
        last.filename.startswith(PACKAGE) and "raise" in linecache.getline(last.filename, last.lineno or 0)
    )
    if not own and not last.filename.endswith(_OWN_CHECKS):
        raise Found(UNHELPFUL, f"{words} ({place})")
    if len(str(error)) > 1500:
        raise Found(UNHELPFUL, f"{len(str(error))} characters: {words}")
    return REFUSED


@contextlib.contextmanager
def watched() -> Iterator[None]:
    """Raise `TooLong` after some seconds of the processor, and Found for memory that was taken meanwhile."""

    def ring(number: int, frame: Any) -> None:
        raise TooLong

    before = signal.signal(signal.SIGPROF, ring)
    signal.setitimer(signal.ITIMER_PROF, SECONDS)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGPROF, before)
    more = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - peak) / 1024
    if more > MEGABYTES:
        raise Found(MEMORY, f"{more:.0f} MB more than before")


def judged(case: Callable[[], str]) -> tuple[str, str]:
    """The kind of outcome of a case, and the words for a bad one."""
    try:
        with watched():
            return case(), ""
    except Found as found:
        return found.kind, str(found)
    except TooLong:
        return HANG, f"more than {SECONDS:g} s"
    except Exception as error:
        lines = traceback.extract_tb(error.__traceback__)
        last = ([line for line in lines if line.filename.startswith(PACKAGE)] or lines)[-1]
        return CRASH, f"{type(error).__name__}: {str(error)[:300]} ({Path(last.filename).name}:{last.lineno})"

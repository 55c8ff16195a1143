"""The command `thermocorr`."""

from __future__ import annotations

import argparse
import contextlib
import os
import shlex
import sys
import warnings
from collections.abc import Iterator, Sequence
from importlib import import_module
from typing import Any

from .._version import __version__

COMMANDS = {
    "analyze": "compare corrections of a log, say what is missing, write the corrected log and the model",
    "correct": "correct a log, or a stream of lines, with a fitted model",
    "workbench": "compare, see where it fails, add what is missing: in a browser on this machine",
    "propose": "find the measurement that decides between causes, or a first calibration",
    "export-c": "write a fitted model as C source for a microcontroller",
}
"""Name -> what for. The module of that name does it: `add_arguments`, `run`."""


PLAIN = str.maketrans({"µ": "u", "Ω": "ohm", "°": "deg", "²": "^2", "³": "^3", "⁻": "^-", "\u2212": "-"})
"""What stands for signs that a terminal does not have."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command.

    Returns the exit status: 0; 1 for a log with damaged rows, which got no result; 2 for what could not be done, with
    one sentence on standard error; 130 after Ctrl-C. A fault of the package is a traceback.
    """
    return _executed(_options(sys.argv[1:] if arguments is None else list(arguments)))


def _options(given: list[str]) -> argparse.Namespace:
    """Read the arguments, loading the named command alone."""
    parser = argparse.ArgumentParser(
        prog="thermocorr", description="Learn and remove the dynamic thermal bias of precise instruments."
    )
    parser.add_argument("--version", action="version", version=f"thermocorr {__version__}")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for name, purpose in COMMANDS.items():
        command = commands.add_parser(name, help=purpose)
        if name in given[:1]:  # the others need not be loaded
            module = import_module(f".{name.replace('-', '_')}", __package__)
            command.description = module.__doc__
            module.add_arguments(command)
            command.set_defaults(execute=module.run)
    options = parser.parse_args(given)
    options.as_written = shlex.join(["thermocorr", *given])
    return options


def _executed(options: argparse.Namespace) -> int:
    """Run a command; errors become a sentence and a status."""
    from ..records.errors import RecordError, as_command

    try:
        with _warnings_as_notes(), as_command():
            status = options.execute(options, _say, show_progress) or 0
        sys.stdout.flush()
        clear_progress()
        return int(status)
    except BrokenPipeError:  # the reader has gone: `thermocorr correct ... | head`
        _abandon_output()
        return 0
    except KeyboardInterrupt:
        return _ended("stopped", 130)
    except MemoryError:
        return _ended("error: there is not enough memory for this. Analyse a shorter log, or close other programs.", 2)
    except OSError as error:
        _abandon_output()
        if isinstance(error, RecordError):  # has a sentence of its own
            return _ended(f"error: {' '.join(str(error).split())}", 2)
        return _ended(f"error: {error.filename or 'The output'}: {error.strerror or error}.", 2)
    except (ValueError, ImportError) as error:
        return _ended(f"error: {' '.join(str(error).split()) or type(error).__name__}", 2)
    except Exception as error:
        error.add_note(f"This is a fault of thermocorr {__version__}. Please report it with the lines above.")
        raise


def _ended(text: str, status: int) -> int:
    if not (text.isascii() and text.isprintable()):
        from ..records.errors import printable

        text = printable(text)
    clear_progress()
    print(f"thermocorr: {text}", file=sys.stderr)
    return status


@contextlib.contextmanager
def _warnings_as_notes() -> Iterator[None]:
    """Warnings as notes on standard error, once each."""
    said: set[str] = set()

    def show(message: Any, *_: Any, **__: Any) -> None:
        from ..records.errors import printable

        text = printable(" ".join(str(message).split()))
        if text not in said:
            said.add(text)
            clear_progress()
            print(f"thermocorr: note: {text}", file=sys.stderr)

    with warnings.catch_warnings():
        warnings.showwarning = show
        yield


def _say(text: str) -> None:
    """Print, as long as somebody reads."""
    from ..records.errors import printable

    text, encoding = printable(text, "\n"), sys.stdout.encoding or "utf-8"
    try:
        text.encode(encoding)
    except UnicodeEncodeError:  # a terminal of few letters
        text = text.translate(PLAIN).encode(encoding, "replace").decode(encoding)
    try:
        print(text, flush=True)
    except BrokenPipeError:
        _abandon_output()


def _abandon_output() -> None:
    """Drop output that nobody reads."""
    with contextlib.suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def show_progress(text: str) -> None:
    """One line of progress that the next one replaces."""
    if sys.stderr.isatty():
        print(f"\r\033[K{text}", end="", file=sys.stderr, flush=True)
    else:
        print(text, file=sys.stderr, flush=True)


def clear_progress() -> None:
    """Remove the progress line from a terminal."""
    if sys.stderr.isatty():
        print("\r\033[K", end="", file=sys.stderr, flush=True)

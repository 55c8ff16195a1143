"""The command `thermocorr`."""

from __future__ import annotations

import argparse
import shlex
import sys
from collections.abc import Sequence
from typing import Any

from .. import __version__
from . import analyze, correct
from .firmware import command as firmware

COMMANDS: dict[str, tuple[Any, str]] = {
    "analyze": (analyze, "compare corrections of a log, say what is missing, write the corrected log and the model"),
    "correct": (correct, "correct a log, or a stream of lines, with a fitted model"),
    "export-c": (firmware, "write a fitted model as C source for a microcontroller"),
}
"""Name -> the module that does it (`add_arguments`, `run`), and what for."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; returns the exit status: 0, or 2 for bad input, with one sentence on standard error."""
    parser = argparse.ArgumentParser(
        prog="thermocorr", description="Learn and remove the dynamic thermal bias of precise instruments."
    )
    parser.add_argument("--version", action="version", version=f"thermocorr {__version__}")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for name, (room, purpose) in COMMANDS.items():
        command = commands.add_parser(name, help=purpose, description=room.__doc__)
        room.add_arguments(command)
        command.set_defaults(execute=room.run)
    options = parser.parse_args(arguments)
    options.as_written = shlex.join(["thermocorr", *(sys.argv[1:] if arguments is None else arguments)])
    try:
        options.execute(options, print, show_progress)
    except (ValueError, TypeError) as error:
        clear_progress()
        print(f"thermocorr: error: {' '.join(str(error).split())}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        clear_progress()
        print("thermocorr: stopped", file=sys.stderr)
        return 130
    clear_progress()
    return 0


def show_progress(text: str) -> None:
    """One line on standard error that the next one replaces; plain lines where it is not a terminal."""
    if sys.stderr.isatty():
        print(f"\r\033[K{text}", end="", file=sys.stderr, flush=True)
    else:
        print(text, file=sys.stderr, flush=True)


def clear_progress() -> None:
    """Remove the progress line from a terminal."""
    if sys.stderr.isatty():
        print("\r\033[K", end="", file=sys.stderr, flush=True)


if __name__ == "__main__":
    sys.exit(main())

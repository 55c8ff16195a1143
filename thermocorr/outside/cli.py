"""The command `thermocorr`."""

from __future__ import annotations

import argparse
import shlex
import sys
from collections.abc import Sequence

from .. import __version__
from . import analyze, correct
from .firmware import command as firmware


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; returns the exit status: 0, or 2 for bad input, with one sentence on standard error."""
    parser = argparse.ArgumentParser(
        prog="thermocorr", description="Learn and remove the dynamic thermal bias of precise instruments."
    )
    parser.add_argument("--version", action="version", version=f"thermocorr {__version__}")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    analyze_parser = commands.add_parser(
        "analyze",
        help="compare corrections of a log, write the corrected log and the model",
        description=analyze.__doc__,
    )
    analyze.add_arguments(analyze_parser)
    analyze_parser.set_defaults(execute=analyze.run)
    correct_parser = commands.add_parser(
        "correct",
        help="correct a log, or a stream of lines, with a fitted model",
        description=correct.__doc__,
    )
    correct.add_arguments(correct_parser)
    correct_parser.set_defaults(execute=correct.run)
    firmware_parser = commands.add_parser(
        "export-c",
        help="write a fitted model as C source for a microcontroller",
        description=firmware.__doc__,
    )
    firmware.add_arguments(firmware_parser)
    firmware_parser.set_defaults(execute=firmware.run)
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

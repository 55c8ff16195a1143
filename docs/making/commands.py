"""The reference of the command line, as the commands themselves give it."""

from __future__ import annotations

import argparse
import os
from importlib import import_module
from pathlib import Path

from thermocorr.command.cli import COMMANDS

WIDTH = "100"


def write_page(path: Path) -> None:
    """Write the help of every command."""
    path.parent.mkdir(exist_ok=True)
    before = os.environ.get("COLUMNS")
    os.environ["COLUMNS"] = WIDTH
    try:
        parts = [
            f"## thermocorr {name}\n\n{purpose[0].upper()}{purpose[1:]}.\n\n{fenced(name)}"
            for name, purpose in COMMANDS.items()
        ]
    finally:
        if before is None:
            del os.environ["COLUMNS"]
        else:
            os.environ["COLUMNS"] = before
    path.write_text("\n".join(parts), encoding="utf-8")


def fenced(name: str) -> str:
    """Help of one command."""
    module = import_module(f"thermocorr.command.{name.replace('-', '_')}")
    parser = argparse.ArgumentParser(prog=f"thermocorr {name}")
    module.add_arguments(parser)
    return f"```text\n{parser.format_help().rstrip()}\n```\n"

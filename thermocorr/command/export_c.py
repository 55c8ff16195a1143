"""`thermocorr export-c`: a fitted model as C99."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import Any

from ..firmware import export_c


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument("model", metavar="MODEL", help="the fitted model's file")
    parser.add_argument(
        "--out", default="firmware", metavar="PATH", help="folder, or a path such as out/bridge.c (default: firmware)"
    )
    parser.add_argument("--name", help="prefix of all names in C (default: thermal_bias, or the stem of --out)")
    parser.add_argument("--force", action="store_true", help="overwrite files that are there already")


def run(options: argparse.Namespace, say: Callable[[str], Any], progress: Callable[[str], Any]) -> None:
    """Load the model, write the files."""
    from ..output.model_file import load

    progress(f"Loading {options.model}")
    model = load(options.model)
    say(str(export_c(model, options.out, name=options.name, force=options.force, inputs=[options.model])))

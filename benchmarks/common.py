"""What the benchmarks share: options by their defaults, seeds, errors, effects by name."""

import argparse
import sys
import warnings
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from thermocorr import DynamicBiasRegressor, RecordWarning, diagnose
from thermocorr.judgement import Diagnosis

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))  # whose records and runs some benchmarks use


def asked(about: str | None, *places: str, **defaults: Any) -> argparse.Namespace:
    """Options of the command line, whose help is the text `about`; `places` have to be given.

    False stands for a switch, a list for several values (for some of these, where they are names), a type for an
    option that is None where it is not given.
    Warnings about records are silenced.
    """
    parser = argparse.ArgumentParser(description=about, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name in places:
        parser.add_argument(name)
    for name, default in defaults.items():
        option = "--" + name.replace("_", "-")
        if default is False:
            parser.add_argument(option, action="store_true")
        elif isinstance(default, type):
            parser.add_argument(option, type=default)
        else:
            more: dict[str, Any] = {"type": type(default), "help": f"default {default}".replace("%", "%%")}
            if isinstance(default, list):
                more |= {"type": type(default[0]), "nargs": "*"}
                more |= {"choices": default, "metavar": "NAME"} if default[0] and isinstance(default[0], str) else {}
            parser.add_argument(option, default=default, **more)
    warnings.simplefilter("ignore", RecordWarning)
    return parser.parse_args()


def seeds_of(options: argparse.Namespace) -> range:
    """As many seeds as are asked for, from the first one on."""
    return range(options.first, options.first + options.seeds)


def rms(values: Any) -> float:
    """Root mean square of what is known."""
    return float(np.sqrt(np.nanmean(np.square(np.asarray(values, float)))))


def diagnosed(X: Any, y: Any) -> Diagnosis:
    """What the default model lacks."""
    return diagnose(DynamicBiasRegressor("temperature").fit(X, y), X, y)


def kinds(effects: Iterable[Any]) -> list[str]:
    """Kinds of causes."""
    return [cause.effect.kind for cause in effects]

"""Nothing hidden, in records of every shape: runs, gaps, uneven steps, short and fast ones. Is anybody accused?

    python benchmarks/null_shapes.py                         # some minutes
    python benchmarks/null_shapes.py --shapes gaps10 --seeds 20

Devices of `make_record` in three settings (lab 60 s, outdoor 600 s, chamber 30 s; four devices in turn), defaults. A
device that starts out of equilibrium by 3 K ("warm") lacks an initial transient: to name it is no accusation.
Seeds 700 to 707 served to find out what gaps do.
"""

from __future__ import annotations

import argparse
import warnings
from collections import Counter
from typing import Any

from thermocorr import DynamicBiasRegressor, RecordError, diagnose
from thermocorr.datasets import make_record

SETTINGS = {"lab": 60.0, "outdoor": 600.0, "chamber": 30.0}
DEVICES = ("slab", "plate", "layered", "box")
SHAPES: dict[str, dict[str, Any]] = {
    "plain": {"n": 5000},
    "uneven": {"n": 5000, "irregular": 0.5},
    "gaps3": {"n": 5000, "gaps": 3},
    "gaps10": {"n": 5000, "gaps": 10},
    "gaps40": {"n": 5000, "gaps": 40},
    "runs3": {"n": 2000, "runs": 3},
    "runs14": {"n": 500, "runs": 14},
    "runs40": {"n": 200, "runs": 40},
    "short": {"n": 600},
    "fast": {"n": 8000, "sampling_period": 10.0},
    "warm": {"n": 5000, "initial_offset": 3.0},
}


def said(shape: str, setting: str, seed: int) -> str:
    """Verdict, or causes, on one record."""
    settings = {"sampling_period": SETTINGS[setting], **SHAPES[shape]}
    record = make_record(seed=seed, setting=setting, device=DEVICES[seed % 4], **settings)
    X, y = record.drop(columns="reading"), record["reading"]
    try:
        model = DynamicBiasRegressor("temperature", run="run" if "run" in X else None).fit(X, y)
        found = diagnose(model, X, y)
    except RecordError as error:
        return f"refused: {str(error)[:60]}"
    return " + ".join(cause.effect.kind for cause in found.causes) or found.verdict


def main() -> None:
    """Print a line for each shape and setting."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--shapes", nargs="*", default=list(SHAPES), choices=list(SHAPES))
    parser.add_argument("--first", type=int, default=720, help="first seed (default 720)")
    parser.add_argument("--seeds", type=int, default=8, help="how many (default 8)")
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    for shape in options.shapes:
        for setting in SETTINGS:
            seeds = range(options.first, options.first + options.seeds)
            counts = Counter(said(shape, setting, seed) for seed in seeds)
            print(f"{shape:8s} {setting:8s} {dict(counts.most_common())}", flush=True)


if __name__ == "__main__":
    main()

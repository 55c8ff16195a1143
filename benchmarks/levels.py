"""Every threshold of the judgement halved and doubled: what changes?

    python benchmarks/levels.py                     # all of them (an hour)
    python benchmarks/levels.py --names GAIN LEVEL  # some

Simulated devices (5000 rows, seeds that served for tuning): planted effects at strength 0.5, records with nothing
hidden in white and in slow noise, one random telegraph. Printed for the thresholds as they are, and with each one
halved and doubled: effects named first, nobody's records accused, processor time over that of the first line.
"""

from __future__ import annotations

import argparse
import sys
import time
import warnings
from collections.abc import Iterator

import numpy as np
import pandas as pd
from null_records import NOISES

from thermocorr import DynamicBiasRegressor, RecordWarning, diagnose
from thermocorr.datasets import make_record
from thermocorr.judgement import levels

PLANTED = ("covariate", "lagged_covariate", "interaction", "drift", "step", "hysteresis", "hinge", "periodic",
           "sensitivity_drift", "log_ageing", "lag_products", "initial_transient")  # fmt: skip
QUIET = ("white", "heavy tails", "10 %", "flicker", "walk")
SEEDS = (5000, 5001)


def records() -> Iterator[tuple[str, DynamicBiasRegressor, pd.DataFrame, pd.Series]]:
    """What is hidden ("" for nothing), the base model, and the record."""
    for seed in SEEDS:
        for kind in PLANTED:
            record, truth = make_record(5000, effects={kind: 0.5}, seed=seed, return_truth=True)
            column = next(iter(truth.attrs["effects"].values()))["parameters"].get("column")
            X, y = record.drop(columns="reading"), record["reading"]
            label = kind + (f":{column}" if column else "")
            yield label, DynamicBiasRegressor("temperature").fit(X, y), X, y
        for noise in QUIET:
            record = make_record(5000, device="box", noise=1e-9, seed=seed)
            X, y = record.drop(columns="reading"), record["reading"]
            y = y + 0.2 * NOISES[noise](np.random.default_rng(seed), len(y), X)
            yield "", DynamicBiasRegressor("temperature").fit(X, y), X, y


def judged(cases: list[tuple[str, DynamicBiasRegressor, pd.DataFrame, pd.Series]]) -> tuple[int, int, float]:
    """Effects named first, records accused of nothing that is there, and processor time [s]."""
    began, first, accused = time.process_time(), 0, 0
    for label, model, X, y in cases:
        causes = diagnose(model, X, y).causes
        names = [cause.effect.kind + "".join(f":{name}" for name in cause.effect.inputs()) for cause in causes]
        first += bool(label) and names[:1] == [label]
        accused += not label and bool(names)
    return first, accused, time.process_time() - began


def changed(name: str, value: float) -> None:
    """Give a threshold another value wherever it is used."""
    for module in [m for key, m in sys.modules.items() if key.startswith("thermocorr.judgement")]:
        if name in vars(module):
            setattr(module, name, value)


def main() -> None:
    """Print the table."""
    numbers = {name: value for name, value in vars(levels).items() if name.isupper() and isinstance(value, int | float)}
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--names", nargs="*", default=list(numbers), choices=list(numbers))
    options = parser.parse_args()
    warnings.simplefilter("ignore", RecordWarning)
    cases = list(records())
    planted = sum(bool(label) for label, *_ in cases)
    first, accused, usual = judged(cases)
    print(f"{'as they are':24s} named first {first}/{planted}  accused {accused}/{len(cases) - planted}  time 1.00")
    for name in options.names:
        if name in ("PIECES", "TIME_LIKE", "SPEAKS"):
            continue  # the folds are cut in these; a correlation; a negative number
        for factor in (0.5, 2.0):
            value = numbers[name] * factor
            changed(name, int(value) if isinstance(numbers[name], int) else value)
            first, accused, spent = judged(cases)
            changed(name, numbers[name])
            print(
                f"{name:16s} x {factor:3.1f}   named first {first}/{planted}  "
                f"accused {accused}/{len(cases) - planted}  time {spent / usual:.2f}",
                flush=True,
            )


if __name__ == "__main__":
    main()

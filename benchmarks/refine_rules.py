"""Which rule of `refine` keeps what lowers the error on data that come later?

    python benchmarks/refine_rules.py ../shared/records
    python benchmarks/refine_rules.py ../shared/records --shares 0.55 0.65 0.75

A share of each measured record is diagnosed. Each cause that is named, and each suspect that is not named though it
helps on held-out blocks and on later ones, is added to the base model alone; the rms of the 30 % of the rows that
follow, offset included, is the judge [dB, after over before]. Printed for each rule: effects kept, the mean and the
worst of their judgement, how many did harm (more than 0.5 dB), and how many did good. Constants were chosen on shares
of 0.5, 0.6, 0.7 and 0.8: try others.
"""

from __future__ import annotations

import argparse
import math
import warnings
from collections.abc import Iterator
from typing import Any

import numpy as np
import pandas as pd
from real_diagnosis import THEN, cases

from thermocorr import DynamicBiasRegressor, RecordWarning, diagnose
from thermocorr.datasets import load_real_record
from thermocorr.estimators.holdout import rms
from thermocorr.judgement.adding import Errors, with_missing
from thermocorr.judgement.levels import FURTHER_HELP, SAME

FEWEST_DB = 0.3
"""Help of what is not named, on later stretches and on blocks alike, from which it is tried."""
MOST = 9
"""Effects that are tried on a part of a record."""


def records(folder: str) -> Iterator[tuple[str, pd.DataFrame, pd.Series, str]]:
    """Name, frame of temperature and suspects, reading, temperature column: those of `real_diagnosis.py`, and more."""
    for name, X, y, temperature, _ in cases(folder):
        yield name, X, y, temperature
    for run in ("run9", "run15", "run17"):
        frame = load_real_record("vhd200_resistor", folder, run=run)
        reading = (frame["resistance_ohm"] / 1000 - 1) * 1e6
        yield f"vhd200 {run}", frame.drop(columns="resistance_ohm"), reading, "oven_temp_degC"
    meter = load_real_record("hp34420a_nanovoltmeter", folder, run="1V")
    for channel in (1, 2):
        reading = meter[f"dut_ch{channel}_V"]
        X = meter.drop(columns=[name for name in meter.columns if name.endswith("_V")])
        yield f"hp34420a 1V ch{channel}", X, (reading / reading.mean() - 1) * 1e6, "bath_temp_degC"


def tried(name: str, X: pd.DataFrame, y: pd.Series, temperature: str, share: float) -> Iterator[dict[str, Any]]:
    """Each effect beside the base model of a share of a record."""
    n = int(share * len(X))
    after = slice(n, n + math.ceil(THEN * len(X)))
    base = DynamicBiasRegressor(temperature, run="run" if "run" in X else None).fit(X[:n], y[:n])
    found = diagnose(base, X[:n], y[:n])
    before, error = Errors.of(base, X[:n], y[:n]), rms(np.asarray(base.residuals(X[after], y[after]), float))
    proven = [s.effect for s in found.causes if s.standing == "proven"]
    unnamed = [s for s in found.suspects[found.n_causes :] if min(s.gain_db, s.later_db) >= FEWEST_DB]
    suspects = [*((s.effect, True) for s in found.causes), *((s.effect, False) for s in unnamed)]
    for effect, named in suspects[:MOST]:
        model = with_missing(base, effect).fit(X[:n], y[:n])
        now = Errors.of(model, X[:n], y[:n])
        yield {
            "record": name,
            "share": share,
            "effect": effect.label(),
            "named": named,
            "of time alone": effect.of_time_alone,
            "product": effect.is_product,
            "lower": now.better_than(before),
            "mostly": now.falls_mostly(before),
            "proven": effect in proven,
            "neither rises": max(now.held_out / before.held_out, now.later / before.later) <= SAME,
            "together": now.ratio(before),
            "kept": now.worth(effect, before),
            "held out": _db(now.held_out, before.held_out),
            "later": _db(now.later, before.later),
            "true": _db(rms(np.asarray(model.residuals(X[after], y[after]), float)), error),
        }


def _db(now: float, before: float) -> float:
    return 20 * math.log10(now / before)


def main() -> None:
    """Print what was tried, then the rules."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", help="folder of the measured records")
    parser.add_argument("--shares", type=float, nargs="*", default=[0.5, 0.6, 0.7, 0.8])
    options = parser.parse_args()
    warnings.simplefilter("ignore", RecordWarning)
    rows = []
    for record in records(options.folder):
        for share in options.shares:
            for row in tried(*record, share):
                rows.append(row)
                print(*(f"{x:.1f}" if isinstance(x, float) else x for x in row.values()), sep="; ", flush=True)
    table = pd.DataFrame(rows).drop_duplicates(["record", "share", "effect"])
    named, alone = table["named"], table["of time alone"]
    clearly = table[["held out", "later"]].max(axis=1) <= -1.0
    rules = {
        "named, both errors together fall": named & ~alone & table["lower"],
        "  and in twice as many blocks as they rise in (kept)": named & ~alone & table["kept"],
        "  not mostly, proven, no product, neither rises (kept)": named
        & ~alone
        & ~table["mostly"]
        & table["proven"]
        & ~table["product"]
        & table["neither rises"]
        & (table["together"] <= FURTHER_HELP),
        "  of time alone, neither rises (kept)": named & alone & table["kept"],
        "not named, both fall by 1 dB": ~named & ~alone & clearly,
        "  and mostly, no product": ~named & ~alone & clearly & table["mostly"] & ~table["product"],
        "  of time alone": ~named & alone & clearly,
    }
    print()
    for rule, chosen in rules.items():
        true = table.loc[chosen, "true"]
        print(
            f"{rule:55} {len(true):3} effects, mean {true.mean():6.2f} dB, worst {true.max():5.1f}, "
            f"harm {(true > 0.5).sum():2}, good {(true < -0.5).sum():2}"
        )


if __name__ == "__main__":
    main()

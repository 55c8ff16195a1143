"""Slow effects that the base model has absorbed: what are its forecasts worth, and those of the refined model?

    python benchmarks/absorbed_effects.py --seeds 206 207 208 209 210 211

Settings, devices and decoy columns are those of `hidden_effects.py`; an effect counts as absorbed where the base model
of the whole record is within 0.15 noise standard deviations of the truth. Learned from is the first 70 %. Printed for
each record are the rms errors on the rest over the noise, offset included: of the base model and of the refined one.
"""

from __future__ import annotations

import argparse
import itertools
import warnings

import numpy as np
import pandas as pd
from hidden_effects import NOISE, SETTINGS, make_case

from thermocorr import DynamicBiasRegressor, RecordWarning, refine

KINDS = ("drift", "log_ageing", "initial_transient")
ABSORBED = 0.15
SHARE = 0.7


def forecast(kind: str, setting: str, seed: int, strength: float) -> dict[str, object] | None:
    """Errors on the rest of one record; None where it cannot be made, or where the effect is not absorbed."""
    try:
        case = make_case(setting, seed, {kind: strength})
    except ValueError:
        return None
    missed = case.model.predict(case.X) - case.truth["noise_free"]
    if np.sqrt(np.mean(missed**2)) >= ABSORBED * NOISE:
        return None
    n = int(SHARE * len(case.X))
    base = DynamicBiasRegressor("temperature").fit(case.X[:n], case.y[:n])
    refinement = refine(base, case.X[:n], case.y[:n])

    def error(model: DynamicBiasRegressor) -> float:
        return float(np.sqrt(np.mean(np.asarray(model.residuals(case.X[n:], case.y[n:])) ** 2))) / NOISE

    added = "; ".join(refinement.steps["effect"][1:])
    errors = {"base": error(base), "refined": error(refinement.model_)}
    return {"kind": kind, "setting": setting, "seed": seed, **errors, "added": added}


def main() -> None:
    """Print a line for each record, and all together."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, nargs="*", default=[206, 207])
    parser.add_argument("--strength", type=float, default=2.0)
    options = parser.parse_args()
    warnings.simplefilter("ignore", RecordWarning)
    results = [
        found
        for kind, setting, seed in itertools.product(KINDS, SETTINGS, options.seeds)
        if (found := forecast(kind, setting, seed, options.strength)) is not None
    ]
    if not results:
        print("No effect was absorbed.")
        return
    table = pd.DataFrame(results)
    print(table.to_string(index=False, float_format="{:.2f}".format))
    worst, good = table[["base", "refined"]].max(), (table[["base", "refined"]] <= 1.3).mean()
    print(f"{len(table)} absorbed; error over noise at most {worst['base']:.2f} before, {worst['refined']:.2f} after;")
    print(f"1.3 or less in {good['base']:.0%} before, in {good['refined']:.0%} after")


if __name__ == "__main__":
    main()

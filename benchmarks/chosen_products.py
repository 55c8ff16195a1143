"""`products="auto"`: which simulated devices get products of lags, and what they are worth on measured records.

    python benchmarks/chosen_products.py --seeds 330 331 332 333
    python benchmarks/chosen_products.py --seeds --records ../shared/records

Settings, devices and hidden effects are those of `hidden_effects.py`; of the simulated records, those with lag products
should get them, and no others. Of each measured record the first 70 % is learned from; the error on the rest, offset
included, is printed without products, with them, and as chosen.
"""

from __future__ import annotations

import argparse
import itertools
import warnings
from collections import Counter

from hidden_effects import NOTHING, SETTINGS, UNKNOWN, make_case
from real_records import cases, error_on_the_rest

from thermocorr import RecordWarning
from thermocorr.effects import CATALOGUE

KINDS = (*CATALOGUE, *NOTHING, *UNKNOWN)


def simulated(seeds: list[int], strength: float) -> None:
    """How many records of each hidden effect get products."""
    records, taken = Counter[str](), Counter[str]()
    for kind, setting, seed in itertools.product(KINDS, SETTINGS, seeds):
        effects = {} if kind in NOTHING else {kind: strength}
        try:
            case = make_case(setting, seed, effects, strength if kind == "coloured" else 0.0)
        except ValueError:
            continue
        records[kind] += 1
        taken[kind] += bool(case.model.products_)
    right, due = taken.pop("lag_products"), records.pop("lag_products")
    others = ", ".join(f"{kind} {count}" for kind, count in taken.items() if count) or "none"
    wrong = f"{sum(taken.values())} of {sum(records.values())} others ({others})"
    print(f"strength {strength:g}: products in {right} of {due} records that have them, and in {wrong}", flush=True)


def measured(folder: str) -> None:
    """Errors on the last 30 % of measured records."""
    for name, X, y in cases(folder):
        errors = [error_on_the_rest(X, y, 0.7, products=products)[0] for products in (False, True, "auto")]
        print(f"{name:24s} without {errors[0]:.4g}, with {errors[1]:.4g}, as chosen {errors[2]:.4g}", flush=True)


def main() -> None:
    """Print both."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, nargs="*", default=[330, 331])
    parser.add_argument("--strengths", type=float, nargs="*", default=[2.0, 0.5])
    parser.add_argument("--records", help="folder of the measured records")
    options = parser.parse_args()
    warnings.simplefilter("ignore", RecordWarning)
    for strength in options.strengths if options.seeds else ():
        simulated(options.seeds, strength)
    if options.records:
        measured(options.records)


if __name__ == "__main__":
    main()

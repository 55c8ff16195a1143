"""Is a correction advised by a thermometer that has nothing to do with the reading, and by the true one?

    python benchmarks/placebo.py                                  # simulated: 600 hourly rows, 8 seeds a cell
    python benchmarks/placebo.py --records ../shared/records      # and measured records, with each one's thermometer

Simulated readings (six noises) are independent of the temperature (white, or like weather without a daily wave).
Measured records are learned on 70 %: with their own thermometer, what is advised and its error on the rest beside the
best of level, static and dynamic; with the thermometers of other devices in its place, how often one is advised.
"""

from __future__ import annotations

import argparse
import warnings
from collections.abc import Callable

import numpy as np
import pandas as pd
from real_diagnosis import every
from scipy.signal import lfilter

from thermocorr import RecordWarning, compare_variants
from thermocorr.estimators import VariantComparison

N = 600
Draw = Callable[[np.random.Generator], np.ndarray]


def remembering(rng: np.random.Generator, rows: float) -> np.ndarray:
    """First-order Markov noise of standard deviation 1."""
    kept = np.exp(-1 / rows)
    return np.asarray(lfilter([np.sqrt(1 - kept**2)], [1, -kept], rng.standard_normal(N + 2000))[2000:])


READINGS: dict[str, Draw] = {
    "white": lambda rng: rng.standard_normal(N),
    "wander": lambda rng: remembering(rng, 10) + 0.3 * rng.standard_normal(N),
    "slow wander": lambda rng: remembering(rng, 100) + 0.3 * rng.standard_normal(N),
    "random walk": lambda rng: 0.2 * np.cumsum(rng.standard_normal(N)) + 0.3 * rng.standard_normal(N),
    "three jumps": lambda rng: np.repeat(3 * rng.standard_normal(4), N // 4) + 0.3 * rng.standard_normal(N),
    "drift": lambda rng: np.linspace(0, 3, N) + 0.3 * rng.standard_normal(N),
}
TEMPERATURES: dict[str, Draw] = {
    "white": lambda rng: rng.standard_normal(N),
    "weather": lambda rng: 3 * remembering(rng, 60) + remembering(rng, 8),
}


def simulated(seeds: range) -> None:
    """Print a line for each cell."""
    times, chosen = pd.date_range("2024-01-01", periods=N, freq="h"), 0
    for room, temperature in TEMPERATURES.items():
        for noise, reading in READINGS.items():
            found = []
            for seed in seeds:
                rng = np.random.default_rng([seed, 7])
                X = pd.DataFrame({"temperature": 20 + temperature(rng)}, index=times)
                y = pd.Series(reading(rng), index=times, name="reading")
                found.append(compare_variants(X, y, temperature="temperature", n_blocks=2).advice.choice)
            chosen += len(found) - found.count("none")
            print(f"{room:8s} {noise:12s} advised in {len(found) - found.count('none')} of {len(found)}", flush=True)
    print(f"in all {chosen} of {len(seeds) * len(READINGS) * len(TEMPERATURES)}")


def later(comparison: VariantComparison, X: pd.DataFrame, y: pd.Series, level: float) -> dict[str, float]:
    """Rms error of each variant on later data, and of the level ("")."""
    left = {name: np.asarray(model.residuals(X, y), float) for name, model in comparison.models.items()}
    left[""] = np.asarray(y, float) - level
    return {name: float(np.sqrt(np.nanmean(values**2))) for name, values in left.items()}


def measured(folder: str) -> None:
    """Print a line for each record, and how many foreign thermometers are taken for one that corrects."""
    records, foreign, tried = every(folder), list[str](), 0
    for name, (X, y, column, n) in records.items():
        degree = 1 if column == "recharge_mm" else 2
        comparison = compare_variants(X[[column]][:n], y[:n], temperature=column, degree=degree, n_blocks=2)
        truth = later(comparison, X[[column]][n:], y[n:], float(np.nanmean(y[:n])))
        advice = comparison.advice
        print(
            f"{name:22s} {advice.choice:8s} predicted {advice.after:8.4g} truth {truth[advice.variant]:8.4g} "
            f"best {min(truth.values()):8.4g} level {truth['']:8.4g} against copies {advice.copies_db:6.1f} dB",
            flush=True,
        )
        for other, (others, _, theirs, _) in records.items():
            if other.split()[0] == name.split()[0]:  # the same thermometer, or the weather of one place
                continue
            T = np.asarray(others[theirs].dropna(), float)
            T = np.interp(np.linspace(0, len(T) - 1, n), np.arange(len(T)), T) if len(T) < n else T[:n]
            X_other = pd.DataFrame({"temperature": T}, index=X.index[:n])
            found = compare_variants(X_other, y[:n], temperature="temperature", n_blocks=2).advice
            tried += 1
            proof = "no proof" if np.isnan(found.copies_db) else "proof"
            foreign += [f"{name} by {other} ({proof})"] if found.choice in ("static", "dynamic") else []
    print(f"foreign thermometers: advised in {len(foreign)} of {tried}", *foreign, sep="\n    ")


def main() -> None:
    """Print both."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=8, help="records of each cell (default 8)")
    parser.add_argument("--first", type=int, default=900, help="first seed (default 900)")
    parser.add_argument("--records", help="folder of the measured records")
    options = parser.parse_args()
    warnings.simplefilter("ignore", RecordWarning)
    simulated(range(options.first, options.first + options.seeds))
    if options.records is not None:
        measured(options.records)


if __name__ == "__main__":
    main()

"""Two plateaus: is the law between them right, or flagged, and what is leaving out worth that they do not determine?

    python benchmarks/plateaus.py --records ../shared/records

A device (20 min) with a straight or curved law is held at 13 and 47.5 degC in turn. The temperature moves about them by
0.02 to 3 K: as white noise, or as measured rooms do. Printed for each: how often the square is left out, the median
error midway [share of the effect] of the default, and of a fit that keeps the square, and of all rows that are wrong by
more than 0.05 of 1.7, how many are flagged.
"""

from __future__ import annotations

import argparse
import warnings

import numpy as np
import pandas as pd
from real_diagnosis import every
from scipy.signal import lfilter

from thermocorr import DynamicBiasRegressor, RecordWarning
from thermocorr.estimators import coverage

N, HOLD, LEVELS, EFFECT = 3600, 200, (13.0, 47.5), 1.725


def law(T: np.ndarray, curve: float) -> np.ndarray:
    """Of the temperature inside."""
    return np.asarray(0.05 * (T - 30) + curve * (T - 30) ** 2)


def record(rng: np.random.Generator, about: np.ndarray, curve: float) -> tuple[pd.DataFrame, pd.Series]:
    """Readings beside a room that moves by `about` around the two levels."""
    room = np.tile(np.repeat(LEVELS, HOLD), N // (2 * HOLD)) + about
    keep = np.exp(-1 / 20)
    inner = room[0] + lfilter([1 - keep], [1, -keep], room - room[0])
    times = pd.date_range("2024-01-01", periods=N, freq="min")
    reading = law(inner, curve) + 0.02 * rng.standard_normal(N)
    return pd.DataFrame({"temperature": room}, times), pd.Series(reading, times, name="reading")


def tried(X: pd.DataFrame, y: pd.Series, curve: float) -> tuple[int, float, int, int]:
    """Degree, error midway, rows that are wrong and those of them that are flagged."""
    model = DynamicBiasRegressor("temperature").fit(X, y)
    levels = np.linspace(*LEVELS, 9)
    rng = np.random.default_rng(9)
    room = np.interp(np.arange(18_000), np.arange(18) * 1000, np.repeat(levels, 2)) + 0.02 * rng.standard_normal(18_000)
    then = pd.DataFrame({"temperature": room}, pd.date_range(X.index[-1], periods=18_000, freq="min"))
    rows = np.arange(9) * 2000 + 900
    wrong = np.abs(np.asarray(model.predict(then))[rows] - law(levels, curve))
    flagged = np.asarray(model.flags(then))[rows] != ""
    return model.degree_, float(wrong[4]) / EFFECT, int((wrong > 0.05).sum()), int((flagged & (wrong > 0.05)).sum())


def main() -> None:
    """Print a line for each background, width and law."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--records", help="folder of the measured records")
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--first", type=int, default=0)
    options = parser.parse_args()
    warnings.simplefilter("ignore", RecordWarning)
    rooms = {"white": []}
    if options.records:
        rooms["measured"] = [np.asarray(X[c].dropna(), float) for X, _, c, _ in every(options.records).values()]
    kept = coverage.FARTHER
    for background, courses in rooms.items():
        for width in (0.02, 0.3, 1.0, 3.0):
            for curve in (0.0, 0.0006):
                found = []
                for seed in range(options.first, options.first + options.seeds):
                    rng = np.random.default_rng(seed)
                    about = rng.standard_normal(N)
                    if courses:
                        course = courses[seed % len(courses)]
                        begin = rng.integers(0, max(len(course) - N, 1))
                        about = np.resize(course[begin : begin + N], N)
                    about = width * (about - about.mean()) / about.std()
                    X, y = record(rng, about, curve)
                    pair = []
                    for farther in (kept, np.inf):
                        coverage.FARTHER = farther
                        pair.append(tried(X, y, curve))
                    found.append(pair)
                degree = sum(one[0] < 2 for one, _ in found)
                error, other = (np.median([pair[k][1] for pair in found]) for k in (0, 1))
                wrong, flagged = (sum(one[k] for one, _ in found) for k in (2, 3))
                print(
                    f"{background:9s} +-{width:4.2f} K, {'curved' if curve else 'straight':8s} left out in {degree:2d} "
                    f"of {len(found)}, midway {error:6.3f} (kept {other:6.3f}), flagged {flagged} of {wrong} wrong",
                    flush=True,
                )


if __name__ == "__main__":
    main()

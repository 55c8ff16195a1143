"""A room with a thermostat, logged too seldom: is anybody accused, and is what is really missing still named?

    python benchmarks/slow_logs.py --seeds 4                 # some minutes; seeds from 301 on served no tuning
    python benchmarks/slow_logs.py --seeds 10 --steps 300

The heating lifts the air by 0.6 K within minutes; in a brisk room it falls again within five, in a calm one within
fifteen. The device is one body in the brisk room and two in a row in the calm one, and white noise; a model that takes
the temperature for a straight line from row to row cannot follow. A knee and a play are twice the noise, a slow clock
four rows behind. Printed for each room and step of the log: records of which somebody is accused although nothing is
missing; and those in which what is hidden is there, worth adding or not.
"""

from __future__ import annotations

import argparse
import itertools
import warnings

import numpy as np
import pandas as pd

from thermocorr import DynamicBiasRegressor, RecordWarning, diagnose

TICK = 10.0
"""Step of the simulation [s]."""
ROOMS = {"brisk": (0.12, 5.0, 0.3, (1500.0,)), "calm": (0.03, 3.0, 15.0, (500.0, 2400.0))}
"""Leak of the air to the outside and heating [1/900 s, K/900 s]; wind [K]; time constants of the device [s]."""
EFFECTS = {"nothing": "", "knee": "hinge", "play": "hysteresis", "clock": "lead"}


def simulated(
    room: str, seed: int, step: float, n: int, hidden: str, noise: float = 0.02
) -> tuple[pd.DataFrame, pd.Series]:
    """Temperature and reading, a row every `step` seconds."""
    rng = np.random.default_rng([seed, 17])
    every, late = round(step / TICK), round(4 * step / TICK)
    leak, power, windy, taus = ROOMS[room]
    air, bodies, heating, seen = 21.0, [21.0] * len(taus), False, []
    for wind in rng.standard_normal(n * every + late).tolist():
        heating = air < (21.8 if heating else 21.2)
        air += TICK / 900 * (leak * (5 + windy * wind - air) + power * heating)
        outer = air
        for k, tau in enumerate(taus):
            bodies[k] += TICK / tau * (outer - bodies[k])
            outer = bodies[k]
        seen.append((air, outer))
    T, inner = np.array(seen).T
    reading = 2 * (inner - 21)
    if hidden in ("knee", "play"):
        middle, half = np.median(inner), 0.5 * inner.std()
        moved = np.maximum(inner - middle, 0) if hidden == "knee" else _play(inner, half) - inner
        reading += 2 * noise * moved / moved.std()
    shift = late if hidden == "clock" else 0  # the thermometer's clock is behind by four rows
    rows = slice(late, None, every)
    index = pd.date_range("2024-03-04", periods=n, freq=pd.Timedelta(seconds=step))
    y = reading[rows] + noise * rng.standard_normal(n)
    return pd.DataFrame({"temperature": T[late - shift :: every][:n]}, index), pd.Series(y, index, name="reading")


def _play(x: np.ndarray, half: float) -> np.ndarray:
    """What follows x only once it has moved by more than a play."""
    found, at = np.empty(len(x)), x[0]
    for k, value in enumerate(x.tolist()):
        found[k] = at = min(max(at, value - half), value + half)
    return found


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=4, help="records of each kind (default 4)")
    parser.add_argument("--first", type=int, default=300, help="first seed (default 300)")
    parser.add_argument("--rows", type=int, default=3000)
    parser.add_argument("--steps", type=float, nargs="*", default=[60.0, 150.0, 300.0, 600.0], help="steps [s]")
    parser.add_argument("--rooms", nargs="*", default=list(ROOMS))
    options = parser.parse_args()
    warnings.simplefilter("ignore", RecordWarning)
    for room, step in itertools.product(options.rooms, options.steps):
        said = []
        for hidden, kind in EFFECTS.items():
            hits = 0
            for seed in range(options.first, options.first + options.seeds):
                X, y = simulated(room, seed, step, options.rows, hidden)
                found = diagnose(DynamicBiasRegressor("temperature").fit(X, y), X, y)
                there = [cause.effect.kind for cause in (*found.causes, *found.small)]
                hits += kind in there if kind else bool(found.causes)
            said.append(f"{'accused' if not kind else hidden} {hits}")
        print(f"{room}, {step:g} s: of {options.seeds} each: {', '.join(said)}", flush=True)


if __name__ == "__main__":
    main()

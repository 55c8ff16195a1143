"""A room with a thermostat, logged too seldom: is anybody accused, and is what is really missing still named?

    python benchmarks/slow_logs.py --seeds 4                 # some minutes; seeds from 301 on served no tuning
    python benchmarks/slow_logs.py --seeds 10 --steps 300

The heating lifts the air by 0.6 K within minutes; in a brisk room it falls again within five, in a calm one within
fifteen. The device is one body in the brisk room and two in a row in the calm one, and white noise; a model that takes
the temperature for a straight line from row to row cannot follow. A knee and a play are twice the noise, a slow clock
four rows behind. Printed for each room and step of the log: records of which somebody is accused although nothing is
missing; and those in which what is hidden is there, worth adding or not.
"""

import itertools

import numpy as np
import pandas as pd
from common import asked, diagnosed, kinds, seeds_of

TICK = 10.0  # step of the simulation [s]
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
    options = asked(__doc__, seeds=4, first=300, rows=3000, steps=[60.0, 150.0, 300.0, 600.0])
    for room, step in itertools.product(ROOMS, options.steps):
        said = []
        for hidden, kind in EFFECTS.items():
            records = (simulated(room, seed, step, options.rows, hidden) for seed in seeds_of(options))
            answers = [diagnosed(X, y) for X, y in records]
            there = [kind in kinds((*found.causes, *found.small)) if kind else bool(found.causes) for found in answers]
            said.append(f"{hidden if kind else 'accused'} {sum(there)}")
        print(f"{room}, {step:g} s: of {options.seeds} each: {', '.join(said)}", flush=True)


if __name__ == "__main__":
    main()

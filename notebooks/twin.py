"""Stand-in for the measured resistor where its record is absent; simulated, and said so."""

from __future__ import annotations

import numpy as np
import pandas as pd

from thermocorr.datasets import make_record
from thermocorr.equations import lag_differences

ROWS, STEP = 3000, 10.0  # samples of a run, seconds between them


def resistor_twin() -> pd.DataFrame:
    """Two runs of a chamber that moves in steps; in the second the room cools, and the meter follows late."""
    runs = []
    for number, cooling in ((9, 0.3), (10, 2.0)):
        rng = np.random.default_rng(number)
        seconds = STEP * np.arange(ROWS)
        oven = 30.0 + np.round(5.0 * np.sin(2 * np.pi * seconds / (9000.0 if number == 9 else 27_000.0)))
        oven = oven + late(oven, 60.0) + rng.normal(0.0, 0.01, ROWS)  # a chamber needs a minute for a step
        wander = make_record(ROWS, sampling_period=STEP, seed=number)["temperature"].to_numpy()
        room = 21.5 + 0.1 * (wander - wander[0]) - cooling * np.clip(np.linspace(-1.0, 1.0, ROWS), 0.0, 1.0)
        deviation = 0.3 * (oven - 30.0) - 0.03 * (oven - 30.0) ** 2 + 0.3 * late(oven, 300.0) + 0.2 * late(oven, 2400.0)
        deviation = deviation - 1.5 * (room - 21.5 + late(room, 3600.0)) + rng.normal(0.0, 0.08, ROWS)
        index = pd.Timestamp("2018-02-01") + pd.to_timedelta(86_400.0 * number + seconds, unit="s")
        columns = {"oven_temp_degC": oven, "ambient_temp_degC": room, "deviation_ppm": 78.0 + deviation}
        runs.append(pd.DataFrame({"run": f"run{number}", **columns}, index=pd.DatetimeIndex(index, name="time")))
    return pd.concat(runs)


def late(values: np.ndarray, time_constant: float) -> np.ndarray:
    """What a body of this time constant [s] lacks of `values`."""
    steps = np.full(len(values), STEP)
    return lag_differences(values, steps, np.array([time_constant]))[0][:, 0]

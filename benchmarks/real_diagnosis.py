"""Measured records with a hidden effect: is it named, and how far does the error fall?

    python benchmarks/real_diagnosis.py ../shared/records [--share 0.6]

Base model: temperature only, defaults, the first share to learn (70 %); `diagnose` and `refine` see that part alone.
Printed are the verdict, the first suspects, and the rms of the 30 % that follow (offset included) before and after.
The rules by which `refine` keeps an effect were chosen on these records and this share: try other shares.
"""

from __future__ import annotations

import argparse
import math
import warnings
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd

from thermocorr import DynamicBiasRegressor, RecordWarning, refine
from thermocorr.datasets import load_real_record

SHARE, THEN = 0.7, 0.3
"""Of the rows: to learn from, and those after them to test on."""


def cases(folder: str, share: float = SHARE) -> Iterator[tuple[str, pd.DataFrame, pd.Series, str, int]]:
    """Name, frame of temperature and suspects, reading, temperature column, rows to learn."""
    run = load_real_record("vhd200_resistor", folder, run="run10")
    X, y = run.drop(columns="resistance_ohm"), (run["resistance_ohm"] / 1000 - 1) * 1e6
    yield "vhd200 run10", X, y, "oven_temp_degC", int(share * len(X))
    runs = load_real_record("vhd200_resistor", folder)
    runs = runs[runs["run"].isin(["run9", "run10"])]  # the same resistor; the second run is later, and shared as above
    X, y = runs.drop(columns="resistance_ohm"), (runs["resistance_ohm"] / 1000 - 1) * 1e6
    yield "vhd200 run9 and run10", X, y, "oven_temp_degC", len(X) - int((1 - share) * (X["run"] == "run10").sum())
    meter = load_real_record("hp34420a_nanovoltmeter", folder, run="100mV")
    for channel in (1, 2):
        X = meter.drop(columns=[name for name in meter.columns if name.endswith("_V")])
        reading = (meter[f"dut_ch{channel}_V"] / 0.1 - 1) * 1e6
        yield f"hp34420a 100mV ch{channel}", X, reading, "bath_temp_degC", int(share * len(X))
    soil = load_real_record("oldtown_soil", folder)
    for depth in (5, 25):
        name = f"soil_temp_{depth}cm_degC"
        X = soil.drop(columns=[column for column in soil.columns if column.startswith("soil_temp")])
        yield f"oldtown {depth} cm", X, soil[name], "air_temp_degC", int(share * len(X))
    box = load_real_record("dmm_box_heater", folder, run="log11.2")
    yield (
        "heater log11.2",
        box.drop(columns="box_temp_degC"),
        box["box_temp_degC"],
        "room_temp_degC",
        int(share * len(box)),
    )
    decade = load_real_record("gr1433_resistor", folder)
    X, y = decade.drop(columns="resistance_ohm"), (decade["resistance_ohm"] / 1e5 - 1) * 1e6
    yield "gr1433", X, y, "room_temp_degC", int(share * len(X))


def heads(folder: str, share: float = SHARE) -> Iterator[tuple[str, pd.DataFrame, pd.Series, str, int]]:
    """Groundwater heads, which follow recharge late as a reading follows temperature; the cause and three decoys."""
    for name in ("river", "well", "step", "change"):
        log = pd.read_csv(Path(folder) / "groundwater_heads" / f"{name}.csv", parse_dates=["time"]).set_index("time")
        yield f"groundwater {name}", log.drop(columns="head_m"), log["head_m"], "recharge_mm", int(share * len(log))


@cache
def every(folder: str) -> dict[str, tuple[pd.DataFrame, pd.Series, str, int]]:
    """All of them and the dam, by name: frame, reading, temperature column, rows to learn."""
    found = {name: case for name, *case in (*cases(folder), *heads(folder))}
    dam = pd.read_csv(Path(folder) / "dam_piezometer" / "piezometer.csv", parse_dates=["time"]).set_index("time")
    found["dam"] = (dam.drop(columns="level_m"), dam["level_m"], "thermistor_36_degC", int(SHARE * len(dam)))
    return {name: tuple(case) for name, case in found.items()}


def main() -> None:
    """Print a line for each record, and its steps."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", help="folder of the measured records")
    parser.add_argument("--share", type=float, default=SHARE, help="share of the rows to learn from (default 0.7)")
    options = parser.parse_args()
    warnings.simplefilter("ignore", RecordWarning)
    for name, X, y, temperature, n in (*cases(options.folder, options.share), *heads(options.folder, options.share)):
        later = slice(n, n + math.ceil(THEN * len(X)))
        run = "run" if "run" in X else None
        model = DynamicBiasRegressor(temperature, degree=1 if temperature == "recharge_mm" else 2, run=run)
        refinement = refine(model, X[:n], y[:n])
        first = refinement.diagnoses[0]
        base = model.fit(X[:n], y[:n])
        before, after = (
            float(np.sqrt(np.nanmean(np.asarray(model.residuals(X[later], y[later]), float) ** 2)))
            for model in (base, refinement.model_)
        )
        print(f"{name}: {first.verdict}; test rms {before:.4g} -> {after:.4g}")
        for row in first.ranking.head(3).itertuples():
            column = "" if pd.isna(row.column) else f":{row.column}"
            print(f"    {row.kind}{column} share {row.share:.2f} p {row.p_value:.1e} gain {row.gain_db:.2f} dB")
        print("    " + refinement.steps.to_string(index=False).replace("\n", "\n    "), flush=True)


if __name__ == "__main__":
    main()

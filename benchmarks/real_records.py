"""Measured records: how far the error falls, against a naive script, and is a hidden effect named?

    python benchmarks/real_records.py ../shared/records                         # the temperature alone
    python benchmarks/real_records.py ../shared/records --time-constants 6      # so many, instead of "auto"
    python benchmarks/real_records.py ../shared/records --refine [--share 0.6]  # with all that may be missing

Learned is the first share of the rows (70 %). The temperature alone: test rms (offset included), the figure of a naive
script with hand-set time constants, and their ratio; and what the test rms is with products of lags. Refined, from
defaults on: the verdict, the first suspects, and the rms of the 30 % that follow before and after. The rules by which
`refine` keeps an effect were chosen on these records and this share: try other shares.
"""

import math
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
from common import asked, rms

from thermocorr import DynamicBiasRegressor, compare_variants, refine
from thermocorr.datasets import load_real_record
from thermocorr.judgement import Refinement
from thermocorr.output.answer import Answer

NAIVE = {
    "vhd200 run9": 0.1332, "vhd200 run15": 0.1465, "vhd200 run17": 0.3268, "vhd200 run10": 0.9308,
    "hp34420a 100mV ch1": 0.3307, "hp34420a 100mV ch2": 0.4578, "oldtown 25 cm from 5 cm": 0.1382, "gr1433": 1.05,
}  # fmt: skip


def cases(folder: str) -> Iterator[tuple[str, pd.DataFrame, pd.Series]]:
    """Name, temperature frame and reading of each case."""
    for run in ("run9", "run15", "run17", "run10"):
        record = load_real_record("vhd200_resistor", folder, run=run)
        yield f"vhd200 {run}", record[["oven_temp_degC"]], (record["resistance_ohm"] / 1000 - 1) * 1e6
    meter = load_real_record("hp34420a_nanovoltmeter", folder, run="100mV")
    for channel in (1, 2):
        yield f"hp34420a 100mV ch{channel}", meter[["bath_temp_degC"]], (meter[f"dut_ch{channel}_V"] / 0.1 - 1) * 1e6
    soil = load_real_record("oldtown_soil", folder)
    yield "oldtown 25 cm from 5 cm", soil[["soil_temp_5cm_degC"]], soil["soil_temp_25cm_degC"]
    box = load_real_record("gr1433_resistor", folder)
    yield "gr1433", box[["room_temp_degC"]], (box["resistance_ohm"] / 1e5 - 1) * 1e6


def error_on_the_rest(
    X: pd.DataFrame, y: pd.Series, share: float, number: int | str = "auto", products: bool = False
) -> tuple[float, DynamicBiasRegressor]:
    """Rms residual of the part that was not learned, offset included, and the model of ``number`` time constants."""
    n = int(share * len(X))
    model = DynamicBiasRegressor(X.columns[0], number, products=products).fit(X[:n], y[:n])
    return rms(model.residuals(X[n:], y[n:])), model


# ---- with all that may be missing ------------------------------------------------------------------------------------
SHARE, THEN = 0.7, 0.3  # of the rows: to learn from, and those after them to test on


def suspected(folder: str, share: float = SHARE) -> Iterator[tuple[str, pd.DataFrame, pd.Series, str, int]]:
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
    X, y = box.drop(columns="box_temp_degC"), box["box_temp_degC"]
    yield "heater log11.2", X, y, "room_temp_degC", int(share * len(X))
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
    found = {name: case for name, *case in (*suspected(folder), *heads(folder))}
    dam = pd.read_csv(Path(folder) / "dam_piezometer" / "piezometer.csv", parse_dates=["time"]).set_index("time")
    found["dam"] = (dam.drop(columns="level_m"), dam["level_m"], "thermistor_36_degC", int(SHARE * len(dam)))
    return {name: tuple(case) for name, case in found.items()}


def learned(X: pd.DataFrame, n: int, share: float) -> int:
    """Rows to learn for another share than `SHARE`, of which `n` are learned."""
    return len(X) - round((len(X) - n) * (1 - share) / (1 - SHARE))


def answered(X: pd.DataFrame, y: pd.Series, temperature: str, n: int) -> dict[str, float]:
    """What is promised of the first n rows by the advised correction, refined, and the truth of the rows after them.

    `truth`: rms of the advised correction; `low`, `high`: its printed range; `given`, `without`: truth of the model
    that was refined, and of no correction.
    """
    run = "run" if "run" in X else None
    later = slice(n, n + math.ceil(THEN * len(X)))
    compared = compare_variants(X[:n], y[:n], temperature=temperature, run=run, degree=2, n_blocks=2)
    found = refine(compared.models[compared.begun], X[:n], y[:n])
    answer = Answer.of(X[:n], y[:n], refinement=found, comparison=compared)
    if answer.advised is None or answer.choice == "":
        return {}
    models = {**compared.models, "refined": found.model_}
    truth = {name: rms(model.residuals(X[later], y[later])) for name, model in models.items()}
    truth["none"] = rms(y[later] - y[:n].mean())
    low, high = answer.advised.range
    advised = answer.choice if answer.choice in ("none", "refined") else answer.advised.variant
    return {
        "truth": truth[advised], "low": low, "high": high, "given": truth[compared.begun], "without": truth["none"],
    }  # fmt: skip


def refined(X: pd.DataFrame, y: pd.Series, temperature: str, n: int) -> tuple[Refinement, float, float]:
    """What `refine` makes of the first n rows, and the rms of the last of the others, before and after."""
    degree = 1 if temperature == "recharge_mm" else 2
    model = DynamicBiasRegressor(temperature, degree=degree, run="run" if "run" in X else None)
    found, later = refine(model, X[:n], y[:n]), slice(n, n + math.ceil(THEN * len(X)))
    before, after = (rms(each.residuals(X[later], y[later])) for each in (model.fit(X[:n], y[:n]), found.model_))
    return found, before, after


def main() -> None:
    options = asked(__doc__, "folder", share=SHARE, time_constants=int, refine=False)
    if options.refine:
        for name, *case in (*suspected(options.folder, options.share), *heads(options.folder, options.share)):
            refinement, before, after = refined(*case)
            first = refinement.diagnoses[0]
            print(f"{name}: {first.verdict}; test rms {before:.4g} -> {after:.4g}")
            print(first.ranking.head(3)[["kind", "column", "share", "p_value", "gain_db"]].to_string(index=False))
            print(refinement.steps.to_string(index=False), flush=True)
        return
    ratios = []
    for name, X, y in cases(options.folder):
        number = options.time_constants or "auto"
        error, model = error_on_the_rest(X, y, options.share, number)
        with_products = error_on_the_rest(X, y, options.share, number, True)[0]
        ratios.append(error / NAIVE[name])
        chosen = ", ".join(f"{tau:.4g}" for tau in model.time_constants_)
        print(f"{name:25s} test rms {error:8.4f}  naive {NAIVE[name]:8.4f}  ratio {ratios[-1]:.2f}  tau/s {chosen}")
        print(f"{'':25s} with products of lags {with_products:.4f}", flush=True)
    print(f"geometric mean of the ratios {np.exp(np.mean(np.log(ratios))):.3f}, worst {max(ratios):.2f}")


if __name__ == "__main__":
    main()

"""Measured records: learn on the first part, test on the rest, against a naive script with hand-set time constants.

    python benchmarks/real_records.py ../shared/records
    python benchmarks/real_records.py ../shared/records --time-constants 6      # so many, instead of "auto"

Prints test rms (offset included), the naive script's figure, and their ratio, with the package's defaults.
"""

from __future__ import annotations

import argparse
import warnings
from collections.abc import Iterator

import numpy as np
import pandas as pd

from thermocorr import DynamicBiasRegressor, RecordWarning
from thermocorr.datasets import load_real_record

NAIVE = {
    "vhd200 run9": 0.1332,
    "vhd200 run15": 0.1465,
    "vhd200 run17": 0.3268,
    "vhd200 run10": 0.9308,
    "hp34420a 100mV ch1": 0.3307,
    "hp34420a 100mV ch2": 0.4578,
    "oldtown 25 cm from 5 cm": 0.1382,
    "gr1433": 1.05,
}


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
    X: pd.DataFrame, y: pd.Series, share: float, number: int | str = "auto", products: bool | str = "auto"
) -> tuple[float, DynamicBiasRegressor]:
    """Rms residual of the part that was not learned, offset included, and the model of ``number`` time constants."""
    n = int(share * len(X))
    model = DynamicBiasRegressor(X.columns[0], number, products=products).fit(X[:n], y[:n])
    return float(np.sqrt(np.nanmean(model.residuals(X[n:], y[n:]) ** 2))), model


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", help="folder of the measured records")
    parser.add_argument("--share", type=float, default=0.7, help="share of the record to learn on (default 0.7)")
    parser.add_argument("--time-constants", type=int, help="how many to choose (default: that too)")
    options = parser.parse_args()
    warnings.simplefilter("ignore", RecordWarning)
    ratios = []
    for name, X, y in cases(options.folder):
        rms, model = error_on_the_rest(X, y, options.share, options.time_constants or "auto")
        ratios.append(rms / NAIVE[name])
        chosen = ", ".join(f"{tau:.4g}" for tau in model.time_constants_)
        print(f"{name:25s} test rms {rms:8.4f}  naive {NAIVE[name]:8.4f}  ratio {ratios[-1]:.2f}  tau/s {chosen}")
    print(f"geometric mean of the ratios {np.exp(np.mean(np.log(ratios))):.3f}, worst {max(ratios):.2f}")


if __name__ == "__main__":
    main()

"""Every display on five records, as pictures to look at, with seconds and memory.

    pip install '.[plot]' && python benchmarks/displays.py pictures --records ../shared/records --rows 10000000

The built-in record, measured ones (where their folder is given), a small one, one with gaps and runs, and a long one in
memory-mapped arrays, whose rows pass in blocks.
"""

from __future__ import annotations

import argparse
import tempfile
import time
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np

matplotlib.use("Agg")
import matplotlib.pyplot as plt

from thermocorr import (
    AllanDisplay,
    ContributionsDisplay,
    DynamicBiasRegressor,
    RecordWarning,
    RefinementDisplay,
    ResidualLoopDisplay,
    ResidualsDisplay,
    SpectrumDisplay,
    StepResponseDisplay,
    SuspectsDisplay,
    VariantsDisplay,
    WhereDisplay,
    compare_variants,
    diagnose,
    refine,
)
from thermocorr.datasets import load_real_record, load_voltage_reference, make_record
from thermocorr.equations import LagState, lag_differences

Case = tuple[str, DynamicBiasRegressor, Any, Any]


def cases(records: str | None) -> Iterator[Case]:
    """Name, model, X, y."""
    record = load_voltage_reference(hidden="moisture")
    yield "reference", DynamicBiasRegressor("temperature"), record.drop(columns="voltage"), record["voltage"]
    record = make_record(30, seed=1)
    model = DynamicBiasRegressor("temperature", ["5 min"], degree=1)
    yield "small", model, record.drop(columns="reading"), record["reading"]
    record = make_record(3000, gaps=3, runs=3, seed=4, effects={"hysteresis": 2.0})
    model = DynamicBiasRegressor("temperature", run="run", max_gap="10 min")
    yield "runs", model, record.drop(columns="reading"), record["reading"]
    if records:
        soil = load_real_record("oldtown_soil", records)
        X = soil.drop(columns=[name for name in soil.columns if name.startswith("soil_temp")])
        yield "soil", DynamicBiasRegressor("air_temp_degC"), X, soil["soil_temp_5cm_degC"]
        box = load_real_record("dmm_box_heater", records)
        model = DynamicBiasRegressor("room_temp_degC", run="run", time="time_s")
        yield "heater", model, box.drop(columns="box_temp_degC"), box["box_temp_degC"]


def long_record(folder: Path, n: int) -> Case:
    """A device with two lags, and one spike, in memory-mapped arrays."""
    X = np.lib.format.open_memmap(folder / "X.npy", "w+", np.float64, (n, 1))
    y = np.lib.format.open_memmap(folder / "y.npy", "w+", np.float64, (n,))
    rng, state = np.random.default_rng(0), LagState(np.zeros(2), 23.0)
    for start in range(0, n, 1_000_000):
        seconds = 15.0 * np.arange(start, min(start + 1_000_000, n))
        T = 23 + np.sin(seconds / 40_000) + 0.3 * np.sin(seconds / 4000) + 0.01 * rng.normal(size=len(seconds))
        lags, state = lag_differences(T, np.full(len(T), 15.0), np.array([300.0, 9000.0]), state)
        X[start : start + len(T), 0] = T
        y[start : start + len(T)] = 10 * T + lags @ [3.0, 4.0] + 0.2 * rng.normal(size=len(T))
    y[2 * n // 3] += 30.0
    X.flush()
    y.flush()
    model = DynamicBiasRegressor(
        time_constants=[60.0, 300.0, 900.0, 9000.0], sampling_period=15.0, initial_state="equilibrium"
    )
    return "long", model, np.load(folder / "X.npy", mmap_mode="r"), np.load(folder / "y.npy", mmap_mode="r")


def show(folder: Path, case: Case, judge: bool) -> None:
    """Make, time and save all displays of one record."""
    name, model, X, y = case
    model.fit(X, y)
    found = diagnose(model, X, y) if judge else None
    makers = {
        "residuals": lambda: ResidualsDisplay.from_estimator(model, X, y, found),
        "loop": lambda: ResidualLoopDisplay.from_estimator(model, X, y),
        "allan": lambda: AllanDisplay.from_estimator(model, X, y),
        "contributions": lambda: ContributionsDisplay.from_estimator(model, X),
        "step": lambda: StepResponseDisplay.from_estimator(model),
        "spectrum": lambda: SpectrumDisplay.from_estimator(model),
    }
    if name != "long":
        makers["variants"] = lambda: VariantsDisplay.from_comparison(compare_variants(X, y, model=model))
    if found is not None:
        makers["where"] = lambda: WhereDisplay.from_diagnosis(found, X)
        makers["suspects"] = lambda: SuspectsDisplay.from_diagnosis(found)
        makers["refinement"] = lambda: RefinementDisplay.from_refinement(refine(model, X, y))
    for label, make in makers.items():
        before, began = own_memory(), time.perf_counter()
        display = make()
        computed, grown = time.perf_counter() - began, own_memory() - before
        began = time.perf_counter()
        display.plot().figure_.savefig(folder / f"{name}_{label}.png", dpi=100)
        plt.close("all")
        drawn = time.perf_counter() - began
        print(f"{name} {label}: {computed:.2f} s to compute, {drawn:.2f} s to draw, {grown:+.0f} MiB", flush=True)


def own_memory() -> float:
    """Memory of this process without mapped files [MiB]."""
    return int(Path("/proc/self/status").read_text().split("RssAnon:")[1].split()[0]) / 1024


def main() -> None:
    """Draw everything."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--records", help="folder of the measured records")
    parser.add_argument("--rows", type=int, default=1_000_000, help="rows of the long record (default 1e6)")
    options = parser.parse_args()
    warnings.simplefilter("ignore", RecordWarning)
    options.folder.mkdir(parents=True, exist_ok=True)
    for case in cases(options.records):
        show(options.folder, case, judge=case[0] != "small")
    with tempfile.TemporaryDirectory() as folder:
        show(options.folder, long_record(Path(folder), options.rows), judge=False)


if __name__ == "__main__":
    main()

"""Exported C against the model: records, a driver that reads and writes binary files, compilers."""

import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from effect_records import LIVE

from thermocorr import DiffusiveFeatures, DynamicBiasRegressor
from thermocorr.effects import (
    Covariate,
    Delay,
    Drift,
    Hinge,
    Hysteresis,
    InitialTransient,
    Interaction,
    LaggedCovariate,
    LagProducts,
    LogAgeing,
    Periodic,
    Rate,
    SensitivityDrift,
    StaticPolynomial,
    Step,
    ThermalLag,
)
from thermocorr.effects.products import CoarseProducts
from thermocorr.firmware import FirmwareExport, export_c

WARNINGS = ["-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-Wconversion", "-Wdouble-promotion", "-Wshadow"]
PERIOD = 15.0
BEGIN = pd.Timestamp("2024-03-04 01:23:45")
SIX = (60.0, 300.0, 1500.0, 7500.0, 30_000.0, 100_000.0)
ALL_AT_ONCE = [
    Hysteresis(0.6),
    Hinge(23.0),
    Interaction("humidity"),
    SensitivityDrift(),
    LagProducts([90.0, 4000.0], temperature_products=True),
    StaticPolynomial(3, lowest_power=2),
]
KINDS = {
    "static_polynomial": {"effects": [StaticPolynomial(3, lowest_power=2)]},
    "thermal_lag": {"effects": [ThermalLag([90.0, 4000.0])]},
    "thermal_lag, held": {"effects": [ThermalLag([90.0, 4000.0], "zero_order")]},
    "thermal_lag, 1e7 s": {"time_constants": [1e7], "alpha": 1e-3},
    "thermal_lag, paper's size": {"time_constants": SIX, "degree": 2, "n": 40_000},
    "initial_transient": {"effects": [InitialTransient(["10 min", "5 h"])]},
    "lag_products": {"effects": [LagProducts([90.0, 4000.0], temperature_products=True)]},
    "lag_products, third order": {"effects": [LagProducts([90.0, 4000.0], temperature_products=True, order=3)]},
    "lag_products, coarse": {"effects": [CoarseProducts(3)]},
    "lag_products, of the model": {"products": True, "time_constants": [60.0, 600.0, 6000.0]},
    "rate": {"effects": [Rate()]},
    "rate, smoothed": {"effects": [Rate("5 min")]},
    "delay, half a step": {"effects": [Delay(7.0)]},
    "delay": {"effects": [Delay("25 min")]},
    "delay, between samples": {"effects": [Delay(100.0)]},
    "covariate": {"effects": [Covariate("humidity")]},
    "covariate, cubed": {"effects": [Covariate("humidity", 3)]},
    "lagged_covariate": {"effects": [LaggedCovariate("humidity", ["20 min"])]},
    "lagged_covariate, squared": {"effects": [LaggedCovariate("humidity", ["20 min", "3 h"], power=2)]},
    "lagged_covariate, of T": {
        "effects": [Covariate("temperature", 2), LaggedCovariate("temperature", [900.0], power=2)]
    },
    "interaction": {"effects": [Interaction("humidity")]},
    "drift": {"effects": [Drift(True)]},
    "log_ageing": {"effects": [LogAgeing("2 h", True)]},
    "sensitivity_drift": {"effects": [SensitivityDrift()]},
    "step": {"effects": [Step(5000.0, True), Step(880_000.0, True)]},
    "hysteresis": {"effects": [Hysteresis(0.6)]},
    "hinge": {"effects": [Hinge(23.0, "above")]},
    "hinge, lagged": {"effects": [Hinge(22.8, "below", ["10 min", "2 h"])]},
    "periodic": {"effects": [Periodic("3 h", 3)]},
    "periodic, tide": {"effects": [Periodic(44_714.16, 1)]},
    "several": {"effects": ALL_AT_ONCE},
    "several, in kelvin": {"effects": [Hinge(296.0), *ALL_AT_ONCE[2:]], "kelvin": True},
}
"""Models to export: the effect besides two lags and a slope; the first word is the kind."""
_COVERED = {kind.split(",")[0] for kind in KINDS}
KINDS |= {effect.kind: {"effects": [effect]} for effect in LIVE if effect.kind not in _COVERED}
DRIVER = """
#include "@.h"
#include <stdio.h>
#include <stdlib.h>
int main(int argc, char **argv)
{
    static @_state state;
    FILE *in = fopen(argv[1], "rb"), *out = fopen(argv[2], "wb");
    double row[@WIDTH], answer[3];
    if (argc < 4 || !in || !out) return 1;
    @_init(&state, strtod(argv[3], NULL));
    while (fread(row, sizeof(double), @WIDTH, in) == @WIDTH) {
        const @_result result = @_update(&state, row[0], row[1], row[2], row + 3);
        answer[0] = result.bias;
        answer[1] = result.corrected;
        answer[2] = (double)result.flags;
        fwrite(answer, sizeof(double), 3, out);
    }
    fclose(in);
    return fclose(out);
}
"""


@dataclass
class Run:
    """What the C code made of a record, shape (n,) each."""

    bias: np.ndarray
    corrected: np.ndarray
    flags: np.ndarray


def ambient(n, seed=0, irregular=False, kelvin=False, begin=BEGIN):
    """A room with a daily wave, an air conditioner and a slow wander; humidity besides it. Whole microseconds."""
    rng = np.random.default_rng(seed)
    steps = PERIOD * (rng.uniform(0.2, 1.8, n) if irregular else np.ones(n))
    ticks = np.cumsum(np.round(steps * 1e6).astype(np.int64))
    ticks -= ticks[0]
    t = ticks / 1e6
    slow = np.interp(t, np.linspace(0, t[-1], 60), np.cumsum(rng.normal(0, 0.4, 60)) / 2)
    T = 23 + 1.5 * np.sin(t / 13_751) + 0.4 * np.sin(t / 600) + slow + 0.02 * rng.normal(size=n)
    h = 45 + 8 * np.sin(t / 30_000 + 1) + 2 * np.sin(t / 4000) + 0.2 * rng.normal(size=n)
    return pd.DataFrame(
        {"temperature": T + (273.15 if kelvin else 0), "humidity": h},
        index=begin + pd.to_timedelta(ticks * 1000, unit="ns"),
    )


def fitted(
    effects=(), n=6000, seed=1, kelvin=False, irregular=False, time_constants=(200.0, 2000.0), alpha=0.0, **settings
):
    """A model fitted to a reading to which every column contributes about as much."""
    X = ambient(n, seed, irregular, kelvin)
    given = {"degree": 1, "max_gap": "1 h", **settings}
    features = DiffusiveFeatures(time_constants, effects=list(effects), **given)
    columns = features.fit_transform(X)
    rng = np.random.default_rng(seed)
    scale = np.where(columns.std(axis=0) > 0, columns.std(axis=0), 1.0)
    y = 10.0 + (columns / scale) @ rng.uniform(0.5, 1.5, columns.shape[1]) + 1e-3 * rng.normal(size=n)
    model = DynamicBiasRegressor("temperature", time_constants, effects=list(effects), alpha=alpha, **given)
    return model.fit(X, y), X


def later(X, n, seed=2, irregular=False, kelvin=False, days=10):
    """A record that starts anew some days after the fitted one."""
    return ambient(n, seed, irregular, kelvin, X.index[-1] + pd.Timedelta(days, "D"))


def compile_c(export: FirmwareExport, command=("gcc", "-O2")) -> Path:
    """Build code and driver; returns the program."""
    _, source, _ = export.paths
    driver = source.with_name(f"{export.name}_driver.c")
    driver.write_text(DRIVER.replace("@WIDTH", str(3 + len(export.columns))).replace("@", export.name))
    program = source.with_name(f"{export.name}_{Path(command[0]).name}_{abs(hash(tuple(command))) % 9999}")
    flags = [] if any(flag.startswith("-w") for flag in command) else WARNINGS
    built = subprocess.run(
        [*command, *flags, source, driver, "-o", program, "-lm"], capture_output=True, text=True, check=False
    )
    assert built.returncode == 0, built.stderr
    return program


def run_c(program: Path, record: pd.DataFrame, reading, columns=(), start=0.0, before=()) -> Run:
    """Feed a record that begins `start` seconds after the fitted one; `before` stands in front, as an emulator does."""
    steps = np.diff(record.index.astype("datetime64[ns]").asi8, prepend=record.index[:1].asi8) / 1e9
    rows = np.column_stack([steps, record["temperature"], reading, *(record[name] for name in columns)])
    given, answers = program.with_suffix(".in"), program.with_suffix(".out")
    np.ascontiguousarray(rows, float).tofile(given)
    command = [*before, program, given, answers, repr(float(start))]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-3000:]
    result = np.fromfile(answers).reshape(-1, 3)
    given.unlink()
    answers.unlink()
    return Run(result[:, 0], result[:, 1], result[:, 2].astype(int))


def seconds_to(X, new):
    """Seconds from the first fitted row to the first of a later record."""
    return (new.index[0] - X.index[0]).total_seconds()


def errors(model, X, folder, n, irregular=False, kelvin=False, command=("gcc", "-O2"), before=()):
    """Largest difference between C and Python, as a share of the range of the bias; the export; answers; the record."""
    new = later(X, n, irregular=irregular, kelvin=kelvin)
    export = export_c(model, Path(folder) / "bias", force=True)
    program = compile_c(export, command)
    run = run_c(program, new, np.ones(n), export.columns, seconds_to(X, new), before)
    expected = model.bias(new).to_numpy()
    return np.abs(run.bias - expected).max() / np.ptp(expected), export, run, new


def tool(name):
    """Path of a program, or None."""
    return shutil.which(name)


needs_gcc = pytest.mark.skipif(tool("gcc") is None, reason="no C compiler: install gcc to run the exported code")
ROWS = 20_000
BOUND = 1e-12
"""Promised share of the range of the bias."""

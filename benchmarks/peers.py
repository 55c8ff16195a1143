"""What a user could pick instead: the same simulated devices, learned and run free by other tools, in one table.

    python benchmarks/peers.py                                  # three records of each device, 84 000 rows
    python benchmarks/peers.py --quick                          # 12 000 rows, one record: does everything run?
    python benchmarks/peers.py --tools static,defaults,pastas   # some of the tools
    python benchmarks/peers.py --device layered                 # a device with two distant time constants

Every tool learns on the first 70 % of the rows; on the rest it gets the temperature alone, never a reading, and its
lags go on from the learned part. The residual is the rms over the rest, offset included, over the standard deviation
of the white noise; "noise alone" is what the record's own noise leaves. Fit and forecast times and residuals are
medians over the records; the memory is the peak of what tracemalloc sees (numpy included) in a separate fit of one
record. Each tool runs once on a short record before, so that imports and compilation do not count.

Tools: pip install statsmodels pastas tqdm pysindy sysidentpy. What is missing is listed as not installed.
"""

from __future__ import annotations

import argparse
import importlib.metadata
import logging
import platform
import time
import tracemalloc
import warnings
from typing import Any

import numpy as np
from peer_tools import STEP, TOOLS, Array, Fit
from threadpoolctl import threadpool_limits

import thermocorr
from thermocorr.datasets import make_record

NOISE = 0.2  # [ppm]
SHARE = 0.7  # learned
BLOCK = 40  # rows; the lengths are multiples of it, so that block means need no care
PACKAGES = ("numpy", "scipy", "scikit-learn", "statsmodels", "pastas", "pysindy", "sysidentpy", "numba")


def make(options: argparse.Namespace, nonlinearity: float, seed: int) -> tuple[Array, Array, Array, Array]:
    """Times [s], temperature, reading and noise of one record."""
    rows = options.rows // BLOCK * BLOCK
    record, truth = make_record(
        rows,
        sampling_period=STEP,
        device=options.device,
        setting="lab",
        noise=NOISE,
        nonlinearity=nonlinearity,
        seed=seed,
        return_truth=True,
    )
    return STEP * np.arange(rows), *(a.to_numpy() for a in (record["temperature"], record["reading"], truth["noise"]))


def learned_rows(rows: int) -> int:
    """Number of rows to learn on."""
    return round(SHARE * rows) // BLOCK * BLOCK


def fit_predict(fit: Fit, t: Array, T: Array, y: Array, n_learn: int) -> tuple[Array, float, float]:
    """Readings that the tool expects in the test part, time of the fit (median of up to five), of the forecast [s]."""
    spent: list[float] = []
    while len(spent) < 5 and sum(spent) < 2.0:
        began = time.perf_counter()
        forecast = fit(t[:n_learn], T[:n_learn], y[:n_learn])
        spent.append(time.perf_counter() - began)
    began = time.perf_counter()
    expected = np.asarray(forecast(t[n_learn:], T[n_learn:]))
    return expected, float(np.median(spent)), time.perf_counter() - began


def peak(fit: Fit, t: Array, T: Array, y: Array, n_learn: int) -> float:
    """Peak of the fit's allocations [MiB]."""
    tracemalloc.start()
    try:
        fit(t[:n_learn], T[:n_learn], y[:n_learn])
        return tracemalloc.get_traced_memory()[1] / 2**20
    finally:
        tracemalloc.stop()


def rms(values: Array) -> float:
    """Root mean square, over the noise."""
    return float(np.sqrt(np.mean(values**2))) / NOISE


def measure(fit: Fit, records: dict[str, list[tuple[Array, Array, Array, Array]]]) -> str:
    """Figures of one tool as a line of the table."""
    fits, forecasts, residuals = [], [], []
    for device in records.values():
        ratios = []
        for t, T, y, _ in device:
            n = learned_rows(len(t))
            expected, fit_time, forecast_time = fit_predict(fit, t, T, y, n)
            ratios.append(rms(y[n:] - expected))
            fits.append(fit_time)
            forecasts.append(forecast_time)
        residuals.append(f"{np.median(ratios):10.3f}")
    t, T, y, _ = next(iter(records.values()))[0]
    memory = peak(fit, t, T, y, learned_rows(len(t)))
    return f"{np.median(fits):8.3f} {np.median(forecasts):10.3f} {memory:8.1f} " + " ".join(residuals)


def line(name: str, fit: Fit, short: tuple[Array, ...], records: dict[str, Any]) -> str:
    """Line of the table, or why there is none."""
    try:
        try:
            fit_predict(fit, *short[:3], learned_rows(len(short[0])))
        except ImportError:
            raise
        except Exception:  # a short record may be too short; the real ones decide
            pass
        return f"{name:42s} {measure(fit, records)}"
    except ModuleNotFoundError as error:
        return f"{name:42s} not installed ({error.name})"
    except ImportError as error:
        return f"{name:42s} not installed ({str(error).splitlines()[0]})"
    except Exception as error:
        first = (str(error).splitlines() or [""])[0]
        return f"{name:42s} {type(error).__name__}: {first}"


def versions() -> str:
    """Versions of the packages at hand."""
    found = [f"python {platform.python_version()}, thermocorr {thermocorr.__version__}"]
    for name in PACKAGES:
        try:
            found.append(f"{name} {importlib.metadata.version(name)}")
        except importlib.metadata.PackageNotFoundError:
            continue
    return ", ".join(found)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rows", type=int, default=84_000)
    parser.add_argument("--device", default="slab", help="device of make_record (default slab)")
    parser.add_argument("--nonlinearity", type=float, default=0.1, help="of the nonlinear device [1/K] (default 0.1)")
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2, 3], help="a record of each device per seed")
    parser.add_argument("--tools", help=f"comma-separated, of {','.join(TOOLS)} (default all)")
    parser.add_argument("--quick", action="store_true", help="12 000 rows, one seed")
    options = parser.parse_args()
    if options.quick:
        options.rows, options.seeds = 12_000, options.seeds[:1]
    names = options.tools.split(",") if options.tools else list(TOOLS)
    if unknown := sorted(set(names) - set(TOOLS)):
        parser.error(f"unknown tools {', '.join(unknown)}; there are {', '.join(TOOLS)}")
    warnings.simplefilter("ignore")
    logging.disable(logging.WARNING)
    with threadpool_limits(1):
        print(f"one BLAS thread; {versions()}")
        devices = {"linear": 0.0, "nonlinear": options.nonlinearity}
        records = {name: [make(options, value, seed) for seed in options.seeds] for name, value in devices.items()}
        short = make(argparse.Namespace(rows=4_000, device=options.device), options.nonlinearity, 0)
        print(
            f"{options.device}, {options.rows} rows, {STEP:g} s, seeds {options.seeds}, nonlinearity "
            f"{options.nonlinearity:g}/K; free-run residual over noise, medians; memory by tracemalloc"
        )
        print(f"{'tool':42s} {'fit/s':>8s} {'forecast/s':>10s} {'MiB':>8s} " + " ".join(f"{d:>10s}" for d in records))
        floor = [np.median([rms(w[learned_rows(len(w)) :]) for _, _, _, w in device]) for device in records.values()]
        print(f"{'noise alone':42s} {'':28s} " + " ".join(f"{value:10.3f}" for value in floor))
        for name in names:
            print(line(TOOLS[name][0], TOOLS[name][1], short, records), flush=True)


if __name__ == "__main__":
    main()

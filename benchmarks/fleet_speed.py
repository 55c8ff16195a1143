"""A fleet on two processes against one: 1000 devices of 20 000 rows, each with time constants of its own.

    python benchmarks/fleet_speed.py
    python benchmarks/fleet_speed.py --devices 200 --tries 3

Prints wall times with one and two processes (joblib, and a pool of `concurrent.futures`) and their ratio. Ten different
records serve all devices; each is sent to its worker.
"""

from __future__ import annotations

import argparse
import time
import warnings
from concurrent.futures import ProcessPoolExecutor

from thermocorr import DynamicBiasRegressor
from thermocorr.cluster.fleet import fit_fleet
from thermocorr.datasets import make_record


def wall(workers: object, devices: dict[str, object]) -> float:
    """Seconds that a fleet takes."""
    began = time.perf_counter()
    fit_fleet(workers, devices, "reading", model=DynamicBiasRegressor("temperature"))
    return time.perf_counter() - began


def pooled(n: int, devices: dict[str, object]) -> float:
    """Seconds that it takes on a pool of `n` processes that stand ready."""
    with ProcessPoolExecutor(n) as pool:
        list(pool.map(len, ["ready"] * n))
        return wall(pool, devices)


def main() -> None:
    """Print the times."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--devices", type=int, default=1000)
    parser.add_argument("--rows", type=int, default=20_000)
    parser.add_argument("--tries", type=int, default=1)
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    records = [make_record(options.rows, seed=seed)[["temperature", "reading"]] for seed in range(10)]
    devices: dict[str, object] = {f"device {k}": records[k % len(records)] for k in range(options.devices)}
    few = dict(list(devices.items())[:4])
    wall(1, few)
    wall(2, few)  # the workers of joblib are started
    for _ in range(options.tries):
        one, two = wall(1, devices), wall(2, devices)
        single, double = pooled(1, devices), pooled(2, devices)
        print(f"joblib: {one:.1f} s and {two:.1f} s, {one / two:.2f} times; {1e3 * one / len(devices):.0f} ms a device")
        print(f"pool:   {single:.1f} s and {double:.1f} s, {single / double:.2f} times", flush=True)


if __name__ == "__main__":
    main()

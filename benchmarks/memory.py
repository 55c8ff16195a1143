"""Peak memory of a fit from a memory-mapped file.

    python benchmarks/memory.py --rows 10000000

Prints the peak of Python's and numpy's allocations during the fit (the mapped pages of the file are the system's).
"""

from __future__ import annotations

import argparse
import tempfile
import time
import tracemalloc
from pathlib import Path

import numpy as np

from thermocorr import DynamicBiasRegressor


def main() -> None:
    """Write a record, map it, fit it, print the peak."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rows", type=int, default=10_000_000)
    n = parser.parse_args().rows
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "log.bin"
        data = np.memmap(path, np.float64, "w+", shape=(n, 2))
        for start in range(0, n, 1_000_000):
            t = np.arange(start, min(start + 1_000_000, n))
            data[t, 0] = 23 + np.sin(t / 3000) + 0.3 * np.sin(t / 171)
            data[t, 1] = np.sin(t / 3000 - 0.1) + 0.01 * np.sin(t * 1.7)
        data.flush()
        data = np.memmap(path, np.float64, "r", shape=(n, 2))
        model = DynamicBiasRegressor(time_constants=np.geomspace(10, 30_000, 6), sampling_period=1.0)
        tracemalloc.start()
        began = time.perf_counter()
        model.fit(data[:, :1], data[:, 1])
        peak = tracemalloc.get_traced_memory()[1]
        print(f"{n} rows, 6 time constants: peak {peak / 2**20:.1f} MiB, {time.perf_counter() - began:.1f} s (traced)")


if __name__ == "__main__":
    main()

"""A record larger than memory: fit, evaluate and search from the parts of a Parquet file.

    python benchmarks/streaming.py --rows 1000000 10000000 100000000

Each job runs in a process of its own, whose peak resident memory is printed besides that of a process that only imports
the package: pandas, pyarrow and scikit-learn are most of it. Pages of mapped columns count, though the system takes
them back where it needs them. A record of 1e8 rows needs 2 GB of disk for a while.
"""

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before numpy is imported, here and in the processes below

import numpy as np
from common import asked

TIME_CONSTANTS = (60.0, 240.0, 900.0, 3600.0, 14_400.0, 43_200.0)
STEP = 15.0


def write(path: Path, n: int) -> None:
    """A room, and a device with two lags, a million rows at a time."""
    import pyarrow as pa
    from pyarrow import parquet

    from thermocorr.equations import LagState, lag_differences

    rng = np.random.default_rng(0)
    bodies, state = np.array([300.0, 9000.0]), LagState(np.zeros(2), 23.0)
    schema = pa.schema([("temperature", pa.float64()), ("reading", pa.float64())])
    with parquet.ParquetWriter(path, schema, compression="none", use_dictionary=False) as writer:
        for start in range(0, n, 1_000_000):
            seconds = STEP * np.arange(start, min(start + 1_000_000, n))
            T = 23 + np.sin(seconds / 40_000) + 0.3 * np.sin(seconds / 4000) + 0.01 * rng.normal(size=len(seconds))
            lags, state = lag_differences(T, np.full(len(seconds), STEP), bodies, state)
            reading = 10 * T + lags @ [3.0, 4.0] + 0.2 * rng.normal(size=len(seconds))
            writer.write_table(pa.table({"temperature": T, "reading": reading}, schema))


def job(name: str, path: str) -> None:
    """One job; prints seconds and peak memory [MiB]."""
    from pyarrow import parquet

    from thermocorr import DynamicBiasRegressor, read_log

    T = np.sin(np.arange(20_000.0)[:, None])  # imports, and compiled code where there is any, are the start-up
    DynamicBiasRegressor(time_constants=[10.0, 100.0], sampling_period=1.0).fit(T, T[:, 0])
    parts = (batch.to_pandas() for batch in parquet.ParquetFile(path).iter_batches(1_000_000))
    log = read_log(parts)
    X, y = log.drop(columns="reading"), log["reading"]
    taus = "auto" if name == "search" else TIME_CONSTANTS
    model = DynamicBiasRegressor("temperature", taus, degree=1, sampling_period=STEP)
    began = time.perf_counter()
    if name != "nothing":
        model.fit(X, y)
    if name == "evaluate":
        began = time.perf_counter()
        for block in model.evaluate_blocks(X, y):
            block["residual"].sum()
    spent, status = time.perf_counter() - began, Path("/proc/self/status").read_text()
    print(spent, int(status.split("VmHWM:")[1].split()[0]) / 1024)


def run(name: str, path: Path) -> tuple[float, float]:
    """A job in a process of its own: seconds, peak memory [MiB]."""
    command = [sys.executable, __file__, "--job", name, "--path", str(path)]
    spent, peak = subprocess.run(command, capture_output=True, text=True, check=True).stdout.split()
    return float(spent), float(peak)


def main() -> None:
    options = asked(__doc__, rows=[1_000_000, 10_000_000], job=str, path=str)
    if options.job:
        job(options.job, options.path)
        return
    for n in options.rows:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "log.parquet"
            write(path, n)
            imports = run("nothing", path)[1]
            print(f"{n} rows, {path.stat().st_size / 2**20:.0f} MiB file; imports alone {imports:.0f} MiB", flush=True)
            for name in ("fit", "evaluate", "search"):
                spent, peak = run(name, path)
                said = f"{spent:.2f} s, {spent / n * 1e9:.0f} ns a row, {peak - imports:.0f} MiB above imports"
                print(f"  {name}: {said}", flush=True)


if __name__ == "__main__":
    main()

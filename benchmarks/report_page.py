"""The report page of short and very long records: size, memory, time to write, and time to open in a browser.

    python benchmarks/report_page.py --rows 84000 10000000

Each record is a Parquet file that is read block by block, fitted and reported in a process of its own, whose peak
resident memory is printed beside that of a process that only imports the package. Opening is timed in a headless
Chromium (Debian: chromium, chromium-driver; pip: selenium) where there is one: from navigation until all is drawn.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before numpy is imported, here and in the processes below

import numpy as np
from streaming import STEP, TIME_CONSTANTS, write
from streaming import _peak as peak

TESTS = Path(__file__).parents[1] / "tests"


def job(log_path: str, page_path: str) -> None:
    """Fit and report; prints seconds of both, size [MB], rows in a cell, whether a planted spike is there, memory."""
    from thermocorr import DynamicBiasRegressor, ParquetLog
    from thermocorr.pages import Answer, PageData, page

    if log_path:
        log = ParquetLog(log_path)
        model = DynamicBiasRegressor("temperature", TIME_CONSTANTS, 1, sampling_period=STEP)
        began = time.perf_counter()
        model.fit(log, log["reading"])
        fitted = time.perf_counter()
        data = PageData.of(model, log, log["reading"])
        text = page(data, Answer(unjudged="A benchmark: not judged."))
        Path(page_path).write_text(text, encoding="utf-8")
        written = time.perf_counter()
        largest = max(float(np.abs(block["residual"]).max()) for block in model.evaluate_blocks(log, log["reading"]))
        kept = float(np.nanmax(np.abs(data.traces.columns["residual"]))) == largest
        print(
            f"fit {fitted - began:6.1f} s, page {written - fitted:6.1f} s, {len(text.encode()) / 1e6:.2f} MB, "
            f"{data.traces.rows_per_cell} rows a cell, largest residual {'kept' if kept else 'LOST'},",
            end=" ",
        )
    else:
        import thermocorr.pages.report  # noqa: F401
    print(f"peak memory {peak():.0f} MiB")


def opening(path: Path, repeats: int = 5) -> str:
    """Median time from navigation until all is drawn [ms], as text."""
    sys.path.insert(0, str(TESTS))
    try:
        from browser import chromium, opened

        ready = "return document.documentElement.dataset.ready"
        with chromium() as driver:
            found = [int(opened(driver, path).execute_script(ready)) for _ in range(repeats)]
            return f"opens in {np.median(found):.0f} ms"
    except BaseException as error:  # pytest's skip is one
        return f"opening not timed: {error}"


def main() -> None:
    """Run all."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rows", type=int, nargs="+", default=[84_000, 10_000_000])
    parser.add_argument("--job", nargs=2, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.job:
        job(*options.job)
        return
    print("import only: ", subprocess.check_output([sys.executable, __file__, "--job", "", ""], text=True), end="")
    for n in options.rows:
        with tempfile.TemporaryDirectory() as folder:
            log, page = Path(folder) / "log.parquet", Path(folder) / "page.html"
            write(log, n)
            done = subprocess.check_output([sys.executable, __file__, "--job", str(log), str(page)], text=True)
            print(f"{n:,} rows: {done.strip()}, {opening(page)}", flush=True)


if __name__ == "__main__":
    main()

"""The workbench with a watch: how soon a picture, a verdict and a fallen error are there; and much clicking at random.

    python benchmarks/workbench.py                      # 84 000 rows, built in; --one-core for server and computation
    python benchmarks/workbench.py --rows 3000000       # a CSV file of so many rows
    python benchmarks/workbench.py --actions 2000       # random actions: errors, memory, consistency
    python benchmarks/workbench.py --picture docs/workbench.png

Needs a Chromium and its driver, and selenium. Times are those of a person with an idle machine: from the page's
opening, and, in brackets, from the command's start.
"""

from __future__ import annotations

import argparse
import random
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import pandas as pd

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from browser import chromium, complaints
from test_workbench_browser import Person, consistent, wild
from visitors import running, until

from thermocorr.datasets import make_record

ZOOMS = 8
SHOWN = "document.querySelector('[data-part=plot]').dataset.drawn"


def long_log(folder: Path, rows: int) -> Path:
    """A CSV file of many rows at 1 s, in which the supply acts on the reading; one row stands out."""
    record = make_record(min(rows, 200_000), effects={"covariate": 2.0}, seed=1)
    at = np.linspace(0, len(record) - 1, rows)
    names = ["temperature", "humidity", "supply", "reading"]
    frame = pd.DataFrame({name: np.interp(at, np.arange(len(record)), record[name]) for name in names})
    frame["reading"] += np.random.default_rng(0).normal(0, record.attrs["noise"], rows)
    frame.index = pd.date_range("2024-01-01", periods=rows, freq="1s", name="time")
    frame.iloc[rows // 3, 3] += 50.0
    frame.round(6).to_csv(folder / "long.csv")
    return folder / "long.csv"


def memory(pid: int) -> float:
    """Resident memory of a process and its children [MiB]."""
    listed = subprocess.run(["ps", "-o", "rss=", "--pid", str(pid), "--ppid", str(pid)], capture_output=True, text=True)
    return sum(map(int, listed.stdout.split())) / 1024


def watched(log: Path | None, one_core: bool) -> None:
    """Times of one visit; with server and computation on one core, the browser is left the others."""
    within = ("taskset", "-c", "0") if one_core else ()
    begun = time.perf_counter()
    with running(*([] if log is None else [log]), within=within) as (process, port, token), chromium() as driver:
        driver.get("about:blank")  # the browser's own start does not count
        person, start = None, time.perf_counter()
        person = Person(driver, port, token)

        def said(what: str, since: float, also: float | None = None) -> None:
            now = time.perf_counter()
            print(f"{what:45s}{now - since:7.2f} s" + (f"  ({now - also:.2f} s)" if also else ""))

        until(lambda: person.js(SHOWN), 300)
        said("first picture", start, begun)
        zooms = []
        for number in range(ZOOMS):
            before, tick = person.js(SHOWN), time.perf_counter()
            person.js(f"thermocorr.bench.plot.chart.step({[0.1, -0.3][number % 2]}, {[0.6, 0.9][number % 2]})")
            until(lambda seen=before: person.js(SHOWN) != seen)
            zooms.append(time.perf_counter() - tick)
        print(f"{'zoom, median and worst':45s}{np.median(zooms):7.2f} s, {max(zooms):.2f} s")
        until(lambda: person.js("thermocorr.bench.state.judged"), 600)
        said("verdict", start, begun)
        until(lambda: person.js("document.querySelector('.workbench').dataset.progress === ''"), 600)
        said("all that is found out by itself", start, begun)
        tick = time.perf_counter()
        person.click("[data-at='add 0 ']")
        until(lambda: person.js("thermocorr.bench.state.history.length === 2"), 300)
        said("added: the residual is drawn anew", tick)
        until(lambda: person.js("thermocorr.bench.state.history[1].held_out"), 600)
        said("added: the error on other data has fallen", tick)
        until(lambda: person.js("thermocorr.bench.state.judged"), 600)
        said("added: the next verdict", tick)
        first, last = (person.js(f"thermocorr.bench.state.history[{k}].held_out.value") for k in (0, 1))
        print(f"error held out {first:.4g} -> {last:.4g}; memory {memory(process.pid):.0f} MiB")
        print("complaints of the console:", complaints(driver))


def pictured(path: Path) -> None:
    """The screen with the first suspect under the pointer."""
    from selenium.webdriver import ActionChains

    with running() as (_, port, token), chromium() as driver:
        person = Person(driver, port, token)
        person.settled()
        ActionChains(driver).move_to_element(driver.find_element("css selector", "[data-at='add 0 ']")).perform()
        person.sees("document.querySelector('.preview').textContent.includes('instead of')")
        person.sees("thermocorr.charts.series.spec.panels[2].lines.length === 3")
        time.sleep(0.5)
        driver.save_screenshot(str(path))


def clicked(actions: int, seed: int) -> None:
    """Many random actions on a record of 4000 rows: the log stays, all else changes."""
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "log.csv"
        make_record(4000, effects={"covariate": 2.0}, seed=3).to_csv(log)
        with running(log, "--keep") as (process, port, token), chromium() as driver:
            person = Person(driver, port, token)
            person.settled()
            chance, begun = random.Random(seed), time.perf_counter()
            wild(person, chance, 100)
            before = memory(process.pid)
            for part in range(100, actions, 100):
                wild(person, chance, 100)
                said = [message for message in person.faults() if "Failed to load" not in message]
                steps = person.js("thermocorr.bench.state.history.length")
                minutes = (time.perf_counter() - begun) / 60
                print(f"{part + 100} actions, {minutes:.1f} min: {steps} steps, {memory(process.pid):.0f} MiB, {said}")
                assert not said
            consistent(person)
            heap = driver.execute_script("return performance.memory.usedJSHeapSize") / 2**20
            print(f"memory {before:.0f} -> {memory(process.pid):.0f} MiB, page {heap:.0f} MiB")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rows", type=int, default=0)
    parser.add_argument("--actions", type=int, default=0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--picture", type=Path)
    parser.add_argument("--one-core", action="store_true")
    options = parser.parse_args()
    if options.picture:
        pictured(options.picture)
    elif options.actions:
        clicked(options.actions, options.seed)
    elif options.rows:
        with tempfile.TemporaryDirectory() as place:
            watched(long_log(Path(place), options.rows), options.one_core)
    else:
        watched(None, options.one_core)

"""The workbench with a watch: how soon a picture, a verdict and a fallen error are there; and much clicking at random.

    python benchmarks/workbench.py                      # 84 000 rows, built in
    python benchmarks/workbench.py --log long.csv       # another log, whose reading lacks something
    python benchmarks/workbench.py --actions 2000       # random actions: errors, memory, consistency
    python benchmarks/workbench.py --picture docs/workbench.png

Needs a Chromium and its driver, and selenium. Times are those of a person with an idle machine: from the page's
opening, and, in brackets, from the command's start.
"""

import random
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from browser import chromium, complaints
from common import asked
from test_workbench_browser import Person, consistent, wild
from visitors import running, until

from thermocorr.datasets import make_record

ZOOMS = 8
SHOWN = "document.querySelector('[data-part=plot]').dataset.drawn"


def memory(pid: int) -> float:
    """Resident memory of a process and its children [MiB]."""
    listed = subprocess.run(["ps", "-o", "rss=", "--pid", str(pid), "--ppid", str(pid)], capture_output=True, text=True)
    return sum(map(int, listed.stdout.split())) / 1024


def watched(*logs: Path) -> None:
    """Times of one visit."""
    begun = time.perf_counter()
    with running(*logs) as (process, port, token), chromium() as driver:
        driver.get("about:blank")  # the browser's own start does not count
        start = time.perf_counter()
        person = Person(driver, port, token)

        def when(true: str, what: str, since: float, also: float | None = None) -> None:
            until(lambda: person.js(true), 600)
            now = time.perf_counter()
            print(f"{what:45s}{now - since:7.2f} s" + (f"  ({now - also:.2f} s)" if also else ""))

        when(SHOWN, "first picture", start, begun)
        zooms = []
        for number in range(ZOOMS):
            before, tick = person.js(SHOWN), time.perf_counter()
            person.js(f"void thermocorr.bench.plot.step({[0.1, -0.3][number % 2]}, {[0.6, 0.9][number % 2]})")
            until(lambda seen=before: person.js(SHOWN) != seen)
            zooms.append(time.perf_counter() - tick)
        print(f"{'zoom, median and worst':45s}{np.median(zooms):7.2f} s, {max(zooms):.2f} s")
        state = "thermocorr.bench.state"
        when(f"{state}.judged", "verdict", start, begun)
        when("document.querySelector('.workbench').dataset.progress === ''", "all found out by itself", start, begun)
        tick = time.perf_counter()
        person.click("[data-at='add 0 ']")
        when(f"{state}.history.length === 2", "added: the residual is drawn anew", tick)
        when(f"{state}.history[1].held_out", "added: the error on other data has fallen", tick)
        when(f"{state}.judged", "added: the next verdict", tick)
        first, last = (person.js(f"{state}.history[{k}].held_out.value") for k in (0, 1))
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
        until(lambda: any(text.startswith("with ") for text in person.texts("plot")))
        time.sleep(0.5)
        driver.save_screenshot(str(path))


def clicked(actions: int, seed: int) -> None:
    """Many random actions on a record of 4000 rows: the log stays, all else changes."""
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "log.csv"
        make_record(4000, effects={"covariate": 2.0}, seed=3).to_csv(log)
        with running(log, "--keep") as (process, port, token), chromium() as driver:
            person, chance = Person(driver, port, token), random.Random(seed)
            person.settled()
            for part in range(0, actions, 100):
                wild(person, chance, 100)
                said = [message for message in person.faults() if "Failed to load" not in message]
                heap = driver.execute_script("return performance.memory.usedJSHeapSize") / 2**20
                print(f"{part + 100} actions: {memory(process.pid):.0f} MiB, page {heap:.0f} MiB, {said}", flush=True)
                assert not said
            consistent(person)


def main() -> None:
    options = asked(__doc__, log=Path, actions=0, seed=0, picture=Path)
    if options.picture:
        pictured(options.picture)
    elif options.actions:
        clicked(options.actions, options.seed)
    else:
        watched(*([options.log] if options.log else []))


if __name__ == "__main__":
    main()

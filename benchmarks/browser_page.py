"""The page that computes in the browser against the same workbench native: answers, model files, processor time.

    python benchmarks/browser_page.py PYODIDE     # folder of a Pyodide distribution; needs chromium and selenium
    python benchmarks/browser_page.py PYODIDE --rows 6000 --logs 10

Each log is opened on the page in a headless Chromium, whose server has files alone, and by `Desk` in this process.
The table has the largest difference of all figures on the screen and of all numbers in ``model.json``, relative to
each; the processor time of the browser's processes behind the start, and of this one; and where requests went.
"""

from __future__ import annotations

import argparse
import base64
import functools
import json
import os
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import numpy as np

from thermocorr.datasets import make_record
from thermocorr.interactive.browser.desk import Desk
from thermocorr.interactive.browser.static_page import write_static
from thermocorr.interactive.tiles import Store

HIDDEN: tuple[dict[str, float], ...] = (
    {"hysteresis": 2.0}, {"step": 1.5}, {"lagged_covariate": 2.0}, {"covariate": 1.0}, {"drift": 1.5}, {},
    {"interaction": 1.5}, {"start_up": 1.5}, {"rate": 2.0}, {"step": 1.0, "lagged_covariate": 1.5},
)  # fmt: skip
"""What is hidden in the logs, strength by kind."""
PATIENCE = 600.0
ROOT = "document.querySelector('.workbench')"
JUDGED = f"return {ROOT}.dataset.judged && {ROOT}.dataset.progress === '' && thermocorr.bench.state.charts.length"
SHOWN = ("history", "judged", "model")
"""What is compared of the state of a screen."""


class Quiet(SimpleHTTPRequestHandler):
    """Files, without a line for each."""

    extensions_map = {**SimpleHTTPRequestHandler.extensions_map, ".mjs": "text/javascript", ".wasm": "application/wasm"}

    def log_message(self, *_: Any) -> None:
        """Say nothing."""


def logs(folder: Path, count: int, rows: int) -> Iterator[Path]:
    """Files of simulated devices, as users would write them."""
    for number in range(count):
        effects = HIDDEN[number % len(HIDDEN)]
        try:
            record = make_record(rows, effects=effects, seed=500 + number)
        except ValueError:  # a kind that is not simulated
            record = make_record(rows, seed=500 + number)
        path = folder / f"log{number}.csv"
        record.to_csv(path, sep=";" if number % 2 else ",", decimal="," if number % 2 else ".")
        yield path


def native(path: Path, folder: str) -> tuple[dict[str, Any], dict[str, Any], float]:
    """State of the screen and model file, and the processor time that they took [s]."""
    said: list[dict[str, Any]] = []
    before = time.process_time()
    desk = Desk(None, said.append, Store(folder))
    desk.hear({"what": "open", "number": 1, "given": {"path": str(path)}})
    spent = time.process_time() - before
    desk.hear({"what": "take", "number": 2, "given": {"kind": "model"}})
    state = [one["content"] for one in said if one["kind"] == "state"][-1]
    content = next(one["content"]["content"] for one in said if one["kind"] == "done" and one["number"] == 2)
    return state, json.loads(base64.b64decode(content)), spent


def differs(one: Any, other: Any, where: str = "") -> Iterator[tuple[float, str]]:
    """Relative differences of two values of JSON, and where they stand."""
    if isinstance(one, dict) and isinstance(other, dict) and one.keys() == other.keys():
        for key in one:
            yield from differs(one[key], other[key], f"{where}.{key}")
    elif isinstance(one, list) and isinstance(other, list) and len(one) == len(other):
        sizes = [abs(v) for v in one if isinstance(v, float)]
        for place, (a, b) in enumerate(zip(one, other, strict=True)):
            if isinstance(a, float) and isinstance(b, float):  # numbers of one row: against the largest of them
                yield (abs(a - b) / max(*sizes, 1e-300), f"{where}[{place}]")
            else:
                yield from differs(a, b, f"{where}[{place}]")
    elif isinstance(one, float | int) and isinstance(other, float | int) and not isinstance(one, bool):
        yield (abs(one - other) / max(abs(one), 1e-300) if one != other else 0.0, where)
    elif one != other:
        yield (np.inf, f"{where}: {str(one)[:60]} / {str(other)[:60]}")


def as_compared(node: dict[str, Any]) -> dict[str, Any]:
    """The model of a file; of its covariance, which stands there as one of many square roots, the whole."""
    model: dict[str, Any] = node["model"]
    errors = model["errors"]
    for name in ("half", "last"):
        kept = errors.get(name) if errors else None
        if isinstance(kept, dict) and len(kept["shape"]) == 2:
            root = np.reshape(kept["$array"], kept["shape"])
            errors[name] = (root @ root.T).ravel().tolist()
    return model


def of_browser(driver: Any) -> float:
    """Processor time of the browser's processes so far [s]."""
    parents, spent = {}, {}
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                fields = (entry / "stat").read_text().rsplit(")", 1)[1].split()
            except OSError:
                continue
            parents[int(entry.name)] = int(fields[1])
            spent[int(entry.name)] = int(fields[11]) + int(fields[12])
    family = {driver.service.process.pid}
    while grown := {pid for pid, parent in parents.items() if parent in family} - family:
        family |= grown
    return sum(spent.get(pid, 0) for pid in family) / os.sysconf("SC_CLK_TCK")


def until(true: Callable[[], Any], what: str) -> Any:
    """Wait until something is true."""
    end = time.monotonic() + PATIENCE
    while time.monotonic() < end:
        found = true()
        if found:
            return found
        time.sleep(0.1)
    raise TimeoutError(what)


def main() -> None:
    """Compare, log by log."""
    from selenium import webdriver

    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("pyodide", type=Path)
    parser.add_argument("--rows", type=int, default=6000)
    parser.add_argument("--logs", type=int, default=10)
    options = parser.parse_args()
    folder = Path(tempfile.mkdtemp())
    write_static(folder / "site", options.pyodide)
    server = ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(Quiet, directory=str(folder / "site")))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    chrome = webdriver.ChromeOptions()
    for argument in ("--headless=new", "--no-sandbox", "--disable-gpu"):
        chrome.add_argument(argument)
    chrome.set_capability("goog:loggingPrefs", {"performance": "ALL"})
    driver = webdriver.Chrome(options=chrome)
    origin = f"http://127.0.0.1:{server.server_address[1]}"
    hosts: set[str] = set()
    print("log  start [s]  browser [s]  native [s]  figures  model.json  verdict")
    try:
        driver.get("about:blank")
        for path in logs(folder, options.logs, options.rows):
            driver.get(f"{origin}/index.html")
            began = of_browser(driver)
            until(lambda: driver.execute_script(f"return {ROOT}.dataset.progress === ''"), "the start")
            started = of_browser(driver)
            driver.find_element("css selector", "[data-part=open]").send_keys(str(path))
            until(lambda: driver.execute_script(JUDGED), "the answer")
            spent = of_browser(driver) - started
            state = driver.execute_script("return thermocorr.bench.state")
            content = driver.execute_async_script(
                "const done = arguments[arguments.length - 1];"
                "thermocorr.bench.wire.asked('take', { kind: 'model' }).then((found) => done(found.content));"
            )
            here, model, seconds = native(path, tempfile.mkdtemp())
            found = {key: max(differs(a, b)) for key, a, b in (
                ("figures", [here[k] for k in SHOWN], [state[k] for k in SHOWN]),
                ("model", as_compared(model), as_compared(json.loads(base64.b64decode(content)))),
            )}  # fmt: skip
            print(
                f"{path.stem}  {started - began:8.1f}  {spent:10.1f}  {seconds:9.1f}  {found['figures'][0]:8.1e}  "
                f"{found['model'][0]:9.1e}  {here['judged']['verdict']} / {state['judged']['verdict']}",
                *(found[key][1] for key in found if found[key][0] > 1e-9),
                flush=True,
            )
            messages = [json.loads(entry["message"])["message"] for entry in driver.get_log("performance")]
            asked = [m["params"]["request"]["url"] for m in messages if m["method"] == "Network.requestWillBeSent"]
            hosts |= {url.split("/")[2] for url in asked if url.startswith("http")}
    finally:
        driver.quit()
        server.shutdown()
    print("requests went to:", ", ".join(sorted(hosts)))


if __name__ == "__main__":
    main()

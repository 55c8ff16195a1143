"""The workbench that computes in the browser: its files, what it may do, and that it comes to the native answer."""

import functools
import io
import json
import os
import threading
import time
import zipfile
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest
from browser import chromium, complaints, requests

from thermocorr import RecordError
from thermocorr.command.cli import main
from thermocorr.datasets import make_record
from thermocorr.workbench.screen.desk import Desk
from thermocorr.workbench.screen.static_page import CORE, LOCK, NEEDED, POLICY, PROGRAMS, packages, page, write_static

PYODIDE = os.environ.get("THERMOCORR_PYODIDE")
"""Folder of a Pyodide distribution."""


def distribution(folder):
    """A folder that looks like one."""
    folder.mkdir()
    needs = {"scikit-learn": ["joblib", "scipy"], "scipy": ["numpy"], "pandas": ["numpy", "python-dateutil"]}
    known = (*NEEDED, "joblib", "python-dateutil", "astropy")
    listed = {name: {"file_name": f"{name}.whl", "depends": needs.get(name, [])} for name in known}
    for name in (*CORE, PROGRAMS[0], *(package["file_name"] for package in listed.values())):
        (folder / name).write_bytes(b"x")
    (folder / LOCK).write_text(json.dumps({"info": {}, "packages": listed}))
    return folder


def test_the_folder_has_all_that_the_page_needs_and_no_more(tmp_path, capsys):
    pyodide = distribution(tmp_path / "pyodide")
    site = tmp_path / "site"
    assert main(["workbench", "--static", str(site), "--pyodide", str(pyodide)]) == 0
    assert "python -m http.server" in capsys.readouterr().out
    files = {path.relative_to(site).as_posix() for path in site.rglob("*") if path.is_file()}
    assert {"index.html", "desk_worker.mjs", "packages.zip", "pyodide/pyodide.mjs", "pyodide/joblib.whl"} <= files
    assert "pyodide/astropy.whl" not in files
    assert set(json.loads((site / "pyodide" / LOCK).read_text())["packages"]) == {*NEEDED, "joblib", "python-dateutil"}
    text = (site / "index.html").read_text()
    assert POLICY in text.replace("&#39;", "'") and "http" not in POLICY
    for name in [part.split('"')[0] for part in text.split('src="')[1:]]:
        assert name in files
    assert main(["workbench", "--static", str(site), "--pyodide", str(pyodide), "--force"]) == 0
    assert main(["workbench", "--static", str(site), "--pyodide", str(pyodide)]) == 2


def test_what_is_no_distribution_is_refused(tmp_path, capsys):
    with pytest.raises(RecordError, match="no distribution of Pyodide"):
        write_static(tmp_path / "site", tmp_path)
    pyodide = distribution(tmp_path / "pyodide")
    (pyodide / "scipy.whl").unlink()
    with pytest.raises(RecordError, match=r"has no scipy\.whl: it is not a full distribution"):
        write_static(tmp_path / "site", pyodide)
    assert not (tmp_path / "site").exists()
    assert main(["workbench", "--static", str(tmp_path / "site")]) == 2
    assert "--pyodide" in capsys.readouterr().err


def test_the_packages_are_python_alone():
    with zipfile.ZipFile(io.BytesIO(packages())) as packed:
        names = packed.namelist()
    assert {"thermocorr/__init__.py", "jinja2/__init__.py", "markupsafe/__init__.py"} <= set(names)
    assert not [name for name in names if name.endswith((".so", ".pyc", ".pyd"))]
    assert "nothing leaves this machine" in page()


def test_a_desk_opens_logs_does_and_answers_in_between(tmp_path):
    said = []
    desk = Desk(None, said.append, chores=False)
    desk.hear({"what": "do", "number": 1, "given": {"do": "undo"}})
    assert "No log is open yet" in said[-1]["problem"]
    path = tmp_path / "log.csv"
    make_record(1500, effects={"lagged_covariate": 2.0}, seed=1).to_csv(path)
    desk.hear({"what": "open", "number": 2, "given": {"path": str(path)}})
    past = next(one["content"]["past"] for one in said if one.get("number") == 2)
    assert [one["content"]["judged"] for one in said if one["kind"] == "state"] == [None]
    while desk.chore():
        pass
    states = [one["content"] for one in said if one["kind"] == "state"]
    assert states[-1]["judged"]["suspects"] and said[-1] == {"kind": "progress", "content": {"text": ""}}
    desk.hear({"what": "do", "number": 3, "given": {"do": "add", "place": 0}})
    done = next(one["content"]["past"] for one in said if one.get("number") == 3)
    again = Desk(None, said.append, chores=False)
    again.hear({"what": "open", "number": 4, "given": {"path": str(path), "past": done}})
    assert len(again.story.acts) == 2 and again.story.key() == desk.story.key()
    assert past != done


class Files(SimpleHTTPRequestHandler):
    extensions_map = {**SimpleHTTPRequestHandler.extensions_map, ".mjs": "text/javascript", ".wasm": "application/wasm"}

    def log_message(self, *_):
        pass


@pytest.mark.newest
def test_the_page_comes_to_the_native_answer_and_asks_nobody_else(tmp_path):
    if PYODIDE is None:
        pytest.skip("The page is tested with a Pyodide distribution: THERMOCORR_PYODIDE=FOLDER")
    site = write_static(tmp_path / "site", PYODIDE).parent
    path = tmp_path / "log.csv"
    make_record(1500, effects={"lagged_covariate": 2.0}, seed=1).to_csv(path)
    said = []
    desk = Desk(None, said.append)
    desk.hear({"what": "open", "number": 1, "given": {"path": str(path)}})
    native = [one["content"] for one in said if one["kind"] == "state"][-1]
    root = "document.querySelector('.workbench')"
    with (
        ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(Files, directory=str(site))) as server,
        chromium() as browser,
    ):
        threading.Thread(target=server.serve_forever, daemon=True).start()
        browser.get(f"http://127.0.0.1:{server.server_address[1]}/")
        browser.find_element("css selector", "[data-part=open]").send_keys(str(Path(path)))
        end = time.monotonic() + 240
        while time.monotonic() < end and not browser.execute_script(
            f"return {root}.dataset.judged && {root}.dataset.progress === ''"
        ):
            time.sleep(0.5)
        state = browser.execute_script("return thermocorr.bench.state")
        asked = [url for url in requests(browser) if url.startswith("http")]
        said = [text for text in complaints(browser) if "pyodide.asm" not in text]
        server.shutdown()
    assert said == []
    assert {url.split("/")[2] for url in asked} == {f"127.0.0.1:{server.server_address[1]}"}
    assert state["judged"]["verdict"] == native["judged"]["verdict"]
    labels = [[one["label"] for one in shown["judged"]["suspects"][:2]] for shown in (state, native)]
    assert labels[0] == labels[1]
    for name in ("rms", "held_out", "later"):
        assert state["history"][0][name]["value"] == pytest.approx(native["history"][0][name]["value"], rel=1e-6)

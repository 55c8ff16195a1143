"""`workbench(model, X, y)`: the screen in a notebook, its messages, and what it falls back to."""

import base64
import json
import sys
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import numpy as np
import pandas as pd
import pytest
from browser import complaints, resize
from visitors import until

from thermocorr import DynamicBiasRegressor, Thermometer, workbench
from thermocorr.datasets import make_record
from thermocorr.effects import Covariate
from thermocorr.judgement import Diagnosis
from thermocorr.workbench import Story
from thermocorr.workbench.screen import page_assets
from thermocorr.workbench.screen.desk import Desk

pytestmark = pytest.mark.filterwarnings("ignore::thermocorr.RecordWarning")


@pytest.fixture(scope="module")
def data():
    record = make_record(3000, effects={"covariate": 2.0}, seed=3)
    return record.drop(columns="reading"), record["reading"]


@pytest.fixture
def desk(data):
    said = []
    made = Desk(Story.of(DynamicBiasRegressor("temperature", 4), *data), said.append)
    made.said = said
    made.hear({"what": "ready", "number": 1})
    return made


def answer(desk, number):
    return next(m for m in desk.said if m.get("number") == number)


def last_state(desk):
    return [m["content"] for m in desk.said if m["kind"] == "state"][-1]


def test_the_screen_is_told_what_it_shows_and_acts_change_it(desk, data):
    assert json.dumps(desk.said, allow_nan=False)
    state = last_state(desk)
    assert state["judged"]["verdict"] in ("missing", "ambiguous")
    desk.hear({"what": "do", "number": 2, "given": {"do": "add", "place": 0}})
    assert answer(desk, 2)["kind"] == "done"
    assert last_state(desk)["history"][1]["db"]["value"] < -3
    model = desk.story.fit().model
    wanted = DynamicBiasRegressor("temperature", 4, effects=[Covariate("supply")]).fit(*data)
    np.testing.assert_array_equal(model.coef_, wanted.coef_)


def test_what_cannot_be_done_is_said(desk):
    for number, message in enumerate(
        (
            {"what": "do", "given": {"do": "add", "place": 99}},
            {"what": "do", "given": {}},
            {"what": "picture", "given": {"name": "x"}},
            {"what": "take", "given": {"kind": "gold"}},
            {"what": "dance"},
            {},
        ),
        10,
    ):
        desk.hear({**message, "number": number})
        assert answer(desk, number)["kind"] == "failed" and len(answer(desk, number)["problem"]) > 10


def test_the_script_repeats_the_model_with_settings_that_the_screen_does_not_show(data):
    X, y = data
    thermometer = Thermometer("temperature", noise=0.01)
    given = DynamicBiasRegressor(thermometer, [120.0, 1500.0], alpha=0.1, effects=[Covariate("mains")])
    desk = Desk(Story.of(given, X, y), lambda message: None)
    desk.story.start()
    said = []
    desk.tell = said.append
    desk.hear({"what": "take", "number": 1, "given": {"kind": "script"}})
    script = base64.b64decode(said[-1]["content"]["content"]).decode()
    space = {"X": X, "y": y}
    exec(script.split("# What is missing")[0], space)
    np.testing.assert_array_equal(space["model"].coef_, given.fit(X, y).coef_)
    assert space["model"].alpha == 0.1


def test_columns_need_not_have_names_of_text(data):
    X, y = data
    frame = pd.DataFrame(X.to_numpy(), index=X.index)
    story = Story.of(DynamicBiasRegressor(0, 3), frame, y.to_numpy())
    story.start()
    assert story.problem == "" and story.roles["reading"] == "reading"
    with pytest.raises(TypeError, match="DataFrame"):
        Story.of(DynamicBiasRegressor(0, 3), X.to_numpy(), y)


def test_without_anywidget_the_diagnosis_is_returned(data, monkeypatch):
    monkeypatch.setitem(sys.modules, "anywidget", None)
    found = workbench(DynamicBiasRegressor("temperature", 4), *data)
    assert isinstance(found, Diagnosis) and found.best is not None


def test_the_widget_has_everything_in_it(data):
    pytest.importorskip("anywidget", reason="the widget needs anywidget: pip install '.[jupyter]'")
    widget = workbench(DynamicBiasRegressor("temperature", 4), *data)
    assert 'data-part="plot"' in widget.body and 'data-part="open"' not in widget.body
    assert "cancel" not in widget.body  # what does nothing there is not there
    assert "export default" in widget._esm and "http" not in widget._esm
    assert ":root" not in widget._css and "body" not in widget._css.replace("tbody", "")
    assert widget.model.time_constants_.shape == (4,)


PAGE = """<!DOCTYPE html><meta charset="utf-8"><link rel="icon" href="data:,"><style>%s</style><div id="cell"></div>
<script type="module">
import widget from "/widget.js";
const heard = [];
const model = {
  get: () => %s,
  on: (kind, run) => heard.push(run),
  send: async (message) => {
    const answer = await fetch("/", { method: "POST", body: JSON.stringify(message) });
    for (const said of await answer.json()) heard.forEach((run) => run(said));
  },
};
widget.render({ model, el: document.getElementById("cell") });
</script>"""


def test_the_widget_draws_and_acts_in_a_browser(browser, desk):
    alone = threading.Lock()

    class Kernel(BaseHTTPRequestHandler):
        def do_GET(self):
            script = self.path == "/widget.js"
            page = PAGE % (page_assets.style(), json.dumps(page_assets.body()))
            self.reply(page_assets.module() if script else page, "text/javascript" if script else "text/html")

        def do_POST(self):
            with alone:  # a kernel answers one message after the other
                desk.said.clear()
                desk.hear(json.loads(self.rfile.read(int(self.headers["Content-Length"]))))
                self.reply(json.dumps(desk.said, allow_nan=False), "application/json")

        def reply(self, text, kind):
            self.send_response(200)
            self.send_header("Content-Type", kind)
            self.end_headers()
            self.wfile.write(text.encode())

        def log_message(self, *_):
            pass

    with ThreadingHTTPServer(("127.0.0.1", 0), Kernel) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        complaints(browser)
        resize(browser, 1000, 900)
        browser.get(f"http://127.0.0.1:{server.server_address[1]}/")
        until(lambda: browser.execute_script("return document.querySelector('[data-part=plot]')?.dataset.drawn"))
        until(lambda: browser.execute_script("return document.querySelector('[data-at=\"add 0 \"]') !== null"))
        browser.find_element("css selector", "[data-at='add 0 ']").click()
        until(lambda: browser.execute_script("return document.querySelectorAll('ol.steps .error data').length >= 2"))
        assert browser.execute_script("return document.documentElement.scrollWidth") <= 1000
        assert complaints(browser) == []
        browser.get("about:blank")
        server.shutdown()

"""The report: its order, its numbers, its pictures, its safety against names, and how it looks in a browser."""

import re
import time
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pandas as pd
import pytest
from browser import complaints, numbers, opened, prefer, requests

from thermocorr import DynamicBiasRegressor, compare_variants, diagnose, refine
from thermocorr.command.cli import main
from thermocorr.datasets import make_record
from thermocorr.displays import ErrorsDisplay, ResidualsDisplay, SuspectsDisplay
from thermocorr.model.tables import VERDICTS
from thermocorr.output.answer import Answer
from thermocorr.output.report import report_text, write_report


@pytest.fixture(scope="module")
def gappy():
    """A record with runs, gaps and a hidden hysteresis; model; diagnosis."""
    record = make_record(1200, effects={"hysteresis": 3.0}, gaps=2, runs=3, seed=4)
    X, y = record.drop(columns="reading"), record["reading"]
    model = DynamicBiasRegressor("temperature", ["5 min", "1 h"], run="run", max_gap="10 min").fit(X, y)
    return X, y, model, diagnose(model, X, y)


HOSTILE = {
    "temperature": "</script><script>window.pwned=1</script>",
    "reading": '"><img src=x onerror="window.pwned=2">',
    "humidity": "<!--<script>window.pwned=3//",
    "pressure": "a & b < c 'd' \u2028 `${window.pwned=4}` $x^2$",
}


@pytest.fixture(scope="module")
def hostile():
    """A diagnosis of a record whose names are attacks."""
    record = make_record(1500, effects=[("covariate", 3.0, {"column": "humidity"})], seed=2)
    record = record.rename(columns=HOSTILE)
    record.attrs["units"] = {HOSTILE["reading"]: "<b onclick=window.pwned=5>V</b>"}
    X, y = record.drop(columns=HOSTILE["reading"]), record[HOSTILE["reading"]]
    y.attrs = dict(record.attrs)
    model = DynamicBiasRegressor(HOSTILE["temperature"], ["5 min", "1 h"]).fit(X, y)
    return diagnose(model, X, y)


@pytest.fixture(scope="module")
def gappy_page(gappy, tmp_path_factory):
    path = tmp_path_factory.mktemp("page") / "diagnosis.html"
    gappy[3].save_html(path, source="log.csv", command="thermocorr analyze log.csv")
    return path


# ---- the whole page as text


class Tags(HTMLParser):
    """Elements and their attributes."""

    def __init__(self, page):
        super().__init__()
        self.tags, self.attributes = [], []
        self.feed(page)

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.attributes += attrs


def test_the_page_is_one_file_without_network_or_script_and_names_are_no_markup(hostile):
    html = hostile.to_html(source="<script>.csv", command="thermocorr analyze '<script>'")
    found = Tags(html)
    assert {"script", "img", "link", "iframe", "object"}.isdisjoint(found.tags)
    assert not [name for name, _ in found.attributes if name.startswith("on") or name == "src"]
    assert all(value.startswith("#") for name, value in found.attributes if name in ("href", "xlink:href"))
    assert "default-src 'none'" in html.replace("&#39;", "'") and "script-src" not in html
    assert len(html.encode()) < 1.5e6


def test_pictures_are_those_of_the_displays(gappy):
    X, y, model, found = gappy
    html = found.to_html()
    assert SuspectsDisplay.from_diagnosis(found).to_svg() in html
    shown = {"uncertainty": True, "columns": ["temperature"]}
    assert ResidualsDisplay.from_estimator(model, X, y, found, **shown).to_svg() in html


def test_short_forms_need_no_script_and_names_are_no_markup(hostile, gappy):
    for html in (hostile._repr_html_(), gappy[3]._repr_html_()):
        assert {"script", "img", "b", "link"}.isdisjoint(Tags(html).tags)
    assert "hysteresis" in gappy[3]._repr_html_()
    assert "DynamicBiasRegressor" in gappy[2]._repr_html_()  # scikit-learn's own diagram


@pytest.mark.parametrize("verdict", VERDICTS)
def test_every_verdict_has_its_page(gappy, verdict):
    named = gappy[3].n_causes if verdict in ("missing", "ambiguous") else 0
    html = replace(gappy[3], verdict=verdict, n_causes=named).to_html()
    assert f'data-verdict="{verdict}"' in html
    assert ("with_effect" in html) == (named > 0)
    assert ("It fails most" in html) == (verdict != "nothing missing")
    assert replace(gappy[3], verdict=verdict, n_causes=named)._repr_html_()


def test_a_record_of_many_segments_does_not_swell_the_page():
    record = make_record(6000, runs=150, seed=4)
    X, y = record.drop(columns="reading"), record["reading"]
    model = DynamicBiasRegressor("temperature", ["5 min", "1 h"], run="run").fit(X, y)
    html = report_text(model, X, y, Answer(unjudged="Not judged: the test is about the page."))
    assert "coefficients, the first 200 of them" in html and "150 stretches, the first 20" in html
    assert len(html) < 1.5e6


def test_a_diagnosis_without_its_record_says_so(gappy):
    bare = replace(gappy[3], record=None)
    with pytest.raises(ValueError, match="holds no record"):
        bare.to_html()
    assert "hysteresis" in bare._repr_html_()


def test_without_matplotlib_the_page_says_what_pictures_need(gappy, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "matplotlib", None)
    monkeypatch.setitem(__import__("sys").modules, "matplotlib.pyplot", None)
    html = gappy[3].to_html()
    assert "<svg" not in html and "pip install matplotlib" in html and 'data-verdict="' in html


# ---- in the browser


def test_sections_stand_in_the_order_of_the_questions_and_nothing_is_asked_for(browser, gappy_page):
    opened(browser, gappy_page)
    heads = browser.execute_script("return [...document.querySelectorAll('h2')].map(h => h.textContent)")
    assert heads == [
        "Does the model follow the measurements?", "Where does it fail?", "What is missing?", "What to do?",
        "The model", "More",
    ]  # fmt: skip
    assert complaints(browser) == []
    assert [url for url in requests(browser) if not url.startswith(("data:", "blob:"))] == [gappy_page.as_uri()]


def test_tables_hold_the_numbers_of_the_frames(browser, gappy, gappy_page):
    diagnosis = gappy[3]
    opened(browser, gappy_page)
    where = diagnosis.where[["share", "lift", "rms"]].to_numpy()
    np.testing.assert_array_equal(numbers(browser, ".places"), where)
    ranking = diagnosis.ranking[["share", "later_db", "gain_db", "p_value"]].to_numpy()
    np.testing.assert_array_equal(numbers(browser, ".suspects"), ranking)
    coefficients = gappy[2].coef_table()[["coefficient", "standard_error"]].to_numpy()
    np.testing.assert_array_equal(numbers(browser, ".coefficients"), coefficients)


@pytest.mark.parametrize("size", [(1280, 800), (390, 844)])
def test_measured_against_model_stands_in_the_first_screen_and_nothing_sticks_out(browser, tmp_path, size):
    record = make_record(3000, effects={"covariate": 2.0}, seed=3)
    X, y = record.drop(columns="reading"), record["reading"]
    model = DynamicBiasRegressor("temperature", ["5 min", "1 h"]).fit(X, y)
    comparison = compare_variants(X, y, model=model, n_blocks=2)
    path = write_report(
        tmp_path / "page.html", model, X, y, diagnosis=diagnose(model, X, y), comparison=comparison, command="x"
    )
    opened(browser, path, width=size[0])
    top, height = browser.execute_script(
        "const box = document.querySelector('#follows .picture').getBoundingClientRect(); return [box.top, box.height]"
    )
    assert top + 0.4 * height < size[1]  # the first panel
    browser.execute_script("document.querySelectorAll('details').forEach(d => { d.open = true; })")
    assert browser.execute_script("return document.documentElement.scrollWidth") == size[0]
    assert browser.execute_script("return visualViewport.scale") == 1


def luminance(colour):
    return np.mean([int(part) for part in re.findall(r"\d+", colour)[:3]])


def test_dark_and_light_colours_change_with_the_preference(browser, gappy_page):
    ask = (
        "const s = getComputedStyle(document.body), t = document.querySelector('.picture text');"
        "return [s.backgroundColor, s.color, getComputedStyle(t).fill]"
    )
    for scheme, dark in (("light", False), ("dark", True)):
        opened(browser, gappy_page, scheme=scheme)
        ground, words, drawn = map(luminance, browser.execute_script(ask))
        assert (ground < 40) == (words > 200) == (drawn > 200) == dark
    prefer(browser, "light")  # and without a reload
    time.sleep(0.2)
    assert luminance(browser.execute_script(ask)[2]) < 60


def test_hostile_names_are_shown_and_do_nothing(browser, hostile, tmp_path):
    path = tmp_path / "a&b' <script>window.pwned=6<sc>.html"
    hostile.save_html(path, source=path.name, command=f"thermocorr analyze '{path.name}'")
    opened(browser, path)
    assert browser.execute_script("return window.pwned") is None
    assert complaints(browser) == []
    texts = browser.execute_script("return [...document.querySelectorAll('.picture text')].map(e => e.textContent)")
    assert any(HOSTILE["temperature"] in text for text in texts)
    assert path.name in browser.execute_script("return document.getElementById('versions').textContent")
    assert "<b onclick" in browser.execute_script("return document.getElementById('what').textContent")


# ---- refinements, long records, runs, the command


def test_a_page_says_which_thermometer_has_which_lags():
    record = make_record(2000, seed=9)[["temperature", "reading"]].rename(columns={"temperature": "case"})
    record["room"] = make_record(2000, seed=10)["temperature"].to_numpy()
    X, y = record.drop(columns="reading"), record["reading"]
    model = DynamicBiasRegressor(["case", "room"], {"case": ["5 min"], "room": ["90 min", "5 h"]}).fit(X, y)
    text = " ".join(report_text(model, X, y, Answer()).split())
    assert "The lags of case have the time constants 5 min. The lags of room have" in text


def test_a_refinement_opens_on_its_last_model(browser, tmp_path):
    record = make_record(1500, effects=[("covariate", 4.0, {"column": "humidity"})], seed=2)
    X, y = record.drop(columns="reading"), record["reading"]
    refinement = refine(DynamicBiasRegressor("temperature", ["5 min", "1 h"]), X, y, max_steps=1)
    assert len(refinement.steps) > 1
    refinement.save_html(tmp_path / "refinement.html")
    last = refinement.diagnoses[-1]
    html = (tmp_path / "refinement.html").read_text(encoding="utf-8")
    assert f'data-verdict="{last.verdict}"' in html and html.count("data-verdict=") == 1
    assert ErrorsDisplay.from_refinement(refinement).to_svg() in html.split("</figure>")[0]
    opened(browser, tmp_path / "refinement.html")
    assert complaints(browser) == []
    expected = refinement.steps[["later_rms", "held_out_rms", "rms", "db", "low", "high"]].to_numpy()
    found = numbers(browser, ".steps")
    assert found[0] == expected[0, :3].tolist()
    assert found[1:] == expected[1:].tolist()
    assert "<script" not in refinement._repr_html_()


def test_a_long_record_has_a_small_page(tmp_path, voltage):
    X, y = voltage
    model = DynamicBiasRegressor("temperature", ["2 min", "1 h"]).fit(X, y)
    path = write_report(tmp_path / "long.html", model, X, y, unjudged="Not judged: the test is about the page.")
    assert path.stat().st_size < 1e6


def test_runs_that_overlap_in_time_stand_one_after_the_other():
    rng = np.random.default_rng(0)
    parts = [
        pd.DataFrame(
            {"s": np.arange(600) * 10.0 + start, "run": run, "temperature": 20 + np.cumsum(rng.normal(0, 0.1, 600))}
        )
        for run, start in (("a", 0.0), ("b", 5.0), ("c", 100_000.0))
    ]
    X = pd.concat(parts, ignore_index=True)
    model = DynamicBiasRegressor("temperature", ["5 min"], time="s", run="run").fit(X, 2 * X["temperature"])
    display = ResidualsDisplay.from_estimator(model, X, 2 * X["temperature"])
    assert not display.timeline.in_order and display.timeline.span < 2 * 1800 * 10  # the long pause is left out
    assert "runs one after the other" in report_text(model, X, 2 * X["temperature"], Answer())


def test_the_command_writes_the_report(tmp_path, capsys):
    record = make_record(1500, seed=5).reset_index()
    log = tmp_path / "a'b <i>.csv"
    record.to_csv(log, index=False)
    report = tmp_path / "sub" / "page.html"
    options = ["--reading", "reading", "--time-constants", "10min,2h"]
    assert main(["analyze", str(log), *options, "--report", str(report)]) == 0
    assert f"Written: page.html in {report.parent}" in capsys.readouterr().out.replace("\n  ", "")
    html = report.read_text(encoding="utf-8")
    assert "Static and dynamic" in html and "thermocorr analyze" in html and "<i>.csv" not in html
    tables = re.findall(r'<table class="variants">.*?</table>', html, re.S)
    assert len(tables) == 2
    for table in tables:  # each row has a cell for each heading
        assert len({len(re.findall("<t[hd]", row)) for row in re.findall(r"<tr.*?</tr>", table, re.S)}) == 1
    assert main(["analyze", str(log), *options, "--report", str(tmp_path)]) == 2  # a folder
    assert "cannot be written" in capsys.readouterr().err

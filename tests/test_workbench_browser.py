"""The workbench as a person sees it, in a headless Chromium: clicks, numbers, sizes, colours, the keyboard."""

import random
import time

import numpy as np
import pytest
from browser import complaints, prefer, requests, resize
from visitors import running, until

from thermocorr import DynamicBiasRegressor, diagnose
from thermocorr.datasets import load_voltage_reference, make_record

pytest.importorskip("starlette", reason="the workbench needs starlette: pip install '.[workbench]'")
pytest.importorskip("uvicorn", reason="the workbench needs uvicorn: pip install '.[workbench]'")

TAKEN = """
const finished = arguments[arguments.length - 1];
thermocorr.bench.wire.asked('take', { kind: arguments[0] }).then(({ content }) => finished(atob(content)));
"""


class Person:
    """Someone in front of the screen."""

    def __init__(self, driver, port, token):
        self.driver = driver
        complaints(driver), requests(driver)
        resize(driver, 1280, 800)
        driver.get(f"http://127.0.0.1:{port}/?token={token}")
        self.clicks = 0

    def js(self, code, *given):
        return self.driver.execute_script(f"return {code.strip()}", *given)

    def faults(self):
        """What the console says besides acts that were refused, and curves of a state that had just gone."""
        return [said for said in complaints(self.driver) if not ("/api/" in said and "Failed to load" in said)]

    def sees(self, code):
        """Wait until this is true on the page."""
        return until(lambda: self.js(code))

    def settled(self):
        """Wait until nothing more is found out, and the pictures show it."""
        root = "document.querySelector('.workbench').dataset"
        self.sees(f"{root}.judged && {root}.progress === '' && !{root}.busy")
        key = "thermocorr.bench.state.fitted.key"
        self.sees(f"document.querySelector('[data-part=plot]').dataset.key === {key}")
        return self.js("thermocorr.bench.state")

    def texts(self, part):
        """What is written in a picture."""
        return self.js(f"[...document.querySelectorAll('[data-part={part}] svg text')].map(t => t.textContent)")

    def click(self, selector):
        self.driver.find_element("css selector", selector).click()
        self.clicks += 1

    def number(self, selector):
        return self.js("Number(document.querySelector(arguments[0]).value)", selector)


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    """A longer log than that of the other tests: its curves come in pieces."""
    path = tmp_path_factory.mktemp("logs") / "log.csv"
    make_record(4000, effects={"covariate": 2.0}, seed=3).to_csv(path)
    return path


@pytest.fixture
def person(browser, log):
    with running(log) as (_, port, token):
        yield Person(browser, port, token)
        asked = [address for address in requests(browser) if not address.startswith(("data:", "about:", "blob:"))]
        assert all(address.startswith(f"http://127.0.0.1:{port}/") for address in asked)
        browser.get("about:blank")


@pytest.mark.long
def test_humidity_is_added_on_the_built_in_record_in_one_click_and_the_numbers_are_the_library_s(browser):
    with running() as (_, port, token):
        person = Person(browser, port, token)
        first = person.settled()
        card = first["judged"]["suspects"][0]
        until(lambda: {"no correction", "839 nV", "dynamic linear correction"} <= set(person.texts("bars")))
        person.click("[data-at='add 0 ']")
        person.sees("thermocorr.bench.state.history.length === 2")
        assert person.js("document.activeElement.dataset.at") == "verdict"  # the list that had the focus is gone
        last = person.settled()
        assert person.clicks <= 5
        assert last["errors"][-1]["error"]["value"] == pytest.approx(card["after"]["value"], rel=1e-9)
        causes = [suspect["label"] for suspect in last["judged"]["suspects"] if suspect["cause"]]
        assert "humidity" in last["history"][1]["text"] and causes == ["static polynomial"]  # the law is curved too
        record = load_voltage_reference(hidden="moisture")
        X, y = record.drop(columns="voltage"), record["voltage"]
        model = DynamicBiasRegressor("temperature", degree=1).fit(X, y)  # what is advised
        found = diagnose(model, X, y)
        better = model.with_effect(found.best).fit(X, y)
        for row, one in zip(last["history"], (model, better), strict=True):
            assert row["held_out"]["value"] == pytest.approx(diagnose(one, X, y).held_out_rms, rel=1e-12)
        script = browser.execute_async_script(TAKEN, "script")
        space = {}
        exec(script.split("# What is missing")[0], space)
        np.testing.assert_array_equal(space["model"].coef_, better.coef_)
        person.click("[data-at=undo]")
        person.sees("thermocorr.bench.state.history.length === 1")
        back = person.settled()
        assert {**back, "revision": 0, "can_redo": False} == {**first, "revision": 0}
        assert person.faults() == []
        browser.get("about:blank")


def test_a_suspect_under_the_pointer_is_previewed_on_the_residual(person):
    from selenium.webdriver import ActionChains

    first = person.settled()["judged"]["suspects"][0]
    button = person.driver.find_element("css selector", "[data-at='add 0 ']")
    ActionChains(person.driver).move_to_element(button).perform()
    person.sees("document.querySelector('.preview').textContent.includes('instead of')")
    until(lambda: "with covariate: supply" in person.texts("plot"))
    assert person.js("document.querySelector('.previewed data').value") == str(first["after"]["value"])
    until(lambda: any("with the suspect" in text for text in person.texts("bars")))
    before, after = (person.js(f"Number(document.querySelectorAll('.preview data')[{k}].value)") for k in (1, 0))
    assert after < 0.7 * before
    title = person.driver.find_element("css selector", "h1")
    ActionChains(person.driver).move_to_element(title).perform()
    until(lambda: "with covariate: supply" not in person.texts("plot"))
    assert person.faults() == []


@pytest.mark.long
def test_a_place_of_failure_leads_the_pictures_there(person):
    state = person.settled()
    places = state["fitted"]["where"]
    number, place = next((i, p) for i, p in enumerate(places) if "from_to" in p)
    person.js("document.querySelectorAll('details').forEach(d => { d.open = true })")
    person.js("document.querySelector(`[data-at='place ${arguments[0]}']`).click()", number)
    low, high = person.sees("thermocorr.bench.plot.range")
    assert low <= place["from_to"][0] < place["from_to"][1] <= high and high - low < 0.5 * state["fitted"]["span"]
    number, place = next((i, p) for i, p in enumerate(places) if "column" in p)
    person.js("document.querySelector(`[data-at='place ${arguments[0]}']`).click()", number)
    person.sees("document.querySelector('[data-part=views] .shown').dataset.shown?.startsWith('against')")
    assert person.js("[thermocorr.bench.views.column, thermocorr.bench.views.range]") == [
        place["column"], place["range"],
    ]  # fmt: skip


def test_a_stretch_is_zoomed_into_told_selected_and_left_out(person):
    from selenium.webdriver import ActionChains

    span = person.settled()["fitted"]["span"]
    plot = person.driver.find_element("css selector", "[data-part=plot]")
    left, right = person.js("[thermocorr.bench.plot.found.left, thermocorr.bench.plot.found.right]")
    width = plot.size["width"] * (right - left)
    middle = round(plot.size["width"] * ((left + right) / 2 - 0.5))

    def drag():
        chain = ActionChains(person.driver, duration=20).move_to_element_with_offset(plot, middle - width // 4, 0)
        chain.click_and_hold().move_by_offset(width // 8, 3).move_by_offset(width // 8, 3).release().perform()

    drag()
    low, high = person.sees("thermocorr.bench.plot.range")
    assert [low / span, high / span] == pytest.approx([0.25, 0.5], abs=0.02)
    ActionChains(person.driver).move_to_element(plot).perform()
    person.sees("document.querySelector('.readout').textContent.includes('measured')")
    assert person.js("document.querySelector('.readout').textContent").startswith("2024-")
    ActionChains(person.driver).double_click(plot).perform()
    person.sees("thermocorr.bench.plot.range === null")
    person.settled()
    person.click("[data-part=zoom] button[aria-pressed]")
    drag()
    low, high = person.sees("thermocorr.bench.plot.selected")
    person.click("[data-leave-out]")
    person.sees("thermocorr.bench.state.history.length === 2")
    state = person.settled()
    assert (high - low) / span == pytest.approx(0.25, abs=0.03)
    assert state["history"][1]["text"].startswith("+ leave out: 20")
    until(lambda: "left out" in person.texts("plot") and "before" in person.texts("plot"))
    person.click("[data-at='compare 1']")
    until(lambda: "after step 1" in person.texts("plot"))
    person.click("[data-at='compare 1']")
    until(lambda: "before" in person.texts("plot"))
    assert person.faults() == []


@pytest.mark.long
def test_two_windows_agree_and_a_reload_shows_the_same(person):
    person.settled()
    driver = person.driver
    here, address = driver.current_window_handle, driver.current_url
    driver.switch_to.new_window("tab")
    driver.get(address)
    person.settled()
    person.click("[data-at='add 0 ']")
    person.sees("thermocorr.bench.state.history.length === 2")
    second = person.settled()
    driver.close()
    driver.switch_to.window(here)
    person.sees("thermocorr.bench.state.history.length === 2")
    assert person.settled() == second
    driver.refresh()
    assert person.settled() == second


def test_the_keyboard_alone_is_enough_and_the_first_add_is_near(person):
    from selenium.webdriver import ActionChains
    from selenium.webdriver.common.keys import Keys

    person.settled()
    for _ in range(10):
        ActionChains(person.driver).send_keys(Keys.TAB).perform()
        if person.js("document.activeElement.dataset.at === 'add 0 '"):
            break
    else:
        raise AssertionError("the button is not reached")
    assert person.js("getComputedStyle(document.activeElement).outlineStyle") != "none"
    ActionChains(person.driver).send_keys(Keys.ENTER).perform()
    person.sees("thermocorr.bench.state.history.length === 2")
    person.settled()
    assert person.js("document.activeElement.dataset.at") == "verdict"
    ActionChains(person.driver).key_down(Keys.CONTROL).send_keys("z").key_up(Keys.CONTROL).perform()
    person.sees("thermocorr.bench.state.history.length === 1")
    person.click(".menu > summary")
    person.sees("document.querySelector('.menu').open")
    ActionChains(person.driver).send_keys(Keys.ESCAPE).perform()
    person.sees("!document.querySelector('.menu').open && document.activeElement.tagName === 'SUMMARY'")


SMALL = """
[...document.querySelectorAll('.workbench *')].filter((e) => e.checkVisibility() && e.clientWidth > 1
  && [...e.childNodes].some((n) => n.nodeType === 3 && n.textContent.trim())
  && parseFloat(getComputedStyle(e).fontSize) * (e.ownerSVGElement ? e.ownerSVGElement.getScreenCTM().a : 1) < 11.9)
  .map((e) => e.outerHTML.slice(0, 80))
"""
CUT = """
[...document.querySelectorAll('.workbench :is(button, select, h2, p, li, summary, label, td, th)')].filter((e) =>
  e.checkVisibility() && !e.closest('.unseen')
  && (e.scrollWidth > e.clientWidth + 2 && e.clientWidth > 0 && getComputedStyle(e).display !== 'inline'
  || e.getBoundingClientRect().right > innerWidth + 1)).map((e) => e.outerHTML.slice(0, 90))
"""
UNNAMED = """
[...document.querySelectorAll('.workbench :is(button, input, select)')].filter((e) => e.checkVisibility()
  && !(e.textContent.trim() || e.getAttribute('aria-label') || e.labels?.length)).map((e) => e.outerHTML)
"""


@pytest.mark.long
@pytest.mark.parametrize(
    ("width", "height", "scheme"), [(1280, 800, "light"), (1920, 1080, "dark"), (390, 844, "light")]
)
def test_nothing_is_cut_or_too_small_or_without_a_name(person, width, height, scheme):
    prefer(person.driver, scheme)
    resize(person.driver, width, height, mobile=width < 600)
    person.settled()
    person.js("document.querySelectorAll('details').forEach(d => { d.open = true })")
    time.sleep(0.3)
    assert person.js("document.documentElement.scrollWidth") <= width
    assert person.js(SMALL) == []
    assert person.js(CUT) == []
    assert person.js(UNNAMED) == []
    ground = person.js("getComputedStyle(document.querySelector('.workbench')).backgroundColor")
    assert (max(map(int, ground[4:-1].split(","))) < 60) == (scheme == "dark")
    assert person.faults() == []
    prefer(person.driver, "light")


@pytest.mark.long
def test_clicking_about_does_no_harm(person):
    person.settled()
    wild(person, random.Random(1), 60)
    assert person.faults() == []


CLICKED = """
(() => {
  const all = [...document.querySelectorAll('.workbench :is(button, summary)')];
  const can = all.filter((e) => e.checkVisibility() && !e.disabled && !e.dataset.take);
  can[Math.floor(arguments[0] * can.length)].click();
})()
"""
CHOSEN = """
(() => {
  const listed = [...document.querySelectorAll('.workbench select')];
  const all = listed.filter((e) => e.checkVisibility());
  const one = all[Math.floor(arguments[0] * all.length)];
  one.selectedIndex = Math.floor(arguments[1] * one.options.length);
  one.dispatchEvent(new Event('change'));
})()
"""
ZOOMED = """
(() => {
  const { found, fitted } = thermocorr.bench.plot;
  if (!found) return;
  thermocorr.bench.plot.zoom([arguments[0] * fitted.span, (arguments[0] + arguments[1]) * fitted.span]);
})()
"""


def wild(person, chance, actions):
    """Click and choose at random; what is shown must stay what its history says."""
    for _ in range(actions):
        act = chance.choices((CLICKED, CHOSEN, ZOOMED), (8, 1, 1))[0]
        person.js(act, chance.random(), chance.random())
        time.sleep(chance.random() * 0.1)
    consistent(person)


def consistent(person):
    """The state on the page is the program's, and its history leads to it."""
    root = "document.querySelector('.workbench').dataset"
    until(lambda: person.js(f"{root}.progress === '' && !{root}.busy"), 120)
    state = person.js("thermocorr.bench.state")
    assert state["trouble"] == ""
    steps = person.js("document.querySelectorAll('ol.steps > li').length")
    assert steps == len(state["history"])
    if state["fitted"]:
        assert state["errors"][-1]["step"] == state["history"][-1]["text"]


IN_VIEW = """
(() => { const box = document.querySelector('[data-part=plot]').getBoundingClientRect();
  return box.top >= -1 && box.top < innerHeight / 2 && box.bottom > box.top + 150; })()
"""


@pytest.mark.parametrize("size", [(1280, 800), (390, 844)])
def test_the_plot_stays_in_view_while_a_suspect_is_previewed_and_added(person, size):
    resize(person.driver, *size)
    person.settled()
    person.js("document.querySelectorAll('details').forEach(d => { d.open = true })")
    for last in (True, False):  # the farthest suspect, then the first
        person.js(
            "[...document.querySelectorAll('.suspects button')].at(arguments[0]).scrollIntoView({block: 'end'})", -last
        )
        person.js(
            "[...document.querySelectorAll('.suspects button')].at(arguments[0]).focus({preventScroll: true})", -last
        )
        person.sees("document.querySelector('.preview:not(:empty)')")
        assert person.js(IN_VIEW)
    person.js("document.querySelector(\"[data-at='add 0 ']\").click()")
    person.sees("thermocorr.bench.state.history.length === 2")
    person.settled()
    assert person.js(IN_VIEW)
    assert person.faults() == []


def test_roles_that_are_refused_stay_and_the_log_is_drawn_before_there_are_any(browser, tmp_path):
    record = make_record(1000, seed=3).rename(columns={"reading": "alpha [mV]", "humidity": "humidity [%]"})
    record.to_csv(tmp_path / "log.csv")
    with running(tmp_path / "log.csv") as (_, port, token):
        person = Person(browser, port, token)
        person.sees("document.querySelectorAll('.raw path').length === 6")
        assert person.js("document.querySelector('[data-part=alert]').hidden")  # a question is no fault
        asked = person.js("[...document.querySelectorAll('.question button')].map(b => b.textContent)")
        assert "alpha [mV]" in asked and "humidity [%]" in asked
        person.js("document.querySelectorAll('details').forEach(d => { d.open = true })")
        role = "document.querySelector(\"[data-at='role humidity [%]']\")"
        person.js(f"{role}.value = 'temperature'")
        person.click("[data-at=columns]")
        person.sees("document.querySelector('[data-at=refused]').textContent.startsWith('Several columns')")
        assert person.js(f"{role}.value") == "temperature"
        person.click("[data-at='ask reading alpha [mV]']")
        person.settled()
        assert person.faults() == []
        browser.get("about:blank")

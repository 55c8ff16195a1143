"""A headless Chromium for tests of pages, skipped where there is none; what a page shows in it."""

import json
import shutil
from contextlib import contextmanager

import pytest


@contextmanager
def chromium():
    """A selenium driver of Debian's chromium and chromium-driver; no other browser is looked for, none downloaded."""
    webdriver = pytest.importorskip("selenium.webdriver", reason="pages are tested with selenium: pip install selenium")
    browser = shutil.which("chromium") or shutil.which("google-chrome")
    driver = shutil.which("chromedriver")
    if browser is None or driver is None:
        pytest.skip("pages are tested in a headless Chromium: apt-get install chromium chromium-driver")
    options = webdriver.ChromeOptions()
    options.binary_location = browser
    for argument in ("--headless=new", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", "--window-size=1100,900"):
        options.add_argument(argument)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    opened = webdriver.Chrome(options=options, service=webdriver.ChromeService(executable_path=driver))
    try:
        yield opened
    finally:
        opened.quit()


def complaints(driver):
    """What the console has said since the last call."""
    return [entry["message"] for entry in driver.get_log("browser")]


def requests(driver):
    """Addresses that were asked for since the last call."""
    messages = [json.loads(entry["message"])["message"] for entry in driver.get_log("performance")]
    return [m["params"]["request"]["url"] for m in messages if m["method"] == "Network.requestWillBeSent"]


def resize(driver, width, height=900, mobile=False):
    """A window of another size."""
    metrics = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": mobile}
    driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)


def prefer(driver, scheme):
    """The user's preference: "light" or "dark"."""
    feature = {"name": "prefers-color-scheme", "value": scheme}
    driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": [feature]})


def opened(driver, path, width=1100, scheme="light"):
    """The driver with this page."""
    prefer(driver, scheme)
    resize(driver, width, mobile=width < 600)
    driver.get_log("browser"), driver.get_log("performance")
    driver.get(path.as_uri())
    return driver


def numbers(driver, selector):
    """Values of all numbers in a table, row by row."""
    return driver.execute_script(
        "return [...document.querySelectorAll(arguments[0] + ' tbody tr')]"
        ".map(r => [...r.querySelectorAll('data.n')].map(d => Number(d.value)))",
        selector,
    )

"""Shared records for tests, and what draws them."""

import gc
import os
from pathlib import Path

import pytest
from browser import chromium
from examples import settings
from stories import story_of_log

from thermocorr.datasets import load_voltage_reference, make_record

os.environ["COLUMNS"] = "100"  # printed pages are as wide as the terminal
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "default"))


def pytest_addoption(parser):
    parser.addoption("--long", action="store_true", help="the tests that take long, too: kills, seeds, whole sessions")


def pytest_collection_modifyitems(config, items):
    """Tests that take long are for `--long`."""
    if not config.getoption("--long"):
        config.hook.pytest_deselected(items=[item for item in items if item.get_closest_marker("long")])
        items[:] = [item for item in items if not item.get_closest_marker("long")]


def pytest_collection_finish():
    """Thousands of tests stay to the end: the collector of garbage need not look at them again and again."""
    gc.collect()
    gc.freeze()


@pytest.fixture(scope="session")
def voltage():
    """The built-in voltage reference: (X, y)."""
    record = load_voltage_reference()
    return record.drop(columns="voltage"), record["voltage"]


@pytest.fixture(scope="session")
def measured():
    """Folder of the measured records; skips where it is absent."""
    folder = Path(os.environ.get("THERMOCORR_RECORDS", Path(__file__).parents[2] / "shared" / "records"))
    if not folder.is_dir():
        pytest.skip(f"no folder of measured records at {folder}; name one with THERMOCORR_RECORDS")
    return folder


@pytest.fixture
def drawing():
    """Pictures are drawn without a window, and closed; skips where matplotlib is absent."""
    matplotlib = pytest.importorskip("matplotlib", reason="matplotlib is not installed: pip install '.[plot]'")
    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    yield
    plt.close("all")


@pytest.fixture(scope="module")
def browser():
    """A driver of a headless Chromium; skips where there is none."""
    with chromium() as driver:
        yield driver


@pytest.fixture
def written(tmp_path):
    """Function that writes a file and returns its path."""

    def write(content, name="log.csv"):
        path = tmp_path / name
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return path

    return write


@pytest.fixture(scope="module")
def story_log(tmp_path_factory):
    """A log in which the supply acts on the reading, for workbenches."""
    path = tmp_path_factory.mktemp("logs") / "log.csv"
    make_record(3000, effects={"covariate": 2.0}, seed=3).to_csv(path)
    return path


@pytest.fixture
def story(story_log):
    """A workbench without a screen, everything found out."""
    return story_of_log(story_log)

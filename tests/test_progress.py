"""Progress of long work: who is told what, and bars in terminals alone."""

import io
import sys

import pytest

from thermocorr import DynamicBiasRegressor, compare_variants, refine
from thermocorr.datasets import make_record
from thermocorr.model.progress import reporting
from thermocorr.validation import held_out_residuals


class Terminal(io.StringIO):
    """A standard error that says it is a terminal."""

    def isatty(self):
        return True


@pytest.fixture(scope="module")
def log():
    record = make_record(1200, seed=5)
    return record[["temperature"]], record["reading"]


MODEL = DynamicBiasRegressor("temperature", ["5 min", "90 min"])


def test_each_piece_of_work_is_told_once(log):
    said: list[str] = []
    held_out_residuals(MODEL, *log, n_blocks=4, progress=said.append)
    assert said == [f"held-out block {k} of 4" for k in (1, 2, 3, 4)]
    said.clear()
    compare_variants(*log, model=MODEL, n_blocks=3, progress=said.append)
    assert len(said) == 4 * (1 + 3) + 1


def test_a_bar_is_drawn_in_a_terminal_and_counts_to_its_end(log, monkeypatch):
    pytest.importorskip("tqdm", reason="bars are drawn by tqdm: pip install '.[progress]'")
    shown = Terminal()
    monkeypatch.setattr(sys, "stderr", shown)
    with reporting(True, 3) as tell:
        for k in range(3):
            tell(f"piece {k}")
    drawn = shown.getvalue()
    assert "piece 0" in drawn and "0/3" in drawn
    assert drawn.endswith("\r")  # gone
    compare_variants(*log, model=MODEL, n_blocks=2, progress=True)
    assert "/13 [" in shown.getvalue()


def test_a_bar_is_silent_where_nobody_looks(log, capfd):
    pytest.importorskip("tqdm", reason="bars are drawn by tqdm: pip install '.[progress]'")
    refine(MODEL, *log, progress=True, max_steps=1)
    assert capfd.readouterr() == ("", "")


def test_an_interrupt_leaves_no_bar(log, monkeypatch):
    pytest.importorskip("tqdm", reason="bars are drawn by tqdm: pip install '.[progress]'")
    shown = Terminal()
    monkeypatch.setattr(sys, "stderr", shown)

    def stopped(model, X, known):
        raise KeyboardInterrupt

    monkeypatch.setattr("thermocorr.model.out_of_sample.unlearned", stopped)
    with pytest.raises(KeyboardInterrupt):
        held_out_residuals(MODEL, *log, progress=True)
    assert shown.getvalue().endswith("\r")


def test_without_the_package_the_way_out_is_said(log, monkeypatch):
    monkeypatch.setitem(sys.modules, "tqdm", None)
    monkeypatch.setitem(sys.modules, "tqdm.auto", None)
    with pytest.raises(ImportError, match=r"pip install tqdm"):
        held_out_residuals(MODEL, *log, progress=True)
    held_out_residuals(MODEL, *log, n_blocks=2, progress=False)


def test_what_is_no_progress_is_refused(log):
    with pytest.raises(ValueError, match="'progress' parameter must be True"):
        held_out_residuals(MODEL, *log, progress="bar")

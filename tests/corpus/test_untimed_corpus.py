"""Logs without any times that random ones have led to."""

import pytest

from corpus.clean_log import CLEAN, FITTED, ROWS, Shown, frame_of, text_of
from thermocorr import DynamicBiasRegressor, ModelFileError, OnlineCorrector, load_model, save_model


@pytest.fixture
def correct(tmp_path, capsys):
    """Function that gives a log to `correct`."""
    return lambda content, model: Shown(tmp_path, content, (), model, capsys)


@pytest.fixture(scope="module")
def untimed_path(tmp_path_factory):
    frame = frame_of(CLEAN[:FITTED])
    model = DynamicBiasRegressor("temperature", [600.0], sampling_period=60.0)
    return save_model(model.fit(frame[["temperature"]], frame["reading"]), tmp_path_factory.mktemp("rows") / "m.json")


def test_a_torn_line_in_a_log_without_times_is_said_in_our_words(correct, untimed_path):
    shown = correct(text_of(CLEAN[40:])[:-5], model=untimed_path)
    assert shown.status == 0 and "the last line is left out" in shown.err and len(shown.rows) == ROWS - 41


@pytest.mark.parametrize("place", ["next_row", "last", "segment_zero"])
@pytest.mark.parametrize("value", [-1, 2**63 - 1])
def test_a_row_that_no_log_reaches_is_no_state(place, value, untimed_path):
    """Rows behind the last integer are stale, and such before the first one lie beyond all gaps."""
    model = load_model(untimed_path)
    live = OnlineCorrector(model)
    live.update_many(frame_of(CLEAN[FITTED:])[["temperature"]])
    state = live.state()
    (state if place in state else state["state"])[place] = value
    with pytest.raises(ModelFileError, match=place):
        OnlineCorrector.from_state(model, state)


def test_a_header_that_comes_again_leaves_rows_without_times_in_their_place(correct, untimed_path):
    """These rows repeat fitted ones: a header between them must not make new rows of them."""
    whole = correct(text_of(CLEAN[:30]), model=untimed_path)
    again = correct(text_of(CLEAN[:10]) + text_of(CLEAN[10:30]), model=untimed_path)
    assert again.status == 0 and again.rows == whole.rows

"""Allan deviation: closed forms, allantools, gaps, and records that arrive in blocks."""

from __future__ import annotations

import numpy as np
import pytest

from thermocorr import DynamicBiasRegressor
from thermocorr.datasets import make_record
from thermocorr.displays import AllanDisplay
from thermocorr.equations import AllanStream, allan_deviation
from thermocorr.equations.allan import edf_overlapping

STEP = 15.0


def series(kind, n=4000, seed=0):
    shocks = np.random.default_rng(seed).normal(size=n)
    return {"white": shocks, "random walk": np.cumsum(shocks), "offset": 1e6 + shocks, "drift": np.arange(float(n))}[
        kind
    ]


@pytest.mark.parametrize("kind", ["white", "random walk", "offset", "drift"])
@pytest.mark.parametrize("times", ["octave", "log"])
def test_equal_to_allantools(kind, times):
    """Both sum the same differences; an offset of a million leaves 1e-10 of a sample's noise."""
    allantools = pytest.importorskip("allantools", reason="allantools is not installed: nothing to compare with")
    values = series(kind)
    found = allan_deviation(values, STEP, times)
    taus, deviation, _, n = allantools.oadev(values, rate=1 / STEP, data_type="freq", taus=found.averaging_times)
    np.testing.assert_allclose(found.averaging_times, taus, rtol=1e-12)
    np.testing.assert_allclose(found.deviation, deviation, rtol=1e-9 if kind == "offset" else 1e-12)
    np.testing.assert_array_equal(found.n, n)


@pytest.mark.parametrize("exponent", [2, 1, 0, -1, -2])
def test_degrees_of_freedom_equal_allantools(exponent):
    """But for flicker noise at one cell, where the other program has kept a misprint of the handbook."""
    allantools = pytest.importorskip("allantools", reason="allantools is not installed: nothing to compare with")
    for m in (1, 2, 30) if exponent != -1 else (2, 30):
        assert edf_overlapping(1001, m, exponent) == pytest.approx(allantools.edf_simple(1001, m, exponent), rel=1e-12)


def test_the_definition_by_hand():
    """Averages over two cells at every offset: 1.5, 3, 5, 6.5 and their differences two cells apart."""
    found = allan_deviation(np.array([1.0, 2.0, 4.0, 6.0, 7.0]), 1.0, [1.0, 2.0])
    assert found.deviation[0] == pytest.approx(np.sqrt((1 + 4 + 4 + 1) / (2 * 4)))
    assert found.deviation[1] == pytest.approx(np.sqrt((3.5**2 + 3.5**2) / (2 * 2)))
    assert found.n.tolist() == [4, 2]


def test_a_drift_and_white_noise_follow_their_laws():
    """Drift: slope tau / sqrt(2), exactly. White noise: sigma / sqrt(m), within its own interval."""
    drift = allan_deviation(3e-3 * STEP * np.arange(1000.0), STEP)
    np.testing.assert_allclose(drift.deviation, 3e-3 * drift.averaging_times / np.sqrt(2), rtol=1e-9)
    white = allan_deviation(series("white", 100_000), STEP, confidence=0.999)
    law = 1 / np.sqrt(white.averaging_times / STEP)
    assert ((white.low < law) & (law < white.high)).all()
    assert (white.noise_exponent == 0).all()
    assert (allan_deviation(series("random walk", 100_000), STEP).noise_exponent == -2).all()


def test_intervals_cover_the_truth_as_often_as_they_say():
    """400 records of white noise, 90 % intervals: 0.90 +- 3 sqrt(0.9 0.1 / 400) = 0.045, and a percent for the edf."""
    inside = []
    for seed in range(400):
        found = allan_deviation(series("white", 512, seed), 1.0, [1.0, 8.0, 64.0], confidence=0.9)
        law = 1 / np.sqrt(found.averaging_times)
        inside.append((found.low < law) & (law < found.high))
    assert np.mean(inside, axis=0) == pytest.approx([0.9] * 3, abs=0.055)


def test_a_periodic_reading_is_no_more_certain_than_white_noise():
    """Its averages over half a period alternate, as phase noise does; freedom for that would be a half of all rows."""
    found = allan_deviation(np.sin(2 * np.pi * np.arange(20_000) / 500), 1.0, "log")
    assert (found.noise_exponent <= 0).all()
    assert found.degrees_of_freedom[-1] < 3 * 20_000 / (2 * found.averaging_times[-1])  # white noise's, about
    assert found.high[-1] > 1.2 * found.deviation[-1]


def test_gaps_are_left_out_not_filled():
    """White noise with a third of it lost in gaps keeps its law; a filled gap would make it quieter."""
    values = series("white", 60_000)
    values[10_000:25_000] = np.nan
    values[np.random.default_rng(1).integers(0, 60_000, 3000)] = np.nan
    found = allan_deviation(values, 1.0, [1.0, 16.0, 128.0, 1024.0], confidence=0.999)
    law = 1 / np.sqrt(found.averaging_times * np.array([1.0, *[np.isfinite(values[25_000:]).mean()] * 3]))
    assert ((found.low < law) & (law < found.high)).all()
    whole = allan_deviation(values[25_000:], 1.0, [1.0])
    both = allan_deviation([values[:10_000], values[25_000:]], 1.0, [1.0])
    assert both.n[0] > whole.n[0]
    assert both.deviation[0] == pytest.approx(found.deviation[0], rel=1e-12)  # neighbours never reach over the gap


def test_pieces_never_share_a_difference():
    values = series("random walk", 1000)
    apart = allan_deviation([values, values + 1e6], 1.0)
    alone = allan_deviation(values, 1.0)
    np.testing.assert_allclose(apart.deviation, alone.deviation, rtol=1e-6)
    np.testing.assert_array_equal(apart.n, 2 * alone.n)


def regular_cells(seconds, values, cell):
    """Means over regular cells of time, NaN where there is no reading; the first is centred on the first time."""
    number = np.floor((seconds - seconds[0]) / cell + 0.5).astype(np.intp)
    known = np.isfinite(values)
    count = np.bincount(number[known], minlength=int(number[-1]) + 1)
    offset = float(values[known][0]) if known.any() else 0.0
    total = np.bincount(number[known], values[known] - offset, minlength=int(number[-1]) + 1)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(count > 0, total / count + offset, np.nan)


def test_irregular_times_are_averaged_into_cells():
    seconds = np.array([0.0, 9.0, 11.0, 41.0])
    cells = regular_cells(seconds, np.array([1.0, 2.0, 4.0, np.nan]), 10.0)
    np.testing.assert_array_equal(cells, [1.0, 3.0, np.nan, np.nan, np.nan])


@pytest.mark.parametrize("irregular", [False, True])
@pytest.mark.parametrize("most", [1 << 20, 1 << 10])
def test_blocks_give_the_same_as_the_whole(irregular, most):
    """Exact where all cells are held; beyond, long averages begin at every f-th cell, a sixteenth of their length."""
    rng = np.random.default_rng(2)
    n = 12_000
    values = 5 + rng.normal(size=n) + 0.02 * np.cumsum(rng.normal(size=n))
    seconds = STEP * np.arange(n)
    if irregular:
        keep = np.ones(n, bool)
        keep[1000:1400] = keep[rng.integers(0, n, 200)] = False
        seconds, values = seconds[keep] + rng.uniform(-4, 4, keep.sum()), values[keep]
        values[5000:5003] = np.nan
    whole = allan_deviation(regular_cells(seconds, values, STEP), STEP)
    stream = AllanStream(STEP, n, n, most=most)
    for start in range(0, len(values), 777):
        stream.add("run", seconds[start : start + 777], values[start : start + 777])
    found = stream.result()
    np.testing.assert_allclose(found.averaging_times, whole.averaging_times, rtol=1e-12)
    tolerance = 1e-9 if most > n else 0.01  # a sixteenth of an interval's width at the shortest of them
    np.testing.assert_allclose(found.deviation, whole.deviation, rtol=tolerance)
    if most < n:
        assert stream.factor == 16
        fine = found.averaging_times < 16 * stream.factor * STEP
        np.testing.assert_allclose(found.deviation[fine], whole.deviation[fine], rtol=1e-9)


def test_a_very_long_gap_and_a_new_run_begin_a_piece():
    values = series("white", 900)
    stream = AllanStream(1.0, 900, 300)
    stream.add(1, np.r_[0:300, 5000:5300].astype(float), values[:600])
    stream.add(2, np.arange(300.0), values[600:])
    np.testing.assert_allclose(
        stream.result().deviation, allan_deviation(np.split(values, 3), 1.0).deviation, rtol=1e-12
    )


@pytest.mark.parametrize("far", [1e9, 1e19, 1e39])
def test_a_last_row_far_behind_the_others_is_a_piece_of_its_own(far):
    values = series("white", 300)
    stream = AllanStream(1.0, 300, 300)
    stream.add(1, np.r_[0:299, far], values)
    np.testing.assert_allclose(stream.result().deviation, allan_deviation(values[:299], 1.0).deviation, rtol=1e-12)


def test_a_record_with_a_last_row_far_behind_the_others_has_a_deviation():
    record = make_record(300, seed=1)
    X = record[["temperature"]].assign(time=np.r_[60.0 * np.arange(299), 1e39])
    y = record["reading"]
    model = DynamicBiasRegressor("temperature", [600.0], time="time", max_gap="5 min").fit(X[:299], y[:299])
    found, alone = (AllanDisplay.from_estimator(model, X[:n], y[:n]).before for n in (300, 299))
    np.testing.assert_allclose(found.deviation, alone.deviation, rtol=1e-12)


def test_what_cannot_be_used_is_refused():
    with pytest.raises(ValueError, match="at least 3 readings"):
        allan_deviation(np.array([1.0, np.nan, 2.0]))
    with pytest.raises(ValueError, match="at least 3 readings"):
        allan_deviation(np.zeros(0))
    with pytest.raises(ValueError, match="at least the sampling period"):
        allan_deviation(series("white"), 15.0, [1.0])
    with pytest.raises(ValueError, match="'octave', 'log' or times"):
        allan_deviation(series("white"), 15.0, "decade")

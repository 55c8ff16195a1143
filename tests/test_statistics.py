"""Moving average, eqs. (9) (26), and reduction in dB, against a naive loop and the founding paper's table.

Also: Allan deviation: closed forms, allantools, gaps, and records that arrive in blocks. Published references:
certified regressions of the NIST StRD, and the stability test suite of NIST SP 1065.
"""

import math

import numpy as np
import pytest
from examples import examples
from hypothesis import given
from hypothesis import strategies as st
from nist_data import SETS

from thermocorr import DynamicBiasRegressor
from thermocorr.datasets import make_record
from thermocorr.displays import AllanDisplay
from thermocorr.equations import allan_deviation, moving_average, reduction_db, regular_cells
from thermocorr.equations.allan import edf_overlapping
from thermocorr.model import MergedRidge


def naive(values, window):
    """Mean over `window` samples around each, cut at the ends; an even window reaches one further ahead."""
    result = []
    for k in range(len(values)):
        inside = range(max(k - (window - 1) // 2, 0), min(k + window // 2, len(values) - 1) + 1)
        known = [values[i] for i in inside if not math.isnan(values[i])]
        result.append(math.fsum(known) / len(known) if known else math.nan)
    return np.array(result)


numbers = st.one_of(st.floats(-1e3, 1e3), st.just(math.nan))


@examples(100)
@given(values=st.lists(numbers, max_size=40), window=st.integers(1, 60))
def test_moving_average_is_the_mean_of_each_window(values, window):
    values = np.array(values, float)
    # atol: a running sum of 40 values of 1000 is rounded 40 times at 4e4
    np.testing.assert_allclose(moving_average(values, window), naive(values, window), rtol=0, atol=1e-9)


def test_large_offset_costs_no_digits():
    ppm = np.random.default_rng(1).normal(0.0, 0.1, 100_000)
    smooth = moving_average(99_998.0 + ppm, 25)
    inside = np.convolve(ppm, np.ones(25) / 25, "valid")
    # atol: the readings themselves are rounded at 99 998 eps / 2 = 7e-12; a running sum of the raw readings,
    # which reaches 1e10, would be off by 1e-6 / 25
    np.testing.assert_allclose(smooth[12:-12] - 99_998.0, inside, rtol=0, atol=5e-11)


@pytest.mark.parametrize(
    ("after", "before", "said"),
    [
        (4.911e-5, 1.114e-3, -27.3),
        (4.471e-5, 1.114e-3, -27.9),
        (1.331e-5, 1.114e-3, -38.6),
        (1.173e-5, 1.114e-3, -39.5),
        (1.331e-5, 4.911e-5, -11.3),
        (1.173e-5, 4.471e-5, -11.6),
    ],
)
def test_reductions_are_those_of_the_paper(after, before, said):
    # atol: the paper's dB do not follow from its own standard deviations to the last digit (up to 0.2 dB off)
    assert reduction_db(after, before) == pytest.approx(said, abs=0.2)


def test_reduction_is_20_db_per_power_of_ten_and_negative_is_good():
    assert reduction_db(0.1, 1.0) == pytest.approx(-20.0, abs=1e-13)
    assert reduction_db(1.0, 1.0) == 0.0
    assert reduction_db(2.0, 1.0) == pytest.approx(6.0206, abs=1e-4)


def test_reduction_from_or_to_nothing_is_infinite_without_a_warning():
    assert reduction_db(0.0, 1.0) == -math.inf
    assert reduction_db(1.0, 0.0) == math.inf
    assert math.isnan(reduction_db(0.0, 0.0))
    assert isinstance(reduction_db(1, 3), float)


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


@pytest.mark.parametrize("exponent", [0, -1, -2])
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


def cells(seconds, values, cell):
    """Means over regular cells of time, NaN where there is no reading; the first is centred on the first time."""
    number = np.floor((seconds - seconds[0]) / cell + 0.5).astype(np.intp)
    known = np.isfinite(values)
    count = np.bincount(number[known], minlength=int(number[-1]) + 1)
    offset = float(values[known][0]) if known.any() else 0.0
    total = np.bincount(number[known], values[known] - offset, minlength=int(number[-1]) + 1)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(count > 0, total / count + offset, np.nan)


@pytest.mark.parametrize("irregular", [False, True])
def test_rows_at_any_times_are_averaged_into_cells(irregular):
    rng = np.random.default_rng(2)
    n = 12_000
    values = 5 + rng.normal(size=n) + 0.02 * np.cumsum(rng.normal(size=n))
    seconds = STEP * np.arange(n)
    if irregular:
        keep = np.ones(n, bool)
        keep[1000:1400] = keep[rng.integers(0, n, 200)] = False
        seconds, values = seconds[keep] + rng.uniform(-4, 4, keep.sum()), values[keep]
        values[5000:5003] = np.nan
    (found,) = regular_cells(np.zeros(len(values), int), seconds, values, STEP, n)
    np.testing.assert_allclose(found, cells(seconds, values, STEP), rtol=1e-12)


@pytest.mark.parametrize("far", [1e9, 1e19, 1e39])
def test_a_very_long_gap_and_a_new_run_begin_a_piece(far):
    values = series("white", 900)
    seconds = np.r_[0:300, 5000:5300, 0:299, far].astype(float)
    found = regular_cells(np.repeat([0, 1], [600, 300]), seconds, values, 1.0, 300)
    assert [len(piece) for piece in found] == [300, 300, 299, 1]
    np.testing.assert_array_equal(np.concatenate(found), values)


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


# Certified digits reached, -log10(|b - c| / |c|) of the worst number of a set, as measured on 400 partitions into
# blocks with numpy 1.26 and 2.4, scipy 1.12 and 1.17 and seven kernels of OpenBLAS: coefficients in the worst partition
# of all, and in the middle one; residual standard deviation, and standard deviations of the slopes, in the worst.
#
# What to expect of a good orthogonal solver in double precision: GSL's own tests ask for 7 digits of Filip and 10 of
# Longley; R's lm drops a column of Filip at its default tolerance, and Stata 9 did not complete that set. scipy's QR of
# the same rows, in one piece: Norris 13.3, Longley 10.9, Filip 7.4, Wampler1-5: 9.3, 12.6, 9.5, 7.8, 5.8.
# Norris: the intercept of -0.26 is a difference of means of 430, which costs 3 of 15 digits.
# Filip: raw powers up to the tenth, condition 5e9 with columns of unit length.
# Wampler3-5: residuals of 2e3, 2e5 and 2e7 besides coefficients of 1.
DIGITS = {
    #            worst  middle  residual  errors
    "Norris": (11.5, 12.3, 12.6, 12.6),
    "Longley": (10.4, 11.2, 11.7, 11.4),
    "Filip": (6.4, 7.3, 6.9, 6.9),
    "Wampler1": (8.7, 9.5, None, None),  # an exact fit: nothing is left over
    "Wampler2": (12.4, 12.9, None, None),
    "Wampler3": (8.7, 9.5, 13.4, 13.0),
    "Wampler4": (7.7, 8.3, 14.7, 13.0),
    "Wampler5": (5.7, 6.3, 14.7, 13.0),
}
MARGIN = 0.4
"""Digits below the measured figure that pass, a factor of 2.5: another library sums in another order."""


def digits(found, certified):
    """Certified digits of the worst of some numbers; 15 were published."""
    error = np.abs(np.asarray(found) - certified) / np.abs(certified)
    return float(-np.log10(max(error.max(), 1e-15)))


def floats(text):
    return np.array(text.split(), float)


def doubles(rows):
    """Exact rows, each number rounded once."""
    return np.array([[float(value) for value in row] for row in rows])


@pytest.mark.parametrize("name", SETS)
def test_certified_digits_of_the_regressor(name):
    """`MergedRidge` takes the first reading off and gives the residual standard deviation itself."""
    certified = SETS[name]
    rows = doubles(certified.rows())
    ridge = MergedRidge().fit(rows[:, 1:-1], rows[:, -1])
    found = digits([ridge.intercept_, *ridge.coef_], floats(certified.coefficients))
    print(f"{name}: {found:.1f} digits, residual {ridge.residual_std_!r}")
    assert ridge.rank_ == rows.shape[1] - 2
    assert found >= DIGITS[name][0] - MARGIN
    residual = float(certified.residual)
    if residual:
        assert digits(ridge.residual_std_, residual) >= DIGITS[name][2] - MARGIN
    else:
        assert ridge.residual_std_ <= 5e-16 * np.abs(rows[:, -1]).max()  # as for the blocks


# Riley, Handbook of Frequency Stability Analysis, NIST SP 1065 (2008), tables 30 to 32 (pages 107 to 109).
NBS = np.array([892.0, 809.0, 823.0, 798.0, 671.0, 644.0, 883.0, 903.0, 677.0])
"""Frequencies of NBS Monograph 140, Annex 8.E."""
AVERAGED = {"NBS": [1, 2], "1000 points": [1, 10, 100]}
OVERLAPPING = {"NBS": [91.22945, 85.95287], "1000 points": [2.922319e-01, 9.159953e-02, 3.241343e-02]}


def frequencies(name):
    """The nine frequencies, or the thousand of a generator of random numbers that runs anywhere."""
    if name == "NBS":
        return NBS
    state = [1234567890]
    for _ in range(999):
        state.append(16807 * state[-1] % 2147483647)
    assert state[1:4] == [395529916, 1209410747, 633705974]  # as the handbook prints them
    return np.array(state) / 2147483647


def printed(values):
    """Rounded to the seven digits that the handbook prints."""
    return [float(f"{value:.7g}") for value in np.atleast_1d(values)]


@pytest.mark.parametrize("name", AVERAGED)
def test_overlapping_deviation_to_the_last_digit_printed(name):
    y = frequencies(name)
    for period in (1.0, 15.0):  # a deviation does not depend on the unit of time
        found = allan_deviation(y, period, period * np.array(AVERAGED[name]))
        assert printed(found.deviation) == OVERLAPPING[name]
        assert found.n.tolist() == [len(y) + 1 - 2 * m for m in AVERAGED[name]]
    halves = allan_deviation([y, y + 7.0], 1.0, AVERAGED[name])  # two pieces with the same differences
    assert printed(halves.deviation) == OVERLAPPING[name]


def test_freedom_and_interval_of_the_thousand_points():
    """Table 32: white noise at ten readings, 146.177 degrees of freedom, 95 % from 8.223942e-02 to 1.035201e-01.

    rtol: above 100 degrees of freedom the program behind the table approximates the quantiles of chi-squared, by up to
    1e-3 of them and more; the exact ones move the ends by 5e-4 and 6e-4.
    """
    found = allan_deviation(frequencies("1000 points"), 1.0, [10.0], confidence=0.95)
    assert found.noise_exponent.tolist() == [0]
    assert found.degrees_of_freedom[0] == pytest.approx(146.177, abs=5e-4)
    np.testing.assert_allclose([found.low[0], found.high[0]], [8.223942e-02, 1.035201e-01], rtol=8e-4)

"""Published references: certified regressions of the NIST StRD, and the stability test suite of NIST SP 1065.

The regressions go through the triangle in blocks that are merged, as records do. The deviations are those that the
package has: the overlapping Allan deviation of readings (frequencies y, there), and the one without overlap, which is
the same function of averages that do not overlap.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from nist_data import SETS

from thermocorr.equations import AllanStream, allan_deviation
from thermocorr.estimators import MergedRidge

# Certified digits reached, -log10(|b - c| / |c|) of the worst number of a set, as measured on 400 partitions into
# blocks with numpy 1.26 and 2.4, scipy 1.12 and 1.17 and seven kernels of OpenBLAS: coefficients in the worst partition
# of all, and in the middle one; residual standard deviation, and standard deviations of the slopes, in the worst.
#
# What to expect of a good orthogonal solver in double precision: GSL's own tests ask for 7 digits of Filip and 10 of
# Longley; R's lm drops a column of Filip at its default tolerance, and Stata 9 did not complete that set. scipy's QR of
# the same rows, in one piece: Norris 13.3, Longley 10.9, Filip 7.4, Wampler1-5: 9.3, 12.6, 9.5, 7.8, 5.8.
# Norris: the intercept of -0.26 is a difference of means of 430, which costs 3 of 15 digits.
# Filip: raw powers up to the tenth, condition 5e9 with columns of unit length.
# Wampler3-5: residuals of 2e3, 2e5 and 2e7 beside coefficients of 1.
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


# -------------------------------------------------------------------------------------------------------- regressions


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


# ----------------------------------------------------------------------------------------------------- Allan deviation

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


@pytest.mark.parametrize("most", [1 << 20, 64])
def test_a_stream_of_the_thousand_points_to_the_last_digit_printed(most):
    """Also where only 64 cells are held, in averages over 16: averages below 256 cells are compared as they pass."""
    y = frequencies("1000 points")
    stream = AllanStream(1.0, len(y), len(y), "log", most=most)
    for start, end in pairwise([0, 1, 2, 70, 77, 500, 999, 1000]):
        stream.add("run", np.arange(start, end, dtype=float), y[start:end])
    found = stream.result()
    chosen = np.isin(found.averaging_times, AVERAGED["1000 points"])
    assert printed(found.deviation[chosen]) == OVERLAPPING["1000 points"]


def test_freedom_and_interval_of_the_thousand_points():
    """Table 32: white noise at ten readings, 146.177 degrees of freedom, 95 % from 8.223942e-02 to 1.035201e-01.

    rtol: above 100 degrees of freedom the program behind the table approximates the quantiles of chi-squared, by up to
    1e-3 of them and more; the exact ones move the ends by 5e-4 and 6e-4.
    """
    found = allan_deviation(frequencies("1000 points"), 1.0, [10.0], confidence=0.95)
    assert found.noise_exponent.tolist() == [0]
    assert found.degrees_of_freedom[0] == pytest.approx(146.177, abs=5e-4)
    np.testing.assert_allclose([found.low[0], found.high[0]], [8.223942e-02, 1.035201e-01], rtol=8e-4)

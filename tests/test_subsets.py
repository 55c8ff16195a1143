"""Held-out errors of sets of columns against scikit-learn's Ridge on the data themselves."""

from itertools import combinations

import numpy as np
import pytest
from sklearn.linear_model import Ridge
from sklearn.preprocessing import StandardScaler

from thermocorr.equations import TriangularFactor, lag_differences
from thermocorr.equations.subsets import fold_of, set_errors

N, CUT = 6000, 4000


@pytest.fixture(scope="module")
def data():
    rng = np.random.default_rng(4)
    T = np.sin(np.arange(N) / 300) + 0.01 * np.cumsum(rng.normal(size=N))
    lags, _ = lag_differences(T, np.full(N, 10.0), np.geomspace(30.0, 30_000.0, 9))
    Q = np.column_stack((T, T**2, lags))
    return Q, 5 + T + 2 * lags[:, 2] + 0.05 * rng.normal(size=N)


def factor(Q, y):
    return TriangularFactor(Q.shape[1] + 2).update(np.asfortranarray(np.column_stack((np.ones(len(Q)), Q, y))))


def by_hand(Q, y, alpha):
    """Mean squared test error of scikit-learn's Ridge behind a StandardScaler."""
    scaler = StandardScaler().fit(Q[:CUT])
    model = Ridge(alpha, solver="svd").fit(scaler.transform(Q[:CUT]), y[:CUT])
    return np.mean((y[CUT:] - model.predict(scaler.transform(Q[CUT:]))) ** 2)


@pytest.mark.parametrize("alpha", [1e-8, 1.0, 300.0])
def test_errors_of_sets_are_those_of_ridge(data, alpha):
    Q, y = data
    fold = fold_of(factor(Q[:CUT], y[:CUT]), factor(Q[CUT:], y[CUT:]), 3, alpha)
    for size in (0, 1, 3, 6):
        sets = np.array(list(combinations(range(9), size))[::7], np.intp)
        errors = set_errors([fold], sets)[:, 0]
        expected = [by_hand(Q[:, [0, 1, *(members + 2)]], y, alpha) for members in sets]
        np.testing.assert_allclose(errors, expected, rtol=1e-9)


def test_columns_that_depend_on_others_or_are_dead_change_nothing(data):
    Q, y = data
    Q = np.column_stack((Q, Q[:, 3] + Q[:, 4], np.zeros(N)))
    learned, tested = factor(Q[:CUT], y[:CUT]), factor(Q[CUT:], y[CUT:])
    fold = fold_of(learned, tested, 3)
    errors = set_errors([fold], np.array([[1, 2, -1, -1], [1, 2, 9, -1], [1, 2, 10, -1]]))[:, 0]
    assert errors[1] == pytest.approx(errors[0], rel=1e-9)
    assert errors[2] == errors[0]
    dead = fold_of(learned, tested, 3, dead=[3 + 2])
    assert set_errors([dead], np.array([[1, 2]]))[0, 0] == pytest.approx(set_errors([fold], np.array([[1]]))[0, 0])

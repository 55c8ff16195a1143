"""Columns of single segments beside shared ones: eliminated one by one, they are what one triangle of all says."""

import numpy as np
import pytest

from thermocorr import DynamicBiasRegressor
from thermocorr.datasets import make_record
from thermocorr.equations import TriangularFactor, solve_ridge
from thermocorr.equations.compiled import is_compiled
from thermocorr.equations.leastsquares import BorderedFactor

SHARED = [0, 1, 2, 3]
"""The 1 and three columns; own columns follow, the reading is last."""


def both(rng, counts, n=30, dependent=False):
    """The bordered factor and the plain one of random segments with so many own columns each."""
    width = len(SHARED) + sum(counts) + 1
    segments, plain, at = [], TriangularFactor(width), len(SHARED)
    for count in counts:
        rows = np.zeros((n, width))
        rows[:, 0] = 1.0
        rows[:, 1:4] = 300.0 * np.array([0.0, 1.0, 0.0]) + rng.standard_normal((n, 3)).cumsum(axis=0)
        own = list(range(at, at + count))
        rows[:, own] = np.exp(-np.arange(n)[:, None] / (2.0 * 3.0 ** np.arange(count)))
        if dependent and count > 1:
            rows[:, own[1]] = rows[:, own[0]]
        rows[:, -1] = rows @ rng.standard_normal(width) + 0.1 * rng.standard_normal(n)
        segments.append((own, rows[:, [*own, *SHARED, width - 1]]))
        plain.update(np.asfortranarray(rows))
        at += count
    return BorderedFactor.of([*SHARED, width - 1], segments, n * len(counts)), plain


@pytest.mark.parametrize("alpha", [0.0, 1e-3, 10.0])
@pytest.mark.parametrize("counts", [[3] * 12, [0, 2, 3, 1, 3, 0], [4]])
def test_the_solution_is_that_of_one_triangle(counts, alpha):
    bordered, plain = both(np.random.default_rng(5), counts)
    found, expected = bordered.solution(alpha), solve_ridge(plain, alpha)
    assert (found.rank, found.n_rows) == (expected.rank, expected.n_rows)
    for name in ("intercept", "coef", "scale", "mean", "residual_sum_of_squares"):
        np.testing.assert_allclose(getattr(found, name), getattr(expected, name), rtol=1e-9, atol=1e-9)
    covariance, known = (s.inverse_triangle @ s.inverse_triangle.T for s in (found, expected))
    size = np.sqrt(np.diag(known))
    np.testing.assert_allclose(covariance / np.outer(size, size), known / np.outer(size, size), atol=1e-9)


@pytest.mark.long
@pytest.mark.skipif(not is_compiled(), reason="the compiled pass needs numba: pip install '.[fast]'")
@pytest.mark.parametrize("options", [{}, {"alpha": 1e-2}])
def test_a_fit_of_many_runs_is_that_of_its_stretches(options):
    record = make_record(12_000, noise=0.2, seed=3)
    X = record[["temperature"]].assign(run=np.arange(12_000) // 100)
    model = DynamicBiasRegressor("temperature", [60.0, 300.0, 1500.0, 9000.0], run="run", **options)
    model.fit(X, record["reading"])
    assert model._swept.bordered is not None
    expected = solve_ridge(model._swept.total(), model.alpha_)
    np.testing.assert_allclose(model.coef_, expected.coef, rtol=1e-8, atol=1e-9)
    assert model._solution.residual_sum_of_squares == pytest.approx(expected.residual_sum_of_squares, rel=1e-10)
    table = model.coef_table()  # standard errors ask for the stretches
    assert np.isfinite(table.to_numpy()[:, -1].astype(float)).all()

"""The sweep of a record: digits that it keeps, and columns of single segments, eliminated one by one."""

import numpy as np
import pandas as pd
import pytest

from thermocorr import DynamicBiasRegressor
from thermocorr.datasets import make_record
from thermocorr.effects import StaticPolynomial, ThermalLag
from thermocorr.effects.stream import equal_edges
from thermocorr.equations import TriangularFactor, lag_differences, solve_ridge
from thermocorr.equations.leastsquares import BorderedFactor
from thermocorr.model.fitting import sweep_effects
from thermocorr.records import Layout, read_record

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
        factor = TriangularFactor(len(own) + len(SHARED) + 1)
        segments.append((own, factor.update(np.asfortranarray(rows[:, [*own, *SHARED, width - 1]])).r))
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


def room(n=9000, jitter=0.0, seed=0):
    """A log of a temperature that wanders, and of a device with two bodies that did not start at rest."""
    rng = np.random.default_rng(seed)
    seconds = np.cumsum(10.0 * (1 + jitter * rng.uniform(-1, 1, n)))
    T = 23 + 2 * np.sin(seconds / 9000) + np.cumsum(rng.normal(0, 0.02, n))
    steps = np.diff(seconds, prepend=seconds[0] - 10.0)
    Psi = lag_differences(T, steps, np.array([300.0, 4000.0]))[0]
    y = 7 + 0.4 * T + 0.01 * (T - 23) ** 2 + Psi @ [0.5, -0.3] + np.exp(-seconds / 2000) + rng.normal(0, 0.01, n)
    X = pd.DataFrame(
        {"temperature": T, "humidity": 40 + np.cumsum(rng.normal(0, 0.1, n))}, index=pd.to_timedelta(seconds, unit="s")
    )
    return X, pd.Series(y, X.index)


def test_a_stretch_without_readings_has_an_empty_factor(capfd):
    """As where a fit learns from the rows before a date: LAPACK prints what it refuses."""
    X, y = room(6000)
    y[4000:] = np.nan
    DynamicBiasRegressor("temperature", [60.0, 3000.0]).fit(X, y)
    assert "illegal" not in "".join(capfd.readouterr())


def exact(Q, U):
    """Least squares by modified Gram-Schmidt, done twice, in 80 bits: fitted values."""
    columns = [*np.asarray(np.column_stack((np.ones(len(Q)), Q)), np.longdouble).T]
    basis, rest = [], np.asarray(U, np.longdouble)
    for column in columns:
        for _ in range(2):
            for other in basis:
                column = column - other * (other @ column)
        basis.append(column / np.sqrt(column @ column))
    fitted = np.zeros(len(U), np.longdouble)
    for _ in range(2):
        for other in basis:
            share = other @ rest
            rest, fitted = rest - share * other, fitted + share * other
    return fitted


@pytest.mark.parametrize(
    ("taus", "largest"),
    [(np.geomspace(2e4, 4e4, 6), 1e-6), (np.geomspace(30.0, 3e4, 24), 1e-4)],
    ids=["six slow adjacent", "24"],
)
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_neighbouring_time_constants_keep_their_digits(taus, largest, seed):
    """Fitted values besides those of 80 bits, in units of the noise of the readings, 0.01."""
    X, y = room(20_000, seed=seed)
    effects = [StaticPolynomial(1), ThermalLag(taus.tolist())]
    record = read_record(X, Layout(), y=y, quiet=True)
    for effect in effects:
        effect.learn(record)
    found = sweep_effects(record, effects, equal_edges(record))
    solution = solve_ridge(found.total())
    T = X["temperature"].to_numpy()
    Q = np.column_stack((T - effects[0].reference_temperature_, lag_differences(T, np.full(len(T), 10.0), taus)[0]))
    U = y.to_numpy() - found.reading_offset
    wrong = np.asarray(exact(Q, U) - (solution.intercept + Q @ solution.coef), float)
    assert np.sqrt(np.mean(wrong**2)) < largest * 0.01

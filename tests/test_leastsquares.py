"""Merged triangular factors and ridge, eqs. (11)-(13) (30)-(32), against scikit-learn, lstsq and extended precision."""

import numpy as np
import pytest
from examples import examples
from hypothesis import given
from hypothesis import strategies as st
from sklearn.linear_model import Ridge
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

from thermocorr.equations import TriangularFactor, lag_differences, solve_ridge


def problem(n=500, p=4, seed=0):
    """Columns of very different sizes, off zero by up to 30 times that, and a reading that depends on all of them."""
    rng = np.random.default_rng(seed)
    size = np.geomspace(1e-3, 1e3, p)
    Q = (rng.normal(size=(n, p)) + np.linspace(-5.0, 30.0, p)) * size
    U = 7.0 + Q @ (rng.normal(size=p) / size) + rng.normal(0.0, 0.1, n)
    return Q, U


def swept(Q, U, cuts=()):
    """The factor of [1 | Q | U], swept in block by block."""
    factor = TriangularFactor(Q.shape[1] + 2)
    for block in np.split(np.column_stack((np.ones(len(Q)), Q, U)), list(cuts)):
        factor.update(np.asfortranarray(block))
    return factor


def predicted(solution, Q):
    return solution.intercept + Q @ solution.coef


def by_lstsq(Q, U):
    """Fitted values by numpy, columns brought to one length first."""
    matrix = np.column_stack((np.ones(len(Q)), Q))
    length = np.linalg.norm(matrix, axis=0)
    matrix = matrix / np.where(length > 0, length, 1.0)
    return matrix @ np.linalg.lstsq(matrix, U, rcond=1e-12)[0]


def same_up_to_signs(one, two, rtol=1e-12):
    """R is unique up to the sign of each row; the tolerance is relative to the length of each column."""
    signs = np.sign(np.diag(one)) * np.sign(np.diag(two))
    size = np.linalg.norm(two, axis=0)
    np.testing.assert_allclose(signs[:, None] * one / size, two / size, rtol=0, atol=rtol)


def test_factor_is_a_triangle_with_the_cross_products_of_the_rows():
    Q, U = problem()
    rows = np.column_stack((np.ones(len(Q)), Q, U))
    r = swept(Q, U, cuts=(3, 3, 7, 400)).r  # blocks shorter than the triangle, and an empty one
    assert np.array_equal(r, np.triu(r))
    size = np.linalg.norm(rows, axis=0)
    # atol: QR of 500 rows is backward stable to some eps of each column's length
    np.testing.assert_allclose(r.T @ r / np.outer(size, size), rows.T @ rows / np.outer(size, size), rtol=0, atol=1e-14)


@examples(30)
@given(cuts=st.lists(st.integers(0, 500), max_size=8), order=st.randoms(use_true_random=False))
def test_blocks_and_merges_in_any_order_give_one_factor(cuts, order):
    Q, U = problem()
    whole = swept(Q, U)
    parts = [swept(Q[rows], U[rows]) for rows in np.split(np.arange(500), sorted(cuts))]
    kept = [part.r.copy() for part in parts]
    order.shuffle(both := list(zip(parts, kept, strict=True)))
    merged = TriangularFactor.merged(part for part, _ in both)
    one_by_one = TriangularFactor(Q.shape[1] + 2)
    for part in parts:
        one_by_one.merge(part)
    for factor in (merged, one_by_one, swept(Q, U, sorted(cuts))):
        assert factor.n_rows == 500
        same_up_to_signs(factor.r, whole.r)
    assert all(np.array_equal(part.r, before) for part, before in both)  # those merged stay as they are


def test_update_leaves_c_ordered_rows_alone_and_accepts_integers():
    rows = np.column_stack((np.ones(50), np.arange(50.0) ** 2 % 17, np.arange(50.0)))
    before = rows.copy()
    factor = TriangularFactor(3).update(rows)
    assert np.array_equal(rows, before)
    same_up_to_signs(TriangularFactor(3).update(rows.astype(int)).r, factor.r)


@pytest.mark.parametrize("kind", [list, tuple, np.array, iter])
def test_select_is_the_factor_of_these_columns(kind):
    Q, U = problem()
    rows = np.column_stack((np.ones(len(Q)), Q, U))
    part = swept(Q, U).select(kind([0, 3, 1, 5]))
    direct = TriangularFactor(4).update(np.asfortranarray(rows[:, [0, 3, 1, 5]]))
    assert part.n_rows == direct.n_rows
    same_up_to_signs(part.r, direct.r)
    part.update(np.ones((1, 4)))  # it goes on like any other
    assert part.n_rows == 501


def test_combined_is_the_factor_of_linear_combinations():
    Q, U = problem()
    rows = np.column_stack((np.ones(len(Q)), Q, U))
    combination = np.random.default_rng(0).normal(size=(rows.shape[1], 3))
    part = swept(Q, U).combined(combination)
    assert part.n_rows == len(Q)
    np.testing.assert_allclose(part.r.T @ part.r, (rows @ combination).T @ (rows @ combination), rtol=1e-10)


@pytest.mark.parametrize("alpha", [0.0, 1e-3, 1.0, 1e4])
@pytest.mark.parametrize("cuts", [(), (1, 2, 60, 499)])
def test_ridge_is_that_of_scikit_learn_behind_a_standard_scaler(alpha, cuts):
    Q, U = problem()
    peer = make_pipeline(StandardScaler(), Ridge(alpha, solver="svd")).fit(Q, U)
    scaler, ridge = peer[0], peer[1]
    solution = solve_ridge(swept(Q, U, cuts), alpha)
    coef = ridge.coef_ / scaler.scale_
    # rtol: both solve the same well-conditioned system (condition below 2); its terms cancel a little
    np.testing.assert_allclose(solution.coef, coef, rtol=1e-10)
    np.testing.assert_allclose(solution.scale, scaler.scale_, rtol=1e-10)
    assert solution.intercept == pytest.approx(ridge.intercept_ - scaler.mean_ @ coef, rel=1e-10)
    rss = ((U - peer.predict(Q)) ** 2).sum()
    assert solution.residual_sum_of_squares == pytest.approx(rss, rel=1e-10)
    assert (solution.rank, solution.n_rows) == (4, 500)


@pytest.mark.parametrize("alpha", [0.0, 3.0])
def test_inverse_triangle_squares_to_the_inverse_of_the_penalised_cross_products(alpha):
    Q, U = problem()
    solution = solve_ridge(swept(Q, U), alpha)
    centred = Q - Q.mean(axis=0)
    expected = np.linalg.inv(centred.T @ centred + alpha * np.diag(Q.var(axis=0)))
    found = solution.inverse_triangle @ solution.inverse_triangle.T
    size = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    np.testing.assert_allclose(found / size, expected / size, rtol=0, atol=1e-10)


def test_no_columns_leave_the_mean():
    U = np.array([1.0, 2.0, 6.0])
    for alpha in (0.0, 1.0):
        solution = solve_ridge(swept(np.zeros((3, 0)), U), alpha)
        assert solution.intercept == pytest.approx(3.0, rel=1e-15)
        assert solution.residual_sum_of_squares == pytest.approx(14.0, rel=1e-14)
        assert (solution.rank, solution.coef.shape, solution.inverse_triangle.shape) == (0, (0,), (0, 0))


def test_no_rows_give_zeros_and_no_nan():
    solution = solve_ridge(TriangularFactor(4))
    assert solution.intercept == 0.0
    assert np.array_equal(solution.coef, [0.0, 0.0])
    assert (solution.rank, solution.residual_sum_of_squares) == (0, 0.0)


def test_parts_per_million_of_a_large_reading_survive():
    Q, U = problem()
    ppm = 1e-6 * 99_998.0 * (U - U.mean()) / U.std()
    solution, small = solve_ridge(swept(Q, 99_998.0 + ppm, (100, 200))), solve_ridge(swept(Q, ppm))
    # atol: the reading itself is rounded to 99 998 eps = 2e-11 ohm, sums over 500 rows to some ten times that
    np.testing.assert_allclose(predicted(solution, Q) - 99_998.0, predicted(small, Q), rtol=0, atol=5e-10)


@pytest.mark.parametrize("block", [7, 500])
@pytest.mark.parametrize("what", ["twice", "sum", "constant", "zero", "all of them", "fewer rows than columns"])
def test_dependent_columns_predict_like_lstsq_with_finite_coefficients(what, block):
    Q, U = problem()
    extra = {
        "twice": [Q[:, 1]],
        "sum": [Q[:, 0] / 1e-3 - Q[:, 2] / 10.0],
        "constant": [np.full(500, 0.1)],
        "zero": [np.zeros(500)],
        "all of them": [2 * Q[:, 3], Q[:, 0], np.full(500, 1e8 / 3), np.zeros(500), Q[:, 0] - Q[:, 3]],
        "fewer rows than columns": [],
    }[what]
    Q = np.column_stack((Q, *extra))
    Q, U = (Q[:3], U[:3]) if not extra else (Q, U)
    solution = solve_ridge(swept(Q, U, range(block, len(Q), block)))
    assert solution.rank == min(4, len(Q) - 1)
    # rtol, atol: offsets of up to 30 times the columns' variation, and coefficients that cancel by as much
    np.testing.assert_allclose(predicted(solution, Q), by_lstsq(Q, U), rtol=1e-10, atol=1e-9)
    unit = (Q - Q.mean(axis=0)) / np.where(solution.scale > 0, solution.scale, 1.0)
    flat = np.ptp(Q, axis=0) == 0
    unit[:, flat] = 0.0
    shortest = np.linalg.lstsq(unit, U - U.mean(), rcond=1e-10)[0]
    # of all coefficients that fit, the shortest ones on the columns' own scales
    np.testing.assert_allclose(np.where(flat, 0.0, solution.coef * solution.scale), shortest, rtol=0, atol=1e-8)
    assert (solution.coef[flat] == 0.0).all()


@pytest.mark.parametrize("wander", [1.0, 0.05])
def test_one_temperature_in_kelvin_and_in_celsius_shares_its_coefficient(wander):
    rng = np.random.default_rng(0)
    kelvin = 293.15 + rng.normal(0.0, wander, 500)
    celsius = kelvin - 273.15
    U = 5.0 + 2.0 * celsius + rng.normal(0.0, 0.1, 500)
    for Q in (np.column_stack((kelvin, celsius)), np.column_stack((kelvin - kelvin.mean(), celsius - celsius.mean()))):
        solution = solve_ridge(swept(Q, U))
        # The columns differ by the rounding of 293 K, 3e-14 K: nothing can be learned from that.
        # atol: the coefficient's own standard error, 0.1 / (0.05 sqrt(500)) = 0.09, in half
        assert solution.rank == 1
        np.testing.assert_allclose(solution.coef, [1.0, 1.0], rtol=0, atol=0.15)


@examples(40)
@given(value=st.floats(-1e12, 1e12), n=st.integers(2, 3000), block=st.integers(1, 700))
def test_constant_column_is_left_to_the_intercept(value, n, block):
    rng = np.random.default_rng(n)
    Q, U = np.column_stack((np.full(n, value), rng.normal(size=n))), rng.normal(size=n)
    solution = solve_ridge(swept(Q, U, range(block, n, block)))
    assert solution.coef[0] == 0.0
    assert solution.rank == 1


def orthogonal_sweep(matrix, target):
    """Least squares by Householder reflections in extended precision."""
    A = np.column_stack((matrix, target)).astype(np.longdouble)
    p = A.shape[1] - 1
    for j in range(p):
        v = A[j:, j].copy()
        v[0] += np.copysign(np.sqrt(v @ v), v[0])
        A[j:, j:] -= np.outer(v, (2 / (v @ v)) * (v @ A[j:, j:]))
    b = np.zeros(p, np.longdouble)
    for j in range(p - 1, -1, -1):
        b[j] = (A[j, p] - A[j, j + 1 : p] @ b[j + 1 :]) / A[j, j]
    return b


@pytest.mark.skipif(np.finfo(np.longdouble).eps > 1e-18, reason="no extended precision on this machine")
def test_24_neighbouring_time_constants_at_once_keep_the_digits_that_the_normal_equations_lose():
    n, n_train, noise = 84_000, 58_800, 1.0
    rng = np.random.default_rng(3)
    T = 20.0 + np.cumsum(rng.normal(0.0, 0.02, n)) + 2 * np.sin(2 * np.pi * np.arange(n) / 5760)
    tau = np.geomspace(150.0, 30_000.0, 24)
    lags, _ = lag_differences(T, np.full(n, 15.0), tau)
    Q = np.column_stack((T, lags))
    U = 100.0 + 5.0 * T + 4.0 * lags[:, 7] - 2.0 * lags[:, 16] + rng.normal(0.0, noise, n)
    full = np.column_stack((np.ones(n), Q))
    train, test = full[:n_train], full[n_train:]
    condition = np.linalg.cond(train / np.linalg.norm(train, axis=0))
    assert 3e7 < condition < 3e9  # the case of NUMERICS.md: 2e8

    exact = test @ orthogonal_sweep(train, U[:n_train])
    solution = solve_ridge(swept(Q[:n_train], U[:n_train], range(8192, n_train, 8192)))
    one_block = solve_ridge(swept(Q[:n_train], U[:n_train]))
    paper = np.linalg.inv(train.T @ train) @ (train.T @ U[:n_train])  # eq. (13) with eps = 0, as printed
    assert solution.rank == 25

    def off(values):
        return float(np.sqrt(np.mean((values - exact) ** 2))) / noise

    ours, whole = off(predicted(solution, Q[n_train:])), off(predicted(one_block, Q[n_train:]))
    printed = off(test @ paper)
    print(f"condition {condition:.1e}; off by {ours:.1e} in blocks, {whole:.1e} whole, {printed:.1e} by inv(Q'Q) Q'U")
    # The bar is far below what noise does to any fit; condition times eps is 4e-8, amplified where the test data leave
    # the range of the training data.
    assert ours <= 1e-4
    assert whole <= 1e-4
    assert printed > 1e-4

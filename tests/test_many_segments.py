"""Records of many runs: each starts anew, and its start is no cause and costs no more than its rows."""

import numpy as np
import pytest

from thermocorr import DynamicBiasRegressor
from thermocorr.datasets import make_record
from thermocorr.effects import InitialTransient, SeveralSteps, StaticPolynomial, ThermalLag
from thermocorr.effects.stream import equal_edges, own_starts, walk
from thermocorr.equations import TriangularFactor
from thermocorr.equations.leastsquares import solve_ridge
from thermocorr.model.fitting import sweep_effects
from thermocorr.records import Layout, read_record

pytestmark = pytest.mark.newest

TAUS = [200.0, 1500.0, 5000.0]


def in_runs(n_runs, n=6000, seed=3, **options):
    """A record that is cut into runs: each begins with an inner temperature that nobody knows."""
    record = make_record(n, seed=seed, **options)
    return record.drop(columns="reading").assign(run=np.arange(n) * n_runs // n), record["reading"]


def learned(X, y, effects):
    record = read_record(X, Layout(run="run"), y=y, quiet=True)
    for effect in effects:
        effect.learn(record)
    return record


def matrix(record, effects):
    """All columns of a record, shape (n, p)."""
    return np.vstack([step.columns for step in walk(effects, record, starts=own_starts(record))])


def test_rows_that_touch_few_of_many_columns_are_swept_as_any():
    """Blocks of columns that meet only in the last ones, and a row that joins them."""
    rng, rows, factor = np.random.default_rng(0), [], TriangularFactor(130)
    for k in (*range(0, 120, 3), 60, 61, 118):
        part = np.zeros((25, 130))
        part[:, k : k + 3], part[:, 124:] = rng.normal(size=(25, 3)), rng.normal(size=(25, 6))
        part[:, 122] = part[:, 124] * (k > 50)
        rows.append(part)
        factor.update(np.asfortranarray(part.copy()))
    every = np.vstack(rows)
    np.testing.assert_allclose(factor.r.T @ factor.r, every.T @ every, rtol=0, atol=1e-10)
    assert (np.tril(factor.r, -1) == 0).all() and factor.n_rows == len(every)
    halves = [TriangularFactor(130).update(np.asfortranarray(part)) for part in np.array_split(every, 2)]
    merged = TriangularFactor.merged(halves)
    np.testing.assert_allclose(merged.r.T @ merged.r, every.T @ every, rtol=0, atol=1e-10)
    chosen = [129, 5, *range(30, 125), 3]
    np.testing.assert_allclose(*(r.T @ r for r in (merged.select(chosen).r, every[:, chosen])), rtol=0, atol=1e-10)


@pytest.mark.parametrize("n_runs", [3, 40, 150])
def test_a_fit_to_many_runs_is_plain_least_squares(n_runs):
    X, y = in_runs(n_runs)
    model = DynamicBiasRegressor("temperature", TAUS, degree=2, run="run").fit(X, y)
    levels = [SeveralSteps(list(model._run_levels.times))]
    effects = [StaticPolynomial(2), ThermalLag(TAUS), InitialTransient(TAUS, model.features_.decay_share), *levels]
    record = learned(X, y, effects)
    rows = np.column_stack([np.ones(len(y)), matrix(record, effects)])
    solution = np.linalg.lstsq(rows, y.to_numpy(), rcond=None)[0]
    assert rows.shape[1] == 1 + len(model.coef_) >= n_runs
    np.testing.assert_allclose(model.predict(X), rows @ solution, rtol=0, atol=1e-6)
    np.testing.assert_allclose(model.coef_[:5], solution[1:6], rtol=1e-4)


def test_starts_are_taken_out_of_each_stretch_of_each_run():
    X, y = in_runs(20, n=2000)
    effects, starts = [StaticPolynomial(1), ThermalLag([300.0])], InitialTransient([200.0, 1500.0])
    record = learned(X, y, [*effects, starts])
    edges = equal_edges(record, 7)
    rows = np.column_stack([np.ones(len(y)), matrix(record, effects), y - y.iloc[0]])
    decays, run = matrix(record, [starts]), X["run"].to_numpy()
    for low, high, factor in zip(
        edges[:-1], edges[1:], sweep_effects(record, effects, edges, starts).chunks, strict=True
    ):
        left = rows[low:high].copy()
        for key in np.unique(run[low:high]):
            inside = run[low:high] == key
            own = decays[low:high][inside]
            Q = np.linalg.qr(own[:, own.any(axis=0)])[0]
            left[inside] -= Q @ (Q.T @ left[inside])
        assert factor.n_rows == high - low
        level = solve_ridge(factor).coef
        np.testing.assert_allclose(level, np.linalg.lstsq(left[:, :-1], left[:, -1], rcond=None)[0][1:], rtol=1e-7)


@pytest.mark.parametrize("seed", [3, 4])
@pytest.mark.parametrize("n_runs", [4, 20])
def test_the_error_falls_to_the_noise_though_each_run_starts_anew(n_runs, seed):
    """The slow body of the device had no start before: decays were left out by the length of their run."""
    X, y = in_runs(n_runs, n=12_000, seed=seed)
    model = DynamicBiasRegressor("temperature", run="run").fit(X, y)
    assert model.residual_std_ < 1.01 * y.attrs.get("noise", 0.2)
    one = DynamicBiasRegressor("temperature").fit(X.drop(columns="run"), y)
    assert abs(model.coef_[0] - one.coef_[0]) < 0.01 * abs(one.coef_[0])

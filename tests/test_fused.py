"""The compiled pass against the walk block by block, and against an extended-precision solution."""

import numpy as np
import pandas as pd
import pytest
from sklearn.base import clone

from thermocorr import DynamicBiasRegressor
from thermocorr.datasets import make_record
from thermocorr.effects import Covariate, Drift, InitialTransient, StaticPolynomial, Step, ThermalLag
from thermocorr.effects.stream import equal_edges
from thermocorr.equations import lag_differences, solve_ridge
from thermocorr.equations.leastsquares import Preconditioned
from thermocorr.estimators import fitting as fitting
from thermocorr.estimators import fused as binned
from thermocorr.estimators import fused as fused_columns
from thermocorr.estimators.fitting import sweep_effects
from thermocorr.records import Layout, read_record

pytest.importorskip("numba", reason="the compiled pass needs numba: pip install '.[fast]'")
TAUS = [60.0, 400.0, 3000.0]


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


def with_gaps(X, y):
    """Two stretches and single rows missing, a temperature missing here and there, no reading in a tenth."""
    keep = np.ones(len(X), bool)
    keep[2000:2600] = keep[6000:6100] = False
    keep[7::501] = False
    X, y = X[keep].copy(), y[keep].copy()
    X.iloc[100:4000:611, 0] = np.nan
    y[np.random.default_rng(5).random(len(y)) < 0.1] = np.nan
    return X, y


EFFECTS = {
    "plain": ([StaticPolynomial(2), ThermalLag(TAUS), InitialTransient(TAUS, 0.3)], {}),
    "lags alone": ([ThermalLag(TAUS)], {}),
    "two lags, two transients": (
        [InitialTransient([500.0], 1.0), ThermalLag([90.0]), ThermalLag(TAUS), InitialTransient(TAUS, 1.0)],
        {},
    ),
    "others": ([Drift(), StaticPolynomial(3), Step("12 h"), ThermalLag(TAUS), InitialTransient(TAUS, 0.3)], {}),
    "held": ([StaticPolynomial(1), ThermalLag(TAUS, hold="zero_order"), InitialTransient(TAUS, 0.3)], {}),
    "segments": ([StaticPolynomial(2), ThermalLag(TAUS), InitialTransient(TAUS, 1.0)], {"max_gap": 500.0}),
}


def swept(X, y, effects, layout, starts=None):
    record = read_record(X, Layout(**layout), y=y, quiet=True)
    for effect in (*effects, *([starts] if starts else [])):
        effect.learn(record)
    return sweep_effects(record, effects, equal_edges(record), starts)


@pytest.fixture
def both(monkeypatch):
    """What the compiled pass gives, and the walk."""

    monkeypatch.setattr(fused_columns, "FEWEST", 1)

    def run(*arguments):
        compiled = swept(*arguments)
        with monkeypatch.context() as changed:
            changed.setattr(fused_columns, "is_compiled", lambda: False)
            changed.setattr(fitting, "FusedSweep", None)
            return compiled, swept(*arguments)

    return run


def crosses(matrix, size):
    """Cross products relative to the lengths of the columns."""
    return (matrix.T @ matrix) / np.maximum(size, 1e-300) / np.maximum(size, 1e-300)[:, None]


def assert_same(compiled, walked):
    """Cross products of each stretch, relative to the columns' lengths over the record; states, averages."""
    size = np.linalg.norm(walked.total().r, axis=0)
    for one, other in zip(compiled.chunks, walked.chunks, strict=True):
        assert one.n_rows == other.n_rows
        np.testing.assert_allclose(crosses(one.r, size), crosses(other.r, size), rtol=0, atol=1e-12)
    for ends, others in zip(compiled.end_states, walked.end_states, strict=True):
        for end, other in zip(ends, others, strict=True):
            if other is None:
                assert end is None
            else:
                np.testing.assert_allclose(end.lag_difference, other.lag_difference, rtol=0, atol=1e-12)
                assert end.temperature == other.temperature
    for name in ("segment", "begins", "count", "known", "width"):
        np.testing.assert_array_equal(getattr(compiled.binned, name), getattr(walked.binned, name))
    np.testing.assert_allclose(compiled.binned.reading, walked.binned.reading, rtol=0, atol=1e-12)
    if walked.binned.columns is not None:
        np.testing.assert_allclose(compiled.binned.columns, walked.binned.columns, rtol=1e-10, atol=1e-12)


@pytest.mark.parametrize("jitter", [0.0, 0.5], ids=["regular", "irregular"])
@pytest.mark.parametrize("gaps", [False, True], ids=["whole", "gaps"])
@pytest.mark.parametrize("kind", list(EFFECTS))
def test_the_pass_gives_what_the_walk_gives(both, kind, gaps, jitter):
    X, y = room(jitter=jitter)
    X, y = with_gaps(X, y) if gaps else (X, y)
    effects, layout = EFFECTS[kind]
    assert_same(*both(X, y, effects, layout))


@pytest.mark.parametrize("kind", ["plain", "segments"])
def test_averages_of_a_long_record_have_its_columns(both, kind, monkeypatch):
    monkeypatch.setattr(binned, "HISTORY_ROWS", 1000)
    effects, layout = EFFECTS[kind]
    compiled, walked = both(*with_gaps(*room(jitter=0.3)), effects, layout)
    assert walked.binned.columns is not None
    assert_same(compiled, walked)


@pytest.mark.parametrize("rows", [300, 2048, 1 << 15])
def test_blocks_may_end_anywhere(both, rows, monkeypatch):
    monkeypatch.setattr(fused_columns.FusedColumns, "block_rows", lambda self: rows)
    effects, layout = EFFECTS["segments"]
    assert_same(*both(*with_gaps(*room(jitter=0.3)), effects, layout))


@pytest.mark.parametrize("rows", [3000, 1 << 15])
def test_rows_are_reflected_until_the_coordinates_know_enough(both, rows, monkeypatch):
    """Slow neighbouring lags of a room that stands still for long, moves a little, then much: few rows tell little."""
    reflected, reflect = [], Preconditioned.reflect

    def counted(self, first, block):
        reflected.append(len(block))
        return reflect(self, first, block)

    monkeypatch.setattr(Preconditioned, "reflect", counted)
    monkeypatch.setattr(fused_columns.FusedColumns, "block_rows", lambda self: rows)
    X, y = room(20_000)
    X.iloc[:4000, 0] = 23.0
    X.iloc[4000:6000, 0] = 23.0 + 1e-3 * np.sin(np.arange(2000) / 300)
    taus = np.geomspace(10.0, 60_000.0, 20).tolist()
    assert_same(*both(X, y, [StaticPolynomial(1), ThermalLag(taus), InitialTransient([500.0], 1.0)], {}))
    assert 5000 < sum(reflected) < len(X)


def test_decays_that_are_over_leave_their_tiles_as_they_are(both):
    """Of very different lives, in a run that begins anew: one ends within the first rows, one in the middle."""
    taus = [3.0, 40.0, 300.0, 1500.0]
    X, y = with_gaps(*room(jitter=0.3))
    assert_same(*both(X, y, [StaticPolynomial(1), ThermalLag(TAUS), InitialTransient(taus, 1.0)], {"max_gap": 500.0}))


def test_a_stretch_without_readings_has_an_empty_factor(both, capfd):
    """As where a fit learns from the rows before a date: LAPACK prints what it refuses."""
    X, y = room()
    y[4000:] = np.nan
    effects, layout = EFFECTS["plain"]
    compiled, walked = both(X.iloc[:6000], y[:6000], effects, layout)
    assert_same(compiled, walked)
    assert "illegal" not in "".join(capfd.readouterr())


def test_what_starts_of_many_runs_hold_is_taken_out(both):
    record = make_record(6000, seed=3)
    X, y = record[["temperature"]].assign(run=np.arange(6000) // 400), record["reading"]
    assert_same(*both(X, y, [StaticPolynomial(2), ThermalLag(TAUS)], {"run": "run"}, InitialTransient(TAUS, 1.0)))


@pytest.mark.filterwarnings("ignore")  # of gaps
@pytest.mark.parametrize("weighted", [False, True])
def test_a_model_is_the_same_with_and_without_compiled_code(weighted, monkeypatch):
    X, y = with_gaps(*room(20_000, jitter=0.3))
    weight = {"sample_weight": np.random.default_rng(1).uniform(0.1, 2.0, len(X))} if weighted else {}
    model = DynamicBiasRegressor("temperature", TAUS, effects=[Covariate("humidity")], max_gap=500.0)
    compiled = clone(model).fit(X, y, **weight)
    monkeypatch.setattr(fused_columns, "is_compiled", lambda: False)
    walked = clone(model).fit(X, y, **weight)
    errors = walked._standard_errors()
    assert np.abs((compiled.coef_ - walked.coef_) / errors[1:]).max() < 1e-6
    np.testing.assert_allclose(compiled._standard_errors(), errors, rtol=1e-6)
    np.testing.assert_allclose(compiled.predict(X), walked.predict(X), rtol=0, atol=1e-10)


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
    """Fitted values beside those of 80 bits, in units of the noise of the readings, 0.01."""
    X, y = room(20_000, seed=seed)
    effects = [StaticPolynomial(1), ThermalLag(taus.tolist())]
    found = swept(X, y, effects, {})
    solution = solve_ridge(found.total())
    T = X["temperature"].to_numpy()
    Q = np.column_stack((T - effects[0].reference_temperature_, lag_differences(T, np.full(len(T), 10.0), taus)[0]))
    U = y.to_numpy() - found.reading_offset
    wrong = np.asarray(exact(Q, U) - (solution.intercept + Q @ solution.coef), float)
    assert np.sqrt(np.mean(wrong**2)) < largest * 0.01

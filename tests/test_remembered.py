"""Searches in one record that leave out other readings: what one has swept, the next does not sweep again."""

from __future__ import annotations

import numpy as np
import pytest
from sklearn.base import clone

from thermocorr import DynamicBiasRegressor
from thermocorr.datasets import make_record
from thermocorr.estimators.holdout import fitted_to, time_blocks
from thermocorr.estimators.time_constants import folds as remembered
from thermocorr.estimators.time_constants.folds import Sweeps

N = 6000


@pytest.fixture
def swept(monkeypatch):
    """Counts the sweeps of searches."""
    calls = []
    plain, chunks = remembered.sweep_effects, Sweeps.chunks

    def counted(self, *given):
        with monkeypatch.context() as inside:
            inside.setattr(remembered, "sweep_effects", lambda *swept: calls.append(swept) or plain(*swept))
            return chunks(self, *given)

    monkeypatch.setattr(Sweeps, "chunks", counted)
    return calls


def data(**options):
    record = make_record(N, seed=5, noise=0.2, **options)
    return record[["temperature"]], record["reading"]


def same(one, other):
    assert one.time_constants_.tolist() == other.time_constants_.tolist()
    np.testing.assert_allclose(one.coef_, other.coef_, rtol=1e-9, atol=1e-9 * abs(other.coef_).max())
    assert one.intercept_ == pytest.approx(other.intercept_, rel=1e-12)


@pytest.mark.parametrize("options", [{}, {"gaps": 3}, {"irregular": 0.2}, {"runs": 12}])
def test_fits_beside_others_are_those_that_each_makes_alone(swept, options):
    X, y = data(**options)
    model, sweeps = DynamicBiasRegressor("temperature", products=False, max_gap="1 h"), Sweeps()
    readings = [y.to_numpy(float)]
    for block in (*time_blocks(y.to_numpy(), 5)[1:], slice(len(y) * 7 // 10, None)):
        readings.append(readings[0].copy())
        readings[-1][block] = np.nan
    for reading in readings:
        same(fitted_to(model, X, reading, sweeps), clone(model).fit(X, reading))
    if not options:
        assert len(swept) == 1


def test_another_offset_of_the_reading_changes_nothing(swept):
    """The reading in the middle of the first block that has any is taken off: here 1e5 times the noise from another."""
    X, y = data()
    reading, sweeps = y.to_numpy(float) + np.linspace(0.0, 2e5, N), Sweeps()
    model = DynamicBiasRegressor("temperature", products=False, screen=False)
    for known in (reading, np.where(np.arange(N) < N // 2, reading, np.nan)):
        same(fitted_to(model, X, known, sweeps), clone(model).fit(X, known))
    assert len(swept) == 1

"""Pieces of long curves: nothing that stands out is lost, nothing is drawn that is not there."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from thermocorr.interactive.tiles import BINS, Store, Tiles


@pytest.fixture(scope="module")
def store(tmp_path_factory):
    return Store(tmp_path_factory.mktemp("store"))


@settings(max_examples=60, deadline=None)
@given(
    n=st.integers(1, 40_000),
    pixels=st.integers(50, 400),
    low=st.floats(-0.1, 1.0),
    wide=st.floats(0.001, 1.2),
    segments=st.integers(1, 5),
    seed=st.integers(0, 99),
)
def test_extremes_of_a_piece_are_those_of_its_rows(store, n, pixels, low, wide, segments, seed):
    rng = np.random.default_rng(seed)
    values = rng.normal(size=n)
    values[rng.random(n) < 0.01] = np.nan
    values[rng.integers(n)] = 1e3
    place = np.cumsum(rng.uniform(0.5, 1.5, n))
    begins = np.unique(np.concatenate(([0], rng.integers(0, n, segments - 1))))
    names = [store.put(array.astype(float)) for array in (place, begins, values)]
    span = place[-1] - place[0]
    a, b = place[0] + low * span, place[0] + (low + wide) * span
    piece = Tiles(store).piece(names[0], names[1], [names[2]], a, b, pixels)
    (drawn,) = piece.curves
    assert len(drawn) == len(piece.place) and (np.diff(piece.place) >= 0).all()
    assert len(drawn) <= 4 * pixels + 3 * len(begins) + 4
    inside = (place >= a) & (place <= b)
    wanted = values[inside & np.isfinite(values)]
    known = drawn[np.isfinite(drawn)]
    if len(wanted):
        assert known.max() >= wanted.max() and known.min() <= wanted.min()
    assert np.isin(known, values).all()


def test_no_line_joins_two_segments(store):
    place, values = np.arange(1000.0), np.arange(1000.0)
    names = [store.put(array) for array in (place, np.array([0.0, 400.0]), values)]
    for pixels in (2000, 50):
        piece = Tiles(store).piece(names[0], names[1], [names[2]], -1e9, 1e9, pixels)
        (gap,) = np.flatnonzero(np.isnan(piece.curves[0]))
        assert piece.curves[0][gap - 1] < 400 <= piece.curves[0][gap + 1]


def test_means_are_those_of_the_rows(store):
    rng = np.random.default_rng(0)
    values = rng.normal(size=100_000)
    names = [store.put(array) for array in (np.arange(100_000.0), np.zeros(1), values)]
    piece = Tiles(store).piece(names[0], names[1], [names[2]], -1.0, 1e9, 800, [names[2]])
    (mean,) = piece.means.values()
    levels = values[: len(values) // piece.mean_rows * piece.mean_rows].reshape(-1, piece.mean_rows).mean(axis=1)
    np.testing.assert_allclose(np.unique(mean)[[0, -1]], [levels.min(), levels.max()], rtol=1e-12)
    few = Tiles(store).piece(names[0], names[1], [names[2]], 5.0, 20.0, 800, [names[2]])
    assert few.means == {} and few.rows_per_point == 1


def test_a_cloud_has_the_means_of_all_rows(store):
    rng = np.random.default_rng(1)
    x, y = rng.uniform(0, 10, 50_000), rng.normal(size=50_000)
    x[:7] = np.nan
    cloud = Tiles(store).cloud(store.put(x), store.put(y))
    edges = np.linspace(np.nanmin(x), np.nanmax(x), BINS + 1)
    edges[-1] += 1.0
    for k, mean in enumerate(cloud["mean"]):
        inside = (x >= edges[k]) & (x < edges[k + 1])
        assert mean == pytest.approx(y[inside].mean(), abs=1e-9)
    assert cloud["count"].sum() == 50_000 - 7
    empty = Tiles(store).cloud(store.put(np.full(5, np.nan)), store.put(np.zeros(5)))
    assert all(len(part) == 0 for part in empty.values())


def test_equal_arrays_are_kept_once_and_others_removed(tmp_path):
    store = Store(tmp_path)
    one, same, other = store.put(np.arange(3.0)), store.put(np.arange(3.0)), store.put(np.arange(4.0))
    assert one == same != other and len(list(tmp_path.iterdir())) == 2
    store.keep([one])
    assert [path.stem for path in tmp_path.iterdir()] == [one]

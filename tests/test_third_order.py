"""Products of three lags, eq. (20): the cube of an inner temperature needs them."""

import numpy as np
import pandas as pd
import pytest

from thermocorr import DynamicBiasRegressor, OnlineCorrector, compare_variants

pytestmark = pytest.mark.filterwarnings("ignore::thermocorr.RecordWarning")
TAU = 1800.0


@pytest.fixture(scope="module")
def cubic():
    """A device that feels the cube of a temperature inside of it, and no noise."""
    rng = np.random.default_rng(0)
    n, step = 6000, 60.0
    T = 20 + 3 * np.sin(2 * np.pi * np.arange(n) * step / 30_000) + np.cumsum(rng.normal(0, 0.03, n))
    inner = np.empty(n)
    inner[0] = T[0]
    decay = np.exp(-step / TAU)
    for k in range(1, n):  # exact for a straight line between samples
        slope = (T[k] - T[k - 1]) / step
        inner[k] = T[k] - slope * TAU + (inner[k - 1] - T[k - 1] + slope * TAU) * decay
    y = 100 + 0.5 * (inner - 20) + 0.02 * (inner - 20) ** 3
    index = pd.Timestamp("2024-01-01") + pd.to_timedelta(np.arange(n) * step, unit="s")
    return pd.DataFrame({"temperature": T}, index=index), pd.Series(y, index=index, name="reading")


def fitted(cubic, products):
    return DynamicBiasRegressor("temperature", [TAU], 3, products=products).fit(*cubic)


def test_the_cube_of_an_inner_temperature_is_removed_whole(cubic):
    left = [fitted(cubic, products).residual_std_ for products in (False, True, 3)]
    assert left[0] > 1e-2 and left[1] > 1e-3
    assert left[2] < 1e-9


def test_two_is_true(cubic):
    np.testing.assert_array_equal(fitted(cubic, 2).coef_, fitted(cubic, True).coef_)


def test_live_correction_has_them(cubic):
    X, _ = cubic
    model = fitted(cubic, 3)
    live = OnlineCorrector(model)
    later = X[-50:].set_axis(X.index[-50:] + (X.index[-1] - X.index[-51]))
    whole = model.bias(later)
    for time, row in later.iterrows():
        sample = live.update(time, row["temperature"], 1.0)
        assert sample.bias == pytest.approx(whole[time], abs=1e-9)


def test_they_are_a_variant(cubic):
    X, y = cubic
    noisy = y + np.random.default_rng(1).normal(0, 1e-3, len(y))
    table = compare_variants(X, noisy, time_constants=[TAU], degree=3, products=3).frame()
    assert table["held_out_rms"].idxmin() == "dynamic nonlinear with products"


@pytest.mark.parametrize("products", [1.0, 4, "three", None])
def test_other_orders_are_refused(cubic, products):
    with pytest.raises(ValueError, match="products"):
        fitted(cubic, products)

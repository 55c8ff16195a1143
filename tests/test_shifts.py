"""Every delay of whole rows at once: against columns written out, and a delay that only its own neighbourhood shows."""

import numpy as np
import pandas as pd
import pytest

from thermocorr import DynamicBiasRegressor, diagnose
from thermocorr.effects import Drift
from thermocorr.judgement.scan import Shifts, filtered
from thermocorr.judgement.score import Comparison


def delayed(T, segment, rows):
    """The temperature of some rows ago less that of now; before a segment began it was that of its first row."""
    parts = []
    for number in np.unique(segment):
        own = T[segment == number]
        parts.append(np.concatenate((np.full(min(rows, len(own)), own[0]), own[: max(len(own) - rows, 0)])) - own)
    return np.concatenate(parts)


def test_all_delays_at_once_gain_what_each_does_alone():
    rng = np.random.default_rng(1)
    segment, span = np.repeat([0, 1, 4], [1500, 6, 700]), np.repeat([0, 1], [1506, 700])
    T, n = np.cumsum(rng.standard_normal(2206)) + 300, 2206
    weight = np.where(np.arange(n) < 900, 1.0, 0.4)
    base = np.column_stack((np.ones(n), T, rng.standard_normal(n))) * weight[:, None]
    reading = (rng.standard_normal(n) + 0.3 * delayed(T, segment, 11)) * weight
    judged = Comparison(reading, base, span)
    judged.add([(delayed(T, segment, rows) * weight)[:, None] for rows in range(1, 16)])
    shifts = Shifts(judged, T, segment, weight)
    assert shifts.most == 15
    for theta in (judged.base.theta, judged.only_white()):
        np.testing.assert_allclose(
            shifts.gains(judged, theta, filtered(judged, theta)), judged.screen(theta), rtol=1e-6, atol=1e-8
        )
    theta = judged.base.theta
    assert shifts.gains(judged, theta, filtered(judged, theta)).argmax() == 10


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("returns", [False, True])
def test_a_drift_hides_where_temperature_and_time_go_together(seed, returns):
    """A chamber that goes up in six steps, or up and down again and again; a drift of four noises is there."""
    n, rng = 720, np.random.default_rng(seed)
    level = np.arange(n) // 120 if not returns else np.abs(np.arange(n) // 20 % 12 - 6)
    room = pd.Series(12.0 + 4 * level).ewm(alpha=0.3).mean()
    felt = room.ewm(alpha=1 / 20, adjust=False).mean()
    stamps = pd.date_range("2024-05-01", periods=n, freq="min")
    reading = 3 * room - 2 * felt + 4 * np.linspace(0, 1, n) + rng.standard_normal(n)
    X, y = pd.DataFrame({"temperature": room.to_numpy()}, stamps), pd.Series(reading.to_numpy(), stamps)
    model = DynamicBiasRegressor("temperature", ["8 min", "20 min"]).fit(X, y)
    found = diagnose(model, X, y)
    assert ("can mimic a drift" in str(found).replace("\n    ", " ")) is not returns
    assert (found.verdict != "nothing missing") is returns
    assert "signed" not in set(model.uncertainty(X, y, diagnosis=found).frame()["status"])
    aged = DynamicBiasRegressor("temperature", ["8 min", "20 min"], effects=[Drift()]).fit(X, y)
    assert not diagnose(aged, X, y).left.drift_hides

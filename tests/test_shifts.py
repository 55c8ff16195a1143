"""Every delay of whole rows at once: against columns written out, and a delay that only its own neighbourhood shows."""

import numpy as np
import pandas as pd
import pytest

from thermocorr import DynamicBiasRegressor, diagnose
from thermocorr.datasets import make_record
from thermocorr.effects import Drift
from thermocorr.judgement.anywhere import filtered
from thermocorr.judgement.blocks import said
from thermocorr.judgement.family import Family
from thermocorr.judgement.likelihood import Comparison
from thermocorr.judgement.shifts import Shifts


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


def test_no_delay_is_tried_where_segments_are_short():
    segment = np.repeat(np.arange(30), 60)
    T = np.random.default_rng(2).standard_normal(1800)
    judged = Comparison(T, np.ones((1800, 1)), segment)
    theta, weight = judged.base.theta, np.ones(1800)
    assert Shifts(judged, T, segment, weight).gains(judged, theta, filtered(judged, theta)).shape == (0,)


@pytest.mark.parametrize("seed", [1, 2])
def test_a_delay_between_the_points_of_the_grid_is_named_where_noise_wanders(seed):
    """A room that jitters: what a delay of 37 rows leaves beside many lags has nothing to do with one of 34 or 40."""
    rng, n = np.random.default_rng(seed), 6000
    T = 23 + pd.Series(rng.standard_normal(n)).ewm(alpha=0.3).mean().to_numpy() + np.sin(np.arange(n) / 500)
    wander = np.cumsum(rng.standard_normal(n)) * 0.02
    reading = 2 * T + 0.15 * np.concatenate((np.full(37, T[0]), T[:-37])) + 0.5 * rng.standard_normal(n) + wander
    times = pd.to_datetime("2026-01-01") + pd.to_timedelta(10 * np.arange(n), unit="s")
    X = pd.DataFrame({"temperature": T}, index=times)
    found = diagnose(DynamicBiasRegressor("temperature").fit(X, reading), X, reading)
    assert found.causes[0].effect.kind == "delay" and found.causes[0].effect.delay == pytest.approx(370, rel=0.02)


@pytest.mark.parametrize("seed", [1, 2])
def test_a_delay_is_named_where_steps_are_uneven(seed):
    """So many rows of 20 s, and one of 60 s in five, are longer than as many usual steps: 62 rows last 1736 s."""
    rng, n = np.random.default_rng(seed), 9000
    seconds = np.cumsum(np.where(np.arange(n) % 5, 20.0, 60.0))
    T = 23 + rng.standard_normal(n) + np.sin(seconds / 15_000)
    late = np.interp(seconds - 1730.0, seconds, T)  # between 61 and 62 rows
    X = pd.DataFrame({"temperature": T, "time": seconds})
    reading = 2 * T + 0.1 * late + 0.5 * rng.standard_normal(n) + np.cumsum(rng.standard_normal(n)) * 0.02
    found = diagnose(DynamicBiasRegressor("temperature", time="time").fit(X, reading), X, reading)
    assert found.causes[0].effect.kind == "delay" and found.causes[0].effect.delay == pytest.approx(1730, rel=0.01)


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
    assert ("can take the place of a drift" in str(found).replace("\n    ", " ")) is not returns
    assert (found.verdict != "nothing missing") is returns
    assert "signed" not in set(model.uncertainty(X, y, diagnosis=found).frame()["status"])
    aged = DynamicBiasRegressor("temperature", ["8 min", "20 min"], effects=[Drift()]).fit(X, y)
    assert not diagnose(aged, X, y).left.drift_hides


def test_what_both_noises_find_is_tried_once(monkeypatch):
    """While a column is missing, wandering noise and white noise find the same delays."""
    record = make_record(3000, effects={"covariate": 3.0}, seed=5)
    X, y = record.drop(columns="reading"), record["reading"]
    plain, looks = Family.add_anywhere, []

    def noted(family):
        before = len(family.tried)
        plain(family)
        looks.append([said(tried.effect) for tried in family.tried[before:]])

    monkeypatch.setattr(Family, "add_anywhere", noted)
    assert diagnose(DynamicBiasRegressor("temperature").fit(X, y), X, y).causes
    assert max(map(len, looks)) > 8 and all(len(set(found)) == len(found) for found in looks)

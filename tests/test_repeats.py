"""Readings that stand in several rows, and readings at the end of a range: neither is a reading of its row."""

import warnings

import numpy as np
import pandas as pd
import pytest

from thermocorr import DynamicBiasRegressor, ParquetLog, diagnose
from thermocorr.datasets import make_record
from thermocorr.equations.sensor_artefacts import ends_of_range, filled_in, is_repeated
from thermocorr.records.errors import RecordError, RecordWarning

N = 3000


def record(seed):
    """A device of one lag in a wandering room, noise of standard deviation 1: frame and readings."""
    rng = np.random.default_rng(seed)
    x = np.cumsum(rng.standard_normal(N + 500))
    room = 22 + 2 * pd.Series(x).ewm(span=60).mean().to_numpy() / 20
    bias = 8 * (room - pd.Series(room).ewm(alpha=1 / 40, adjust=False).mean().to_numpy())
    stamps = pd.date_range("2024-10-07", periods=N, freq="min")
    reading = 100 + (bias + 3 * room)[500:] + rng.standard_normal(N)
    return pd.DataFrame({"temperature": room[500:].round(3)}, index=stamps), pd.Series(reading, stamps, name="reading")


def told(X, y):
    """Model, diagnosis and what was warned of."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", RecordWarning)
        model = DynamicBiasRegressor("temperature").fit(X, y)
    return model, diagnose(model, X, y), " ".join(str(w.message) for w in caught)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("rows", [2, 5, 3.4])
def test_readings_that_stand_in_several_rows_are_no_effect(seed, rows):
    X, y = record(seed)
    first = np.minimum(np.ceil(np.floor(np.arange(N) / rows) * rows).astype(int), N - 1)
    repeated = pd.Series(y.to_numpy()[first], y.index, name="reading")
    model, found, said = told(X, repeated)
    assert found.verdict == "nothing missing"
    again = N - len(np.unique(first))
    assert f"{again} of the readings are the one of the row before" in said
    once, other = repeated.mask(repeated == repeated.shift()), DynamicBiasRegressor("temperature")
    assert model.residual_std_ == pytest.approx(other.fit(X, once).residual_std_, rel=1e-12)
    assert model.flags(X, repeated).eq("").all()  # later rows are corrected: what is measured is still shown


@pytest.mark.long
@pytest.mark.newest
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(("rows", "digits"), [(2, 12), (2, 2), (3, 3), (5, 12), (5, 3)])
def test_readings_between_which_rows_were_filled_in_are_no_effect(seed, rows, digits):
    """Waves and leads were told of straight lines."""
    X, y = record(seed)
    bends = np.arange(0, N, rows)
    lines = pd.Series(np.interp(np.arange(N), bends, y.to_numpy()[bends]).round(digits), y.index, name="reading")
    model, found, said = told(X, lines)
    assert found.verdict == "nothing missing" and "the rows between rarer readings were filled in" in said
    rare = DynamicBiasRegressor("temperature").fit(X, lines.mask(np.arange(N) % rows != 0))
    assert model.residual_std_ == pytest.approx(rare.residual_std_, rel=0.02)
    assert model.flags(X, lines).eq("").all()


@pytest.mark.parametrize("rows", [2, 3, 6, 10, 30])
@pytest.mark.parametrize("n", [3000, 8000, 50_000])
def test_filled_in_rows_are_told_in_records_of_any_length(rows, n):
    """Of long ones some stretches are looked at, whose ends are no bends; nor are still rows at the end."""
    X = pd.DataFrame({"temperature": np.sin(np.arange(n) / 500)})
    lines = pd.Series(np.random.default_rng(n + rows).standard_normal(n)).where(np.arange(n) % rows == 0).interpolate()
    spoiled = lines.mask(np.random.default_rng(0).random(n) < 0.01, 500.0)
    for y in (lines, lines.astype(np.float32), lines.mask(np.arange(n) % 97 == 5), spoiled if rows <= 10 else lines):
        with pytest.warns(RecordWarning, match="rows between rarer readings were filled in"):
            DynamicBiasRegressor("temperature", [20.0], sampling_period=1.0).fit(X, y)


def test_glitches_of_a_temperature_that_was_filled_in_are_found():
    X, y = record(0)
    rare = X["temperature"] + 0.1 * np.random.default_rng(0).standard_normal(N)
    X["temperature"] = rare.where(np.arange(N) % 5 == 0).interpolate()
    X.iloc[[500, 1001, 2002], 0] += 1.0
    _, _, said = told(X, y)
    assert "3 temperatures left out as spikes: rows 500, 1001, 2002." in said


def test_too_few_readings_between_filled_in_rows_are_said():
    X, y = record(0)
    rare = y.where(np.arange(N) % 48 == 0).interpolate()
    with pytest.warns(RecordWarning, match="filled in"):
        model = DynamicBiasRegressor("temperature", [60.0]).fit(X, rare)
    with pytest.raises(RecordError, match=r"100 are needed, beside what was left out \(filled in\)\. Record longer"):
        diagnose(model, X, rare)


@pytest.mark.parametrize("seed", range(5))
def test_smooth_and_straight_readings_were_not_filled_in(seed):
    rng, row = np.random.default_rng(seed), np.arange(N)
    noise = pd.Series(rng.standard_normal(N))
    for values in (
        0.9 * row,
        0.9 * row + 0.1 * noise,
        20 * np.sin(row / 30) + 0.01 * noise,
        noise.ewm(span=20).mean(),
        noise.rolling(5, min_periods=1).mean(),
        np.abs(row % 200 - 100.0),
        np.cumsum(noise),
    ):
        for digits in (0, 1, 3, 12):
            assert np.isnan(filled_in(np.round(np.asarray(values), digits)))


def test_a_parquet_log_is_screened_as_a_frame_is(tmp_path):
    pytest.importorskip("pyarrow", reason="Parquet needs pyarrow: pip install '.[parquet]'")
    X, y = record(0)
    once = y.clip(upper=y.quantile(0.98)).to_numpy()[np.arange(N) // 5 * 5]
    X.assign(reading=once).to_parquet(tmp_path / "log.parquet", row_group_size=777)
    log = ParquetLog(tmp_path / "log.parquet")
    model = DynamicBiasRegressor("temperature", ["5 min"], max_gap="10 min")
    expected = model.fit(X, pd.Series(once, X.index))
    notes, coef = expected.notes_, expected.coef_
    found = model.fit(log, log["reading"])
    assert found.notes_ == notes
    np.testing.assert_array_equal(found.coef_, coef)


@pytest.mark.parametrize("seed", range(3))
def test_spikes_are_found_among_repeated_readings(seed):
    X, y = record(seed)
    y.iloc[[500, 1500]] += 60.0
    _, found, said = told(X, y.iloc[np.arange(N) // 5 * 5].set_axis(y.index))
    assert "2 readings left out as spikes: rows 500, 1500." in said
    assert found.verdict == "nothing missing"


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("share", [0.99, 0.97])
def test_clipped_readings_are_no_effect(seed, share):
    X, y = record(seed)
    end = float(y.quantile(share))
    clipped = y.clip(upper=end)
    model, found, said = told(X, clipped)
    count = int((clipped == end).sum())
    left_out = int(said.partition(" readings left out as clipped")[0].rpartition(" ")[2])
    assert count < left_out < 15 * count
    assert f"readings left out as clipped, at exactly {end:.10g} or so near" in said
    assert found.verdict == "nothing missing"
    assert model.flags(X, clipped).eq("sentinel").sum() == count


def test_a_temperature_that_is_measured_seldom_is_said_and_kept():
    X, y = record(0)
    seldom = X.iloc[np.arange(N) // 10 * 10].set_axis(X.index)
    rng = np.random.default_rng(0)
    seldom["temperature"] = np.round(seldom["temperature"] + 0.02 * rng.standard_normal(N // 10).repeat(10), 3)
    model, _, said = told(seldom, y)
    assert "measured less often than the readings" in said
    assert model.flags(seldom, y).eq("").all()


@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize("digit", [1e-6, 0.1, 0.3, 1.0, 3.0, 10.0])
def test_coarse_readings_and_devices_at_rest_are_neither(seed, digit):
    X, y = record(seed)
    at_rest = y.where(np.arange(N) > N // 4, y.iloc[0])
    loud = y + np.where(np.arange(N) // 50 % 2, 20, 0.1) * np.random.default_rng(seed).standard_normal(N)
    for values in (y, at_rest, loud, X["temperature"] * 50):
        rounded = np.round(values.to_numpy() / digit) * digit
        assert not is_repeated(rounded)
        assert ends_of_range(rounded) == ()
        assert np.isnan(filled_in(rounded))


COARSE = {
    "one finer value": lambda c, w: np.where(np.arange(N) == 777, c + 0.0003, c),
    "four digits across a decade": lambda c, w: np.array([float(f"{value:.3g}") for value in w]),
    "two tares": lambda c, w: np.where(np.arange(N) < N // 2, c - 1.3, c - 1.3003),
    "two ways of scaling": lambda c, w: np.where(np.arange(N) < N // 2, np.round(c * 10) * 0.1, np.round(c * 10) / 10),
    "two factors": lambda c, w: np.where(np.arange(N) < N // 2, c, c * 1.00037),
    "a difference": lambda c, w: c - np.round(0.5 * w + 0.03, 1),
    "a ratio": lambda c, w: c / np.round(0.5 * w + 0.03, 1),
}


@pytest.mark.parametrize("how", COARSE)
@pytest.mark.parametrize("noise", [0.01, 0.05, 0.1, 0.2])
def test_coarse_readings_of_more_than_one_digit_are_not_repeated(how, noise):
    for seed in range(5):
        rng = np.random.default_rng(seed)
        w = 10 + 0.02 * np.cumsum(rng.standard_normal(N)) + noise * rng.standard_normal(N)
        assert not is_repeated(COARSE[how](np.round(w, 1), w))
        assert np.isnan(filled_in(COARSE[how](np.round(w, 1), w)))


@pytest.mark.long
@pytest.mark.parametrize("rows", [12_000, 60_000])
def test_long_clipped_records_hide_nothing(rows):
    """What is left just below the end has its noise cut on one side: knees and disturbances were told of it."""
    rng = np.random.default_rng(1)
    slow = pd.Series(np.cumsum(rng.standard_normal(rows + 500))).ewm(span=60).mean().to_numpy()
    room = 22 + slow / 10 / np.sqrt(rows / 3000)
    bias = 8 * (room - pd.Series(room).ewm(alpha=1 / 40, adjust=False).mean().to_numpy()) + 3 * room
    stamps = pd.date_range("2024-10-07", periods=rows, freq="min")
    y = pd.Series(100 + bias[500:] + rng.standard_normal(rows), stamps)
    X = pd.DataFrame({"temperature": room[500:].round(3)}, stamps)
    _, found, said = told(X, y.clip(upper=y.quantile(0.97)))
    assert "left out as clipped" in said
    assert found.verdict == "nothing missing"


@pytest.mark.parametrize("digits", [10, 30])
def test_repeated_readings_are_told_down_to_few_digits_of_noise(digits):
    _, y = record(1)
    assert is_repeated(np.repeat(np.round(y.to_numpy() * digits), 3))


def test_a_switch_is_neither():
    switch = np.repeat(np.random.default_rng(0).integers(0, 2, 300), 7).astype(float)
    assert not is_repeated(switch)
    assert ends_of_range(switch) == ()


def test_the_builtin_record_has_neither():
    frame = make_record(seed=1)
    for name in ("temperature", "reading"):
        assert not is_repeated(frame[name].to_numpy())
        assert ends_of_range(frame[name].to_numpy()) == ()

"""A device that was not at rest when the record began, as none is: the model has its start, and nothing is missing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from scipy.signal import lfilter

from thermocorr import DynamicBiasRegressor, diagnose, refine
from thermocorr.datasets import make_record
from thermocorr.effects import InitialTransient

pytestmark = pytest.mark.newest

BEFORE, N = 4000, 12_000
SETTINGS = [("lab", "slab", 60.0, 31), ("outdoor", "plate", 600.0, 32), ("chamber", "layered", 30.0, 33),
            ("lab", "box", 60.0, 34)]  # fmt: skip


def cut(setting, device, step, seed, effects=None):
    """A record whose device has followed the room for some time before it begins."""
    options = {"sampling_period": step, "setting": setting, "device": device, "noise": 0.2, "seed": seed}
    record = make_record(BEFORE + N, effects=effects, **options).iloc[BEFORE:]
    return record.drop(columns="reading"), record["reading"]


@pytest.mark.parametrize(("setting", "device", "step", "seed"), SETTINGS)
@pytest.mark.parametrize("pause", [0, 300])
def test_nothing_is_missing_where_a_record_begins_in_the_middle(setting, device, step, seed, pause):
    """An initial transient was told, or a lead, of most such records."""
    X, y = cut(setting, device, step, seed)
    kept = np.r_[0 : N // 3, N // 3 + pause : N]
    model = DynamicBiasRegressor("temperature", max_gap=20 * step).fit(X.iloc[kept], y.iloc[kept])
    found = diagnose(model, X.iloc[kept], y.iloc[kept])
    assert found.verdict == "nothing missing" and not found.causes


def test_an_effect_is_found_beside_a_start():
    X, y = cut(*SETTINGS[0], effects={"covariate": 1.0})
    found = diagnose(DynamicBiasRegressor("temperature").fit(X, y), X, y)
    assert [cause.effect.kind for cause in found.causes] == ["covariate"]


def test_a_start_is_missing_where_the_model_has_none():
    X, y = cut(*SETTINGS[0])
    model = DynamicBiasRegressor("temperature", initial_state="equilibrium").fit(X, y)
    assert isinstance(diagnose(model, X, y).best, InitialTransient)


def test_an_ageing_is_told_from_the_start_of_a_device_at_rest():
    """Many decays of free size say as much as it; it has one column."""
    options = {"sampling_period": 60.0, "setting": "lab", "device": "slab", "noise": 0.2, "seed": 7}
    record = make_record(20_160, effects={"log_ageing": 2.0}, **options)
    X, y = record.drop(columns="reading"), record["reading"]
    found = diagnose(DynamicBiasRegressor("temperature").fit(X, y), X, y)
    assert found.best is not None and found.best.kind == "log_ageing"


def drifting(seed):
    """A device that is not at rest when its record begins, and drifts by seven times the noise."""
    rng, n, before = np.random.default_rng(seed), 2500, 900
    walk = lfilter([1 / 120], [1, -119 / 120], rng.standard_normal(n + before) * np.sqrt(240))
    T = 22 + 1.2 * lfilter([1 / 37], [1, -36 / 37], walk)
    bias = 0.3 * T - lfilter([1 / 20], [1, -19 / 20], T - T[0])
    y = 15 * bias / bias.std() + 7 * np.linspace(0, 1, n + before) + rng.standard_normal(n + before)
    index = pd.date_range("2024-01-01", periods=n + before, freq="min")
    return pd.DataFrame({"temperature": T}, index)[before:], y[before:]


def test_what_lags_as_long_as_the_record_keep_of_the_time_before_is_no_start():
    """The fit takes a drift for such lags. Their decays passed for the start: in one of these the drift was named."""
    named = 0
    for X, y in map(drifting, range(60, 68)):
        found = diagnose(DynamicBiasRegressor("temperature").fit(X, y), X, y)
        kinds = {e.kind for cause in found.causes for e in (cause.effect, *cause.confusable_with)}
        named += bool(kinds & {"drift", "log_ageing"})
    assert named >= 5


def rms(values):
    return float(np.sqrt(np.mean(np.asarray(values) ** 2)))


@pytest.mark.parametrize(
    ("setting", "device", "n", "step", "seed"),
    [("lab", "plate", 20_160, 60.0, 301), ("outdoor", "box", 17_280, 600.0, 303)],
)
def test_a_start_that_the_model_s_decays_miss_is_missing(setting, device, n, step, seed):
    """It was taken for the model's, and nothing or a lag was said to be missing: the slow lags were bent for it."""
    options = {"sampling_period": step, "setting": setting, "device": device, "noise": 0.2, "seed": seed}
    record, truth = make_record(n, effects={"initial_transient": 2.0}, return_truth=True, **options)
    X, y = record.drop(columns="reading"), record["reading"]
    model = DynamicBiasRegressor("temperature").fit(X, y)
    (cause,) = diagnose(model, X, y).causes
    (planted,) = truth.attrs["effects"]["initial_transient"]["parameters"]["time_constants"]
    assert isinstance(cause.effect, InitialTransient)
    assert cause.effect.time_constants[0] == pytest.approx(planted, rel=0.1)
    better = refine(model, X, y).model_
    assert rms(better.predict(X) - truth["noise_free"]) < 0.3 * rms(model.predict(X) - truth["noise_free"])
    without = diagnose(model, X, y, exclude=("initial_transient",)).causes
    assert not any(isinstance(cause.effect, InitialTransient) for cause in without)


def test_what_goes_on_and_is_as_likely_as_a_start_is_said():
    """An ageing was taken for the start of a record, which the model has; readings were signed."""
    options = {"sampling_period": 600.0, "setting": "outdoor", "device": "layered", "noise": 0.2, "seed": 3002}
    record = make_record(17_280, effects={"hysteresis": 1.0, "log_ageing": 1.0}, **options)
    X, y = record.drop(columns="reading"), record["reading"]
    found = diagnose(DynamicBiasRegressor("temperature").fit(X, y), X, y)
    assert [cause.effect.kind for cause in found.causes] == ["hysteresis"]
    assert [text.split(":")[0] for text in found.left.start_or] == ["log ageing"]
    for text in (str(found), found.to_html()):
        assert "start of the record is as likely log ageing" in " ".join(text.split())
    better = DynamicBiasRegressor("temperature").with_effect(found.best).fit(X, y)
    (cause,) = diagnose(better, X, y).causes  # beside the hysteresis, the two are told to be one set
    assert {effect.kind for effect in (cause.effect, *cause.confusable_with)} == {"initial_transient", "log_ageing"}


def test_readings_are_not_signed_where_a_start_may_go_on():
    X, y = cut(*SETTINGS[0])
    model = DynamicBiasRegressor("temperature").fit(X, y)
    found = diagnose(model, X, y)
    assert not model.uncertainty(X[-100:], y[-100:], diagnosis=found).why_provisional
    doubtful = replace(found, left=replace(found.left, start_or=("log ageing",)))
    assert "goes on" in model.uncertainty(X[-100:], y[-100:], diagnosis=doubtful).why_provisional

"""A device that was not at rest when the record began, as none is: the model has its start, and nothing is missing."""

from dataclasses import replace

import pytest

from thermocorr import DynamicBiasRegressor, diagnose
from thermocorr.datasets import make_record
from thermocorr.effects import InitialTransient, ThermalLag

pytestmark = pytest.mark.newest

BEFORE, N = 4000, 12_000
SETTINGS = [("lab", "slab", 60.0, 31), ("outdoor", "plate", 600.0, 32), ("chamber", "layered", 30.0, 33),
            ("lab", "box", 60.0, 34)]  # fmt: skip


def cut(setting, device, step, seed, effects=None):
    """A record whose device has followed the room for some time before it begins."""
    options = {"sampling_period": step, "setting": setting, "device": device, "noise": 0.2, "seed": seed}
    record = make_record(BEFORE + N, effects=effects, **options).iloc[BEFORE:]
    return record.drop(columns="reading"), record["reading"]


def test_a_start_is_missing_where_the_model_has_none():
    X, y = cut(*SETTINGS[0])
    times = DynamicBiasRegressor("temperature").fit(X, y).time_constants_
    model = DynamicBiasRegressor("temperature", [], effects=[ThermalLag(times)]).fit(X, y)
    found = diagnose(model, X, y)
    assert isinstance(found.best, InitialTransient) and found.suspects[0].matters_from > 10


def test_readings_are_not_signed_where_a_start_may_go_on():
    X, y = cut(*SETTINGS[0])
    model = DynamicBiasRegressor("temperature").fit(X, y)
    found = diagnose(model, X, y)
    assert not model.uncertainty(X[-100:], y[-100:], diagnosis=found).why_provisional
    doubtful = replace(found, left=replace(found.left, start_or=("log ageing",)))
    assert "continues" in model.uncertainty(X[-100:], y[-100:], diagnosis=doubtful).why_provisional

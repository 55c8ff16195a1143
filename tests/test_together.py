"""Causes that are one: a wave with its harmonics."""

from __future__ import annotations

import pytest

from thermocorr import DynamicBiasRegressor, diagnose, refine
from thermocorr.datasets import make_record
from thermocorr.effects import Drift, Periodic
from thermocorr.judgement.found import FoundSuspect
from thermocorr.judgement.together import as_one
from thermocorr.records import Layout, read_record

DAY = 86_400.0
RECORD = read_record(make_record(10_000, seed=1)[["temperature"]], Layout(), quiet=True)
"""A week."""


def found(effect, share=0.2, **more):
    return FoundSuspect(effect=effect, standing="proven", share=share, gain_db=1.0, later_db=2.0, p_value=1e-9, **more)


def waves(*causes):
    return [(float(cause.effect.period), cause.effect.harmonics) for cause in causes]


def test_a_wave_takes_its_harmonics_along():
    drift, own = found(Drift()), [found(Periodic(DAY / k, 1)) for k in (2, 1, 3)]
    first, second = as_one([own[0], drift, *own[1:]], RECORD)
    assert waves(first) == [(DAY, 3)] and second is drift
    assert (first.share, first.gain_db, first.later_db) == pytest.approx((0.6, 3.0, 6.0))


def test_harmonics_of_a_harmonic_count():
    (one,) = as_one([found(Periodic(DAY, 1)), found(Periodic(DAY / 2, 2))], RECORD)
    assert waves(one) == [(DAY, 4)]


@pytest.mark.parametrize("period", [0.9 * DAY, DAY / 2.3, DAY / 7, DAY / 1.5])
def test_other_waves_stay_what_they_are(period):
    causes = [found(Periodic(DAY, 1)), found(Periodic(period, 1))]
    assert as_one(causes, RECORD) == causes


def test_a_wave_of_two_harmonics_is_one_cause_and_one_step_of_refinement():
    record = make_record(3000, seed=12, effects={"periodic": 1.0})
    X, y = record.drop(columns="reading"), record["reading"]
    model = DynamicBiasRegressor("temperature").fit(X, y)
    (cause,) = diagnose(model, X, y).causes
    assert cause.effect.kind == "periodic" and cause.effect.harmonics > 1
    steps = refine(model, X, y).steps
    assert len(steps) == 2 and steps["verdict"].iloc[-1] == "nothing missing"

"""What the record never showed is said: rows beyond what each effect made of the fitted record are flagged."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from thermocorr import DynamicBiasRegressor, OnlineCorrector, RecordWarning, diagnose, load_model, save_model
from thermocorr.datasets import make_record
from thermocorr.effects import Covariate, Drift

BEYOND = "outside fitted range"


@pytest.fixture(scope="module")
def cases():
    folder = Path(__file__).parents[2] / "shared" / "cases"
    if not folder.is_dir():
        pytest.skip(f"no folder {folder}: it has small logs with their truth")
    return folder


def heated(n=1500):
    """A body that follows an oven 20 min late: up, and at rest; then down again."""
    T = np.concatenate((np.linspace(20, 60, n // 2), np.full(n - n // 2, 60.0), np.linspace(60, 20, n // 2)))
    T = T + 0.01 * np.random.default_rng(1).standard_normal(len(T))
    late = pd.Series(T).ewm(alpha=1 / 120, adjust=False).mean().to_numpy()
    X = pd.DataFrame({"temperature": T}, index=pd.timedelta_range(0, periods=len(T), freq="10s"))
    return X, pd.Series(10 + late + 0.1 * np.random.default_rng(2).standard_normal(len(T)), X.index), n


def test_cooling_is_flagged_where_only_heating_was_learned(tmp_path):
    X, y, n = heated()
    with pytest.warns(RecordWarning, match="'temperature' only rises in the record: falling is not covered"):
        model = DynamicBiasRegressor("temperature", ["20 min"], degree=1).fit(X[:n], y[:n])
    flags = model.evaluate(X, y)["flag"]
    assert not flags[:n].any()
    felt = model.contributions(X).filter(like="lag").sum(axis=1)[n:] > 3 * model.residual_std_ + 0.05
    assert (flags[n:][felt] == BEYOND).all() and felt.mean() > 0.8
    assert list(model.flags(X, y)) == list(flags)
    for one in (model, load_model(save_model(model, tmp_path / "model.json"))):
        live = OnlineCorrector(one)
        singly = [live.update(t, T, u).flag for t, T, u in zip(X.index[n:], X["temperature"][n:], y[n:], strict=True)]
        assert singly == list(flags[n:]) == list(OnlineCorrector(one).update_many(X[n:], y[n:])["flag"])


def test_a_column_beyond_its_range_is_flagged_where_that_matters():
    record = make_record(3000, seed=1)
    humidity = 45 + 5 * np.sin(np.arange(3000) / 200)
    X, y = record[["temperature"]].assign(humidity=humidity), record["reading"]
    for slope, flagged in ((0.2, True), (0.0, False)):  # nothing is said of a column that does nothing
        effects = [Covariate("humidity"), Drift()]
        model = DynamicBiasRegressor("temperature", ["5 min", "90 min"], effects=effects, screen=False)
        model.fit(X, y + slope * (humidity - 45))
        far = X.assign(humidity=90.0)
        assert (model.flags(far)[1000:] == BEYOND).all() == flagged
        assert not (model.flags(X) == BEYOND).any()


@pytest.mark.filterwarnings("ignore::thermocorr.RecordWarning")
def test_the_cases_of_a_machine_that_heats_and_then_cools(cases):
    heat, both = (pd.read_csv(cases / f"heat_{name}.csv") for name in ("only", "cool"))
    model = DynamicBiasRegressor("chamber", time="seconds").fit(heat.drop(columns="z_mm"), heat["z_mm"])
    found = model.evaluate(both.drop(columns="z_mm"), both["z_mm"])
    cooling = found.index >= len(heat)
    assert not found["flag"][~cooling].any()
    assert (found["flag"][cooling] == BEYOND).mean() > 0.5
    assert any("'chamber' only rises" in note for note in model.notes_)


@pytest.mark.filterwarnings("ignore::thermocorr.RecordWarning")
@pytest.mark.parametrize("name", ["drift_beside_ramp", "drift_with_gaps", "drift_swallowed"])
def test_a_drift_beside_a_ramp_is_named_and_not_parted_from_it(cases, name):
    log = pd.read_csv(cases / f"{name}.csv", parse_dates=["time"]).set_index("time")
    X, y = log.drop(columns="reading [mGal]"), log["reading [mGal]"]
    model = DynamicBiasRegressor("T_in [degC]").fit(X, y)
    found = diagnose(model, X, y)
    named = [*found.causes, *found.small]
    assert {"drift", "periodic"} <= {cause.effect.kind for cause in named}
    for drift in (cause for cause in found.causes if cause.effect.kind == "drift"):
        assert "static_polynomial" in [effect.kind for effect in drift.confusable_with]
    assert model.flags(X, y).eq("").mean() > 0.9

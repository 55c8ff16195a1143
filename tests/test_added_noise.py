"""Where a correction adds noise at short averaging times, and through which column."""

import numpy as np
import pandas as pd
import pytest

from thermocorr import DynamicBiasRegressor
from thermocorr.command.cli import main
from thermocorr.datasets import make_record
from thermocorr.effects import Covariate
from thermocorr.equations import allan_deviation
from thermocorr.output.residual_displays import added_noise


def noisy(kelvin, seed):
    """A record whose thermometer is noisy, fitted while it was not: what a cheap sensor in its place does."""
    record = make_record(6000, seed=seed)
    X, y = record[["temperature"]], record["reading"]
    model = DynamicBiasRegressor("temperature", ["30 s", "10 min"]).fit(X, y)
    return model, X + kelvin * np.random.default_rng(seed).standard_normal(X.shape), y


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_noise_of_a_thermometer_is_told_with_its_figures(seed):
    model, X, y = noisy(0.3, seed)
    said = added_noise(model, X, y)
    after = allan_deviation(np.asarray(model.correct(X, y)), 60.0).deviation
    assert said.startswith("At averaging times up to ") and "passes on the noise" in said
    assert any(f"{value:.2g} ppm after" in said for value in after)
    assert any(name in said for name in model.features_.get_feature_names_out())


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_nothing_is_said_of_a_quiet_thermometer(seed):
    assert added_noise(*noisy(0.0, seed)) == ""


def test_the_loudest_column_is_named():
    record = make_record(6000, effects={"covariate": 2.0}, seed=4)
    X, y = record.drop(columns="reading"), record["reading"]
    model = DynamicBiasRegressor("temperature", ["10 min"], effects=[Covariate("supply")]).fit(X, y)
    loud = X.assign(supply=X["supply"] + 5 * X["supply"].std() * np.random.default_rng(4).standard_normal(len(X)))
    assert "through supply, which" in added_noise(model, loud, y)


@pytest.mark.parametrize("missing", [400, 17_000])
def test_rows_without_a_temperature_in_front_are_no_hindrance(missing):
    model, X, y = noisy(0.3, 1)
    bare = pd.DataFrame({"temperature": np.full(missing, np.nan)})
    bare.index = X.index[0] - pd.Timedelta(minutes=1) * np.arange(missing, 0, -1)
    longer = pd.concat([bare, X])
    assert added_noise(model, longer, y.reindex(longer.index)) == added_noise(model, X, y) != ""


def test_too_short_a_record_has_nothing_to_compare():
    model, X, y = noisy(0.3, 5)
    assert added_noise(model, X[:20], y[:20]) == ""


@pytest.mark.parametrize(("kelvin", "told"), [(0.3, True), (0.0, False)])
def test_the_command_says_it(kelvin, told, tmp_path, capsys):
    record = make_record(6000, seed=3)[["temperature", "reading"]]
    record["temperature"] += kelvin * np.random.default_rng(0).standard_normal(6000)
    record.to_csv(tmp_path / "log.csv")
    main(["analyze", str(tmp_path / "log.csv"), "--reading", "reading"])
    assert ("the correction adds noise: Allan deviation" in capsys.readouterr().out) == told

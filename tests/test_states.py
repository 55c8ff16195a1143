"""Columns of words: an operator, a fixture, a mode are suspects as numbers are, and go where the model goes."""

import numpy as np
import pandas as pd
import pytest

from thermocorr import DynamicBiasRegressor, OnlineCorrector, RecordError, diagnose, load_model, refine, save_model
from thermocorr.command.cli import main
from thermocorr.datasets import make_record
from thermocorr.effects import Covariate
from thermocorr.records.labels import state, states_of

pytestmark = pytest.mark.newest

ROWS = 6000


def lab(seed=1):
    """A log with an operator, a fan, a mode and comments."""
    rng = np.random.default_rng(seed)
    log = make_record(ROWS, seed=seed, noise=0.2)[["temperature", "humidity", "reading"]]
    log["operator"] = np.repeat(rng.choice(["Kim", "Ada", "Bo"], ROWS // 100), 100)
    log["fan"] = np.repeat(rng.random(ROWS // 200) > 0.5, 200)
    log["mode"] = pd.Categorical(np.repeat(rng.choice(["a", "b"], ROWS // 300), 300))
    log["comment"] = [f"row {k}" for k in range(ROWS)]
    return log


def judged(log, y):
    X = log.drop(columns="reading")
    model = DynamicBiasRegressor("temperature").fit(X, y)
    return X, model, diagnose(model, X, y)


def test_the_words_of_a_column_are_states():
    log = lab()
    log.loc[log.index[5], "operator"] = " "
    assert set(states_of(log)) == {"operator=Kim", "operator=Ada", "operator=Bo", f"mode={log['mode'].unique()[1]}"}
    values = state(log, "operator=Kim")
    assert np.isnan(values[5]) and set(values[~np.isnan(values)]) == {0.0, 1.0}
    np.testing.assert_array_equal(values[10:] == 1, log["operator"][10:] == "Kim")
    assert states_of(log[["temperature", "comment"]]) == []  # a text, no state
    few = log[["operator"]].assign(operator=["a"] * 10 + ["b"] * (ROWS - 10))
    assert states_of(few) == []  # ten rows tell nothing
    assert states_of(pd.DataFrame({"x": ["a"] * 100})) == []


@pytest.mark.long
@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize(
    ("hidden", "column"),
    [
        (lambda log: 0.3 * (log["operator"] == "Kim"), "operator=Kim"),
        (lambda log: 0.3 * log["fan"], "fan"),
        (lambda log: 0.3 * (log["mode"] == "a"), "mode="),
        (lambda log: 0.0, None),
    ],
)
def test_the_state_that_moves_the_reading_is_named(hidden, column, seed):
    log = lab(seed)
    y = log["reading"] + hidden(log)
    X, model, found = judged(log, y)
    if column is None:
        assert found.verdict == "nothing missing"
        return
    assert found.best.inputs()[0].startswith(column)
    better = refine(model, X, y).model_
    assert better.residual_std_ < 1.02 * 0.2
    assert column in found.to_html()


def test_an_operator_who_feels_the_room_differently_is_an_interaction():
    log = lab()
    _, _, found = judged(log, log["reading"] + 0.4 * (log["operator"] == "Ada") * (log["temperature"] - 22.5))
    first = found.causes[0].effect
    assert first.kind in ("interaction", "lagged_modulation") and "operator=Ada" in first.inputs()


def test_a_state_goes_with_the_model(tmp_path, capsys):
    log = lab()
    log["reading"] += 0.3 * (log["operator"] == "Kim")
    X, y = log.drop(columns="reading"), log["reading"]
    model = DynamicBiasRegressor("temperature", ["5 min", "90 min"], effects=[Covariate("operator=Kim")])
    model.fit(X[:4000], y[:4000])
    assert model.coef_table().loc["operator=Kim", "coefficient"] == pytest.approx(0.3, abs=0.03)
    save_model(model, tmp_path / "m.json")
    live = OnlineCorrector(load_model(tmp_path / "m.json"))
    whole = model.correct(X, y)
    shown = live.update_many(X[4000:5000], y[4000:5000])["corrected"]
    np.testing.assert_allclose(shown, whole[4000:5000], atol=1e-9)
    row = X.iloc[5000]
    one = live.update(X.index[5000], row["temperature"], y.iloc[5000], **{"operator=Kim": row["operator"] == "Kim"})
    assert one.corrected == pytest.approx(whole.iloc[5000], abs=1e-9)
    log[4000:].rename_axis("time").to_csv(tmp_path / "log.csv")
    assert (
        main(
            [
                "correct",
                str(tmp_path / "log.csv"),
                "--model",
                str(tmp_path / "m.json"),
                "--out",
                str(tmp_path / "o.csv"),
            ]
        )
        == 0
    )
    np.testing.assert_allclose(pd.read_csv(tmp_path / "o.csv")["corrected"], whole[4000:], atol=1e-9)
    with pytest.raises(RecordError, match="no column 'operator=Kim'"):
        model.predict(X.assign(operator=1.0))


def test_a_column_with_that_very_name_is_meant():
    log = lab()
    X = log[["temperature", "operator"]].assign(**{"operator=Kim": 0.5})
    model = DynamicBiasRegressor("temperature", ["5 min"], effects=[Covariate("operator=Kim", power=1)])
    model.fit(X, log["reading"])
    assert model.features_.transform(X)[:, -1].std() == 0


def test_states_of_odd_names_and_switches_with_holes():
    log = lab()
    for X in (
        log[["temperature"]].assign(**{"op=er": log["operator"]}),
        pd.DataFrame({0: log["temperature"], 1: log["operator"]}, index=log.index),
    ):
        y = log["reading"] + 0.5 * (log["operator"] == "Kim")
        name = "op=er=Kim" if "op=er" in X else "1=Kim"
        model = DynamicBiasRegressor("temperature" if "op=er" in X else 0, ["5 min"]).fit(X, y)
        assert name in diagnose(model, X, y).best.inputs()
    switch = log["fan"].astype(object)
    switch.iloc[5:15] = None
    X = log[["temperature"]].assign(fan=switch)
    _, _, found = judged(X.assign(reading=log["reading"]), log["reading"] + 0.5 * log["fan"])
    assert found.best.inputs() == ["fan"]


@pytest.mark.parametrize("column", ["operator=Kim", "fan"])
def test_where_it_fails_is_a_state_of_a_switch(column):
    """An error in one of two states, of half of the rows each, is told of that state."""
    rng = np.random.default_rng(7)
    log = make_record(ROWS, seed=7)[["temperature", "reading"]]
    on = np.repeat(rng.permutation(np.arange(60) % 2), 100)
    log = log.assign(operator=np.where(on, "Kim", "Ada"), fan=on) if column != "fan" else log.assign(fan=on)
    log = log.drop(columns="fan") if column != "fan" else log
    log["reading"] += on * np.repeat(rng.standard_normal(120), 50)
    X, y = log.drop(columns="reading"), log["reading"]
    found = diagnose(DynamicBiasRegressor("temperature").fit(X, y), X, y)
    worst = found.where.iloc[0]
    assert worst["column"] == column and worst["low"] == worst["high"]
    assert worst["share"] > 0.8
    assert f"where {column} is {worst['low']:g}:" in str(found)

"""A reading that is compared with a better instrument while both move: a board whose thermometer heats itself."""

import shutil
import subprocess

import numpy as np
import pandas as pd
import pytest

from thermocorr import (
    DynamicBiasRegressor,
    OnlineCorrector,
    RecordError,
    compare_variants,
    load_model,
    refine,
    save_model,
)
from thermocorr.command.cli import main
from thermocorr.datasets import make_record
from thermocorr.datasets._planted import follow
from thermocorr.effects import Step
from thermocorr.firmware import export_c

DAY = 1440
LEARNED = 3 * DAY


def board(seed, days=5):
    """Thermometer of a board that heats itself by its load, a better one in the room, and the room."""
    rng, n = np.random.default_rng(seed), days * DAY
    minutes = np.arange(n)

    def late(values, tau):
        return np.asarray(follow(60.0 * minutes, np.asarray(values, float), tau))

    heating = np.repeat(rng.random(n // 90 + 1) < 0.4, 90)[:n]
    room = 21 + 1.5 * np.sin(2 * np.pi * minutes / DAY + rng.uniform(0, 6)) + late(2.0 * heating, 3600.0)
    room = room + late(rng.normal(0, 0.3, n), 1800.0)
    load = np.repeat(rng.choice([0.1, 0.3, 1.0], n // 30 + 1), 30)[:n]
    warm = late(room, 600.0) + 3.0 * late(load, 900.0) + 1.2 * late(load, 120.0)
    index = pd.date_range("2024-03-04", periods=n, freq="1min", name="time")
    shown = [np.round(values + rng.normal(0, 0.02, n), 2) for values in (warm, room)]
    return pd.DataFrame({"board": shown[0], "load": load, "room_sensor": shown[1]}, index=index), room


def rms(values):
    return float(np.sqrt(np.nanmean(np.square(values))))


@pytest.fixture(scope="module")
def fitted():
    """A record, its room, and the model that was refined for a device on the first three days."""
    log, room = board(5)
    model = DynamicBiasRegressor("board", reference="room_sensor")
    return log, room, refine(model, log[:LEARNED], log["board"][:LEARNED], deployable=True).model_


@pytest.mark.newest
@pytest.mark.parametrize("seed", [5, *(pytest.param(seed, marks=pytest.mark.long) for seed in (6, 7))])
def test_a_board_that_heats_itself_reads_right_on_later_days(seed):
    log, room = board(seed)
    X, y = log[:LEARNED], log["board"][:LEARNED]
    later, shown = log[LEARNED:].drop(columns="room_sensor"), log["board"][LEARNED:]
    model = refine(DynamicBiasRegressor("board", reference="room_sensor"), X, y, deployable=True).model_
    assert rms(model.correct(later, shown) - room[LEARNED:]) < 0.08
    offset = (y - X["room_sensor"]).mean()
    assert rms(shown - offset - room[LEARNED:]) > 0.5


def test_the_reference_is_needed_for_what_compares_and_for_nothing_else(fitted, tmp_path):
    log, _, model = fitted
    y = log["board"]
    without = log.drop(columns="room_sensor")
    corrected = model.correct(without, y)
    pd.testing.assert_series_equal(corrected, model.correct(log, y))
    np.testing.assert_allclose(model.predict(log) - log["room_sensor"], model.bias(log), rtol=0, atol=1e-12)
    np.testing.assert_allclose(corrected, y - model.bias(without), rtol=0, atol=1e-12)
    assert np.isnan(model.predict(without)).all() and np.isnan(model.residuals(without, y)).all()
    evaluated = model.evaluate(log, y)
    np.testing.assert_allclose(evaluated["residual"], evaluated["corrected"] - log["room_sensor"], rtol=0, atol=1e-9)
    loaded = load_model(save_model(model, tmp_path / "model.json"))
    pd.testing.assert_series_equal(loaded.correct(without, y), corrected)
    assert "board - room_sensor = " in model.equation()
    assert not any("room_sensor" in name for name in model.features_.get_feature_names_out())


def test_its_uncertainty_is_in_every_corrected_reading(fitted):
    log, _, model = fitted
    X, y = log.drop(columns="room_sensor"), log["board"]
    stated = [model.uncertainty(X, y, reference=u, allow_missing=True).frame()["u"].iloc[-1] for u in (0.0, 0.1)]
    np.testing.assert_allclose(np.hypot(stated[0], 0.1), stated[1])


def test_live_and_c_give_what_correct_gives(fitted, tmp_path):
    log, _, model = fitted
    later = log[LEARNED : LEARNED + 200]
    live = OnlineCorrector(model)
    found = [
        live.update(time=time, temperature=row.board, reading=row.board, load=row.load).corrected
        for time, row in later.iterrows()
    ]
    whole = model.correct(log.drop(columns="room_sensor"), log["board"])
    np.testing.assert_allclose(found, whole[later.index], rtol=0, atol=1e-9)
    with pytest.raises(ValueError, match="Leave track out"):
        OnlineCorrector(model, track="2h")
    if shutil.which("gcc") is None:
        pytest.skip("gcc is needed to run the C")
    export = export_c(model, tmp_path)
    sources = [str(path) for path in export.paths if path.suffix == ".c"]
    subprocess.run(["gcc", "-std=c99", "-Wall", "-Werror", *sources, "-lm", "-o", str(tmp_path / "t")], check=True)
    assert "passed" in subprocess.run([str(tmp_path / "t")], capture_output=True, text=True, check=True).stdout


def test_what_is_learned_is_the_error_with_its_level():
    log, _ = board(8, days=1)
    X, y = log, log["board"]
    compared = compare_variants(
        X, y, model=DynamicBiasRegressor("board", time_constants=["10 min"], reference="room_sensor")
    )
    plain = compare_variants(
        X.drop(columns="room_sensor"),
        y - X["room_sensor"],
        model=DynamicBiasRegressor("board", time_constants=["10 min"]),
    )
    pd.testing.assert_frame_equal(compared.frame(), plain.frame())
    holes = X.assign(room_sensor=X["room_sensor"].where(np.arange(len(X)) % 5 > 0))
    model = DynamicBiasRegressor("board", time_constants=["10 min"], reference="room_sensor").fit(holes, y)
    assert model.reading_.n_readings == int(holes["room_sensor"].notna().sum())
    with pytest.raises(RecordError, match="reference"):
        DynamicBiasRegressor("board", reference="nowhere").fit(X, y)
    for reference, y_, words in (
        (2, y, "name of a column"), ("board", y, "its own reference"),
        ("room [degF]", y.rename("board [degC]"), "is in degC, and its reference 'room .degF.' in degF"),
    ):  # fmt: skip
        with pytest.raises(RecordError, match=words):
            DynamicBiasRegressor("board", reference=reference).fit(X.assign(**{"room [degF]": 70.0}), y_)
    with pytest.raises(RecordError, match="DataFrame"):
        DynamicBiasRegressor(0, reference="room").fit(X.to_numpy(), y.to_numpy())


def test_nothing_of_an_error_is_kept():
    """Neither a step nor the level of a run: corrected readings are those of the reference."""
    log, _ = board(11, days=2)
    n = len(log)
    stepped = log["board"] + 1.5 * (np.arange(n) > n // 2)
    model = DynamicBiasRegressor("board", time_constants=["10 min"], effects=[Step(str(log.index[n // 2]))])
    fitted_ = model.set_params(reference="room_sensor").fit(log.assign(board=stepped), stepped.rename("board"))
    left = fitted_.correct(log.assign(board=stepped), stepped) - log["room_sensor"]
    np.testing.assert_allclose(left, fitted_.residuals(log.assign(board=stepped), stepped), rtol=0, atol=1e-9)
    assert abs(left[n // 2 :].mean()) < 0.2


@pytest.mark.long
@pytest.mark.newest
def test_the_command_learns_corrects_and_exports(tmp_path, capsys):
    log, _ = board(9)
    path, out = tmp_path / "board.csv", tmp_path / "out"
    log.to_csv(path)
    words = ["--reference", "room_sensor", "--refine", "--deployable", "--out", str(out)]
    assert main(["analyze", str(path), *words]) == 0
    shown = capsys.readouterr().out
    assert "refined" in shown and "offset alone" in shown
    assert main(["correct", str(path), "--model", str(out / "model.json"), "--out", str(tmp_path / "c.csv")]) == 0
    one, other = pd.read_csv(out / "corrected.csv"), pd.read_csv(tmp_path / "c.csv")
    np.testing.assert_allclose(one["corrected"], other["corrected"], rtol=0, atol=1e-9)
    assert main(["export-c", str(out / "model.json"), "--out", str(tmp_path / "c")]) == 0


def test_time_constants_are_those_of_the_difference():
    """Whatever the reference does: with gaps, which ask for a second choice."""
    record = make_record(6000, seed=3, gaps=6)
    reference = 1000.0 + 0.5 * np.cumsum(np.random.default_rng(0).standard_normal(6000))
    X, y = record[["temperature"]], record["reading"]
    plain = DynamicBiasRegressor("temperature").fit(X, y)
    against = DynamicBiasRegressor("temperature", reference="better").fit(X.assign(better=reference), y + reference)
    np.testing.assert_allclose(against.time_constants_, plain.time_constants_)

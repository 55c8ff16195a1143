"""The workbench without a browser: steps, undo, previews, what is taken away, against the library's calls."""

import json

import numpy as np
import pandas as pd
import pytest
from benches import in_python, settled, shown, stretch

from thermocorr import DynamicBiasRegressor, compare_variants, diagnose
from thermocorr.datasets import make_record
from thermocorr.interactive.acts import ModelSettings, Roles, guessed
from thermocorr.interactive.bench import Bench
from thermocorr.interactive.snapshots import snapshot
from thermocorr.interactive.source import opened
from thermocorr.interactive.tiles import Store
from thermocorr.records import RecordError

pytestmark = pytest.mark.newest


def test_numbers_on_the_screen_are_those_of_the_library(bench, bench_log):
    X, y = in_python(bench_log)
    model = DynamicBiasRegressor("temperature", 6, degree=1).fit(X, y)  # what is advised
    found = diagnose(model, X, y)
    state = snapshot(bench)
    first = state["history"][0]
    assert first["rms"]["value"] == pytest.approx(found.residual_rms, rel=1e-12)
    assert first["held_out"]["value"] == pytest.approx(found.held_out_rms, rel=1e-12)
    assert first["later"]["value"] == pytest.approx(found.later_rms, rel=1e-12)
    assert state["judged"]["verdict"] == found.verdict
    assert [one["exactly"] for one in state["judged"]["suspects"]] == [s.effect.label() for s in found.suspects]
    assert state["fitted"]["equation"] == model.equation()


def test_what_is_missing_is_added_the_error_falls_and_undo_returns_to_the_same_bits(bench):
    before, coefficients = shown(bench), bench.current.model.coef_.copy()
    card = snapshot(bench)["judged"]["suspects"][0]
    bench.perform({"do": "add", "suspect": 0})
    state = snapshot(settled(bench))
    first, last = state["history"]
    assert [card["before"]["value"], card["after"]["value"]] == [first["later"]["value"], last["later"]["value"]]
    assert not state["advised"]  # which was about the model before
    assert last["later"]["value"] < 0.7 * first["later"]["value"]
    assert last["db"]["value"] == pytest.approx(20 * np.log10(last["later"]["value"] / first["later"]["value"]))
    assert last["verdict"] == "nothing missing"
    after = shown(bench)
    bench.perform({"do": "undo"})
    assert snapshot(settled(bench)) == {**json.loads(before), "can_redo": True}
    np.testing.assert_array_equal(bench.current.model.coef_, coefficients)
    bench.perform({"do": "redo"})
    assert shown(settled(bench)) == after
    bench.kept.clear()  # as if it had been forgotten: fitted again to the same bits
    bench.perform({"do": "undo"})
    np.testing.assert_array_equal(settled(bench).current.model.coef_, coefficients)


def test_the_work_begins_with_what_is_advised_where_nobody_chose_settings(bench, bench_log, tmp_path):
    X, y = in_python(bench_log)
    advice = compare_variants(X, y, temperature="temperature", time_constants=6).advice
    assert advice.variant == "dynamic linear" and snapshot(bench)["model"]["degree"] == 1
    assert snapshot(bench)["advised"].startswith("Use the dynamic linear correction")
    source = opened([bench_log])
    chosen = Bench(source, Store(tmp_path), roles=guessed(source.frame), settings=ModelSettings(degree=3))
    chosen.start()
    assert snapshot(settled(chosen))["model"]["degree"] == 3
    assert snapshot(chosen)["advised"].startswith("Use the dynamic linear correction")


def test_errors_of_other_readings_are_not_compared_and_some_must_be_left(bench):
    with pytest.raises(ValueError, match="all readings that are learned from"):
        bench.perform({"do": "leave_out", **stretch(bench, 0.0, 1.0)})
    bench.perform({"do": "leave_out", **stretch(bench, 0.2, 0.3)})
    first, last = snapshot(settled(bench))["history"]
    assert first["same"] and not last["same"] and last["later"] and not last["db"]["value"]


def test_errors_compare_behind_the_last_date_and_the_model_is_drawn_where_readings_are(tmp_path):
    record = make_record(2000, effects={"step": 2.0}, seed=1)
    record.loc[record.index[300:400], "reading"] = np.nan
    path = tmp_path / "step.csv"
    record.to_csv(path)
    source = opened([path])
    bench = settled(Bench(source, Store(tmp_path), roles=guessed(source.frame)))
    bench.start()
    card = snapshot(settled(bench))["judged"]["suspects"][0]
    assert card["label"] == "step" and card["after"]["value"] < 0.6 * card["before"]["value"]
    assert np.isnan(bench.store.get(bench.current.curves["model"])[300:400]).all()
    bench.perform({"do": "add", "suspect": 0})
    first, last = snapshot(settled(bench))["history"]
    assert 0 < bench.moment < 1
    assert [first["later"]["value"], last["later"]["value"]] == [card["before"]["value"], card["after"]["value"]]


def test_a_step_in_the_middle_is_removed_and_the_others_stand(bench):
    bench.perform({"do": "leave_out", **stretch(bench, 0.2, 0.3)})
    settled(bench).perform({"do": "add", "suspect": 0})
    settled(bench).perform({"do": "drop", "step": 1})
    state = snapshot(settled(bench))
    assert [row["kind"] for row in state["history"]] == ["columns", "add"]
    assert not bench.arrangement().left_out and len(bench.arrangement().effects) == 1
    assert all(row["held_out"] for row in state["history"])
    with pytest.raises(ValueError, match="what the columns are"):
        bench.perform({"do": "drop", "step": 0})


def test_a_preview_says_what_the_fit_then_leaves(bench):
    seen = bench.perform({"do": "preview", "suspect": 0})
    found = bench.current
    taus, alpha = found.model.time_constants_.tolist(), found.model.alpha_
    held = DynamicBiasRegressor("temperature", taus, degree=1, alpha=alpha)
    fitted = held.with_effect(found.diagnosis.suspects[0].effect).fit(found.data.X, found.data.learned)
    residual = fitted.evaluate(found.data.X, found.data.y)["residual"]
    assert seen["after"]["value"] == pytest.approx(np.sqrt(np.mean(residual**2)), rel=1e-12)
    curves = {name: bench.store.get(key) for name, key in seen["curves"].items()}
    total = curves["preview after"] + curves["preview taken"]
    np.testing.assert_allclose(total, bench.store.get(found.curves["residual"]), rtol=0, atol=1e-12)
    assert len(bench.acts) == 1  # nothing was done


def test_a_stretch_is_left_out_of_the_fit(bench):
    n = len(bench.source.frame)
    bench.perform({"do": "leave_out", **stretch(bench, 0.4, 0.5)})
    learned = bench.current.data.learned
    (start, stop), *more = bench.arrangement().left_out
    assert not more and start == pytest.approx(0.4 * n, abs=2) and stop == pytest.approx(0.5 * n, abs=2)
    assert learned.isna().to_numpy().nonzero()[0].tolist() == list(range(start, stop))
    residual = bench.store.get(bench.current.curves["residual"])
    assert np.isfinite(residual[start:stop]).all()  # shown all the same
    with pytest.raises(ValueError, match="no rows"):
        bench.perform({"do": "leave_out", "low": -5.0, "high": -4.0})


def test_what_cannot_be_done_changes_nothing_and_says_why(bench):
    before = shown(bench)
    for asked in (
        {"do": "undo"},
        {"do": "redo"},
        {"do": "fly"},
        {"do": None},
        {},
        {"do": "add", "suspect": 99},
        {"do": "add", "suspect": -1},
        {"do": "add", "suspect": "0"},
        {"do": "add", "suspect": 0, "alike": 7},
        {"do": "drop", "step": 44},
        {"do": "shape", "time_constants": "many", "degree": 2, "products": False},
        {"do": "shape", "time_constants": "-3", "degree": 2, "products": False},
        {"do": "shape", "time_constants": "", "degree": 2, "products": False},
        {"do": "shape", "time_constants": "\u00b2", "degree": 2, "products": False},
        {"do": "shape", "time_constants": "9" * 5000, "degree": 2, "products": False},
        {"do": "leave_out", "low": 10**4000, "high": 1.0},
        {"do": "shape", "time_constants": 6, "degree": 2.5, "products": False},
        {"do": "shape", "time_constants": 6, "degree": 2, "products": "yes"},
        {
            "do": "columns",
            "temperature": "nothing",
            "reading": "reading",
            "reference": None,
            "time": None,
            "run": None,
            "ignored": [],
        },
        {
            "do": "columns",
            "temperature": "reading",
            "reading": "reading",
            "reference": None,
            "time": None,
            "run": None,
            "ignored": [],
        },
        {"do": "columns", "temperature": "temperature", "reading": "reading"},
        {"do": "mark", "low": 0.0, "high": 1.0},
        {"do": "leave_out", "low": float("nan"), "high": 1.0},
        {"do": "leave_out", **stretch(bench, -1.0, 2.0)},
    ):
        with pytest.raises(ValueError, match=r".{15,}"):
            bench.perform(asked)
        assert shown(bench) == before, asked


def test_a_log_whose_columns_cannot_be_guessed_waits_for_its_user(tmp_path):
    record = make_record(1500, effects={"covariate": 1.0}, seed=1).rename(columns={"reading": "a", "mains": "b"})
    path = tmp_path / "log.csv"
    record.to_csv(path)
    bench = Bench(source := opened([path]), Store(tmp_path), roles=guessed(source.frame))
    bench.start()
    state = snapshot(bench)
    assert not state["decided"] and state["fitted"] is None and "which the reading" in state["problem"]
    asked = {
        "do": "columns",
        "temperature": "temperature",
        "reading": "a",
        "reference": None,
        "time": None,
        "run": None,
        "ignored": ["b"],
    }
    bench.perform(asked)
    state = snapshot(bench)
    assert state["decided"] and state["fitted"] and not state["problem"]
    assert {c["name"]: c["role"] for c in state["columns"]}["b"] == "ignored"
    bench.perform({"do": "undo"})
    assert not snapshot(bench)["decided"]


@pytest.mark.parametrize(
    ("columns", "temperature", "reading"),
    [
        (["time", "temperature", "reading", "humidity"], "temperature", "reading"),
        (["time", "T [°C]", "U / mV"], "T [°C]", "U / mV"),
        (["t", "room_degC", "voltage", "rh"], "room_degC", "voltage"),
        (["timestamp", "ambient", "value"], "ambient", "value"),
    ],
)
def test_roles_are_guessed_from_names_and_units(columns, temperature, reading, tmp_path):
    frame = pd.DataFrame(np.random.default_rng(0).normal(size=(50, len(columns))), columns=columns)
    frame[columns[0]] = 60.0 * np.arange(50)
    frame.to_csv(tmp_path / "log.csv", index=False)
    source = opened([tmp_path / "log.csv"])
    roles = guessed(source.frame)
    assert (roles.temperature, roles.reading, roles.time) == (temperature, reading, None)
    assert columns[0] not in source.frame and source.frame.index[1].total_seconds() == 60.0


GERMAN = """Messung Labor 3

Datum;Uhrzeit;Temp. Raum (\u00b0C);rel. Feuchte (%);U1 (V)
"""


def test_columns_of_a_german_log_are_told(tmp_path):
    record = make_record(1500, effects={"covariate": 0.0}, seed=2)
    lines = [
        f"{time:%d.%m.%Y};{time:%H:%M:%S};{row.temperature:.3f};{row.temperature + 1:.3f};{row.reading:.4f}".replace(
            ".", ","
        )
        for time, row in zip(record.index, record.itertuples(), strict=True)
    ]
    lines = [line.replace(",", ".", 2) for line in lines]  # the dates have dots
    path = tmp_path / "messung.csv"
    path.write_text(GERMAN + "\n".join(lines) + "\n", encoding="latin-1")
    bench = Bench(source := opened([path]), Store(tmp_path), roles=guessed(source.frame))
    bench.start()
    state = snapshot(bench)
    roles = {c["role"]: c["name"] for c in state["columns"]}
    assert roles["temperature"] == "Temp. Raum (°C)" and roles["reading"] == "U1 (V)"
    assert not state["fitted"]["without_times"] and "steps of" in state["source"]["said"][-1]
    assert "times from 'Datum' and 'Uhrzeit' as %d.%m.%Y %H:%M:%S" in state["source"]["said"]


def test_a_role_for_two_columns_or_one_column_for_two_roles_is_refused():
    with pytest.raises(RecordError, match="two things at once"):
        Roles(temperature="a", reading="a")
    with pytest.raises(RecordError, match="ignored as well"):
        Roles(temperature="a", reading="b", ignored=("a",))


@pytest.mark.filterwarnings("error")
def test_warnings_of_the_fit_are_notes_on_the_screen(tmp_path):
    record = make_record(1500, effects={"covariate": 1.0}, seed=1)
    record.iloc[700, record.columns.get_loc("temperature")] = np.nan
    path = tmp_path / "log.csv"
    record.to_csv(path)
    bench = Bench(source := opened([path]), Store(tmp_path), roles=guessed(source.frame))
    bench.start()
    settled(bench)
    notes = snapshot(bench)["fitted"]["notes"]
    assert any("temperature" in note for note in notes)

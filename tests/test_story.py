"""The story without a screen: steps, undo, previews, pictures, what is taken away, against the library's calls."""

import json
import subprocess
import sys

import numpy as np
import pandas as pd
import pytest
from stories import in_python, settled, shown, story_of_log, stretch

from thermocorr import DynamicBiasRegressor, compare_variants, diagnose, load_model
from thermocorr.datasets import make_record
from thermocorr.readers import Options
from thermocorr.records import RecordError
from thermocorr.workbench import Story
from thermocorr.workbench.files import KINDS
from thermocorr.workbench.log import effects_in
from thermocorr.workbench.state import state_of

pytestmark = pytest.mark.newest


def test_numbers_on_the_screen_are_those_of_the_library(story, story_log):
    X, y = in_python(story_log)
    model = DynamicBiasRegressor("temperature", degree=1).fit(X, y)  # what is advised
    found = diagnose(model, X, y)
    state = state_of(story)
    first = state["history"][0]
    assert first["rms"]["value"] == pytest.approx(found.residual_rms, rel=1e-12)
    assert first["held_out"]["value"] == pytest.approx(found.held_out_rms, rel=1e-12)
    assert first["later"]["value"] == pytest.approx(found.later_rms, rel=1e-12)
    assert state["judged"]["verdict"] == found.verdict
    assert [one["exactly"] for one in state["judged"]["suspects"]] == [s.effect.label() for s in found.suspects]
    assert state["fitted"]["equation"] == model.equation()


def test_what_is_missing_is_added_the_error_falls_and_undo_returns_to_the_same_bits(story):
    before, coefficients = shown(story), story.now.model.coef_.copy()
    card = state_of(story)["judged"]["suspects"][0]
    story.add(0)
    state = state_of(settled(story))
    first, last = state["history"]
    assert [card["before"]["value"], card["after"]["value"]] == [first["later"]["value"], last["later"]["value"]]
    assert [row["error"]["value"] for row in state["errors"][-2:]] == [first["later"]["value"], last["later"]["value"]]
    assert not state["advised"]  # which was about the model before
    assert last["later"]["value"] < 0.7 * first["later"]["value"]
    assert last["db"]["value"] == pytest.approx(20 * np.log10(last["later"]["value"] / first["later"]["value"]))
    assert last["verdict"] == "nothing missing"
    after = shown(story)
    story.undo()
    assert state_of(settled(story)) == {**json.loads(before), "can_redo": True}
    np.testing.assert_array_equal(story.now.model.coef_, coefficients)
    story.redo()
    assert shown(settled(story)) == after
    story._steps.clear()  # as if it had been forgotten: fitted again to the same bits
    story.undo()
    np.testing.assert_array_equal(settled(story).now.model.coef_, coefficients)


def test_the_errors_stand_on_one_scale_from_no_correction_to_the_last_step(story, story_log):
    X, y = in_python(story_log)
    advice = compare_variants(X, y, temperature="temperature").advice
    story.add(0)
    table = settled(story).errors()
    names = ["no correction", "static linear correction", "dynamic linear correction", "+ covariate: supply"]
    assert table["step"].tolist() == names
    known = advice.table["all"]
    assert table["error"].iloc[:2].tolist() == pytest.approx([advice.before, known["static linear"]], rel=1e-9)
    assert table["error"].is_monotonic_decreasing


def test_the_work_begins_with_what_is_advised_where_nobody_chose_settings(story, story_log):
    assert state_of(story)["model"]["degree"] == 1
    assert state_of(story)["advised"].startswith("Use the dynamic linear correction")
    chosen = story_of_log(story_log, model=DynamicBiasRegressor(degree=3))
    assert state_of(chosen)["model"]["degree"] == 3
    assert state_of(chosen)["advised"].startswith("Use the dynamic linear correction")


def test_errors_of_other_readings_are_not_compared_and_some_must_be_left(story):
    with pytest.raises(ValueError, match="all readings that are learned from"):
        story.leave_out(*stretch(story, 0.0, 1.0))
    story.leave_out(*stretch(story, 0.2, 0.3))
    first, last = state_of(settled(story))["history"]
    assert last["same"] and not first["same"] and first["later"] is None and last["later"] and not last["db"]


def test_errors_compare_behind_the_last_date_and_the_model_is_drawn_where_readings_are(tmp_path):
    record = make_record(2000, effects={"step": 2.0}, seed=1)
    record.loc[record.index[300:400], "reading"] = np.nan
    record.to_csv(tmp_path / "step.csv")
    story = story_of_log(tmp_path / "step.csv", roles={"reading": "reading"})
    card = state_of(story)["judged"]["suspects"][0]
    assert card["label"] == "step" and card["after"]["value"] < 0.8 * card["before"]["value"]
    cells = story.display("time").frame()
    assert cells["modelled"].isna().tolist() == cells["measured"].isna().tolist()
    assert cells["modelled"].isna().sum() == 100
    story.add(0)
    first, last = state_of(settled(story))["history"]
    assert 0 < story.moment < 1
    assert [first["later"]["value"], last["later"]["value"]] == [card["before"]["value"], card["after"]["value"]]


def test_a_step_in_the_middle_is_removed_and_the_others_stand(story):
    story.leave_out(*stretch(story, 0.2, 0.3))
    settled(story).add(0)
    settled(story).drop(1)
    state = state_of(settled(story))
    assert [row["kind"] for row in state["history"]] == ["roles", "add"]
    assert not story.now.left_out and len(story.now.model.effects) == 1
    assert all(row["held_out"] for row in state["history"])
    with pytest.raises(ValueError, match="what the columns are"):
        story.drop(0)


def test_a_preview_says_what_the_fit_then_leaves(story):
    seen, found = story.preview(0), story.now
    taus, alpha = found.model.time_constants_.tolist(), found.model.alpha_
    held = DynamicBiasRegressor("temperature", taus, degree=1, alpha=alpha)
    fitted = held.with_effect(found.diagnosis.suspects[0].effect).fit(found.X, found.learned)
    residual = fitted.evaluate(found.X, found.y)["residual"]
    assert seen["after"] == pytest.approx(np.sqrt(np.mean(residual**2)), rel=1e-12)
    drawn = story.display("time", preview=True).others["with covariate: supply"]
    assert drawn["residual_high"].max() == pytest.approx(residual.max(), rel=1e-12)
    assert np.sum(drawn["n"] * drawn["residual"]) == pytest.approx(residual.sum(), abs=1e-9)
    assert not story.display("time").others
    assert len(story.acts) == 1  # nothing was done


def test_a_stretch_is_left_out_of_the_fit_and_drawn_grey(story):
    n = len(story.log.frame)
    story.leave_out(*stretch(story, 0.4, 0.5))
    ((start, stop),) = story.now.left_out
    assert start == pytest.approx(0.4 * n, abs=2) and stop == pytest.approx(0.5 * n, abs=2)
    assert story.now.learned.isna().to_numpy().nonzero()[0].tolist() == list(range(start, stop))
    low, high = stretch(story, 0.35, 0.55)
    cells = story.display("time", low=low, high=high).frame()
    out = cells[cells["left out"].notna()]
    assert len(out) == stop - start
    assert out["measured"].isna().all() and out["residual"].isna().all() and out["modelled"].notna().all()
    assert state_of(story)["fitted"]["left_out"] == f"{stop - start} rows left out"
    with pytest.raises(ValueError, match="no rows"):
        story.leave_out(-5.0, -4.0)


@pytest.mark.parametrize(
    ("what", "given"),
    [
        ("undo", {}), ("redo", {}), ("add", {"place": 99}), ("add", {"place": -1}), ("add", {"place": "0"}),
        ("add", {"place": 0, "alike": 7}), ("drop", {"step": 44}), ("shape", {"time_constants": "many"}),
        ("shape", {"time_constants": "-3"}), ("shape", {"time_constants": ""}), ("shape", {"time_constants": "²"}),
        ("shape", {"time_constants": "9" * 5000}), ("shape", {"degree": 2.5}), ("shape", {"products": "yes"}),
        ("leave_out", {"low": 10**4000, "high": 1.0}), ("leave_out", {"low": float("nan"), "high": 1.0}),
        ("assign", {"temperature": "nothing", "reading": "reading"}),
        ("assign", {"temperature": "reading", "reading": "reading"}),
        ("assign", {"temperature": "temperature", "reading": "reading", "ignored": ["reading"]}),
        ("assign", {"temperature": "temperature"}), ("assign", {"temperature": "temperature", "pilot": "reading"}),
        ("preview", {"place": 99}), ("export", {"kind": "gold"}), ("display", {"name": "moon"}),
        ("display", {"name": "time", "low": -50.0, "high": 1e9}), ("display", {"name": "time", "versus": 7}),
    ],
)  # fmt: skip
def test_what_cannot_be_done_changes_nothing_and_says_why(story, what, given):
    before = shown(story)
    with pytest.raises(ValueError, match=r".{15,}"):
        getattr(story, what)(**given)
    assert shown(story) == before


def test_a_log_whose_columns_cannot_be_guessed_waits_for_its_user(tmp_path):
    record = make_record(1500, effects={"covariate": 1.0}, seed=1).rename(columns={"reading": "a", "mains": "b"})
    record.to_csv(tmp_path / "log.csv")
    story = Story.open([tmp_path / "log.csv"])
    story.begin()
    state = state_of(story)
    assert not state["decided"] and state["fitted"] is None and "which the reading" in state["problem"]
    with pytest.raises(ValueError, match="which the reading"):
        story.judge()
    story.assign(temperature="temperature", reading="a", ignored=["b"])
    state = state_of(story)
    assert state["decided"] and state["fitted"] and not state["problem"]
    assert {c["name"]: c["role"] for c in state["columns"]}["b"] == "ignored"
    story.undo()
    assert not state_of(story)["decided"]


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
    story = Story.open([tmp_path / "log.csv"])
    assert [story.roles[role] for role in ("temperature", "reading", "time")] == [temperature, reading, None]
    assert columns[0] not in story.log.frame and story.log.frame.index[1].total_seconds() == 60.0


GERMAN = """Messung Labor 3

Datum;Uhrzeit;Temp. Raum (°C);rel. Feuchte (%);U1 (V)
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
    story = Story.open([path])
    story.start()
    state = state_of(story)
    roles = {c["role"]: c["name"] for c in state["columns"]}
    assert roles["temperature"] == "Temp. Raum (°C)" and roles["reading"] == "U1 (V)"
    assert not state["fitted"]["without_times"] and "steps of" in state["source"]["said"][-1]
    assert "times from 'Datum' and 'Uhrzeit' as %d.%m.%Y %H:%M:%S" in state["source"]["said"]


@pytest.mark.filterwarnings("error")
def test_warnings_of_the_fit_are_notes_on_the_screen(tmp_path):
    record = make_record(1500, effects={"covariate": 1.0}, seed=1)
    record.iloc[700, record.columns.get_loc("temperature")] = np.nan
    record.to_csv(tmp_path / "log.csv")
    notes = state_of(story_of_log(tmp_path / "log.csv"))["fitted"]["notes"]
    assert any("temperature" in note for note in notes)


def test_no_two_cards_have_one_name_and_what_is_not_compared_has_no_figure():
    story = Story(make_record(3000, effects=[("hinge", 2.0), ("covariate", 2.0)], seed=4))
    story.begin()
    story.judge()
    cards = state_of(story)["judged"]["suspects"]
    assert len({card["label"] for card in cards}) == len(cards)
    for card in cards:
        assert bool(card["before"] and card["after"]) == card["cause"]


def test_where_it_fails_is_known_before_the_diagnosis(story_log):
    story = Story.open([story_log])
    story.begin()
    words = []
    while not (chore := story.next_chore())[0].startswith("looking for"):
        chore[1]()
    state = state_of(story)
    assert state["judged"] is None and state["fitted"]["where"][0]["share"]["value"] > 0.05
    story.progress = words.append
    story.judge()
    assert any(text.startswith("trying ") for text in words) and any(t.startswith("best so far: ") for t in words)


# ---- what is taken away

OWN = '''
import numpy as np
from thermocorr.effects import Effect, EffectInfo

class Fan(Effect):
    """A fan that comes on above 5 V."""
    kind = "fan"
    info = EffectInfo(physics="A fan.", bench_check="Stop it.", formula="fan", parameters={})
    def __init__(self, column="supply"):
        self.column = column
    def inputs(self):
        return [self.column]
    @classmethod
    def candidates(cls, record, columns=None):
        return [cls(c) for c in (columns or ()) if c == "supply"]
    def names(self):
        return ["fan"]
    def signals(self, x):
        return [x.where(x[self.column] >= 5.0, 1.0, 0.0)]
'''


@pytest.mark.long
@pytest.mark.filterwarnings("ignore::thermocorr.RecordWarning")
def test_the_script_and_the_model_file_come_to_the_same_model(story, tmp_path):
    story.add(0)
    story.leave_out(*stretch(story, 0.2, 0.25))
    story.shape("4", 2)
    settled(story)
    for kind, (name, *_) in KINDS.items():
        (tmp_path / name).write_bytes(story.export(kind))
    wanted = story.now.model
    tail = "\nimport json\nprint(json.dumps([model.intercept_, *model.coef_.tolist()]))\n"
    (tmp_path / "run.py").write_bytes(story.export("script") + tail.encode())
    done = subprocess.run([sys.executable, tmp_path / "run.py"], capture_output=True, text=True, check=True)
    assert json.loads(done.stdout.splitlines()[-1]) == [wanted.intercept_, *wanted.coef_.tolist()]
    held_out = state_of(story)["history"][-1]["held_out"]["value"]
    assert f"held out {held_out:.6g}" in done.stdout
    np.testing.assert_array_equal(load_model(tmp_path / "model.json").coef_, wanted.coef_)
    corrected = pd.read_csv(tmp_path / "corrected.csv")
    assert len(corrected) == 3000 and {"corrected", "flag", "u"} <= set(corrected.columns)
    report = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "<!DOCTYPE html>" in report[:100] and "+ covariate: supply" in report


def test_several_files_are_runs(story_log, tmp_path):
    frame = pd.read_csv(story_log)
    frame["time"] = pd.to_datetime(frame["time"]) + pd.Timedelta("90 days")
    frame.to_csv(tmp_path / "later.csv", index=False)
    story = Story.open([story_log, tmp_path / "later.csv"])
    story.start()
    assert story.problem == "" and story.roles["run"] == "file"
    assert story.now.curves.timeline.span < 0.2 * 90 * 86_400  # the long pause is left out of the axis
    space = {}
    exec(story.script().split("# What is missing")[0], space)
    np.testing.assert_array_equal(space["model"].coef_, story.now.model.coef_)


@pytest.mark.long
def test_an_effect_from_a_file_is_a_suspect_and_comes_into_the_script(tmp_path):
    path = tmp_path / "fan_of_the_test.py"
    path.write_text(OWN)
    record = make_record(3000, effects={"covariate": 0.0}, seed=3)
    record["reading"] += 2.0 * record.attrs["noise"] * (record["supply"] >= 5.0)
    record.to_csv(tmp_path / "fan.csv")
    story = story_of_log(tmp_path / "fan.csv", effects_file=str(path))
    assert [cls.kind for cls in story.own] == ["fan"]
    first = state_of(story)["judged"]["suspects"][0]
    assert first["cause"] and first["label"].startswith("fan")
    story.add(0)
    tail = "\nimport json\nprint(json.dumps(model.coef_.tolist()))\n"
    (tmp_path / "run.py").write_text(story.script() + tail)
    done = subprocess.run([sys.executable, tmp_path / "run.py"], capture_output=True, text=True, check=True)
    assert json.loads(done.stdout.splitlines()[-1]) == story.now.model.coef_.tolist()
    for content, sentence in (
        ("x = 1", "defines no effect"),
        ("1/0", "ZeroDivisionError"),
        ("class", "SyntaxError"),
        ("exit()", "SystemExit"),
    ):
        broken = tmp_path / "broken_effects.py"
        broken.write_text(content)
        with pytest.raises(RecordError, match=sentence):
            effects_in(broken)


def test_the_corrected_log_lacks_the_rows_that_were_left_out(tmp_path):
    record = make_record(600, seed=1).reset_index()[["time", "temperature", "reading"]]
    doubled = pd.concat([record, record[100:103]]).sort_values("time", kind="stable")
    doubled.to_csv(tmp_path / "log.csv", index=False)
    story = Story.open([tmp_path / "log.csv"], Options(skip_bad_rows=True))
    story.start()
    (tmp_path / "corrected.csv").write_bytes(story.export("corrected"))
    written = pd.read_csv(tmp_path / "corrected.csv")
    assert written["time"].tolist() == record["time"].astype(str).tolist() and written["corrected"].notna().all()

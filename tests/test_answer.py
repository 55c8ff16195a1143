"""The answer to a record: sixteen lines, JSON, page and workbench tell the same, in the same order."""

import json
import re
import sys
from pathlib import Path

import pytest

from thermocorr import DynamicBiasRegressor, compare_variants, diagnose, refine
from thermocorr.command.cli import main
from thermocorr.datasets import make_record
from thermocorr.effects import Covariate
from thermocorr.output.answer import LINES, Answer
from thermocorr.output.report import report_text
from thermocorr.output.words import page_width
from thermocorr.workbench import Story
from thermocorr.workbench.state import state_of

sys.path.append(str(Path(__file__).parents[1] / "benchmarks"))
from real_records import every

KEYS = [
    "choice", "model", "error", "errors", "verdict", "causes", "proposal", "small", "left", "notes", "files",
]  # fmt: skip


@pytest.fixture(scope="module")
def asked():
    record = make_record(3000, effects={"covariate": 2.0}, seed=3)
    X, y = record.drop(columns="reading"), record["reading"]
    comparison = compare_variants(X, y, temperature="temperature", time_constants=["5 min", "90 min"], n_blocks=2)
    return X, y, comparison, refine(comparison.best_, X, y)


def test_the_refined_model_is_one_of_the_corrections(asked):
    X, y, comparison, refinement = asked
    answer = Answer.of(X, y, comparison=comparison, refinement=refinement)
    told = answer.to_dict()
    assert list(told) == KEYS and json.loads(json.dumps(told, allow_nan=False)) == told
    assert told["choice"] == "refined" and told["model"] == "dynamic linear with covariate: supply"
    assert list(told["errors"])[-1] == "refined" and told["error"]["after"] == told["errors"]["refined"]
    assert told["error"]["after"] < 0.7 * told["errors"]["dynamic linear"]
    (cause,) = told["causes"]
    assert cause["state"] == "added" and cause["column"] == "supply" and cause["stretches"] == 6
    assert cause["after"] == pytest.approx(refinement.steps["later_rms"].iloc[-1], rel=0.05)
    assert cause["before"] == pytest.approx(refinement.steps["later_rms"].iloc[0], rel=1e-9)
    assert str(answer).startswith("Use the refined correction, dynamic linear with covariate: supply: it leaves 0.2")


def test_a_refined_model_that_is_no_better_is_not_advised(asked):
    """It must beat what was advised by as much as an effect must be worth to be added."""
    X, y, comparison, refinement = asked
    same = refine(comparison.best_, X, y, max_steps=0)
    other = same.model_.with_effect(Covariate("mains")).fit(X, y)  # a column that does nothing
    worse = type(refinement)(refinement.steps, other, refinement.diagnoses, refinement.added)
    assert Answer.of(X, y, comparison=comparison, refinement=same).choice == "dynamic"
    answer = Answer.of(X, y, comparison=comparison, refinement=worse)
    assert answer.choice == "dynamic" and answer.last is refinement.diagnoses[0]
    assert [cause.state for cause in answer.causes] == ["not confirmed"]


def test_what_the_user_asks_for_is_used_and_said(asked):
    X, y, comparison, _ = asked
    answer = Answer.of(X, y, comparison=comparison, asked="static linear")
    assert answer.choice == "static" and answer.model == "static linear"
    assert str(answer).startswith("You asked for the static linear correction: it leaves")
    assert "static linear *" in str(answer) and "* is asked for" in str(answer) and "advised" not in str(answer)


def fits(text):
    lines = text.splitlines()
    return len(lines) <= LINES and max(map(len, lines)) <= page_width()


def test_there_is_room_for_what_matters_however_much_there_is_to_say(asked):
    X, y, comparison, refinement = asked
    note = "A note on the data, with words enough that it takes more than one line of the terminal, as some do."
    many = tuple(f"{note} {k}" for k in range(20))
    files = tuple(f"/a/folder/with/a/long/name/file_{k}.csv" for k in range(6))
    answer = Answer.of(X, y, comparison=comparison, refinement=refinement, notes=many, files=files)
    assert fits(str(answer))
    assert re.search(r"^\d+ more on the data: --json$", str(answer), re.M) and "Written: file_0.csv" in str(answer)
    assert answer.to_dict()["notes"] == list(many)


def test_too_short_a_record_is_answered(tmp_path, capsys):
    make_record(60, seed=1).to_csv(tmp_path / "log.csv")
    command = ["analyze", str(tmp_path / "log.csv"), "--time-constants", "10min"]
    assert main([*command, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["choice"] is None and told["verdict"] is None and told["error"]["after"] is None
    assert main([*command, "--variant", "dynamic-linear"]) == 0
    said = capsys.readouterr().out
    assert fits(said) and "the record is too short" in said


@pytest.mark.long
@pytest.mark.newest
def test_terminal_json_page_and_workbench_name_the_same_causes_in_the_same_order(measured):
    for name, (X, y, column, n) in every(str(measured)).items():
        if name.startswith("oldtown"):  # the last 3 000 rows: they have most causes, and take longest
            X, y, n = X[n - 3000 : n], y[n - 3000 : n], 3000
        model = DynamicBiasRegressor(
            column, degree=1 if column == "recharge_mm" else 2, run="run" if "run" in X else None
        )
        found = diagnose(model.fit(X[:n], y[:n]), X[:n], y[:n])
        answer = Answer(diagnosis=found)
        titles = [cause["effect"] for cause in answer.to_dict()["causes"]]
        rows = [line for line in answer.lines() if line.endswith(("missing", "missing, not proven"))]
        assert fits(str(answer)), name
        for row, title in zip(rows, titles, strict=True):
            assert title.startswith(row.split("   ")[0].removesuffix("...").strip()), name
        story = Story.of(model, X[:n], y[:n])
        story.fit().diagnosis = found
        shown = [one for one in state_of(story)["judged"]["suspects"] if one["cause"]]
        labels = [one["label"].split(", ")[0] for one in shown]
        assert labels == [cause.label for cause in found.causes], name
        text = report_text(*found.record, answer).replace("&#39;", "'").replace("&gt;", ">")
        order = re.search(r'<table class="suspects">.*?</table>', text, re.S)[0]
        places = [order.index(f"<strong>{cause.label}</strong>") for cause in dict.fromkeys(found.causes)]
        assert places == sorted(places), name

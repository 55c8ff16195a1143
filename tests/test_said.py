"""What the commands say before a wrong number leaves them: other units, other clocks, rows that deserve no trust."""

import json
import re

import numpy as np
import pandas as pd
import pytest
from sklearn.exceptions import NotFittedError
from sklearn.linear_model import Ridge

from thermocorr import (
    DynamicBiasRegressor,
    OnlineCorrector,
    RecordError,
    TimeConstantSearch,
    diagnose,
    load_model,
    save_model,
)
from thermocorr.command.cli import main
from thermocorr.datasets import make_record

ROWS = 1500


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    """Folder with log.csv, whose times are local ones of winter, and model.json, and the log as a frame."""
    folder = tmp_path_factory.mktemp("bench")
    log = make_record(ROWS, sampling_period=30.0, seed=3).reset_index()[["time", "temperature", "humidity", "reading"]]
    log["time"] = log["time"].dt.strftime("%Y-%m-%dT%H:%M:%S")
    model = DynamicBiasRegressor(time="time", time_constants=["10 min", "2 h"])
    save_model(model.fit(log, log["reading"]), folder / "model.json")
    log.to_csv(folder / "log.csv", index=False)
    return folder, log


def written(tmp_path, log, **columns):
    path = tmp_path / "changed.csv"
    log.assign(**columns).to_csv(path, index=False)
    return str(path)


def correct(bench, *more):
    return main(["correct", "--model", str(bench[0] / "model.json"), *map(str, more)])


def analyze(path, *more):
    return main(["analyze", str(path), "--time-constants", "10min", *map(str, more)])


@pytest.mark.parametrize("way", ["whole", "short"])
def test_a_log_in_kelvin_is_refused(bench, tmp_path, capsys, way):
    log = bench[1][: 7 if way == "short" else ROWS]
    path = written(tmp_path, log, temperature=log["temperature"] + 273.15)
    assert correct(bench, path, "--out", tmp_path / "out.csv") == 2
    assert "looks like kelvin where degC was fitted. Convert 'temperature' first." in capsys.readouterr().err
    assert not (tmp_path / "out.csv").exists()


def test_a_single_row_in_another_unit_is_flagged(bench, tmp_path, capsys):
    log = bench[1][:100].copy()
    log.loc[50:52, "temperature"] += 273.15
    assert correct(bench, written(tmp_path, log), "--out", tmp_path / "out.csv") == 0
    assert "3 of 100 rows got no result: 3 other unit" in capsys.readouterr().err
    assert pd.read_csv(tmp_path / "out.csv")["flag"].eq("other unit").to_numpy().nonzero()[0].tolist() == [50, 51, 52]


def test_degrees_fahrenheit_are_asked_back(bench, tmp_path, capsys):
    path = written(tmp_path, bench[1], temperature=1.8 * bench[1]["temperature"] + 32.0)
    assert correct(bench, path, "--out", tmp_path / "out.csv") == 0
    said = capsys.readouterr().err
    assert said.count("if 'temperature' is in degF, convert it first") == 1
    assert f"{ROWS} of {ROWS} rows are flagged" in said and "doubtful input" in said


@pytest.fixture(scope="module")
def with_units(tmp_path_factory):
    """As `bench`, with units in the headers."""
    folder = tmp_path_factory.mktemp("units")
    log = make_record(ROWS, seed=3).reset_index()[["time", "temperature", "reading"]]
    log = log.set_axis(["time", "room [degC]", "U [V]"], axis=1)
    model = DynamicBiasRegressor("room [degC]", time="time", time_constants=["10 min"])
    save_model(model.fit(log.drop(columns="U [V]"), log["U [V]"]), folder / "model.json")
    return folder, log


@pytest.mark.parametrize(
    ("renamed", "factor", "option", "said"),
    [
        (
            {"U [V]": "U [mV]"},
            1000.0,
            "--reading",
            "reading 'U [mV]' is in mV, and the model was fitted to 'U [V]' in V",
        ),
        (
            {"room [degC]": "room [degF]"},
            1.8,
            "--temperature",
            "temperature 'room [degF]' is in degF, and the model was fitted to 'room [degC]' in degC",
        ),
    ],
)
def test_a_header_with_another_unit_is_refused(with_units, tmp_path, capsys, renamed, factor, option, said):
    ((old, new),) = renamed.items()
    path = written(tmp_path, with_units[1].assign(**{old: factor * with_units[1][old]}).rename(columns=renamed))
    assert correct(with_units, path, option, new, "--out", tmp_path / "out.csv") == 2
    error = capsys.readouterr().err
    assert said in error and "Convert the column to " in error and "or rename it if its header is wrong" in error
    assert not (tmp_path / "out.csv").exists()


@pytest.mark.parametrize("name", ["U", "U [V]", "U_V", "reading (raw)"])
def test_a_header_with_the_same_unit_or_none_is_read(with_units, tmp_path, capsys, name):
    path = written(tmp_path, with_units[1].rename(columns={"U [V]": name}))
    assert correct(with_units, path, "--reading", name) == 0


def test_readings_whose_name_has_another_unit_are_refused(with_units):
    log, model = with_units[1], load_model(with_units[0] / "model.json")
    X = log.drop(columns="U [V]")
    wrong = (1000.0 * log["U [V]"]).rename("U [mV]")
    model.correct(X, wrong.rename(None))  # nothing is said of the unit
    for done in (model.correct, model.residuals, model.evaluate, model.flags, OnlineCorrector(model).update_many):
        with pytest.raises(RecordError, match=r"'U \[mV\]' is in mV, and the model was fitted to 'U \[V\]' in V"):
            done(X, wrong)


def test_the_question_of_degf_names_the_column_of_this_log(with_units, tmp_path, capsys):
    log = with_units[1].rename(columns={"room [degC]": "hall"})
    path = written(tmp_path, log.assign(hall=1.8 * log["hall"] + 32.0))
    assert correct(with_units, path, "--temperature", "hall", "--out", tmp_path / "out.csv") == 0
    said = capsys.readouterr().err
    assert "is in degF, convert it first" in said


def test_rows_that_deserve_no_trust_are_counted(bench, tmp_path, capsys):
    later = bench[1].assign(time=bench[1]["time"].str.replace("2024", "2023", n=1))[:600]
    assert correct(bench, written(tmp_path, later), "--out", tmp_path / "out.csv") == 0
    said = capsys.readouterr().err
    assert "600 of 600 rows are flagged: 600 washout. washout: the log lacks the time before them" in said
    assert correct(bench, bench[0] / "log.csv", "--out", tmp_path / "out.csv", "--force") == 0
    assert capsys.readouterr().err == ""


@pytest.fixture
def autumn(bench, tmp_path):
    """A log of local times over the end of summer time."""
    times = pd.date_range("2024-10-26T20:00", periods=ROWS, freq="30s", tz="UTC").tz_convert("Europe/Berlin")
    return written(tmp_path, bench[1], time=times.strftime("%Y-%m-%dT%H:%M:%S"))


def test_the_end_of_summer_time_is_named_before_sorting(autumn, capsys):
    for more in ((), ("--skip-bad-rows",)):
        assert analyze(autumn, *more) == 2
        said = capsys.readouterr().err
        assert "2024-10-27 02:00:00 follows 2024-10-27 02:59:30" in said and "--timezone Europe/Berlin" in said
    assert analyze(autumn, "--timezone", "Europe/Berlin") == 0


def test_rows_that_came_an_hour_late_are_sorted(bench, tmp_path, capsys):
    log = bench[1]
    path = written(tmp_path, pd.concat([log[:100], log[101:220], log[100:101], log[220:]]))
    assert analyze(path, "--skip-bad-rows") == 0
    assert "sorted by time: 120 rows moved" in capsys.readouterr().out


def test_labels_of_which_each_row_has_another_are_refused_at_once(bench, capsys):
    log = bench[1]
    assert analyze(bench[0] / "log.csv", "--run", "humidity") == 2
    assert f"'humidity' has {ROWS} different values in {ROWS} rows: each run needs many rows" in capsys.readouterr().err
    for model in (DynamicBiasRegressor(run="time"), TimeConstantSearch(DynamicBiasRegressor(run="time"))):
        with pytest.raises(RecordError, match="'time' has 1500 different values in 1500 rows"):
            model.fit(log, log["reading"])


def test_times_of_the_log_count_beside_a_sampling_period(bench, tmp_path, capsys):
    assert analyze(bench[0] / "log.csv", "--sampling-period", "5s") == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "have times of their own: --sampling-period is not used" in said and "a row every 30 s" in said
    assert analyze(written(tmp_path, bench[1].drop(columns="time")), "--sampling-period", "5s") == 0
    assert "a row every 5 s" in " ".join(capsys.readouterr().out.split())
    stopped = written(tmp_path, bench[1], time="2024-03-04T00:00:00")
    assert analyze(stopped, "--sampling-period", "5s") == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "The times do not go forward" in said and "a row every 5 s" in said


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--time-constants", "10min,foo"), "Got 'foo' instead"),
        (("--time-constants", ","), "--time-constants names none"),
    ],
)
def test_options_out_of_range_are_refused_before_the_log_is_read(options, said, capsys):
    assert analyze("there is no such log.csv", *options) == 2
    assert said in capsys.readouterr().err


def test_a_temperature_in_a_unit_of_none(bench, tmp_path, capsys):
    path = written(tmp_path, bench[1].rename(columns={"humidity": "Feuchte [%rH]"}))
    assert analyze(path, "--temperature", "Feuchte [%rH]") == 0
    assert "The unit of 'Feuchte [%rH]' is %, no temperature" in capsys.readouterr().out


def test_times_are_in_the_zone_of_the_models_log_or_refused(bench, autumn, tmp_path, capsys):
    """A log that is written as the fitted one is in its zone; one of another form may be in any."""
    assert analyze(autumn, "--timezone", "Europe/Berlin", "--out", tmp_path / "zoned") == 0
    command = ["correct", "--model", str(tmp_path / "zoned" / "model.json")]
    assert main([*command, autumn, "--out", str(tmp_path / "out.csv")]) == 0
    same = [pd.read_csv(path)["time"].tolist() for path in (tmp_path / "out.csv", tmp_path / "zoned" / "corrected.csv")]
    assert same[0] == same[1] and same[0][0] == "2024-10-26 20:00:00+00:00"
    capsys.readouterr()
    other = tmp_path / "tabs.csv"
    pd.read_csv(autumn).to_csv(other, sep="\t", index=False)
    assert main([*command, str(other)]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and "The times have no zone" in said and "--timezone Europe/Berlin" in said
    assert main([*command, str(other), "--timezone", "Europe/Berlin"]) == 0


def test_a_sample_that_is_no_number_is_refused_in_a_sentence(bench):
    log = bench[1]
    live = OnlineCorrector(
        DynamicBiasRegressor(time="time", time_constants=["10 min"]).fit(log, log["reading"]), continues=False
    )
    with pytest.raises(RecordError, match=r"None or NaN where there is none\. Got 'warm' instead"):
        live.update("2024-03-05T00:00:00", "warm", 10.0)
    with pytest.raises(TypeError, match="must be numbers"):
        live.update("2024-03-05T00:00:00", [1.0, 2.0], 10.0)
    assert np.isfinite(live.update("2024-03-05T00:00:00", 21.0, 10.0).corrected)


def test_only_fitted_models_are_judged():
    X, y = pd.DataFrame({"temperature": np.arange(9.0)}), np.arange(9.0)
    with pytest.raises(TypeError, match=r"judges a fitted DynamicBiasRegressor\. Got Ridge\."):
        diagnose(Ridge().fit(X, y), X, y)
    with pytest.raises(NotFittedError):
        diagnose(DynamicBiasRegressor(), X, y)


@pytest.mark.long
@pytest.mark.newest
def test_the_refined_model_is_the_first_thing_that_terminal_page_and_json_say(capsys, tmp_path):
    command = ["analyze", "--refine"]
    assert main([*command, "--report", str(tmp_path / "page.html")]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) <= 16 and max(map(len, lines)) <= 100
    first = " ".join(line.strip() for line in lines[:2])
    assert first.startswith(
        "Use the refined correction, dynamic linear with lagged covariate: humidity, static polynomial: it leaves 59 nV"
    )
    page = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert re.findall(r'<p class="lead">(.*?)</p>', page, flags=re.S)[0] == first
    what, cure = (re.search(rf'<section id="{name}">.*?</section>', page, re.S)[0] for name in ("what", "cure"))
    assert re.findall('data-verdict="(.*?)"', what) == ["nothing missing"] and "Add the effect" not in cure
    assert main([*command, "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["choice"] == "refined" and answer["verdict"] == "nothing missing" and answer["small"] == 0
    assert [cause["effect"] for cause in answer["causes"]] == ["lagged covariate: humidity", "static polynomial"]
    assert answer["error"]["after"] < 0.08 * answer["error"]["before"] and answer["error"]["unit"] == "mV"


def test_a_diagnosis_alone_speaks_of_its_model():
    record = make_record(2000, effects={"hysteresis": 2.0}, seed=1)
    X, y = record.drop(columns="reading"), record["reading"]
    model = DynamicBiasRegressor("temperature").fit(X, y)
    page = diagnose(model, X, y).to_html()
    assert page.count("data-verdict=") == 1 and "Add the effect" in page and " already" not in page

"""Which measurement decides: profiles within limits, expected ratios, and what is said of them."""

import json
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from thermocorr import DynamicBiasRegressor, calibration_profile, diagnose, propose
from thermocorr.command.cli import main
from thermocorr.datasets import make_record
from thermocorr.effects import (
    Covariate,
    Drift,
    Hinge,
    Interaction,
    LaggedCovariate,
    LogAgeing,
    SensitivityStep,
    StaticPolynomial,
)
from thermocorr.judgement.propose import UNDISTURBED

LIMITS = {"temperature": (18.0, 28.0), "humidity": (30.0, 60.0)}


@pytest.fixture(scope="module")
def record():
    """A record, its readings and a model of the temperature."""
    made = make_record(1200, effects={"hinge": 1.0}, device="plate", seed=3)
    X, y = made.drop(columns="reading"), made["reading"]
    return DynamicBiasRegressor("temperature").fit(X, y), X, y


def between(*effects):
    """A diagnosis that cannot distinguish these."""
    first = SimpleNamespace(effect=effects[0], confusable_with=effects[1:])
    return SimpleNamespace(verdict="ambiguous", causes=(first,))


def test_no_profile_leaves_its_limits_or_moves_too_fast(record):
    model, X, y = record
    proposal = propose(model, between(Hinge(22.5), Interaction("humidity")), X, y, limits=LIMITS, hours=12)
    for name, frame in proposal.frames.items():
        driven = proposal.table.loc[name, "driven"]
        assert len(frame) == 720 and frame.index[0] == X.index[-1] + pd.Timedelta("1min")
        for column in X.columns.difference([driven]):  # goes on as the record did
            assert frame[column].between(X[column].min(), X[column].max()).all()
        if pd.notna(driven):
            low, high = LIMITS[driven]
            assert frame[driven].between(min(low, X[driven].iloc[-1]), max(high, X[driven].iloc[-1])).all()
            most = (6.0 if driven == "temperature" else (high - low) / 2) / 60
            assert np.diff(frame[driven], prepend=X[driven].iloc[-1]).__abs__().max() <= most * (1 + 1e-9)


def test_what_is_driven_decides_sooner_than_waiting(record):
    """A knee and another law from a moment on look alike until the temperature passes the knee again."""
    model, X, y = record
    rivals = between(Hinge(22.5), SensitivityStep(36_000.0))
    ratios = [propose(model, rivals, X, y, limits=LIMITS, hours=hours).table["ratio"] for hours in (3, 6, 12)]
    for some in ratios:
        assert some.iloc[0] >= some[UNDISTURBED] and (some.to_numpy() >= 0).all()
    assert ratios[0].iloc[0] < ratios[1].iloc[0] < ratios[2].iloc[0]  # twice as long says more


def test_odds_are_stated_where_they_are_kept(record):
    model, X, y = record
    table = propose(model, between(Hinge(22.5), Interaction("humidity")), X, y, limits=LIMITS, hours=6).table
    driven = table[table["driven"].notna()]  # the best first
    assert (np.diff(driven["odds"].fillna(0.0)) <= 0).all() and driven["odds"].iloc[0] > 0.5
    assert not table["odds"][UNDISTURBED] > driven["odds"].iloc[0]


def test_laws_of_time_ask_for_days_and_for_no_profile(record):
    model, X, y = record
    y = y + np.linspace(0.0, 3.0, len(y))
    proposal = propose(model, between(Drift(), LogAgeing(3600.0)), X, y, limits=LIMITS)
    assert proposal.days and proposal.profile is None and proposal.table["odds"].isna().all()
    assert f"drift from log ageing in 24 h; time does: log on for {proposal.days} days" in proposal.sentence()


def test_time_decides_where_no_profile_does(record):
    """Pressure cannot be driven; a drift does not come back as the weather does."""
    model, X, y = record
    rivals, y = between(Covariate("pressure"), Drift()), y + np.linspace(0.0, 3.0, len(y))
    proposal = propose(model, rivals, X, y, limits={"temperature": (22.0, 23.0)}, hours=3)
    assert np.isnan(proposal.table["odds"].iloc[0]) and proposal.days
    assert "in 3 h; time does: log on" in proposal.sentence()


def test_a_late_form_is_bounded_and_not_excluded(record):
    model, X, y = record
    proposal = propose(model, between(Covariate("humidity"), LaggedCovariate("humidity", ["1 h"])), X, y, limits=LIMITS)
    assert proposal.nested and "bounds it" in proposal.sentence()


def test_a_proposal_is_printed_drawn_and_written(record):
    model, X, y = record
    proposal = propose(model, between(Hinge(22.5), Interaction("humidity")), X, y, limits=LIMITS, hours=6)
    assert str(proposal).startswith(proposal.sentence())
    assert json.loads(json.dumps(proposal.to_dict()))["profiles"][0]["profile"] == proposal.best
    pytest.importorskip("matplotlib")
    assert " ".join(proposal.plot().get_title(loc="left").split()) == proposal.sentence()


@pytest.mark.parametrize("kind", ["an array", "seconds", "two runs"])
def test_records_of_other_kinds_go_on(kind, record):
    _, X, y = record
    limits = {"temperature": (18.0, 28.0)}
    columns = {"temperature": "temperature"}
    if kind == "an array":
        X, limits, columns = X.to_numpy(), {0: (18.0, 28.0)}, {"temperature": 0, "sampling_period": 60.0}
    elif kind == "seconds":
        X = X.reset_index(drop=True).assign(t=60.0 * np.arange(len(X)))
        columns["time"] = "t"
    else:
        X, columns["run"] = X.assign(run=np.arange(len(X)) // 600), "run"
    model = DynamicBiasRegressor(**columns).fit(X, y)
    column = 1 if kind == "an array" else "humidity"
    proposal = propose(model, between(Hinge(22.5), Interaction(column)), X, y, limits=limits, hours=6)
    assert len(proposal.profile) == 360 and np.isfinite(proposal.table["ratio"]).all()


@pytest.mark.parametrize(
    ("limits", "said"),
    [({"pressing": (1.0, 2.0)}, "names 'pressing'; the record has"), ({"humidity": (60.0, 30.0)}, "Got 60.0 and 30.0")],
)
def test_limits_that_are_none_are_refused(record, limits, said):
    model, X, y = record
    with pytest.raises(ValueError, match=said):
        propose(model, between(Hinge(22.5), Interaction("humidity")), X, y, limits=limits)


@pytest.mark.parametrize(
    "more", [{"hours": -5}, {"hours": np.nan}, {"fastest": {"mains": 1}}, {"fastest": {"humidity": 0}}]
)
def test_lengths_and_rates_that_are_none_are_refused(record, more):
    model, X, y = record
    with pytest.raises(ValueError, match="positive"):
        propose(model, between(Hinge(22.5), Interaction("humidity")), X, y, limits=LIMITS, **more)


def test_a_profile_of_few_rows_is_refused(record):
    model, X, y = record
    with pytest.raises(ValueError, match=r"or more: a row stands for 0\.0167 h of this record"):
        propose(model, between(Hinge(22.5), Interaction("humidity")), X, y, limits=LIMITS, hours=0.1)


def test_where_nothing_is_ambiguous_nothing_is_proposed(record):
    model, X, y = record
    calm = SimpleNamespace(verdict="nothing missing", causes=())
    with pytest.raises(ValueError, match="There is nothing to decide: the diagnosis says 'nothing missing'"):
        propose(model, calm, X, y)


def test_an_ambiguous_answer_says_what_to_measure(record, tmp_path, capsys):
    model, X, y = record
    found = diagnose(model, X, y)
    assert found.verdict == "ambiguous" and found.proposal.sentence() in " ".join(str(found).split())
    X.assign(reading=y).to_csv(tmp_path / "log.csv")
    assert main(["analyze", str(tmp_path / "log.csv"), "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert (answer["verdict"] == "ambiguous") == (answer["proposal"] is not None)
    profile = tmp_path / "profile.csv"
    given = ["--drive", "temperature", "18", "28", "--hours", "6", "--out", str(profile)]
    assert main(["propose", str(tmp_path / "log.csv"), *given]) == 0
    assert "of 100" in capsys.readouterr().out
    written = pd.read_csv(profile, index_col=0, parse_dates=True)
    assert len(written) == 360 and written.index[0] == X.index[-1] + pd.Timedelta("1min")


def test_a_log_that_is_not_ambiguous_has_no_profile(tmp_path, capsys):
    make_record(2000, seed=1).to_csv(tmp_path / "log.csv")
    assert main(["propose", str(tmp_path / "log.csv"), "--out", str(tmp_path / "profile.csv")]) == 2
    assert "There is nothing to decide: the verdict is 'nothing missing'" in capsys.readouterr().err
    assert not (tmp_path / "profile.csv").exists()


def test_a_temperature_that_comes_back_decides_between_a_drift_and_a_static_law():
    """The air of the record goes one way, as time does: what a drift is there, a temperature coefficient may be."""
    n = 1200
    index = pd.date_range("2024-03-04", periods=n, freq="min", tz="Europe/Berlin")
    X = pd.DataFrame({"temperature": 20 + np.arange(n) / 400}, index)
    y = 100 + 2 * np.arange(n) / n + 0.05 * np.random.default_rng(3).standard_normal(n)
    model = DynamicBiasRegressor("temperature", ["5 min"]).fit(X, y)
    proposal = propose(model, between(Drift(), StaticPolynomial(1)), X, y, limits={"temperature": (20, 23)}, hours=12)
    assert proposal.rivals == ("drift", "static polynomial")
    assert proposal.table["driven"].iloc[0] == "temperature"
    assert str(proposal.profile.index.tz) == "UTC" and proposal.profile.index[0] > index[-1]


def test_a_first_calibration_stays_within_its_limits_and_learns_fast_and_slow_lags(tmp_path, capsys):
    """A device of two lags, minutes and hours: the model knows later air better than after a day in a flat room."""
    out = tmp_path / "profile.csv"
    assert main(["propose", "--drive", "oven", "21", "25", "--out", str(out)]) == 0
    assert "Let the instrument settle at 23 before" in capsys.readouterr().out
    T = pd.read_csv(out, index_col="seconds")["oven"]
    assert len(T) == 1440 and T.min() == 21 and T.max() == 25 and T.diff().abs().max() <= 0.1 + 1e-9
    model = DynamicBiasRegressor("temperature")
    rng, minutes = np.random.default_rng(5), np.arange(4320)
    later = 23 + np.sin(2 * np.pi * minutes / 1440) + 0.3 * np.sin(2 * np.pi * minutes / 97)
    room = 23 + 0.3 * np.sin(2 * np.pi * minutes[:1440] / 1440)

    def bias(temperature):
        fast, slow = (
            pd.Series(temperature - 23).ewm(alpha=1 - np.exp(-1 / tau), adjust=False).mean() for tau in (5, 120)
        )
        return (6 * fast + 4 * slow).to_numpy()

    def error(temperature):
        model.fit(_dated(temperature), bias(temperature) + 0.2 * rng.standard_normal(len(temperature)))
        return np.std((model.predict(_dated(later)) - bias(later))[1440:])

    assert error(T.to_numpy()) < error(room)


def _dated(temperature):
    return pd.DataFrame({"temperature": temperature}, pd.date_range("2024-03-04", periods=len(temperature), freq="min"))


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ((25, 21), "a lower and an upper one. Got 25 and 21"),
        ((21, np.inf), "Got 21 and inf"),
        ((21, 25, {"hours": 0}), "must be a positive number. Got 0"),
        ((21, 25, {"fastest": 0.1}), "take more hours, closer limits, or faster changes"),
        ((21, 25, {"hours": 0.1}), "6 samples of 60.0 s in 0.1 h are fewer than"),
    ],
)
def test_a_first_calibration_refuses_limits_and_lengths_that_are_none(given, said):
    low, high, *more = given
    with pytest.raises(ValueError, match=said):
        calibration_profile(low, high, **(more[0] if more else {}))


def test_without_a_log_a_temperature_is_needed(tmp_path, capsys):
    assert main(["propose", "--out", str(tmp_path / "profile.csv")]) == 2
    assert "one --drive gives the temperature's name" in capsys.readouterr().err

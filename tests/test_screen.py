"""The screen: what is no reading and no temperature is found, left out and said; what a device really does is not."""

import warnings

import numpy as np
import pandas as pd
import pytest

from thermocorr import (
    DynamicBiasRegressor,
    OnlineCorrector,
    RecordError,
    RecordWarning,
    compare_variants,
    diagnose,
    load_model,
    refine,
    save_model,
)
from thermocorr.command.cli import main
from thermocorr.datasets import make_record
from thermocorr.equations.outliers import spikes, usual_of
from thermocorr.records.screen import Limits
from thermocorr.validation import held_out_residuals

N = 20_000
TAUS = ["5 min", "90 min"]


def telegraph(rng, dwell):
    return 30.0 * (np.cumsum(rng.random(N) < 1 / dwell) % 2) + rng.normal(size=N)


def bursts(rng):
    values = rng.normal(size=N)
    values[5000:5030] *= 50
    return values


def pulses(rng):
    """A heater pulse in every 2500 rows, three rows long in its decay."""
    since = np.arange(N) % 2500
    return 20 * np.exp(-since / 3.0) + 0.01 * rng.normal(size=N)


def steps(rng):
    return 5.0 * (np.arange(N) // 2500) + 0.01 * rng.normal(size=N)


def one_step(rng):
    return 500.0 * (np.arange(N) > 7777) + rng.normal(size=N)


PHYSICS = {
    "white": lambda rng: rng.normal(size=N),
    "Laplace": lambda rng: rng.laplace(size=N),
    "random walk": lambda rng: np.cumsum(rng.normal(size=N)),
    "quantised": lambda rng: np.round(0.1 * rng.normal(size=N)),
    "quantised, wandering": lambda rng: np.round(0.15 * rng.normal(size=N) + 3 * np.sin(np.arange(N) / 3000)),
    "hardly ever moving": lambda rng: (rng.random(N) < 1e-3) * 1.0,
    "telegraph of 2 rows": lambda rng: telegraph(rng, 2),
    "telegraph of 20 rows": lambda rng: telegraph(rng, 20),
    "telegraph of 200 rows": lambda rng: telegraph(rng, 200),
    "bursts of noise": bursts,
    "heater pulses": pulses,
    "steps": steps,
    "one step": one_step,
    "oven, 20 to 85": lambda rng: np.clip(20 + np.arange(N) / 100, 20, 85.0).round(1),
}


@pytest.mark.parametrize("make", PHYSICS.values(), ids=PHYSICS)
def test_what_a_device_does_is_no_spike(make):
    assert [np.flatnonzero(spikes(make(np.random.default_rng(seed)))).tolist() for seed in range(100, 103)] == [[]] * 3


def test_white_noise_has_less_than_one_spike_in_a_million():
    assert not spikes(np.random.default_rng(11).normal(size=2_000_000)).any()


def test_heavy_tails_have_at_most_rare_spikes():
    """Student's t with three degrees: a tenth of the records may lose its largest reading, by how the reach is set."""
    found = [int(spikes(np.random.default_rng(seed).standard_t(3, size=N)).sum()) for seed in range(200, 240)]
    assert sum(found) <= 8


@pytest.mark.parametrize("make", [PHYSICS["white"], PHYSICS["quantised, wandering"], steps])
def test_spikes_are_found_where_they_are(make):
    values = make(np.random.default_rng(300))
    noise = usual_of([values]).noise
    rows = [100, 5100, 5101, 15_100, 19_998]
    values[rows] += np.array([1, -1, -1.5, 1, 2]) * 60 * noise
    assert np.flatnonzero(spikes(values)).tolist() == rows


def test_codes_are_found_where_they_are():
    values = 20 + 0.05 * np.random.default_rng(5).normal(size=N) + np.sin(np.arange(N) / 500)
    rows = np.r_[0, 9000, 3000:3040, 700:710, 12_000:12_500, N - 1]
    values[rows] = np.r_[-999.0, 85.0, np.full(40, 85.0), np.full(10, -127.0), np.full(500, 9.9e37), 9999.0]
    assert np.flatnonzero(spikes(values)).tolist() == np.sort(rows).tolist()


@pytest.fixture(scope="module")
def clean():
    record = make_record(N, seed=61)
    return record[["temperature"]], record["reading"]


def fit(X, y, **options):
    return DynamicBiasRegressor("temperature", TAUS, **options).fit(X, y)


def spoiled(X, y, temperature=True):
    """Spikes of 100 times the noise, overloads, and a thermometer that falls out; the rows of each."""
    X, y = X.copy(), y.copy()
    y.iloc[[120, 4711, 9000]] += 20.0
    y.iloc[[300, 7000]] = 9.9e37
    if temperature:
        X.iloc[[2000, 2101]] = 85.0
        X.iloc[4000:4040] = -999.0
        X.iloc[6001] += 5.0
    return X, y, [2000, 2101, *range(4000, 4040), 6001]


def test_clean_records_are_left_alone(clean):
    model, plain = fit(*clean), fit(*clean, screen=False)
    assert model.notes_ == () and not any("left out" in note for note in plain.notes_)
    np.testing.assert_array_equal(model.coef_, plain.coef_)


@pytest.mark.long
@pytest.mark.newest
def test_spikes_and_overloads_change_neither_error_nor_verdict(clean):
    for rows, spoil in ((N, "spikes"), (3000, "overloads")):
        X, y = clean[0].iloc[:rows], clean[1].iloc[:rows]
        bad = y.copy()
        if spoil == "spikes":
            bad.iloc[[777, 10_000, 15_555]] += [20.0, -20.0, 20.0]
        else:
            bad.iloc[[5, 700, 701, 2500]] = 9.9e37
        with pytest.warns(RecordWarning, match="left out as"):
            model = DynamicBiasRegressor("temperature").fit(X, bad)
        plain = DynamicBiasRegressor("temperature").fit(X, y)
        true = plain.residuals(X, y)
        assert np.std(y - model.predict(X)) == pytest.approx(np.std(true), rel=0.02)
        found, expected = diagnose(model, X, bad), diagnose(plain, X, y)
        assert found.verdict == expected.verdict == "nothing missing"
        assert found.residual_rms == pytest.approx(expected.residual_rms, rel=0.02)
        unscreened = DynamicBiasRegressor("temperature", TAUS, screen=False)
        assert diagnose(unscreened.fit(X, bad), X, bad).verdict != "nothing missing"


def test_a_refused_temperature_is_as_if_its_row_had_not_been_recorded(clean):
    """What the record without these rows gives, to rounding: blocks, which are cut elsewhere, are summed otherwise."""
    X, y, rows = spoiled(*clean)
    kept = np.delete(np.arange(N), rows)
    for max_gap in (None, "10 min"):
        model, less = fit(X, y, max_gap=max_gap), fit(X.iloc[kept], y.iloc[kept], max_gap=max_gap)
        np.testing.assert_allclose(model.predict(X)[kept], less.predict(X.iloc[kept]), rtol=1e-13)
        assert np.isnan(model.predict(X)[rows]).all()
        assert model.residual_std_ == pytest.approx(0.2, rel=0.02)
    assert len(model.features_.history_.record.segments) == 2


def test_rows_are_named_and_flagged(clean):
    X, y, _ = spoiled(*clean)
    with pytest.warns(RecordWarning) as said:
        model = DynamicBiasRegressor("temperature", TAUS).fit(X, y)
    assert model.notes_ == tuple(str(one.message) for one in said)
    assert "3 readings left out as spikes: rows 120, 4711, 9000." in model.notes_
    assert "2 readings left out as sentinels: rows 300, 7000." in model.notes_
    assert "1 temperature left out as spike: row 6001." in model.notes_
    assert any(note.startswith("42 temperatures left out as sentinels: rows 2000,") for note in model.notes_)
    found = model.evaluate(X, y)
    assert np.flatnonzero(found["flag"] == "spike").tolist() == [120, 4711, 6001, 9000]
    assert np.flatnonzero(found["flag"] == "sentinel").tolist() == [300, 2000, 2101, *range(4000, 4040), 7000]
    refused = found["flag"].isin(["spike", "sentinel"])
    assert found.loc[refused, "corrected"].isna().all() and found.loc[~refused, "corrected"].notna().all()
    pd.testing.assert_series_equal(model.flags(X, y), found["flag"])
    pd.testing.assert_series_equal(model.correct(X, y), found["corrected"])
    pd.testing.assert_series_equal(model.residuals(X, y), found["residual"])


def test_codes_are_refused_in_later_data_too(clean):
    """What no thermometer of this room shows is refused where it comes first; a spike in new data is not known."""
    X, y = clean
    model, later = fit(X.iloc[:9000], y.iloc[:9000]), X.iloc[9000:9500].copy()
    later.iloc[[10, 20, 30]] = [[-127.0], [9999.0], [1e35]]
    later.iloc[40] += 3.0
    flags = model.flags(later)
    assert flags.iloc[[10, 20, 30]].tolist() == ["sentinel"] * 3 and flags.iloc[40] != "spike"
    kept = np.delete(np.arange(500), [10, 20, 30])
    np.testing.assert_array_equal(model.predict(later)[kept], model.predict(later.iloc[kept]))


@pytest.mark.parametrize("dtype", ["float16", "float32", "int16"])
def test_temperatures_of_few_bits_are_screened_as_the_numbers_that_they_are(clean, dtype):
    """1e30, from where on all numbers are codes, is none of half precision."""
    model, later = fit(*clean), clean[0].iloc[9000:9500].copy()
    later.iloc[[10, 20]] = [[-127.0], [999.0]]
    few = later.astype(dtype)
    flags = model.flags(few)
    assert flags.iloc[[10, 20]].tolist() == ["sentinel"] * 2
    assert flags.tolist() == model.flags(few.astype(float)).tolist()


@pytest.mark.parametrize("value", [1e30, -1e30])
def test_overloads_begin_where_they_are_said_to_row_by_row_as_in_blocks(value):
    limits, below = Limits(), float(np.nextafter(value, 0.0))
    assert limits.reason(value, None) == "sentinel" and limits.coded(np.array([0.0, value])).tolist() == [1]
    assert limits.reason(below, None) == "" and limits.coded(np.array([0.0, below])).tolist() == []


def test_all_temperatures_refused_is_an_error(clean):
    model = fit(*clean)
    with pytest.raises(RecordError, match="all 5 rows are refused as sentinels"):
        model.predict(clean[0].iloc[:5] * 0 - 999.0)


def test_figures_about_a_record_leave_them_out(clean):
    X, y = clean[0].iloc[:4000], clean[1].iloc[:4000]
    bad = y.copy()
    bad.iloc[[300, 2500]] = 9.9e37, bad.iloc[2500] + 30.0
    model = fit(X, y)
    stds = [np.nanstd(held_out_residuals(model, X, readings)) for readings in (bad, y)]
    assert stds[0] == pytest.approx(stds[1], rel=0.02)
    comparison = compare_variants(X, bad, model=model)
    assert comparison.frame()["std"].max() < 10
    assert comparison.advice.after < 20


@pytest.mark.long
def test_it_is_said_once_and_at_the_users_line(clean):
    X, y, _ = spoiled(*clean, temperature=False)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("default")
        model = DynamicBiasRegressor("temperature", max_gap="10 min").fit(X, y)
        refine(model, X, y)
        compare_variants(X, y, model=model)
    places = [(str(w.message), w.filename, w.lineno) for w in caught if issubclass(w.category, RecordWarning)]
    assert {filename for _, filename, _ in places} == {__file__}
    assert len(set(places)) == len(places)


def test_without_the_screen_they_are_learned_from(clean):
    X, y, _ = spoiled(*clean, temperature=False)
    y = y.where(y < 1e30)
    model = fit(X, y, screen=False)
    assert not (model.flags(X, y) == "spike").any() and model.correct(X, y).iloc[120] > 200
    assert model.residual_std_ > 0.3


@pytest.mark.parametrize("kind", ["dates", "rows"])
@pytest.mark.parametrize("max_gap", [None, "10 min"])
def test_a_stream_refuses_what_the_record_refuses(clean, tmp_path, kind, max_gap):
    X, y, _ = spoiled(*clean)
    X.iloc[0], X.iloc[9000:9020], y.iloc[9500] = -999.0, 85.0, 9.9e37
    options = {"max_gap": max_gap}
    if kind == "rows":
        X, y = X.reset_index(drop=True), y.reset_index(drop=True)
        options["sampling_period"] = 60.0
    fitted = fit(X[:8000], y[:8000], **options)
    model = load_model(save_model(fitted, tmp_path / "model.json"))
    assert model.features_.history_.screen == fitted.features_.history_.screen
    X, y = X[:10_000], y[:10_000]
    expected = model.evaluate(X, y)
    for cut in (10_000, 992):  # the last block of 80: fewer than 64 rows go one by one
        live = OnlineCorrector(model, average=5, track="2h")
        parts = [live.update_many(X[low : low + cut], y[low : low + cut]) for low in range(0, len(X), cut)]
        got = pd.concat(parts)
        np.testing.assert_array_equal(got["corrected"], expected["corrected"])
        jumps = got["flag"] == "gap"
        assert (got["flag"][~jumps] == expected["flag"][~jumps]).all() and jumps.sum() <= 2
    if kind == "dates":
        live = OnlineCorrector(model, average=5, track="2h")
        one = [live.update(time, T, U) for time, T, U in zip(X.index, X["temperature"], y, strict=True)]
        np.testing.assert_allclose([sample.corrected for sample in one], expected["corrected"], rtol=0, atol=1e-10)
        assert [sample.flag for sample in one] == got["flag"].tolist()
        for name in ("smoothed", "reference"):
            np.testing.assert_allclose([getattr(sample, name) for sample in one], got[name], rtol=0, atol=1e-10)


@pytest.mark.long
@pytest.mark.newest
def test_the_command_says_what_it_left_out(clean, tmp_path, capsys):
    X, y, _ = spoiled(*clean)
    log = X.iloc[:5000].assign(reading=y.iloc[:5000])
    log.to_csv(tmp_path / "log.csv")
    given = ["analyze", str(tmp_path / "log.csv"), "--time-constants", "5min,90min"]
    assert main([*given, "--out", str(tmp_path / "out")]) == 0
    said = capsys.readouterr().out
    assert "Data: 2 readings left out as spikes: rows 120, 4711.\n" in said and said.count("left out as spike") == 1
    corrected = pd.read_csv(tmp_path / "out" / "corrected.csv")
    assert corrected["flag"].iloc[[120, 300, 4000]].tolist() == ["spike", "sentinel", "sentinel"]
    model = str(tmp_path / "out" / "model.json")
    assert main(["correct", str(tmp_path / "log.csv"), "--model", model, "--out", str(tmp_path / "again.csv")]) == 0
    again = pd.read_csv(tmp_path / "again.csv", dtype=str)["corrected"]
    assert again.equals(pd.read_csv(tmp_path / "out" / "corrected.csv", dtype=str)["corrected"])


def test_a_reading_that_is_stuck_has_no_codes(clean):
    """How far a number is from the usual ones cannot be told of one that never changes."""
    X, y = clean
    with pytest.warns(RecordWarning, match="never changes"):
        model = DynamicBiasRegressor("temperature", ["10 min"]).fit(X, 0 * y + 5.0)
    assert model.features_.history_.screen.reading.codes == ()

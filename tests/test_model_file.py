"""Model files: bit for bit there and back, and nothing that is damaged or hostile gets in."""

import json
import sys

import numpy as np
import pandas as pd
import pytest
from effect_records import EXAMPLES, NAMES, log
from sklearn.exceptions import NotFittedError
from sklearn.preprocessing import SplineTransformer

import thermocorr
from thermocorr import DynamicBiasRegressor, ModelFileError, load_model, save_model
from thermocorr.datasets import make_record
from thermocorr.effects import Covariate, Effect, LaggedCovariate
from thermocorr.equations import LagState, lag_differences
from thermocorr.output.codec import pack, parse, render, unpack
from thermocorr.output.model_file import signed as sign


def readings(X, seed=0):
    return (X["temperature"] + np.random.default_rng(seed).normal(0, 0.1, len(X))).rename("reading")


def there_and_back(model, path, **options):
    save_model(model, path / "model.json", force=True, **options)
    return load_model(path / "model.json")


def same(one, other, X, y):
    """Everything that can be asked of two models, bit for bit."""
    np.testing.assert_array_equal(one.predict(X), other.predict(X))
    pd.testing.assert_frame_equal(one.evaluate(X, y), other.evaluate(X, y), check_exact=True)
    np.testing.assert_array_equal(one.correct(X, y), other.correct(X, y))
    pd.testing.assert_frame_equal(one.contributions(X), other.contributions(X), check_exact=True)


@pytest.mark.parametrize("effect", EXAMPLES, ids=NAMES)
def test_every_kind_comes_back_bit_for_bit(effect, tmp_path):
    X = log(600, seed=2, holes=[200])
    y = readings(X)
    model = DynamicBiasRegressor(time_constants=[300.0], max_gap="1 h").with_effect(effect).fit(X[:450], y[:450])
    again = there_and_back(model, tmp_path)
    for rows in (slice(0, 450), slice(450, 600), slice(0, 600)):
        same(model, again, X[rows], y[rows])
    afresh = X.set_axis(X.index - pd.Timedelta("900 days"))
    same(model, again, afresh, y.set_axis(afresh.index))
    pd.testing.assert_frame_equal(model.coef_table(), again.coef_table(), check_exact=True)
    assert model.equation() == again.equation()
    assert repr(model) == repr(again)
    first = (tmp_path / "model.json").read_text()
    save_model(again, tmp_path / "again.json")
    assert (tmp_path / "again.json").read_text() == first


LAYOUTS = {
    "zone": lambda X: (X.tz_localize("Europe/Berlin"), {}),
    "milliseconds": lambda X: (X.set_axis(X.index.as_unit("ms")[:1].append(X.index[1:].as_unit("ms"))), {}),
    "spans": lambda X: (X.set_axis(X.index - X.index[0]), {}),
    "seconds": lambda X: (X.assign(s=0.1 + (X.index - X.index[0]).total_seconds()), {"time": "s"}),
    "rows": lambda X: (X.reset_index(drop=True), {"sampling_period": "1 min"}),
    "array": lambda X: (X.to_numpy(), {"sampling_period": 60}),
    "runs": lambda X: (X.assign(run=np.arange(len(X)) // 250), {"run": "run"}),
    "named runs": lambda X: (X.assign(run=np.where(np.arange(len(X)) < 300, "a", "b")), {"run": "run"}),
}


@pytest.mark.parametrize("layout", LAYOUTS)
def test_every_kind_of_time_comes_back(layout, tmp_path):
    X, more = LAYOUTS[layout](log(600, seed=4))
    y = readings(log(600, seed=4)).to_numpy()
    model = DynamicBiasRegressor(time_constants=["5 min", 7200.0], products=True, **more).fit(X[:450], y[:450])
    again = there_and_back(model, tmp_path)
    for rows in (slice(0, 450), slice(450, 600), slice(0, 100), slice(0, 600)):
        np.testing.assert_array_equal(model.predict(X[rows]), again.predict(X[rows]))
        np.testing.assert_array_equal(model.flags(X[rows]), again.flags(X[rows]))


def test_a_file_is_as_long_as_the_model_and_not_as_its_record(tmp_path):
    """Rows that begin in the middle of the fitted record start afresh, and say so."""
    X = log(3000, seed=1)
    y = readings(X)
    model = DynamicBiasRegressor(time_constants=[300.0, 6000.0]).fit(X[:2500], y[:2500])
    again = there_and_back(model, tmp_path)
    assert (tmp_path / "model.json").stat().st_size < 12_000
    same(model, again, X[:2500], y[:2500])
    same(model, again, X[2500:], y[2500:])
    same(model, again, X, y)
    assert again.flags(X[1234:1300]).eq("washout").all() and model.flags(X[1234:1300]).eq("").all()


def test_a_loaded_model_learns_anew(tmp_path):
    X = log(800, seed=3)
    y = readings(X)
    model = DynamicBiasRegressor(time_constants=2, effects=[("wet", LaggedCovariate("humidity", ["20 min"]))]).fit(X, y)
    again = there_and_back(model, tmp_path)
    assert again.get_params()["wet__time_constants"] == ["20 min"]
    assert again.search_ is None
    refitted = thermocorr.load_model(tmp_path / "model.json").fit(X, y)
    np.testing.assert_array_equal(refitted.predict(X), model.predict(X))
    pd.testing.assert_frame_equal(refitted.coef_table(), model.coef_table())


@pytest.mark.parametrize(
    "value",
    [
        0.1,
        -0.0,
        5e-324,
        1.7976931348623157e308,
        2**53 + 1,
        2**63 - 1,
        1 - 2**63,
        float("inf"),
        float("-inf"),
        True,
        None,
        "",
        "$float",
        [1, [2.0, ()]],
        (1.0, "a"),
        {"a": {1: 2.0, "$b": 3}},
        pd.Timestamp("2024-03-31T01:30+01:00"),
        pd.Timedelta(1, "ns"),
        LagState(np.array([0.1, -0.0]), 23.0),
    ],
    ids=repr,
)
def test_values_come_back_as_they_were(value):
    again = unpack(parse(render({"x": pack(value, "x")}).encode())["x"], "$.x")
    assert type(again) is type(value) and repr(again) == repr(value)


@pytest.mark.parametrize("unit", ["s", "ms", "us", "ns"])
def test_a_record_to_the_last_second_of_the_clock_lives_in_a_file(unit, tmp_path):
    """What a fit takes, a file takes, to the last second of 200 years."""
    X = log(90, seed=9).reset_index(drop=True)
    index = pd.to_timedelta(np.arange(6_311_433_600 - 89, 6_311_433_601), unit="s").as_unit(unit)
    model = DynamicBiasRegressor(time_constants=[5.0]).fit(X.set_axis(index), X["humidity"].to_numpy())
    again = load_model(save_model(model, tmp_path / "m.json"))
    np.testing.assert_array_equal(again.predict(X.set_axis(index)), model.predict(X.set_axis(index)))


@pytest.mark.parametrize("value", [2**63, -(2**63), 10**30])
def test_an_integer_that_could_not_be_read_again_is_not_written(value):
    with pytest.raises(ModelFileError, match=f"x is the integer {value}, which is too large"):
        pack(value, "x")


@pytest.mark.parametrize("dtype", ["float64", "float32", "int64", "int32", "bool"])
@pytest.mark.parametrize("shape", [(3,), (0,), (2, 2), ()])
def test_arrays_come_back_as_they_were(dtype, shape):
    values = (np.random.default_rng(0).normal(0, 1e9, shape) if dtype != "bool" else np.ones(shape)).astype(dtype)
    again = unpack(parse(render({"x": pack(values, "x")}).encode())["x"], "$.x")
    assert again.dtype == values.dtype and again.shape == values.shape
    assert again.tobytes() == values.tobytes()


def test_nan_and_infinity_in_arrays_are_written_in_words():
    values = np.array([np.nan, np.inf, -np.inf, 1.5])
    written = render({"x": pack(values, "x")})
    assert "NaN" not in written and "Infinity" not in written
    np.testing.assert_array_equal(unpack(parse(written.encode())["x"], "$.x"), values)


def test_random_doubles_keep_every_bit():
    bits = np.random.default_rng(5).integers(0, 2**63, 20_000).view(np.float64)
    values = bits[np.isfinite(bits)]
    again = unpack(parse(render({"x": pack(values, "x")}).encode())["x"], "$.x")
    assert again.tobytes() == values.tobytes()


def signed(node):
    """The file with a digest that fits whatever is in it."""
    return sign({key: value for key, value in node.items() if key not in ("format", "version", "digest")}).decode()


class FanNoise(Effect):
    """A user's own effect, with a lag and with settings of several types."""

    kind = "fan_noise"

    def __init__(self, column="humidity", settings=None):
        self.column = column
        self.settings = settings

    def inputs(self):
        return [self.column]

    def learn(self, record):
        self.scale_ = record.moments(self.column).std
        self.table_ = np.array([[1, 2], [3, 4]])

    def names(self):
        return ["fan", "late fan"]

    def columns(self, block, state):
        values = block[self.column] / self.scale_
        lag, state = lag_differences(values, block.steps, np.array([600.0]), state)
        return np.column_stack((values**2, lag)), state


class Untidy(FanNoise):
    kind = "untidy"

    def learn(self, record):
        super().learn(record)
        self.table = 1


PATH = f"{__name__}.FanNoise"


def own_model():
    X = log(500, seed=6)
    y = readings(X)
    settings = {"levels": (1, 2.5), "since": pd.Timestamp("2024-01-01"), "gain": np.float32(0.5), 3: None}
    return (
        DynamicBiasRegressor(time_constants=[300.0], effects=[FanNoise(settings=settings)]).fit(X[:400], y[:400]),
        X,
        y,
    )


def test_own_effects_come_back_where_the_caller_allows_them(tmp_path):
    model, X, y = own_model()
    save_model(model, tmp_path / "m.json")
    for allowed in ([PATH], PATH, {PATH, "os.system"}):
        again = load_model(tmp_path / "m.json", allow_imports=allowed)
        same(model, again, X, y)
        same(model, again, X[400:], y[400:])
    effect = again.features_.effect_list()[-1]
    assert effect.settings["levels"] == (1, 2.5) and effect.settings["since"] == pd.Timestamp("2024-01-01")
    assert effect.table_.dtype == np.int64 and effect.table_.shape == (2, 2)


def test_own_effects_are_refused_otherwise_and_nothing_is_imported(tmp_path):
    model, *_ = own_model()
    save_model(model, tmp_path / "m.json")
    with pytest.raises(ModelFileError, match=r"allow_imports=\['.*FanNoise'\].*nothing of the file was run"):
        load_model(tmp_path / "m.json")
    marker = tmp_path / "imported"
    (tmp_path / "hostile_module.py").write_text(f"open({str(marker)!r}, 'w')\n")
    sys.path.insert(0, str(tmp_path))
    try:
        for path in ("hostile_module.FanNoise", "os.system", "thermocorr.effects.protocol.Effect", PATH + "x", "", "a"):
            rewritten = (tmp_path / "m.json").read_text().replace(PATH, path)
            (tmp_path / "h.json").write_text(signed(json.loads(rewritten)))
            with pytest.raises(ModelFileError):
                load_model(tmp_path / "h.json", allow_imports=[PATH])
        assert not marker.exists() and "hostile_module" not in sys.modules
        for path in ("os.system", "os.nothing", "no_such_module.X", "thermocorr.effects.ThermalLag", "x", ""):
            rewritten = (tmp_path / "m.json").read_text().replace(PATH, path)
            (tmp_path / "h.json").write_text(signed(json.loads(rewritten)))
            with pytest.raises(ModelFileError, match=r"import|is no effect"):
                load_model(tmp_path / "h.json", allow_imports=[path])  # even where the caller is careless
    finally:
        sys.path.remove(str(tmp_path))


def test_what_cannot_be_written_is_named(tmp_path):
    X = log(400)
    y = readings(X)
    spline = DynamicBiasRegressor(time_constants=[300.0], effects=[SplineTransformer(3)]).fit(X, y)
    with pytest.raises(ModelFileError, match="scikit-learn transformer SplineTransformer"):
        save_model(spline, tmp_path / "m.json")

    class Local(FanNoise):
        pass

    for effect, words in ((Local(), "cannot be imported"), (Untidy(), "'table'"), (FanNoise(settings=open), "builtin")):
        model = DynamicBiasRegressor(time_constants=[300.0], effects=[effect]).fit(X, y)
        with pytest.raises(ModelFileError, match=words):
            save_model(model, tmp_path / "m.json")
    with pytest.raises(TypeError, match="Only a DynamicBiasRegressor"):
        save_model(model.features_, tmp_path / "m.json")
    with pytest.raises(NotFittedError):
        save_model(DynamicBiasRegressor(), tmp_path / "m.json")
    assert list(tmp_path.iterdir()) == []


def test_provenance_knows_the_record(tmp_path):
    X = log(500, seed=7)
    y = readings(X)
    model = DynamicBiasRegressor(time_constants=[300.0], effects=[Covariate("humidity")]).fit(X, y)
    kept = there_and_back(model, tmp_path).provenance_
    noted = kept["data"]
    assert (
        noted["rows"] == 500
        and noted["first"].startswith("2024-03-04 01:23:45")
        and noted["columns"][0] == "temperature"
    )
    assert noted["span_s"] == (X.index[-1] - X.index[0]).total_seconds()
    assert kept["versions"]["numpy"] == np.__version__


def test_a_start_as_long_as_its_segment_survives_the_file(tmp_path):
    """In a segment shorter than the longest decay, one as long as the segment stands for it."""
    record = make_record(1500, runs=3, seed=2)
    X, y = record[["temperature", "run"]], record["reading"]
    model = DynamicBiasRegressor("temperature", run="run", time_constants=[600.0, "40 h"]).fit(X, y)
    decays = next(effect for effect in model.features_.effect_list() if effect.kind == "initial_transient").decays_
    assert not np.isin(np.concatenate(list(decays.values())), [40 * 3600.0]).all()
    save_model(model, tmp_path / "m.json")
    np.testing.assert_array_equal(load_model(tmp_path / "m.json").predict(X), model.predict(X))

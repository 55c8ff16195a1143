"""Distributed fits equal those in one process, also when a worker dies."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from sklearn.base import clone

from thermocorr import DynamicBiasRegressor, ParquetLog, RecordError, TimeConstantSearch
from thermocorr.datasets import make_record
from thermocorr.effects import Covariate, Effect, Hinge, Hysteresis, LaggedCovariate, Rate

distributed = pytest.importorskip("distributed", reason="needs Dask: pip install 'thermocorr[dask]'")
pytest.importorskip("pyarrow", reason="Parquet needs pyarrow: pip install 'thermocorr[parquet]'")

from thermocorr.cluster.distributed import DistributedLog  # noqa: E402
from thermocorr.cluster.fleet import fit_fleet  # noqa: E402

pytestmark = [
    pytest.mark.filterwarnings("ignore::DeprecationWarning"),
    pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning"),
    pytest.mark.filterwarnings("ignore:Port .* is already in use"),
]
N = 9000


@pytest.fixture(scope="module")
def client():
    cluster = distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None)
    with cluster, distributed.Client(cluster) as client:
        yield client


@pytest.fixture(scope="module")
def record():
    record = make_record(N, seed=6, irregular=0.4)
    record.iloc[1000:1010, record.columns.get_loc("reading")] = np.nan
    return record


@pytest.fixture(scope="module")
def path(record, tmp_path_factory):
    path = tmp_path_factory.mktemp("logs") / "log.parquet"
    record.to_parquet(path, row_group_size=700)
    return path


def parts_of(record, cuts):
    return [record.iloc[low:high] for low, high in zip([0, *cuts], [*cuts, len(record)], strict=True)]


class Mixed(Effect):
    """A user's own effect: two words that follow inputs."""

    def inputs(self):
        return ["humidity", "supply"]

    def names(self):
        return ["late power", "change"]

    def signals(self, x):
        return [x.lag(x["supply"] * x["humidity"], [4000.0])[0], x["supply"] - x.previous(x["supply"])]


MODELS = {
    "six lags and decays": DynamicBiasRegressor("temperature", np.geomspace(60, 40_000, 6), longest_decay_share=1.0),
    "searched": DynamicBiasRegressor("temperature"),
    "device at the reference": DynamicBiasRegressor("temperature", [300.0, 5000.0], initial_state="zero"),
    "products, zero-order hold": DynamicBiasRegressor("temperature", [300.0, 5000.0], products=True, hold="zero_order"),
    "humidity, late": DynamicBiasRegressor(
        "temperature", [300.0, 5000.0], effects=[LaggedCovariate("humidity", [20_000.0]), Covariate("supply")]
    ),
    "squares, hinges, changes": DynamicBiasRegressor(
        "temperature", [300.0, 5000.0],
        effects=[LaggedCovariate("humidity", [20_000.0], power=2), Hinge(22.0, "below", ["1 h"]), Rate(), Mixed()],
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", MODELS)
def test_fit_in_parts_equals_the_fit_in_one_process(client, record, path, name):
    """1e-10 of the readings' range in every prediction: rounding, for states are carried exactly."""
    model = MODELS[name]
    expected = model.fit(record, record["reading"])
    predicted, coef, table = expected.predict(record), expected.coef_, expected.coef_table()
    log = DistributedLog(client, ParquetLog(path), n_parts=5)
    assert len(log.parts) == 5
    found = clone(model).fit(log, log["reading"])
    np.testing.assert_allclose(found.time_constants_, expected.time_constants_, rtol=0)
    np.testing.assert_allclose(found.predict(record), predicted, rtol=0, atol=1e-10 * np.ptp(predicted))
    np.testing.assert_allclose(found.coef_, coef, rtol=1e-7, atol=1e-9)
    np.testing.assert_allclose(found.coef_table()["standard_error"], table["standard_error"], rtol=1e-5)
    later = record.set_axis(record.index + pd.Timedelta("200h"))  # rows that follow: the states went along
    np.testing.assert_allclose(found.predict(later), expected.predict(later), rtol=0, atol=1e-10 * np.ptp(predicted))


@pytest.mark.parametrize("options", [{}, {"irregular": 0.4}, {"nonlinearity": 0.1, "device": "slab"}])
def test_long_parts_are_swept_in_one_compiled_pass_to_the_same(client, options):
    """Parts that the compiled pass takes, where there is one: they go on where the one before has ended."""
    long = make_record(45_000, sampling_period=60.0, noise=0.2, seed=2, **options)
    long.iloc[30_000:30_050, long.columns.get_loc("reading")] = np.nan
    parts = parts_of(long, [12_000, 25_001])
    effects = [LaggedCovariate("humidity", [5000.0]), Rate()]
    for model in (
        DynamicBiasRegressor("temperature", [60.0, 900.0, 40_000.0], effects=effects, longest_decay_share=1.0),
        DynamicBiasRegressor("temperature"),
    ):
        expected = model.fit(long, long["reading"])
        predicted, table = expected.predict(long), expected.coef_table()["standard_error"]
        log = DistributedLog(client, parts)
        found = clone(model).fit(log, log["reading"])
        assert found.products_ is expected.products_ is (model.time_constants == "auto" and "nonlinearity" in options)
        np.testing.assert_allclose(found.predict(long), predicted, rtol=0, atol=1e-10 * np.ptp(predicted))
        np.testing.assert_allclose(found.coef_table()["standard_error"], table, rtol=1e-5)


def test_search_and_its_tables_are_the_same(client, record, path):
    expected = TimeConstantSearch(DynamicBiasRegressor("temperature")).fit(record, record["reading"])
    log = DistributedLog(client, ParquetLog(path))
    found = TimeConstantSearch(DynamicBiasRegressor("temperature")).fit(log, log["reading"])
    assert found.best_params_ == expected.best_params_
    np.testing.assert_allclose(
        found.cv_results_["mean_test_score"], expected.cv_results_["mean_test_score"], rtol=1e-10
    )
    pd.testing.assert_frame_equal(found.spectrum_, expected.spectrum_, rtol=1e-6)


def test_frames_without_times_count_on(client, record):
    plain = record.reset_index(drop=True)
    model = DynamicBiasRegressor("temperature", [300.0, 5000.0], sampling_period=60.0)
    expected = model.fit(plain, plain["reading"]).predict(plain)
    log = DistributedLog(client, parts_of(plain, [1, 4000, 4003]))  # parts of one and of three rows
    np.testing.assert_allclose(model.fit(log, log["reading"]).predict(plain), expected, rtol=0, atol=1e-9)


def test_repeated_and_clipped_readings_are_left_out_by_the_workers(client, record):
    """Parts that begin within a repeated reading, too."""
    model, clipped = DynamicBiasRegressor("temperature", [300.0]), record[:8997].copy()
    once = clipped["reading"].clip(upper=clipped["reading"].quantile(0.9)).to_numpy()
    clipped["reading"] = once[np.arange(len(once)) // 3 * 3]
    expected = model.fit(clipped, clipped["reading"])
    notes = expected.notes_
    assert any("clipped" in note for note in notes)
    assert any("the one of the row before" in note for note in notes)
    log = DistributedLog(client, parts_of(clipped, [1001, 4000, 4003]))
    found = clone(model).fit(log, log["reading"])
    assert found.notes_ == notes
    np.testing.assert_allclose(found.coef_, expected.coef_, rtol=1e-8)


def test_dask_frames_are_parts(client, record):
    dask_frames = pytest.importorskip("dask.dataframe", reason="needs dask.dataframe")
    model = DynamicBiasRegressor("temperature", [300.0, 5000.0])
    expected = model.fit(record, record["reading"]).coef_
    log = DistributedLog(client, dask_frames.from_pandas(record, npartitions=4))
    np.testing.assert_allclose(model.fit(log, log["reading"]).coef_, expected, rtol=1e-8)


def test_stretches_are_asked_for_at_once(client, record):
    log = DistributedLog(client, parts_of(record, [700, 1500]))
    wanted = [slice(0, 5), slice(690, 710), np.array([1510, 1499, 1500, 1490]), slice(695, 705)]
    asked = []
    log.each, each = lambda *a, **k: asked.append(a) or each(*a, **k), log.each
    found = log["reading"].stretches(wanted)
    assert len(asked) == 1 and len(found) == 4
    for values, rows in zip(found, wanted, strict=True):
        np.testing.assert_array_equal(values, record["reading"].to_numpy()[rows])


def test_a_lost_worker_changes_nothing(client, record, path):
    model = MODELS["six lags and decays"]
    expected = model.fit(record, record["reading"]).predict(record)
    log = DistributedLog(client, ParquetLog(path), n_parts=12)
    each, calls = log.each, []

    def each_with_a_kill(function, *arguments, **options):
        calls.append(function.__name__)
        if function.__name__ == "sweep_part":
            victim = next(iter(client.scheduler_info()["workers"]))
            client.submit(_die, workers=[victim], allow_other_workers=False, pure=False, retries=0)
        return each(function, *arguments, **options)

    log.each = each_with_a_kill
    found = model.fit(log, log["reading"]).predict(record)
    assert "sweep_part" in calls
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-10 * np.ptp(expected))
    client.wait_for_workers(2, timeout=30)


def _die():
    import os

    os._exit(1)


@pytest.mark.parametrize(
    ("parts", "words"),
    [
        (lambda r: [r[:4000], r[3990:]], "Part 1 of the log begins at .* before the end of part 0"),
        (lambda r: [r[:4000], r[4000:].assign(temperature=np.nan)], "Part 1 of the log: No row has a number"),
        (lambda r: [r[:4000], r[4000:].assign(temperature=r["temperature"].where(r.index != r.index[5000]))],
         "Part 1 of the log is not one segment: 1 row of 5000 has a missing value"),
        (lambda r: [r[:4000], r[4000:][::-1]], "Part 1 of the log: Time goes backward at row 1"),
        (lambda r: [r[:4000], r[4000:].assign(reading=np.inf)], "Part 1 of the log: The reading y contains infinity"),
        (lambda r: [], "no parts"),
    ],
)  # fmt: skip
def test_parts_that_make_no_record_are_refused(client, record, parts, words):
    def fit():
        log = DistributedLog(client, parts(record))
        DynamicBiasRegressor("temperature", [300.0]).fit(log, log["reading"])

    with pytest.raises(RecordError, match=words):
        fit()


def test_what_cannot_be_done_in_parts_is_refused(client, record):
    log = DistributedLog(client, parts_of(record, [4000]))
    with pytest.raises(RecordError, match=r"'hysteresis: width 0.5' carries a state that is no plain lag's"):
        DynamicBiasRegressor("temperature", [300.0], effects=[Hysteresis(0.5)]).fit(log, log["reading"])
    with pytest.raises(RecordError, match="one of its columns"):
        DynamicBiasRegressor("temperature", [300.0]).fit(log, record["reading"])
    with pytest.raises(RecordError, match="no column 'readings'"):
        log["readings"]


def test_a_fleet_has_a_model_for_each_device(client):
    devices = {f"box {i}": make_record(3000, seed=i, device="box") for i in range(3)}
    alone = {name: DynamicBiasRegressor("temperature").fit(r, r["reading"]) for name, r in devices.items()}
    fleet = fit_fleet(client, devices, "reading", DynamicBiasRegressor("temperature"))
    assert list(fleet) == list(devices)
    for name, model in fleet.items():
        np.testing.assert_allclose(model.coef_, alone[name].coef_)
    shared = fit_fleet(client, devices, "reading", DynamicBiasRegressor("temperature"), shared_time_constants=True)
    sets = {tuple(model.time_constants_) for model in shared.values()}
    assert len(sets) == 1
    for name, model in shared.items():
        assert model.residual_std_ < 1.02 * alone[name].residual_std_
    bad = devices | {"box 9": devices["box 0"].assign(temperature=20.0)}
    with pytest.raises(RecordError, match="Device 'box 9': The temperature never changes"):
        fit_fleet(client, bad, "reading", DynamicBiasRegressor("temperature"))

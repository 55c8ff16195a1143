"""What is no record, no fleet and no file is refused by its kind, in one sentence."""

import pytest

from thermocorr import DiffusiveFeatures, DynamicBiasRegressor, OnlineCorrector, ParquetLog, RecordError, diagnose
from thermocorr.cluster.fleet import fit_fleet
from thermocorr.datasets import make_record


@pytest.fixture(scope="module")
def record():
    return make_record(1200, seed=3)


@pytest.fixture(scope="module")
def fleet():
    return {f"box {i}": make_record(600, seed=i, device="box")[["temperature", "reading"]] for i in range(2)}


@pytest.mark.parametrize("shared", [False, True])
def test_a_device_without_the_reading_is_named(fleet, shared):
    model = DynamicBiasRegressor("temperature", 2 if shared else ["5 min"])
    bad = fleet | {"box 7": fleet["box 0"].rename(columns={"reading": "R"})}
    with pytest.raises(
        RecordError, match=r"Device 'box 7': There is no reading 'reading' in the data. Its columns are"
    ):
        fit_fleet(1, bad, "reading", model, shared_time_constants=shared)
    with pytest.raises(RecordError, match="Device 'box 7': There is no file"):
        fit_fleet(1, fleet | {"box 7": "no.parquet"}, "reading", model)


def test_devices_without_names_and_workers_that_are_none_are_refused(fleet):
    with pytest.raises(TypeError, match=r"a dict of name to record. Got a list: give each device its name"):
        fit_fleet(1, list(fleet.values()), "reading")
    for workers in (0, "two", 1.5, True):
        with pytest.raises(ValueError, match=f"must be a number of processes .* Got {workers!r}"):
            fit_fleet(workers, fleet, "reading")


@pytest.mark.parametrize(
    ("paths", "said"), [("no.parquet", "There is no file no.parquet"), (".", "is a folder"), ([], "needs a file")]
)
def test_a_parquet_log_of_no_file_is_refused_in_a_sentence(paths, said):
    pytest.importorskip("pyarrow", reason="Parquet needs pyarrow: pip install '.[parquet]'")
    with pytest.raises(RecordError, match=said):
        ParquetLog(paths)


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda X: X.to_dict("list"), r"X is a dict. Pass a DataFrame, for example pandas.DataFrame\(X\)"),
        (lambda X: "log.csv", r"X is a str. Pass a DataFrame, which pandas.read_csv makes of a file"),
    ],
)
def test_what_is_no_table_is_refused_by_its_kind(record, make, said):
    X, y = record[["temperature"]], record["reading"]
    model = DynamicBiasRegressor("temperature", ["5 min"]).fit(X, y)
    live = OnlineCorrector(model)
    doors = (
        DynamicBiasRegressor("temperature").fit, model.correct, DiffusiveFeatures(["5 min"]).fit, live.update_many,
        lambda X, y: diagnose(model, X, y),
    )  # fmt: skip
    for door in doors:
        with pytest.raises(RecordError, match=said):
            door(make(X), y)

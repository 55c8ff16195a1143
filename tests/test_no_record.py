"""What is no record and no file is refused by its kind, in one sentence."""

import pytest

from thermocorr import DiffusiveFeatures, DynamicBiasRegressor, OnlineCorrector, RecordError, diagnose
from thermocorr.datasets import make_record


@pytest.fixture(scope="module")
def record():
    return make_record(1200, seed=3)


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda X: X.to_dict("list"), r"X is a dict. Pass a DataFrame, for example pandas.DataFrame\(X\)"),
        (lambda X: "log.csv", r"X is a str. Pass a DataFrame, which thermocorr.read_log makes of a file"),
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

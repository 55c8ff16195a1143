"""A reading that runs ahead of its thermometer: columns, who refuses them, and what is named."""

import numpy as np
import pytest
from effect_records import columns_of, learned, log, whole
from sklearn.base import clone

from thermocorr import DynamicBiasRegressor, OnlineCorrector
from thermocorr.datasets import make_record
from thermocorr.effects import CATALOGUE, Lead
from thermocorr.effects.stream import own_starts, walk
from thermocorr.equations import lag_differences
from thermocorr.firmware import export_c


def test_the_column_is_the_temperature_of_a_while_later():
    X = log(500, seed=3)
    seconds = (X.index - X.index[0]).total_seconds().to_numpy()
    T = X["temperature"].to_numpy()
    expected = [np.interp(t + 400.0, seconds, T) - now for t, now in zip(seconds, T, strict=True)]
    np.testing.assert_allclose(columns_of(Lead(400.0), X)[:, 0], expected, atol=1e-9)
    lags = lag_differences(np.array(expected), np.diff(seconds, prepend=-1.0), np.array([900.0]))[0]
    np.testing.assert_allclose(columns_of(Lead(400.0, [900.0]), X)[:, 1:], lags, atol=1e-9)
    effect, record = learned(Lead("1 h"), log(300, holes=[150]), max_gap="1 h")
    column = whole(effect, record)[:, 0]
    ends = [segment.stop - 1 for segment in record.segments]
    assert len(ends) == 2 and (column[ends] == 0).all()  # where a segment ends nothing more is known


@pytest.mark.parametrize("where", [0, 1500, 2999])
def test_a_refused_temperature_ahead_is_passed_over(where):
    """As if its row had not been recorded."""
    record = make_record(3000, seed=4)
    X, y = record[["temperature"]], record["reading"]
    model = DynamicBiasRegressor("temperature", ["10 min"], effects=[Lead(600.0)])
    damaged = X.where(np.arange(3000)[:, None] != where, 9.9e37)
    found, kept = clone(model).fit(damaged, y), np.arange(3000) != where
    expected = clone(model).fit(X[kept], y[kept])
    np.testing.assert_allclose(found.coef_, expected.coef_, rtol=1e-9)
    np.testing.assert_allclose(found.predict(damaged)[kept], expected.predict(X[kept]), rtol=1e-9)


def test_streams_and_devices_refuse_what_they_cannot_know(tmp_path):
    X = log(400, seed=1)
    model = DynamicBiasRegressor(time_constants=[300.0], effects=[Lead(60.0)]).fit(X, X["temperature"])
    words = r"effect 'lead: 60 s' looks at samples that come later, which {} does not have. .* or take Rate\(\)"
    with pytest.raises(ValueError, match=words.format("a stream")):
        OnlineCorrector(model)
    with pytest.raises(ValueError, match=words.format("a device")):
        export_c(model, tmp_path)
    assert [kind for kind, effect in CATALOGUE.items() if effect.foresees] == ["lead"]


def ahead(seed, lead, noise=None):
    """A simulated device whose thermometer's clock is `lead` seconds late: cut off where nothing is known."""
    record = make_record(6000, coloured_noise=noise, device=("layered", "plate")[seed % 2], seed=seed)
    seconds = (record.index - record.index[0]).total_seconds().to_numpy()
    late = np.interp(seconds - lead, seconds, record["temperature"])
    kept = seconds > lead
    return record.drop(columns="reading").assign(temperature=late)[kept], record["reading"][kept]


@pytest.mark.parametrize("effect", [Lead(300.0), Lead(300.0, [900.0])], ids=repr)
@pytest.mark.parametrize("irregular", [0.0, 0.5])
def test_rows_passed_over_where_a_block_looks_ahead_do_not_end_the_record(effect, irregular):
    """Columns, and what a lead carries on, are the same however the record is cut."""
    X = log(120, irregular=irregular)
    X.iloc[40:60, 0] = X.iloc[90:91, 0] = X.iloc[117:, 0] = np.nan
    effect, record = learned(effect, X)
    at_once = list(walk([effect], record, starts=own_starts(record), size=10**9))
    for size in (1, 2, 3, 7, 10, 20, 50):
        parts = list(walk([effect], record, starts=own_starts(record), size=size))
        np.testing.assert_allclose(np.vstack([part.columns for part in parts]), at_once[0].columns, rtol=1e-12)
        if isinstance(effect, Lead) and len(effect.time_constants_):
            carried, expected = parts[-1].states[0], at_once[0].states[0]
            np.testing.assert_allclose(carried.lag_difference, expected.lag_difference, rtol=1e-12)

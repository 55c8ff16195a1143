"""Model files of earlier versions say what they said."""

from __future__ import annotations

import hashlib
import json

import numpy as np
import pytest
from effect_records import log
from test_model_file import readings, same

from thermocorr import DynamicBiasRegressor, ModelFileError, load_model, save_model
from thermocorr.effects import Hinge
from thermocorr.files import model_file
from thermocorr.files.migrations import MIGRATIONS


def test_a_draft_of_version_0_is_brought_up_to_date(tmp_path):
    X = log(300, seed=8)
    y = readings(X)
    model = DynamicBiasRegressor(time_constants=[300.0]).fit(X[:200], y[:200])
    save_model(model, tmp_path / "m.json")
    node = json.loads((tmp_path / "m.json").read_text())
    del node["digest"], node["provenance"], node["model"]["standard_errors"]
    (tmp_path / "old.json").write_text(json.dumps(node | {"version": 0}))
    old = load_model(tmp_path / "old.json")
    same(model, old, X, y)
    assert (old.coef_table()["standard_error"] == 0).all()
    node["model"].pop("coefficients")
    (tmp_path / "old.json").write_text(json.dumps(node | {"version": 0}))
    with pytest.raises(ModelFileError, match="no list of coefficients"):
        load_model(tmp_path / "old.json")


@pytest.mark.parametrize("products", [True, 2, 3])
def test_products_of_lags_are_read_and_older_files_had_pairs_alone(tmp_path, products):
    X = log(600, seed=8)
    y = readings(X)
    model = DynamicBiasRegressor(time_constants=[60.0, 300.0], products=products).fit(X[:400], y[:400])
    save_model(model, tmp_path / "m.json")
    same(model, load_model(tmp_path / "m.json"), X, y)
    node = json.loads((tmp_path / "m.json").read_text())
    write_as(5, {"provenance": node["provenance"], "model": without_order(node["model"])}, tmp_path / "old.json")
    if products == 3:  # no such file was ever written: its coefficients do not fit
        with pytest.raises(ModelFileError):
            load_model(tmp_path / "old.json")
    else:
        same(model, load_model(tmp_path / "old.json"), X, y)


def write_as(version, content, path):
    """A file of an earlier version."""
    body = (model_file.render(content) + "\n").removeprefix("{\n").encode("ascii")
    digest = hashlib.sha256(body).hexdigest()
    head = f'{{"format": "thermocorr model", "version": {version}, "digest": "sha256:{digest}",\n'.encode()
    path.write_bytes(head + body)


@pytest.mark.parametrize("side", ["above", "below"])
def test_hinges_of_older_files_were_zero_at_their_knee(tmp_path, side):
    """U0 was that without the hinge; what such a model says does not change."""
    X = log(600, seed=8)
    y = readings(X)
    knee = float(X["temperature"][:400].mean()) + (-0.3 if side == "above" else 0.3)
    model = DynamicBiasRegressor(time_constants=[60.0], effects=[Hinge(knee, side, ["10 min"])]).fit(X[:400], y[:400])
    save_model(model, tmp_path / "m.json")
    node = json.loads((tmp_path / "m.json").read_text())
    hinges = []

    def collect(part):
        if isinstance(part, dict) and part.get("kind") == "hinge" and "learned" in part:
            hinges.append(part)
        for inner in part.values() if isinstance(part, dict) else part if isinstance(part, list) else ():
            collect(inner)

    collect(node["model"])
    rest = {h["learned"].pop("reference_temperature_") for h in hinges}.pop() - knee
    assert len(hinges) and (rest > 0) == (side == "above")
    place = model.features_.get_feature_names_out().tolist().index(model.features_.effect_list()[-1].names()[0])
    write_as(12, {"provenance": node["provenance"], "model": node["model"]}, tmp_path / "old.json")
    old = load_model(tmp_path / "old.json")
    np.testing.assert_allclose(old.predict(X) - model.predict(X), model.coef_[place] * rest, rtol=1e-9)
    np.testing.assert_allclose(old.bias(X) - model.bias(X), model.coef_[place] * rest, rtol=1e-9)


def without_order(node):
    """A part of a file as version 5 had it."""
    if isinstance(node, list):
        return [without_order(part) for part in node]
    return {k: without_order(v) for k, v in node.items() if k != "order"} if isinstance(node, dict) else node


def test_every_version_has_its_migration():
    assert set(MIGRATIONS) == set(range(model_file.VERSION))

"""Uncertainty where it is hard: measured records, an effect that is missing, temperatures that were not learned.

    python benchmarks/signed_cases.py ../shared/records
    python benchmarks/signed_cases.py --seeds 100          # the simulated cases alone

Measured: learned on 70 % (or --share), 95 % intervals of the readings of the rest: share covered, and the mean
standard uncertainty over the root mean square error. Missing: an effect of humidity, as large as the noise, that the
model does not have; corrected readings, and how many records have rows called signed. Beyond: learned on colder days
than it is used on, with a curvature that the model leaves out. After an excursion: such a device, heated by 30 K for
two hours; in the three hours behind them, where the measured temperature is back in the fitted range. There "called
signed" are records in which more than a fifth of the signed readings are outside their intervals.
"""

from __future__ import annotations

import argparse
import warnings
from typing import Any

import numpy as np
import pandas as pd
from interval_coverage import covered, rms
from real_records import cases

from thermocorr import DynamicBiasRegressor, RecordWarning
from thermocorr.datasets import make_record
from thermocorr.datasets._devices import make_device
from thermocorr.estimators.uncertainty.signed import coverage_factor


def measured(X: pd.DataFrame, y: pd.Series, share: float) -> tuple[float, float]:
    """Share of later readings inside their intervals, and the width over the error."""
    n = int(share * len(X))
    model = DynamicBiasRegressor(X.columns[0]).fit(X[:n], y[:n])
    _, u = model.predict(X[n:], return_std=True)
    error = model.residuals(X[n:], y[n:]).to_numpy()
    k = coverage_factor(model._joint_errors().noise.dof, 0.95)
    return covered(error, u, k), float(np.nanmean(u)) / rms(error)


def missing(seed: int) -> dict[str, Any]:
    """One device with an effect of humidity that the model does not have."""
    record, truth = make_record(
        5000, device=("layered", "box")[seed % 2], effects={"covariate": 1.0}, seed=seed, return_truth=True
    )
    X, y = record[["temperature"]], record["reading"]
    model = DynamicBiasRegressor("temperature").fit(X, y)
    signed = model.uncertainty(X, y)
    level = truth.attrs["base"] + 10 * (model.reference_temperature_ - truth.attrs["device"]["reference_temperature"])
    frame = signed.frame()
    inside = (frame["low"] <= level) & (level <= frame["high"])
    return {"covered": float(inside[300:].mean()), "signed": bool((frame["status"] == "signed").any())}


def beyond(seed: int) -> dict[str, Any]:
    """One device with a curvature, learned below a temperature and used above it."""
    record = make_record(
        8000, device=("layered", "box")[seed % 2], setting="outdoor", sampling_period=600.0, nonlinearity=0.002,
        seed=seed,
    )  # fmt: skip
    X, y = record[["temperature"]], record["reading"]
    low = X["temperature"].quantile(0.5)
    n = int(np.argmax(X["temperature"].to_numpy() > low + 5)) if (X["temperature"][:4000] <= low + 5).all() else 4000
    model = DynamicBiasRegressor("temperature", degree=1).fit(X[:n], y[:n])
    hot = (X["temperature"] > model.reading_.temperature_range[1] + 1).to_numpy() & (np.arange(len(X)) >= n)
    if not hot.any():
        return {"covered": np.nan, "signed": np.nan}
    told, u = model.predict(X, return_std=True)
    status = model.uncertainty(X, y).frame()["status"].to_numpy()
    inside = np.abs(y.to_numpy() - told) <= coverage_factor(model._joint_errors().dof, 0.95) * u
    return {"covered": float(inside[hot].mean()), "signed": bool((status[hot] == "signed").any())}


def after_excursion(seed: int) -> dict[str, Any]:
    """One device with a curvature, learned in a room, heated for two hours, and read as it cools down again."""
    name, learned, heated = ("layered", "box")[seed % 2], 5000, slice(5400, 5520)
    record, truth = make_record(6000, device=name, seed=seed, return_truth=True)
    air = record["temperature"].to_numpy().copy()
    air[heated] += 30.0
    body = make_device(name, sensitivity=10.0, nonlinearity=0.003, reference_temperature=23.0)
    clean = body.respond(60.0 * np.arange(len(air)), air)
    y = pd.Series(clean + truth["noise"].to_numpy(), record.index)
    X = pd.DataFrame({"temperature": air}, record.index)
    model = DynamicBiasRegressor("temperature", degree=1).fit(X[:learned], y[:learned])
    low, high = model.reading_.temperature_range
    rows = slice(heated.stop, heated.stop + 180)
    told, u = model.predict(X[learned:], return_std=True)
    inside = np.abs(y[learned:] - told) <= coverage_factor(model._joint_errors().dof, 0.95) * u
    status = model.uncertainty(X[learned:], y[learned:]).frame()["status"]
    back = X["temperature"].iloc[rows].between(low, high)
    said = status.loc[back.index[back]] == "signed"
    false = ~inside.loc[back.index[back]][said]
    return {"covered": float(inside.loc[back.index[back]].mean()), "signed": bool(false.mean() > 0.2)}


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", nargs="?", help="folder of the measured records")
    parser.add_argument("--share", type=float, default=0.7)
    parser.add_argument("--seeds", type=int, default=30)
    parser.add_argument("--first", type=int, default=9500)
    options = parser.parse_args()
    warnings.simplefilter("ignore", RecordWarning)
    if options.folder:
        for name, X, y in cases(options.folder):
            share, wide = measured(X, y, options.share)
            print(f"{name:25s} covered {100 * share:5.1f} %   wide {wide:.2f}")
    cases_of = {"humidity missing": missing, "beyond the range": beyond, "after an excursion": after_excursion}
    for name, case in cases_of.items():
        found = pd.DataFrame([case(seed) for seed in range(options.first, options.first + options.seeds)]).dropna()
        share, signed = 100 * found["covered"].mean(), int(found["signed"].sum())
        print(f"{name:25s} covered {share:5.1f} % of {len(found)} records   called signed in {signed}")


if __name__ == "__main__":
    main()

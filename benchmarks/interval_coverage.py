"""Do 95 % intervals hold the truth in 95 % of all cases, and how wide are they?

    python benchmarks/interval_coverage.py --seeds 200 --jobs 2              # some minutes
    python benchmarks/interval_coverage.py --seeds 40 --kinds white walk --only searched
    python benchmarks/interval_coverage.py --hard --records ../shared/records      # where it is hard

Two simulated devices (`make_record`: a package on a board, an instrument in a box) under noises that are drawn beside
them, time constants given and searched. Covered share of the bias, the corrected reading, means of 10 and of 100
corrected readings, the static gain, the step response after 600 s and 5000 s, and of readings after the fitted 70 % of
the record. "wide" is the mean over the records of the standard uncertainty (root mean square over the rows), over the
root mean square of the true error: what somebody would state who knows the noise. 1 is perfect. What may be missing
("structure") is left out: nothing is. Seeds below 1000 served for tuning.

Hard: of measured records, learned on 70 %, 95 % intervals of the readings of the rest: share covered, and the mean
standard uncertainty over the root mean square error. Missing: an effect of humidity, as large as the noise, that the
model does not have; corrected readings, and how many records have rows called signed. Beyond: learned on colder days
than it is used on, with a curvature that the model leaves out. After an excursion: such a device, heated by 30 K for
two hours; in the three hours behind them, where the measured temperature is back in the fitted range. There "called
signed" are records in which more than a fifth of the signed readings are outside their intervals.
"""

import itertools
import warnings
from typing import Any

import numpy as np
import pandas as pd
from common import asked, rms, seeds_of
from joblib import Parallel, delayed
from null_records import NOISES, remembering
from real_records import cases
from test_signed import heated

from thermocorr import DynamicBiasRegressor, RecordWarning
from thermocorr.datasets import make_record
from thermocorr.datasets._devices import make_device
from thermocorr.displays import StepResponseDisplay
from thermocorr.model.budget import coverage_factor

NOISE = 0.2  # standard deviation of the white part [ppm]
GAIN = 10.0  # static sensitivity of the simulated devices [ppm/K]
DEVICES = ("layered", "box")
KINDS = {
    "white": NOISES["white"], "irregular": NOISES["white"], "gaps": NOISES["white"],
    "heteroscedastic": NOISES["grows with time"], "heavy tails": NOISES["heavy tails"],
    "AR 3 rows": NOISES["3 rows"], "AR 1/300": NOISES["0.3 %"], "AR 1/40": remembering(1 / 40),
    "AR 1/4": remembering(0.25), "flicker": NOISES["flicker"], "walk": NOISES["walk"],
}  # fmt: skip
UNEVEN: dict[str, dict[str, Any]] = {"irregular": {"irregular": 0.3, "gaps": 3}, "gaps": {"gaps": 8}}
"""How rows are recorded: behind the gaps of the first the lags start afresh, across those of the second they go on."""
SKIPPED = 300  # rows at the start, where heat that nobody saw decays


def bodies(device: str) -> tuple[np.ndarray, np.ndarray]:
    """Time constants of a device [s], and their weights."""
    made = make_device(device, sensitivity=GAIN, nonlinearity=0.0, reference_temperature=22.5)
    return made.lag_coefficients()


def given(device: str) -> list[float]:
    """Time constants that can be seen at a step of a minute [s]."""
    times, weights = bodies(device)
    return sorted(times[(np.abs(weights) > 1e-4 * np.abs(weights).sum()) & (times > 15)])


def response(device: str, after: float) -> float:
    """Bias some time after a step of 1 K [s]."""
    times, weights = bodies(device)
    return float((1 - np.exp(-after / times)) @ weights)


def covered(error: np.ndarray, u: np.ndarray, k: np.ndarray | float) -> float:
    """Share of errors inside the interval."""
    known = np.isfinite(error) & np.isfinite(u)
    return float(np.mean(np.abs(error[known]) <= (k * u)[known]))


def fitted(device: str, searched: bool, X: pd.DataFrame, y: pd.Series, afresh: bool = True) -> DynamicBiasRegressor:
    """The default model, or one that has been given its time constants; gaps start segments, or do not."""
    settings: dict[str, Any] = {} if searched else {"time_constants": given(device), "degree": 1}
    return DynamicBiasRegressor("temperature", max_gap="10 min" if afresh else None, **settings).fit(X, y)


def squares(error: np.ndarray, u: np.ndarray) -> float:
    """Mean square of the errors where an uncertainty is stated."""
    return float(np.mean(np.asarray(error)[np.isfinite(np.asarray(u) * np.asarray(error))] ** 2))


def judged(kind: str, seed: int, n: int, searched: bool) -> dict[str, Any]:
    """One record."""
    warnings.simplefilter("ignore", RecordWarning)
    rng = np.random.default_rng([seed, len(kind)])
    device, setting = DEVICES[seed % 2], ("lab", "outdoor", "chamber")[seed // 2 % 3]
    uneven = UNEVEN.get(kind, {})
    afresh = kind != "gaps"
    record, truth = make_record(n, device=device, setting=setting, noise=1e-9, seed=seed, return_truth=True, **uneven)
    X, clean = record[["temperature"]], record["reading"]
    y = clean + NOISE * KINDS[kind](rng, len(X), X)
    model = fitted(device, searched, X, y, afresh)
    joint = model._joint_errors()
    level = truth.attrs["base"] + GAIN * (model.reference_temperature_ - truth.attrs["device"]["reference_temperature"])
    bias, u_bias = model.bias(X, return_std=True)
    signed = model.uncertainty(X, y, diagnosis=None)
    k_bias = coverage_factor(joint.dof, 0.95)
    rows = slice(SKIPPED, None)
    wrong = (bias - (clean - level)).to_numpy()[rows]
    row = SKIPPED + seed * 7919 % (len(X) - SKIPPED)  # one row of a record: those of all records are independent
    found = {
        "kind": kind, "searched": searched,
        "bias row": covered(wrong[row - SKIPPED :][:1], u_bias.to_numpy()[row:][:1], k_bias),
        "bias": covered(wrong, u_bias.to_numpy()[rows], k_bias),
        "bias u": rms(u_bias.to_numpy()[rows]), "bias e2": squares(wrong, u_bias.to_numpy()[rows]),
    }  # fmt: skip
    plain = {part: value for part, value in signed.variances.items() if part != "structure"}
    reading_u = np.sqrt(sum(plain.values()))[rows]
    reading_e = (signed.corrected - level)[rows]
    k_reading = coverage_factor(signed.dof[rows], 0.95)
    found |= {
        "reading": covered(reading_e, reading_u, k_reading),
        "reading row": bool(abs(reading_e[row - SKIPPED]) <= k_reading[row - SKIPPED] * reading_u[row - SKIPPED]),
        "reading u": rms(reading_u), "reading e2": squares(reading_e, reading_u),
    }  # fmt: skip
    for count in (10, 100):
        hits = []
        for first in np.linspace(SKIPPED, n - count - 1, 12).astype(int):
            mean = signed.mean(slice(int(first), int(first) + count))
            lines = [line for line in mean.lines if line.quantity != "effects that may be missing"]
            u = np.sqrt(sum(line.contribution**2 for line in lines))
            dof = mean.dof
            hits.append(abs(mean.value - level) <= coverage_factor(dof, 0.95) * u)
        found[f"mean {count}"] = float(np.mean(hits))
    display = StepResponseDisplay.from_estimator(model).frame()
    gain = np.eye(1, len(joint.coef) - 1)  # of the temperature itself, the first column
    found["gain"] = abs(model.coef_[0] - GAIN) <= k_bias * joint.combined(gain, model.coef_[:1])[0]
    for after in (600.0, 5000.0):
        value = np.interp(after, display["time"], display["response"])
        error = np.interp(after, display["time"], display["standard_error"])
        found[f"step {after:.0f} s"] = abs(value - response(device, after)) <= k_bias * error
    cut = int(0.7 * n)
    early = fitted(device, searched, X.iloc[:cut], y.iloc[:cut], afresh)
    told, u_told = early.predict(X.iloc[cut:], return_std=True)
    k = coverage_factor(early._joint_errors().noise.dof, 0.95)
    later = y.to_numpy()[cut:] - told
    found |= {"later": covered(later, u_told, k), "later u": rms(u_told), "later e2": squares(later, u_told)}
    return found


def table(rows: list[dict[str, Any]]) -> pd.DataFrame:
    """Shares in percent, widths as ratios."""
    means = pd.DataFrame(rows).set_index(["searched", "kind"]).astype(float).groupby(level=[0, 1], sort=False).mean()
    result = pd.DataFrame(index=means.index)
    for name in ("bias", "reading", "later"):
        result[name] = 100 * means[name]
        result[f"{name} wide"] = means[f"{name} u"] / np.sqrt(means[f"{name} e2"])
    for name in ("mean 10", "mean 100", "gain", "step 600 s", "step 5000 s"):
        result[name] = 100 * means[name]
    return result


# ---- where it is hard ------------------------------------------------------------------------------------------------
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
    model, X, y, first = heated(seed)
    told, u = model.predict(X, return_std=True)
    inside = np.abs(y - told) <= coverage_factor(model._joint_errors().dof, 0.95) * u
    after = (np.arange(len(X)) >= first) & (np.arange(len(X)) < first + 180)
    back = X["temperature"].between(*model.reading_.temperature_range).to_numpy() & after
    signed = (model.uncertainty(X, y).frame()["status"] == "signed").to_numpy()
    return {"covered": float(inside[back].mean()), "signed": bool((~inside[back & signed]).mean() > 0.2)}


def hard(folder: str | None, seeds: range) -> None:
    """Print the figures."""
    for name, X, y in cases(folder) if folder else ():
        share, wide = measured(X, y, 0.7)
        print(f"{name:25s} covered {100 * share:5.1f} %   wide {wide:.2f}")
    cases_of = {"humidity missing": missing, "beyond the range": beyond, "after an excursion": after_excursion}
    for name, case in cases_of.items():
        found = pd.DataFrame([case(seed) for seed in seeds]).dropna()
        share, signed = 100 * found["covered"].mean(), int(found["signed"].sum())
        print(f"{name:25s} covered {share:5.1f} % of {len(found)} records   called signed in {signed}")


def main() -> None:
    options = asked(
        __doc__, seeds=40, first=9000, rows=5000, kinds=list(KINDS), only=str, jobs=1, hard=False, records=str
    )
    if options.hard:
        hard(options.records, seeds_of(options))
        return
    each = [searched for searched in (False, True) if options.only != ("given" if searched else "searched")]
    records = itertools.product(options.kinds, seeds_of(options), [options.rows], each)
    rows = Parallel(n_jobs=options.jobs)(delayed(judged)(*case) for case in records)
    with pd.option_context("display.width", 250, "display.max_columns", 30):
        print(table(rows).round(2).to_string())


if __name__ == "__main__":
    main()

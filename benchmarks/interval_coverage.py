"""Do 95 % intervals hold the truth in 95 % of all cases, and how wide are they?

    python benchmarks/interval_coverage.py --seeds 200 --jobs 2              # some minutes
    python benchmarks/interval_coverage.py --seeds 40 --kinds white walk --only searched

Two simulated devices (`make_record`: a package on a board, an instrument in a box) under noises that are drawn beside
them, time constants given and searched. Covered share of the bias, the corrected reading, means of 10 and of 100
corrected readings, the static gain, the step response after 600 s and 5000 s, and of readings after the fitted 70 % of
the record. "wide" is the mean over the records of the standard uncertainty (root mean square over the rows), over the
root mean square of the true error: what somebody would state who knows the noise. 1 is perfect. What may be missing
("structure") is left out: nothing is.
"""

from __future__ import annotations

import argparse
import time
import warnings
from typing import Any

import numpy as np
import pandas as pd
from joblib import Parallel, delayed
from null_records import NOISES, remembering

from thermocorr import DynamicBiasRegressor, RecordWarning
from thermocorr.datasets import make_record
from thermocorr.datasets._devices import make_device
from thermocorr.displays import StepResponseDisplay
from thermocorr.estimators.uncertainty.signed import coverage_factor

NOISE = 0.2
"""Standard deviation of the white part [ppm]."""
GAIN = 10.0
"""Static sensitivity of the simulated devices [ppm/K]."""
DEVICES = ("layered", "box")
KINDS = {
    "white": NOISES["white"], "irregular": NOISES["white"], "gaps": NOISES["white"],
    "heteroscedastic": NOISES["grows with time"], "heavy tails": NOISES["heavy tails"],
    "AR 3 rows": NOISES["3 rows"], "AR 1/300": NOISES["0.3 %"], "AR 1/40": remembering(1 / 40),
    "AR 1/4": remembering(0.25), "flicker": NOISES["flicker"], "walk": NOISES["walk"],
}  # fmt: skip
UNEVEN: dict[str, dict[str, Any]] = {"irregular": {"irregular": 0.3, "gaps": 3}, "gaps": {"gaps": 8}}
"""How rows are recorded: behind the gaps of the first the lags start afresh, across those of the second they go on."""
SKIPPED = 300
"""Rows at the start, where heat that nobody saw decays."""


def given(device: str) -> list[float]:
    """Time constants of a device that can be seen at a step of a minute [s]."""
    times, weights = make_device(
        device, sensitivity=GAIN, nonlinearity=0.0, reference_temperature=22.5
    ).lag_coefficients()
    return sorted(times[(np.abs(weights) > 1e-4 * np.abs(weights).sum()) & (times > 15)])


def response(device: str, after: np.ndarray) -> np.ndarray:
    """Bias some time after a step of 1 K [s]."""
    times, weights = make_device(
        device, sensitivity=GAIN, nonlinearity=0.0, reference_temperature=22.5
    ).lag_coefficients()
    return np.asarray((1 - np.exp(-after[:, None] / times)) @ weights)


def covered(error: np.ndarray, u: np.ndarray, k: np.ndarray | float) -> float:
    """Share of errors inside the interval."""
    known = np.isfinite(error) & np.isfinite(u)
    return float(np.mean(np.abs(error[known]) <= (k * u)[known]))


def rms(values: np.ndarray) -> float:
    """Root mean square of what is known."""
    return float(np.sqrt(np.nanmean(np.square(values))))


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
    began = time.process_time()
    joint = model._joint_errors()
    seconds = time.process_time() - began
    level = truth.attrs["base"] + GAIN * (model.reference_temperature_ - truth.attrs["device"]["reference_temperature"])
    bias, u_bias = model.bias(X, return_std=True)
    signed = model.uncertainty(X, y, diagnosis=None)
    k_bias = coverage_factor(joint.dof, 0.95)
    rows = slice(SKIPPED, None)
    wrong = (bias - (clean - level)).to_numpy()[rows]
    row = SKIPPED + seed * 7919 % (len(X) - SKIPPED)  # one row of a record: those of all records are independent
    found = {
        "kind": kind, "searched": searched, "seconds": seconds,
        "bias row": covered(wrong[row - SKIPPED :][:1], u_bias.to_numpy()[row:][:1], k_bias),
        "bias": covered(wrong, u_bias.to_numpy()[rows], k_bias),
        "bias u": rms(u_bias.to_numpy()[rows]), "bias e2": squares(wrong, u_bias.to_numpy()[rows]),
    }  # fmt: skip
    plain = {part: value for part, value in signed.variances.items() if part != "structure"}
    reading_u = np.sqrt(np.maximum(sum(plain.values()) - 2 * signed.shared, 0))[rows]
    reading_e = (signed.corrected - level)[rows]
    found |= {
        "reading": covered(reading_e, reading_u, coverage_factor(signed.dof[rows], 0.95)),
        "reading row": abs(reading_e[row - SKIPPED])
        <= coverage_factor(signed.dof[row : row + 1], 0.95) * reading_u[row - SKIPPED],
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
        found[f"step {after:.0f} s"] = abs(value - response(device, np.array([after]))[0]) <= k_bias * error
    cut = int(0.7 * n)
    early = fitted(device, searched, X.iloc[:cut], y.iloc[:cut], afresh)
    told, u_told = early.predict(X.iloc[cut:], return_std=True)
    k = coverage_factor(early._joint_errors().noise.dof, 0.95)
    later = y.to_numpy()[cut:] - told
    found |= {"later": covered(later, u_told, k), "later u": rms(u_told), "later e2": squares(later, u_told)}
    return found


def table(rows: list[dict[str, Any]]) -> pd.DataFrame:
    """Shares in percent, widths as ratios."""
    frame = pd.DataFrame(rows)
    means = frame.groupby(["searched", "kind"], sort=False).mean(numeric_only=False)
    result = pd.DataFrame(index=means.index)
    for name in ("bias", "reading", "later"):
        result[name] = 100 * means[name]
        result[f"{name} wide"] = means[f"{name} u"].astype(float) / np.sqrt(means[f"{name} e2"].astype(float))
    for name in ("mean 10", "mean 100", "gain", "step 600 s", "step 5000 s"):
        result[name] = 100 * means[name].astype(float)
    result["ms"] = 1000 * means["seconds"].astype(float)
    return result


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=40)
    parser.add_argument("--first", type=int, default=9000, help="first seed (tuning used those below 1000)")
    parser.add_argument("--rows", type=int, default=5000)
    parser.add_argument("--kinds", nargs="*", default=list(KINDS))
    parser.add_argument("--only", choices=("given", "searched"))
    parser.add_argument("--jobs", type=int, default=1)
    options = parser.parse_args()
    cases = [
        (kind, seed, options.rows, searched)
        for searched in (False, True)
        if options.only in (None, "searched" if searched else "given")
        for kind in options.kinds
        for seed in range(options.first, options.first + options.seeds)
    ]
    rows = Parallel(n_jobs=options.jobs)(delayed(judged)(*case) for case in cases)
    with pd.option_context("display.width", 250, "display.max_columns", 30):
        print(table(rows).astype(float).round(2).to_string())


if __name__ == "__main__":
    main()

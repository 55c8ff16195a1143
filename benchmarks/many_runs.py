"""One device, its record cut into runs, each of which starts anew: error, cost, and is the verdict that of one run?

    python benchmarks/many_runs.py                              # seeds 21 to 24, a few minutes
    python benchmarks/many_runs.py --rows 84000 --runs 1 300 --seeds 21

The inner temperatures at the start of a run are unknown to the model. Residual: standard deviation over the noise's,
of all rows and of the middle of each run (40 to 70 %) that a second fit did not see. Over "equilibrium": processor time
of a fit with these time constants, over that of one without start-up columns. Right: nothing hidden and nothing named,
or the hidden effect named first; beside it: further causes named.
"""

from __future__ import annotations

import argparse
import time
import warnings

import numpy as np

from thermocorr import DynamicBiasRegressor, RecordWarning, diagnose
from thermocorr.datasets import make_record

NOISE = 0.2
HIDDEN = (None, "hysteresis", "covariate")


def fitted(X, y, time_constants="auto", **options):
    """A model of runs, and the processor time of its fit [s]."""
    began = time.process_time()
    model = DynamicBiasRegressor("temperature", time_constants, run="run", **options).fit(X, y)
    return model, time.process_time() - began


def line(rows: int, runs: int, seed: int, hidden: str | None) -> tuple[float, ...]:
    """Residual, that of held-out middles, cost of the fit, right or not, further causes, time of the diagnosis."""
    effects = None if hidden is None else {hidden: 1.0}
    record = make_record(rows, seed=seed, noise=NOISE, effects=effects)
    X, y = record.drop(columns="reading").assign(run=np.arange(rows) * runs // rows), record["reading"]
    model, _ = fitted(X, y)
    taus = model.time_constants_.tolist()
    cost = fitted(X, y, taus)[1] / fitted(X, y, taus, initial_state="equilibrium")[1]
    place = np.arange(rows) * runs / rows % 1.0
    held = (place > 0.4) & (place < 0.7)
    without = fitted(X, y.mask(held))[0]
    middle = float(np.std((y - without.predict(X))[held]))
    began = time.process_time()
    causes = diagnose(model, X, y).causes
    spent = time.process_time() - began
    kinds = [cause.effect.kind for cause in causes]
    right = not kinds if hidden is None else kinds[:1] == [hidden]
    return model.residual_std_ / NOISE, middle / NOISE, cost, right, len(kinds[1:] if right else kinds), spent


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rows", type=int, default=20_000)
    parser.add_argument("--runs", type=int, nargs="*", default=[1, 3, 10, 30, 100, 300])
    parser.add_argument("--seeds", type=int, nargs="*", default=[21, 22, 23, 24])
    options = parser.parse_args()
    warnings.simplefilter("ignore", RecordWarning)
    print(f"{options.rows} rows, seeds {options.seeds}; residuals where nothing is hidden, times in processor seconds")
    print("runs  hidden       residual  middle  over equilibrium  right  beside it  diagnose")
    for runs in options.runs:
        for hidden in HIDDEN:
            lines = np.array([line(options.rows, runs, seed, hidden) for seed in options.seeds])
            residual, middle, cost, _, beside, spent = np.mean(lines, axis=0)
            shown = f"{residual:8.3f}  {middle:6.3f}" if hidden is None else " " * 16
            right = f"{int(lines[:, 3].sum())}/{len(lines)}"
            told = f"{cost:16.1f}  {right:>5s}  {beside:9.1f}  {spent:8.1f}"
            print(f"{runs:4d}  {hidden or 'nothing':11s}  {shown}  {told}", flush=True)


if __name__ == "__main__":
    main()

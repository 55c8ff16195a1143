"""A noisy or coarse thermometer: how wrong the static gain is that the defaults learn.

    python benchmarks/thermometer_noise.py

Prints, over simulated devices (two weeks, a row a minute), mean, scatter and worst error of the gain in per cent: with
the defaults, and with the device's own time constants given. Seeds 0 to 11 served to choose what the search leaves out.
"""

from __future__ import annotations

import argparse
import warnings

import numpy as np

from thermocorr import DynamicBiasRegressor
from thermocorr.datasets import make_record

OWN = ["269 s", "5124 s"]
"""Time constants of the device, see `thermocorr.datasets`."""
THERMOMETERS = {
    "exact": (0.0, 0.0),
    "0.1 K noise": (0.1, 0.0),
    "0.0625 K steps": (0.0, 0.0625),
    "0.1 K steps": (0.0, 0.1),
}
"""Standard deviation of the noise, and step [K]."""


def gain_error(seed: int, noise: float, step: float, time_constants: object) -> float:
    """Relative error of the static gain."""
    record, truth = make_record(20_160, seed=seed, sampling_period=60.0, return_truth=True)
    T = record["temperature"].to_numpy()
    seen = np.round(T / step) * step if step else T + noise * np.random.default_rng([9, seed]).standard_normal(len(T))
    model = DynamicBiasRegressor("temperature", time_constants)
    model.fit(record[["temperature"]].assign(temperature=seen), record["reading"])
    return float(model.coef_[0] / truth.attrs["device"]["sensitivity"] - 1)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--first", type=int, default=12, help="first seed (default 12)")
    parser.add_argument("--seeds", type=int, default=36, help="how many (default 36)")
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    print(f"{'':16s}{'defaults: mean  scatter  worst':>34s}{'own lags: mean  scatter  worst':>34s}  [%]")
    for name, (noise, step) in THERMOMETERS.items():
        line = f"{name:16s}"
        for taus in ("auto", OWN):
            seeds = range(options.first, options.first + options.seeds)
            errors = 100 * np.array([gain_error(seed, noise, step, taus) for seed in seeds])
            line += f"{errors.mean():17.3f}{errors.std():9.3f}{np.abs(errors).max():8.3f}"
        print(line)


if __name__ == "__main__":
    main()

"""Simulated devices under noises of our own, with the bias that is true."""

import numpy as np
from scipy.signal import lfilter

from thermocorr.datasets import make_record

TIMES = ["269 s", "5124 s"]
"""What the package on a board answers with, see `thermocorr.datasets`."""


def markov(rng, n, rows):
    """First-order Markov noise of unit variance that remembers so many rows."""
    kept = np.exp(-1 / rows)
    white = rng.standard_normal(n)
    return lfilter([np.sqrt(1 - kept**2)], [1, -kept], white, zi=[kept * rng.standard_normal()])[0]


def device(n, seed, noise, **more):
    """Temperature, readings under a noise of unit size, and the true bias from the temperature's mean, at rest."""
    record, truth = make_record(n, seed=seed, noise=1e-9, return_truth=True, **more)
    X, clean = record[["temperature"]], record["reading"]
    rest = truth.attrs["base"] + 10 * (X["temperature"].mean() - truth.attrs["device"]["reference_temperature"])
    return X, clean + 0.2 * noise, clean - rest

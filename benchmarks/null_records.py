"""Nothing hidden, thirteen kinds of noise: is anybody accused, and is the stated p-value true?

    python benchmarks/null_records.py --records 20               # per kind, seeds that served no tuning
    python benchmarks/null_records.py --records 300 --kinds white flicker walk
    python benchmarks/null_records.py --before 3000               # devices that are not at rest when the record begins

Devices of `make_record` without an effect, whose white noise of one sample is exchanged for another noise of the same
standard deviation (random walks and slow noises: twice that over the record). Where the noise has misled the search
for time constants, so that the model's fast part is wrong by more than 0.14 of the noise, a lag, delay or rate that
is named is no accusation ("lags found wanting"); nor is a start that brings the model of a device that was not at
rest nearer to the truth by a fifth. Printed for each kind: accused, told "nothing missing", and how often the
smallest p-value of the family lies at or below 0.001, 0.01 and 0.05. Seeds 5000 to 5099 served for tuning.
"""

from collections.abc import Callable

import numpy as np
import pandas as pd
from common import asked
from scipy.signal import lfilter

from thermocorr import DynamicBiasRegressor, diagnose
from thermocorr.datasets import make_record
from thermocorr.effects.protocol import Effect

Noise = Callable[[np.random.Generator, int, pd.DataFrame], np.ndarray]


def remembering(rows: float) -> Noise:
    """First-order Markov noise that remembers so many rows (a share of the record if below 1)."""

    def draw(rng: np.random.Generator, n: int, X: pd.DataFrame) -> np.ndarray:
        kept = np.exp(-1 / (rows * n if rows < 1 else rows))
        white, start = rng.standard_normal(n), [kept * rng.standard_normal()]
        return 2 * lfilter([np.sqrt(1 - kept**2)], [1, -kept], white, zi=start)[0] + rng.standard_normal(n)

    return draw


def flicker(rng: np.random.Generator, n: int, X: pd.DataFrame) -> np.ndarray:
    """Power that falls with frequency, white noise above it."""
    spectrum = np.fft.rfft(rng.standard_normal(4 * n))
    spectrum[1:] /= np.sqrt(np.arange(1, len(spectrum)))
    spectrum[0] = 0
    slow = np.fft.irfft(spectrum, 4 * n)[:n]
    return 2 * slow / slow.std() + rng.standard_normal(n)


def walk(rng: np.random.Generator, n: int, X: pd.DataFrame) -> np.ndarray:
    """A random walk under white noise."""
    slow = np.cumsum(rng.standard_normal(n))
    return 2 * slow / slow.std() + rng.standard_normal(n)


NOISES: dict[str, Noise] = {
    "white": lambda rng, n, X: rng.standard_normal(n),
    "heavy tails": lambda rng, n, X: rng.standard_t(3, n) / np.sqrt(3),
    "grows with time": lambda rng, n, X: rng.standard_normal(n) * np.linspace(0.3, 1.7, n),
    "grows with T": lambda rng, n, X: (
        rng.standard_normal(n) * (0.3 + 1.4 * (X["temperature"].rank(pct=True).to_numpy()))
    ),
    "quantised": lambda rng, n, X: np.round(rng.standard_normal(n) * 0.5) * 2,
    "3 rows": remembering(3.0),
    "30 rows": remembering(30.0),
    "0.3 %": remembering(0.003),
    "2 %": remembering(0.02),
    "10 %": remembering(0.1),
    "flicker": flicker,
    "walk": walk,
    "bursts": lambda rng, n, X: rng.standard_normal(n) * np.where(rng.random(n) < 0.01, 8.0, 1.0),
}


def judged(kind: str, seed: int, n: int, setting: str, before: int = 0) -> dict[str, object]:
    """One record, whose device has followed the temperature for so many rows before."""
    rng = np.random.default_rng([seed, len(kind)])
    record = make_record(
        n + before, setting=setting, device=("slab", "plate", "layered", "box")[seed % 4], noise=1e-9, seed=seed
    ).iloc[before:]
    X, y = record.drop(columns="reading"), record["reading"]
    noise = NOISES[kind](rng, n, X)
    y = y + 0.2 * noise
    model = DynamicBiasRegressor("temperature").fit(X, y)
    misfit = model.predict(X) - record["reading"]
    whole = misfit.std()
    misfit -= misfit.rolling(50, center=True, min_periods=1).mean()
    found = diagnose(model, X, y)
    lacking = bool(misfit.std() > 0.14 * 0.2)  # lags that the noise has spoiled: what is said of them is true

    def true(effect: Effect) -> bool:
        if not before or effect.kind != "initial_transient":
            return lacking and bool(effect.thermal_rank)
        better = model.with_effect(effect).fit(X, y)  # of a device not at rest
        return bool((better.predict(X) - record["reading"]).std() < 0.8 * whole)

    causes = [cause for cause in found.causes if not true(cause.effect)]
    return {
        "kind": kind, "accused": bool(causes), "lags found wanting": len(found.causes) > len(causes),
        "nothing": found.verdict == "nothing missing",
        "p": min((s.p_value for s in found.suspects if s.p_value > 0.05 or not true(s.effect)), default=1.0),
        "who": ", ".join(f"{s.label} ({s.standing})" for s in causes),
    }  # fmt: skip


def main() -> None:
    options = asked(__doc__, records=20, first=6000, rows=5000, before=0, kinds=list(NOISES), verbose=False)
    settings, seeds = ("lab", "outdoor", "chamber"), range(options.first, options.first + options.records)
    cases = [(kind, seed, options.rows, settings[seed % 3], options.before) for kind in options.kinds for seed in seeds]
    table = pd.DataFrame([judged(*case) for case in cases])
    if options.verbose:
        print(table[table["accused"]].to_string())
    for level in (0.001, 0.01, 0.05):
        table[f"p<={level}"] = table["p"] <= level
    figures = table.drop(columns=["p", "who"]).groupby("kind", sort=False).mean()
    print(figures.round(3).to_string())
    print("all:", figures.mean().round(3).to_dict())


if __name__ == "__main__":
    main()

"""The model's thermal part on trial: which lag, delay or rate it lacks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from sklearn.base import clone

from ..effects import CATALOGUE, InitialTransient, StaticPolynomial, ThermalLag
from ..effects.protocol import Effect
from ..effects.wrap import as_effects
from ..estimators.regressor import DynamicBiasRegressor
from ..records import Record
from .blocks import averaged
from .evidence import Evidence, orthonormal, own_part
from .noise import noise_model
from .trial import FAIR_SHARE, SHARES, TIE, Key, Suspect, Trial, residual_sum_of_squares

RICH_LAGS = 16
"""Lags of the thermal part that suspects are judged against: a poorer one makes others look guilty."""
FASTEST_LAG = 0.25
"""Fastest of these lags, in sampling steps: a device faster than the sampling shows as a lag of less than a step."""
LONGEST_DECAY = 1 / 25
"""Longest start-up decay of the thermal part, as a share of the segment: slower decays swallow drift and ageing."""
MINOR = 0.15
"""Rms of what further lags explain, over the noise of one sample. Below this, the model's lags are good enough."""
SLIGHT = 0.14
"""Rms of what a delay, rate or fast lag explains, over the noise of one sample. Below this, it is not a suspect."""
WEIGHTY = 0.2
"""Rms of what a delay, rate or fast lag must explain, over that noise, to be named before another suspect."""
SAMPLES = 40_000
"""Samples (or averages of longer records) on which delays and fast lags are told apart."""


def thermal_parts(model: DynamicBiasRegressor, record: Record) -> tuple[list[Effect], list[Effect]]:
    """The rich thermal part with the model's further effects, and the model's own part."""
    span = max(record.duration(segment) for segment in record.segments)
    grid = np.geomspace(FASTEST_LAG * record.usual_step(), max(span / 3, 8 * record.usual_step()), RICH_LAGS)
    own_taus = model.time_constants_[model.time_constants_ <= grid[-1]]  # slower ones swallow drift and ageing
    taus = np.unique(np.concatenate((grid, own_taus)))
    taus = taus[np.concatenate(([True], np.diff(np.log(taus)) > 0.02))].tolist()
    further = [clone(effect) for _, effect in as_effects(model.effects)]
    if model.products:
        further += [clone(effect) for effect in model.features_.effect_list() if effect.kind == "lag_products"]
    static = StaticPolynomial(model.degree, model.reference_temperature)
    rich = [static, ThermalLag(taus), InitialTransient(taus, LONGEST_DECAY), *further]
    return rich, [clone(effect) for effect in model.features_.effect_list()]


class Lagging:
    """What the model's own thermal part lacks, judged against that part alone.

    On short averages a rich set of lags tells whether anything slow is lacking; the samples themselves tell a delay
    of a few steps from a lag of the same size, which averages cannot.
    """

    def __init__(self, trial: Trial, own: Sequence[Effect], kinds: Sequence[str]):
        self.trial, self.own = trial, own
        self.candidates = [effect for kind in kinds for effect in CATALOGUE[kind].candidates(trial.record)]
        for effect in self.candidates:
            effect.learn(trial.record)

    def suspects(self) -> list[Suspect]:
        """The best candidate of each kind, best first; none where nothing is clearly lacking."""
        return (self._in_averages() or self._in_samples()) if self.candidates else []

    def _in_averages(self) -> list[Suspect]:
        """Where the rich thermal part explains clearly more than the model's own."""
        trial, data, noise = self.trial, self.trial.data, self.trial.evidence.noise
        left = [residual_sum_of_squares(Q, data.reading) for Q in (trial.own, trial.base)]
        chance = (np.linalg.matrix_rank(trial.base) - trial.own.shape[1]) * left[1] / len(trial.own)
        explained = max(left[0] - left[1] - chance, 0.0) / len(trial.own)
        if explained < (MINOR * trial.floor) ** 2:
            return []
        judged = replace(trial.evidence, space=orthonormal(noise.whitened(trial.own, data.segment)))
        rich = judged.gain(own_part(noise.whitened(trial.base, data.segment), judged.space))
        columns = averaged(trial.record, self.candidates, weight=data.weight).columns
        found = [self._suspect(effect, Q, judged, rich) for effect, Q in zip(self.candidates, columns, strict=True)]
        return best_of_each([s for s in found if s.share >= FAIR_SHARE and s.supported()])

    def _in_samples(self) -> list[Suspect]:
        """Where a candidate explains clearly more of single samples."""
        record = self.trial.record
        data = averaged(record, [*self.own, *self.candidates], SAMPLES)
        if len(data.reading) <= len(self.trial.data.reading):
            return []
        thin = np.column_stack([data.weight, *data.columns[: len(self.own)]])
        columns = data.columns[len(self.own) :]
        saturated = orthonormal(np.column_stack((thin, *columns)))
        noise = noise_model(data.reading - saturated @ (saturated.T @ data.reading), data.segment)
        space = orthonormal(noise.whitened(thin, data.segment))
        reading = noise.whitened(data.reading[:, None], data.segment)[:, 0]
        judged = Evidence(
            noise=noise, segment=data.segment, space=space, reading=reading, bases=[], tests=float(len(columns))
        )
        first = [self._suspect(effect, Q, judged, None) for effect, Q in zip(self.candidates, columns, strict=True)]
        if not any(clearly(suspect) for suspect in first):
            return []
        found = [self._refined(suspect) for suspect in best_of_each(first)]
        return best_of_each([suspect for suspect in found if clearly(suspect) and suspect.supported()])

    def _suspect(self, effect: Effect, columns: np.ndarray, judged: Evidence, rich: float | None) -> Suspect:
        """A candidate with its evidence; its share is of the gain of the rich part, or of the best candidate."""
        basis = judged.basis(columns)
        score = judged.score(basis) - float(np.log(len(self.candidates))) if basis.shape[1] else -np.inf
        share = 1.0 if rich is None else min(judged.gain(basis) / max(rich, 1e-300), 1.0)
        return Suspect(effect, basis, score, judged, share)

    def _refined(self, suspect: Suspect) -> Suspect:
        """A suspect with its parameters moved to where it explains most."""
        for share in SHARES:
            near = suspect.effect.nearby(self.trial.record, share)
            for effect in near:
                effect.learn(self.trial.record)
            columns = averaged(self.trial.record, near, SAMPLES).columns if near else []
            for effect, Q in zip(near, columns, strict=True):
                suspect = max(suspect, self._suspect(effect, Q, suspect.judged, None), key=lambda s: s.score)
        return suspect

    def beats(self, lag: Suspect, other: Suspect) -> bool:
        """Whether a lag found in the samples explains more than another suspect does, of these and of the averages."""
        if len(lag.judged.space) <= len(self.trial.data.reading) or not clearly(lag, WEIGHTY):
            return False
        gain, data = lag.judged.gain(lag.basis), self.trial.data
        slow = self.trial.explained(averaged(self.trial.record, [other.effect], weight=data.weight).columns[0])
        if gain / (1 - gain) * lag.judged.noise.innovation_variance < slow / len(data.reading):
            return False
        columns = averaged(self.trial.record, [other.effect], SAMPLES).columns[0]
        return lag.score > self._suspect(other.effect, columns, lag.judged, None).score + TIE


def clearly(suspect: Suspect, enough: float = SLIGHT) -> bool:
    """Whether the rms of what a candidate explains is above `enough`, over the noise of one sample."""
    chance = suspect.basis.shape[1] / suspect.judged.freedom
    return bool(suspect.basis.shape[1] > 0 and suspect.judged.gain(suspect.basis) - chance > enough**2)


def best_of_each(suspects: Sequence[Suspect]) -> list[Suspect]:
    """The best suspect of each kind and column, best first."""
    best: dict[Key, Suspect] = {}
    for suspect in sorted(suspects, key=lambda s: -s.score):
        best.setdefault(suspect.key, suspect)
    return list(best.values())

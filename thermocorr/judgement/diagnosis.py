"""`diagnose`: whether anything is missing in a fitted model, and what."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Any

import numpy as np
import pandas as pd
from sklearn.base import clone

from ..effects import CATALOGUE
from ..effects.protocol import Effect
from ..estimators.regressor import DynamicBiasRegressor
from ..estimators.threads import one_blas_thread
from ..pages import PageData
from .candidates import as_fitted, further_candidates, given_effects, suspect_record
from .found import Diagnosis, FoundSuspect
from .helping import helping
from .lagging import Lagging, thermal_parts
from .trial import FAIR_SHARE, LEVEL, MOST_CAUSES, TIE, Suspect, Trial, tied
from .where import against_white, where_it_fails

COLOURED = 1.05
"""Variance over innovation variance of the saturated model's residual. Above this, structure is left."""
SIMPLER = 1.5
"""Score that one parameter is worth among suspects that cannot be told apart: the simpler one is named first."""
CLEAR_SHARE = 0.8
"""A suspect that explains at least this share is named whatever the number of further causes."""


def diagnose(
    model: DynamicBiasRegressor,
    X: Any,
    y: Any,
    *,
    columns: Sequence[Any] | None = None,
    exclude: Collection[str] = (),
    suspects: Sequence[Any] = (),
    random_state: int = 0,
) -> Diagnosis:
    """Find out whether a physical effect is missing in a fitted model, and which.

    Parameters
    ----------
    model : DynamicBiasRegressor
        Fitted.
    X, y : as for `DynamicBiasRegressor.fit`
        The record: the fitted one, or another of the same device.
    columns : sequence, optional
        Recorded columns under suspicion; by default every numeric column that the model does not use.
    exclude : collection of str
        Kinds of `thermocorr.effects.CATALOGUE` not to try.
    suspects : sequence
        Suspects of your own beside the catalogue: effects, classes of effects (tried over what their `candidates`
        returns), or scikit-learn transformers as in the model's `effects`.
    random_state : int
        Seed of the draws that calibrate the error probabilities.

    Returns
    -------
    Diagnosis

    Raises
    ------
    RecordError
        For a record that cannot be used, or is too short to judge.

    Examples
    --------
    >>> from thermocorr import DynamicBiasRegressor, diagnose
    >>> from thermocorr.datasets import make_record
    >>> record = make_record(2000, effects={"hysteresis": 2.0}, seed=1)
    >>> X, y = record.drop(columns="reading"), record["reading"]
    >>> diagnosis = diagnose(DynamicBiasRegressor("temperature").fit(X, y), X, y)
    >>> diagnosis.verdict, diagnosis.best.kind
    ('missing', 'hysteresis')
    """
    unknown = set(exclude) - set(CATALOGUE)
    if unknown:
        raise ValueError(f"The 'exclude' parameter names {sorted(unknown)}, which are no kinds: {sorted(CATALOGUE)}.")
    with one_blas_thread():
        record = suspect_record(model, X, y, columns, given_effects(suspects))
        names = [name for name in record.columns if name != record.temperature_name]
        base, own = thermal_parts(model, record)
        candidates = [
            effect
            for kind, effects in CATALOGUE.items()
            if kind not in exclude and kind != "thermal_lag"  # judged against the model's own lags, below
            for effect in effects.candidates(record, names)
        ]
        candidates += further_candidates(suspects, record)
        trial = Trial(record, base, own, candidates, np.random.default_rng(random_state))
        lagging = Lagging(trial, own, [kind for kind in ("thermal_lag", "delay", "rate") if kind not in exclude])
        return _conclude(model, X, y, trial, lagging)


def _conclude(model: DynamicBiasRegressor, X: Any, y: Any, trial: Trial, lagging: Lagging) -> Diagnosis:
    """Verdict and ordered suspects, from the evidence for each and from what nothing explains."""
    seen = as_fitted(model, X)
    residual = np.asarray(model.residuals(seen, y), float)
    rms = float(np.sqrt(np.nanmean(residual**2)))
    floor = min(trial.floor, rms)
    coloured = trial.evidence.noise.colour > COLOURED
    suspects, lags = trial.suspects(), lagging.suspects()
    supported = bool(suspects) and suspects[0].supported()
    causes, wanders = trial.causes()
    if supported and lags and lagging.beats(lags[0], suspects[0]):
        supported = False
    best: list[Suspect] = []  # the one to name, and those that cannot be told apart from it
    unexplained = coloured or wanders
    if supported and (wanders or not _fair(suspects[0], causes)):
        best, unexplained = helping(model, X, y, trial, suspects), True
    elif supported:
        best = [suspects[0], *(other for other in suspects[1:] if tied(suspects[0], other))]
    elif lags and not unexplained:
        best = [lags[0], *(other for other in lags[1:] if tied(lags[0], other))]
    best.sort(key=lambda suspect: SIMPLER * n_parameters(suspect.effect) - suspect.score)
    if best:
        verdict = "ambiguous" if len(best) > 1 else "missing"
    else:
        verdict = "unexplained" if unexplained else "nothing missing"
    named = {suspect.key for suspect in best}
    ranked = [*best, *(other for other in (*suspects, *lags) if other.key not in named)]
    beside = dict.fromkeys(ranked[0].effect.inputs() if ranked else ())
    return Diagnosis(
        verdict=verdict,
        noise_floor=floor,
        explainable=float(np.clip(1 - floor**2 / rms**2, 0.0, 1.0)) if rms > 0 else 0.0,
        where=_where(model, trial, residual),
        allan=against_white(trial.record, residual, floor),
        suspects=tuple(_found(suspect, ranked) for suspect in ranked),
        best=clone(best[0].effect) if best else None,
        residual_rms=rms,
        colour=trial.evidence.noise.colour,
        unit=model.reading_.unit,
        gather=lambda: PageData.of(model, seen, y, beside=tuple(name for name in beside if name in seen)),
    )


def n_parameters(effect: Effect) -> int:
    """Parameters with a unit that are in use: what makes one explanation simpler than another."""
    named = effect.info.parameters if effect.info is not None else {}
    values = [getattr(effect, name) for name in named]
    return sum(value is not None and np.size(value) > 0 for value in values)


def _fair(best: Suspect, causes: int) -> bool:
    """Whether the best suspect explains enough, or few enough others are needed beside it."""
    return best.share >= CLEAR_SHARE or (best.share >= FAIR_SHARE and causes <= MOST_CAUSES)


def _where(model: DynamicBiasRegressor, trial: Trial, residual: np.ndarray) -> pd.DataFrame:
    lag = None
    if len(model.time_constants_):  # the lag that moves the reading most
        names = [effect.kind for effect in model.features_.effect_list()]
        start = sum(len(effect.names()) for effect in model.features_.effect_list()[: names.index("thermal_lag")])
        mu = np.abs(model.coef_[start : start + len(model.time_constants_)])
        lag = float(model.time_constants_[int(mu.argmax())])
    recorded = [name for name in trial.record.columns if name != trial.record.temperature_name]
    return where_it_fails(trial.record, residual, trial.floor, lag, recorded)


def _found(suspect: Suspect, ranked: Sequence[Suspect]) -> FoundSuspect:
    others = [other for other in ranked if other is not suspect and abs(other.score - suspect.score) < 2 * TIE]
    p = suspect.p_value
    alike = [clone(other.effect) for other in others if p <= LEVEL and tied(suspect, other)]
    return FoundSuspect(
        effect=clone(suspect.effect),
        share=suspect.share,
        gain_db=suspect.gain_db,
        p_value=p,
        confusable_with=tuple(alike[:3]),
    )

"""`diagnose`: whether anything is missing in a fitted model, and what."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pandas as pd
from sklearn.base import clone

from ..effects import CATALOGUE, InitialTransient, StaticPolynomial, ThermalLag
from ..effects.protocol import Effect
from ..effects.wrap import as_effects
from ..estimators.regressor import DynamicBiasRegressor
from ..estimators.threads import one_blas_thread
from ..records import Log, Record, RecordError, read_record
from ..records.read import from_polars, is_frame, numeric_reading
from .adding import held_out_rms, with_missing
from .averages import Averages, averaged, filled
from .evidence import Evidence, evidence, orthonormal, own_part
from .where import where_it_fails

RICH_LAGS = 16
"""Lags of the thermal part that suspects are judged against: a poorer one makes others look guilty."""
FASTEST_LAG = 0.25
"""Fastest of them, in sampling steps: a device faster than the sampling shows as a lag of less than a step."""
LONGEST_DECAY = 1 / 25
"""Start-up decays of that part, as a share of the segment: slower ones swallow drift and ageing."""
LEVEL = 0.01
"""Family-wise error probability below which a suspect is named."""
COLOURED = 1.05
"""Variance over innovation variance of the saturated model's residual, above which structure is left."""
FAIR_SHARE = 0.45
"""Share of the structured variance that the best suspect must explain: the larger of two causes has about half."""
CLEAR_SHARE = 0.8
"""Share beyond which the number of further causes does not matter."""
SMALLEST_SHARE = 0.3
"""Share below which a suspect is not tried on held-out blocks."""
CLEAR_HELP = 0.8
"""Held-out error with a suspect over that without, up to which it is named although other structure is left."""
TRIED = 3
"""Suspects that are tried so."""
MOST_CAUSES = 3
"""More causes than this, each needed, are the sign of a noise that wanders."""
TIE = 4.0
"""Difference of scores (log likelihood) below which two suspects that explain the same cannot be parted."""
ALIKE = 0.8
"""Squared cosine of what two suspects explain, above which they explain the same."""
RANKED = 10
"""Suspects that are listed."""
REFINED = 4
"""Best suspects whose parameters are refined."""
SHARES = (0.5, 0.25, 0.1, 0.03)
"""Steps of this refinement, coarse to fine."""
MOVES = 2
"""Moves at each step."""
MINOR = 0.15
"""What a lag explains, over the noise of one sample, below which the model's thermal part is good enough."""

Key = tuple[str, Any]


@dataclass(frozen=True)
class Suspect:
    """A kind of effect on a column, at its best parameters."""

    effect: Effect
    basis: np.ndarray = field(repr=False)
    score: float
    """Log likelihood above that without it, less penalties for its columns and for the parameters tried."""
    judged: Evidence = field(repr=False)
    share: float
    """Share of the structured variance that it explains."""

    @property
    def key(self) -> Key:
        """Kind and column."""
        return key_of(self.effect)

    @property
    def label(self) -> str:
        """``kind`` or ``kind:column``."""
        kind, column = self.key
        return kind if column is None else f"{kind}:{column}"

    @property
    def p_value(self) -> float:
        """Error probability, the whole family having been tried."""
        return self.judged.family_p(self.basis)

    @property
    def gain_db(self) -> float:
        """Held-out gain."""
        return self.judged.held_out_gain(self.basis)

    def supported(self) -> bool:
        """Whether the evidence is beyond chance and holds on blocks of time that it was not learned from."""
        return self.p_value <= LEVEL and self.gain_db > 0


@dataclass(frozen=True)
class Diagnosis:
    """What `diagnose` found. Prints as a page."""

    verdict: str
    """ "nothing missing", "missing", "ambiguous" or "unexplained"."""
    noise_floor: float
    """Standard deviation of one sample that no effect can explain, in the unit of y."""
    explainable: float
    """Share of the residual variance that something could still explain."""
    where: pd.DataFrame
    """Conditions under which the model fails, worst first, see `thermocorr.judgement.where`."""
    ranking: pd.DataFrame
    """Suspects, best first: kind, column, parameters, gain_db (held out), p_value (of the whole family), share (of the
    structured variance), confusable_with, sentence."""
    best: Effect | None
    """The first suspect, ready for ``model.with_effect``; None where the verdict names nobody."""
    residual_rms: float
    """Of the model on these data, in the unit of y."""
    colour: float
    """Variance over innovation variance of what all suspects together leave: 1 for white noise."""
    unit: str

    def __str__(self) -> str:
        lines = [
            f"Verdict: {self.verdict}",
            f"Residual {self.residual_rms:.4g} {self.unit}, noise floor {self.noise_floor:.4g} {self.unit}: "
            f"{self.explainable:.0%} of the residual variance could still be explained.",
        ]
        if len(self.where) and self.verdict != "nothing missing":
            worst = self.where.iloc[0]
            lines.append(
                f"Where it fails most: {worst.condition} {worst.interval}: {worst.share:.0%} of the error beyond the "
                f"noise in {worst.share / worst.lift:.0%} of the samples."
            )
        if self.verdict == "unexplained":
            lines.append("There is structure in the residual that no known effect explains by itself.")
        for number, row in enumerate(self.ranking.head(3).itertuples(), 1):
            lines.append(f"Suspect {number}, {row.sentence}")
        if self.best is not None and self.best.info is not None:
            lines.append(f"To confirm the first on the bench: {self.best.info.bench_check}")
            lines.append("To add it: better = model.with_effect(diagnosis.best).fit(X, y), or refine(model, X, y).")
        return "\n".join(lines)


def diagnose(
    model: DynamicBiasRegressor,
    X: Any,
    y: Any,
    *,
    columns: Sequence[Any] | None = None,
    exclude: Collection[str] = (),
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
    random_state : int
        Seed of the draws that calibrate the error probabilities.

    Returns
    -------
    Diagnosis

    Raises
    ------
    RecordError
        For a record that cannot be used, or is too short to judge.
    """
    unknown = set(exclude) - set(CATALOGUE)
    if unknown:
        raise ValueError(f"The 'exclude' parameter names {sorted(unknown)}, which are no kinds: {sorted(CATALOGUE)}.")
    with one_blas_thread():
        record = suspect_record(model, X, y, columns)
        names = [name for name in record.columns if name not in used_columns(model, record)]
        base, own = thermal_parts(model, record)
        candidates = [
            effect
            for kind, effects in CATALOGUE.items()
            if kind not in exclude and kind != "thermal_lag"  # judged against the model's own lags, below
            for effect in effects.candidates(record, names)
        ]
        trial = Trial(record, base, candidates, np.random.default_rng(random_state))
        fast = [kind for kind in ("thermal_lag", "delay", "rate") if kind not in exclude]
        lag = trial.missing_lag(own, fast)
        return _conclude(model, X, y, trial, trial.suspects(), lag)


class Trial:
    """All candidates of a record before the evidence."""

    def __init__(self, record: Record, base: Sequence[Effect], candidates: Sequence[Effect], rng: np.random.Generator):
        self.record, self.candidates, self.rng = record, list(candidates), rng
        for effect in (*base, *candidates):
            effect.learn(record)
        self.data: Averages = averaged(record, [*base, *candidates])
        if len(self.data.reading) < 100:
            raise RecordError(
                f"The record is too short to judge: {len(self.data.reading)} readings, and 100 are needed. "
                "Record longer."
            )
        self.base = np.column_stack([np.ones(len(self.data.reading)), *self.data.columns[: len(base)]])
        self.columns = self.data.columns[len(base) :]
        self.evidence: Evidence = evidence(self.data, self.base, self.columns, rng)
        self._refine()
        self.evidence = evidence(self.data, self.base, self.columns, rng)

    def suspects(self) -> list[Suspect]:
        """The best candidate of each kind and column, best first."""
        sizes = self._grid_sizes()
        best: dict[Key, tuple[float, int]] = {}
        for i, (effect, basis) in enumerate(zip(self.candidates, self.evidence.bases, strict=True)):
            if basis.shape[1]:
                score = self.evidence.score(basis) - float(np.log(sizes[key_of(effect)]))
                best[key_of(effect)] = max(best.get(key_of(effect), (-np.inf, -1)), (score, i))
        return [
            Suspect(self.candidates[i], self.evidence.bases[i], score, self.evidence, self._structured_share(i))
            for score, i in sorted(best.values(), reverse=True)[:RANKED]
        ]

    def _grid_sizes(self) -> dict[Key, float]:
        """Effective number of different candidates of each kind and column: (sum of eigenvalues)^2 / sum of squares."""
        leading: dict[Key, list[np.ndarray]] = {}
        for effect, basis in zip(self.candidates, self.evidence.bases, strict=True):
            if basis.shape[1]:
                leading.setdefault(key_of(effect), []).append(basis[:, -1])
        return {
            key: float(len(vectors) ** 2 / np.sum((np.array(vectors) @ np.array(vectors).T) ** 2))
            for key, vectors in leading.items()
        }

    def _refine(self) -> None:
        """Search around the parameters of the best suspects."""
        for suspect in self.suspects()[:REFINED]:
            effect, gain = suspect.effect, self.evidence.gain(suspect.basis)
            found: np.ndarray | None = None
            for share in (share for share in SHARES for _ in range(MOVES)):
                near = effect.nearby(self.record, share)
                for other in near:
                    other.learn(self.record)
                if not near:
                    break
                tried = averaged(self.record, near).columns
                gains = [self.evidence.gain(self.evidence.basis(columns)) for columns in tried]
                if max(gains) > gain:
                    which = int(np.argmax(gains))
                    effect, gain, found = near[which], gains[which], tried[which]
            if found is not None:
                self.candidates.append(effect)
                self.columns.append(found)

    def causes(self, most: int = MOST_CAUSES + 1) -> tuple[int, bool]:
        """How many candidates, one after the other, are each supported by what those before have left; and whether
        what all of them leave still wanders.

        One cause needs one, two need two; a noise that wanders is imitated by ever more, and never quite.
        """
        judged = self.evidence
        for count in range(most):
            scores = [judged.score(basis) if basis.shape[1] else -np.inf for basis in judged.bases]
            best = judged.bases[int(np.argmax(scores))]
            if best.shape[1] == 0 or judged.family_p(best) > LEVEL:
                return count, judged.wanders(self.rng)
            space = np.column_stack((judged.space, best))
            bases = [own_part(basis, best) if basis.shape[1] else basis for basis in judged.bases]
            judged = replace(judged, space=space, bases=bases)
        return most, judged.wanders(self.rng)

    def _structured_share(self, i: int) -> float:
        """Share of the structured variance (base residual less white noise) that candidate i explains."""
        left = [
            residual_sum_of_squares(Q, self.data.reading)
            for Q in (self.base, np.column_stack((self.base, self.columns[i])))
        ]
        structured = left[0] - len(self.base) * self.evidence.noise.innovation_variance
        return float(np.clip((left[0] - left[1]) / max(structured, 1e-300), 0.0, 1.0))

    @property
    def floor(self) -> float:
        """Standard deviation of one sample that no effect can explain, in the unit of y."""
        return float(np.sqrt(self.evidence.noise.innovation_variance * np.median(self.data.counts)))

    def missing_lag(self, own: Sequence[Effect], kinds: Sequence[str]) -> list[Suspect]:
        """The lag, delay or rate that a model's `own` thermal part lacks, where the rich one explains clearly more."""
        for effect in own:
            effect.learn(self.record)
        thin = np.column_stack([np.ones(len(self.base)), *averaged(self.record, own).columns])
        left = [residual_sum_of_squares(Q, self.data.reading) for Q in (thin, self.base)]
        chance = (np.linalg.matrix_rank(self.base) - thin.shape[1]) * left[1] / len(thin)
        explained = max(left[0] - left[1] - chance, 0.0) / len(thin)
        if explained < (MINOR * self.floor) ** 2:
            return []
        noise, data = self.evidence.noise, self.data
        judged = replace(self.evidence, space=orthonormal(noise.whitened(thin, data.segment)))
        candidates = [effect for kind in kinds for effect in CATALOGUE[kind].candidates(self.record)]
        for effect in candidates:
            effect.learn(self.record)
        bases = [judged.basis(columns) for columns in averaged(self.record, candidates).columns]
        gains = [judged.gain(basis) if basis.shape[1] else 0.0 for basis in bases]
        best = int(np.argmax(gains))
        if not bases[best].shape[1]:
            return []
        rich = judged.gain(own_part(noise.whitened(self.base, data.segment), judged.space))
        score = judged.score(bases[best]) - float(np.log(len(candidates)))
        found = Suspect(candidates[best], bases[best], score, judged, min(gains[best] / max(rich, 1e-300), 1.0))
        return [found] if found.supported() and found.share >= FAIR_SHARE else []


def residual_sum_of_squares(columns: np.ndarray, reading: np.ndarray) -> float:
    """What least squares leaves."""
    return float(np.sum((reading - columns @ np.linalg.lstsq(columns, reading, rcond=1e-10)[0]) ** 2))


def _conclude(
    model: DynamicBiasRegressor, X: Any, y: Any, trial: Trial, suspects: list[Suspect], lag: list[Suspect]
) -> Diagnosis:
    residual = np.asarray(model.residuals(X, y), float)
    rms, floor = float(np.sqrt(np.nanmean(residual**2))), trial.floor
    coloured = trial.evidence.noise.colour > COLOURED
    best: Suspect | None = None
    supported = bool(suspects) and suspects[0].supported()
    causes, wanders = trial.causes()
    if supported and (wanders or not _fair(suspects[0], causes)):
        helping = _helping(model, X, y, suspects)
        ranked = [*helping, *(other for other in suspects if other not in helping), *lag]
        verdict, best = ("missing", helping[0]) if helping else ("unexplained", None)
    elif supported:
        best = suspects[0]
        rivals = [other for other in suspects[1:] if tied(best, other)]
        verdict = "ambiguous" if rivals else "missing"
        ranked = [*suspects, *lag]
    elif lag and not coloured and not wanders:
        best, verdict, ranked = lag[0], "missing", [*lag, *suspects]
    else:
        verdict = "unexplained" if coloured or wanders else "nothing missing"
        ranked = [*suspects, *lag]
    return Diagnosis(
        verdict,
        floor,
        float(np.clip(1 - floor**2 / rms**2, 0.0, 1.0)) if rms > 0 else 0.0,
        _where(model, trial, residual),
        pd.DataFrame([_row(suspect, ranked) for suspect in ranked]).astype({"column": object}),
        None if best is None else clone(best.effect),
        rms,
        trial.evidence.noise.colour,
        model.reading_.unit,
    )


def _fair(best: Suspect, causes: int) -> bool:
    """Whether the best suspect explains enough, or few enough others are needed beside it."""
    return best.share >= CLEAR_SHARE or (best.share >= FAIR_SHARE and causes <= MOST_CAUSES)


def _helping(model: DynamicBiasRegressor, X: Any, y: Any, suspects: Sequence[Suspect]) -> list[Suspect]:
    """Of the first suspects, the one whose addition lowers the error on held-out blocks most, if it lowers it clearly.

    The last word where much of the structure has other causes: the model is fitted anew, time constants and all,
    without each block.
    """
    before = held_out_rms(model, X, y)
    found: list[tuple[float, int]] = []
    for i, suspect in enumerate(suspects[:TRIED]):
        if suspect.supported() and suspect.share >= SMALLEST_SHARE:
            after = held_out_rms(with_missing(model, clone(suspect.effect)), X, y)
            found.append((after / before, i))
    return [suspects[min(found)[1]]] if found and min(found)[0] <= CLEAR_HELP else []


def _where(model: DynamicBiasRegressor, trial: Trial, residual: np.ndarray) -> pd.DataFrame:
    lag = None
    if len(model.time_constants_):  # the lag that moves the reading most
        names = [effect.kind for effect in model.features_.effect_list()]
        start = sum(len(effect.names()) for effect in model.features_.effect_list()[: names.index("thermal_lag")])
        mu = np.abs(model.coef_[start : start + len(model.time_constants_)])
        lag = float(model.time_constants_[int(mu.argmax())])
    recorded = [name for name in trial.record.columns if name != trial.record.temperature_name]
    return where_it_fails(trial.record, residual, trial.floor, lag, recorded)


def tied(best: Suspect, other: Suspect) -> bool:
    """Whether another suspect is as good as the best one, or nearly as good by explaining the same."""
    if best.judged is not other.judged:
        return False
    behind = best.score - other.score
    return behind < TIE or (behind < 2 * TIE and best.judged.alike(best.basis, other.basis) > ALIKE)


def _row(suspect: Suspect, ranked: Sequence[Suspect]) -> dict[str, Any]:
    others = [other for other in ranked if other is not suspect and abs(other.score - suspect.score) < 2 * TIE]
    confusable: tuple[str, ...] = ()
    if suspect.p_value <= LEVEL:
        confusable = tuple(other.label for other in others if tied(suspect, other))[:3]
    tie = f"; cannot be told apart from {', '.join(confusable)}" if confusable else ""
    probability = f"{suspect.p_value:.2g}" if suspect.p_value > 1e-12 else "below 1e-12"
    sentence = (
        f"{suspect.effect.label()}: explains {suspect.share:.0%} of the structured variance, held-out gain "
        f"{suspect.gain_db:.2f} dB, error probability {probability}{tie}. "
        f"{suspect.effect.info.physics if suspect.effect.info is not None else ''}"
    )
    return {
        "kind": suspect.effect.kind,
        "column": suspect.key[1],
        "parameters": suspect.effect.get_params(deep=False),
        "gain_db": suspect.gain_db,
        "p_value": suspect.p_value,
        "share": suspect.share,
        "confusable_with": confusable,
        "sentence": sentence.strip(),
    }


def key_of(effect: Effect) -> Key:
    """Kind and column of an effect."""
    inputs = effect.inputs()
    return effect.kind, inputs[0] if inputs else None


def suspect_record(model: DynamicBiasRegressor, X: Any, y: Any, columns: Sequence[Any] | None) -> Record:
    """The record with every suspect column beside those that the model uses."""
    X = from_polars(X)
    if isinstance(X, Log):
        raise RecordError("Diagnosis works on a frame or an array. Pass a part of the log that fits in memory.")
    layout = model.features_._layout()
    own = [name for effect in model.features_.effect_list() for name in effect.inputs()]
    temperature = model.features_.history_.record.temperature_name
    special = {layout.time, layout.run, temperature}
    if columns is None:
        frame = X.select_dtypes("number") if is_frame(X) else pd.DataFrame(np.asarray(X))
        columns = [name for name in frame.columns if name not in special and frame[name].nunique() > 1]
    read = read_record(X, layout, y=numeric_reading(y, X), needed=list(dict.fromkeys(own)), quiet=True)
    suspects = {name: (X[name] if is_frame(X) else np.asarray(X)[:, name]) for name in columns if name not in own}
    values = {name: np.asarray(column, float) for name, column in suspects.items()}
    known = {name: column for name, column in values.items() if np.isfinite(column).mean() > 0.95}
    return filled(
        Record(
            read.times,
            read.temperature_name,
            {**read.columns, **{name: np.where(np.isfinite(column), column, np.nan) for name, column in known.items()}},
            read.segments,
            read.order,
            read.reading,
            read.notes,
        )
    )


def used_columns(model: DynamicBiasRegressor, record: Record) -> set[Any]:
    """Temperature; other columns stay under suspicion even where the model has them (their lags may be missing)."""
    return {record.temperature_name}


def thermal_parts(model: DynamicBiasRegressor, record: Record) -> tuple[list[Effect], list[Effect]]:
    """The rich thermal part with the model's further effects, and the model's own part."""
    span = max(record.duration(segment) for segment in record.segments)
    grid = np.geomspace(FASTEST_LAG * record.usual_step(), max(span / 3, 8 * record.usual_step()), RICH_LAGS)
    taus = np.unique(np.concatenate((grid, model.time_constants_)))
    taus = taus[np.concatenate(([True], np.diff(np.log(taus)) > 0.02))]
    further = [clone(effect) for _, effect in as_effects(model.effects)]
    if model.products:
        further += [clone(effect) for effect in model.features_.effect_list() if effect.kind == "lag_products"]
    static = StaticPolynomial(model.degree, model.reference_temperature)
    rich = [static, ThermalLag(taus), InitialTransient(taus, LONGEST_DECAY), *further]
    return rich, [clone(effect) for effect in model.features_.effect_list()]

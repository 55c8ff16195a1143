"""`diagnose`: what is missing, and what is worth adding."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np
import pandas as pd
from sklearn.base import clone
from sklearn.utils.validation import check_is_fitted

from ..effects import (
    CATALOGUE,
    Covariate,
    Drift,
    InitialTransient,
    LaggedCovariate,
    LogAgeing,
    SensitivityDrift,
    StaticPolynomial,
)
from ..effects.grids import time_grid
from ..effects.protocol import SINCE_START, TEMPERATURE_DIFFERENCE, Effect
from ..model.averages import key_of
from ..model.out_of_sample import GAIN, OutOfSample, Worth
from ..model.progress import Progress, one_blas_thread, reporting
from ..model.regressor import DynamicBiasRegressor
from ..model.tables import Grounds, verdict_on
from ..output.words import effect_text, parameters_text
from ..records import Record
from ..records.numbers import as_data
from .data import (
    ThermalBase,
    as_fitted,
    candidates_of,
    given_effects,
    quiet_share,
    record_of,
    residuals_of,
    suspect_record,
)
from .levels import HELPFUL, RANKED
from .report import Diagnosis, FoundSuspect, Interval, as_one, intervals, what_is_left
from .scan import DATED, is_shown
from .search import ANYWHERE, Search, Term, Tried
from .terms import Pool, helps_evenly, passes_twice
from .where import where_it_fails


@dataclass(frozen=True, kw_only=True)
class Cause:
    """A term in its most helpful form, and its worth."""

    term: Term
    effect: Effect
    worth: Worth
    before: float
    after: float
    """Rms errors on later stretches given the other causes: without it, and with it."""
    moment: float | None
    """Share of the record before the last moment at which it begins or ends; None for kinds without one."""
    size: float
    """Rms of what it explains of the reading that the model and the other causes do not, in the unit of y."""


def by_worth(pool: Pool, terms: Sequence[Term], search: Search) -> tuple[list[Cause], list[Cause]]:
    """Confirmed causes by worth, and proven ones.

    One is added after the other, or two at once where one hides what the other is worth; and left out again where it is
    worth nothing given those that came later.
    """
    kept, left, held = list[_Offer](), [_Offer(pool, term, search) for term in terms], pool.out_of_sample
    while left:
        able = [offer for offer in left if offer.weigh(held)]
        best = [max(able, key=lambda offer: offer.worth.rank)] if able else _best_pair(left, held)
        if not best:
            break
        kept += best
        left = [offer for offer in left if offer not in best]
        held = held.with_columns(np.column_stack([offer.columns for offer in best]))
    for offer in list(kept):
        if not offer.weigh(_beside(pool, kept, offer)):
            kept.remove(offer)
            left.append(offer)
    for offer in (*kept, *left):
        offer.settle(_beside(pool, kept, offer))
        offer.size = pool.size(offer.fine, [other.fine for other in kept if other is not offer])
    kept.sort(key=lambda offer: -offer.worth.rank)
    return [offer.cause for offer in kept], [offer.small for offer in left if offer.term.tried.proven]


def _best_pair(left: Sequence[_Offer], held: OutOfSample) -> list[_Offer]:
    """The pair that is worth most together."""
    best, most = list[_Offer](), 0.0
    for one, other in combinations(left, 2):
        if one.weigh(held.with_columns(other.columns)) and other.weigh(held.with_columns(one.columns)):
            rank = min(one.worth.rank, other.worth.rank)
            best, most = ([one, other], rank) if rank > most else (best, most)
    return best


def _beside(pool: Pool, kept: Sequence[_Offer], one: _Offer) -> OutOfSample:
    """The user's model with all that is kept but for one."""
    columns = [offer.columns for offer in kept if offer is not one]
    return pool.out_of_sample.with_columns(np.column_stack(columns)) if columns else pool.out_of_sample


def lacking(pool: Pool, exclude: Collection[str]) -> list[Cause]:
    """At most one thermal effect that the model lacks.

    Other effects are judged given many lags, so that a poor thermal part makes none of them look guilty. Where none
    was found, what the model's few lags leave is looked at.
    """
    if pool.rows.exact:
        return []
    kinds = [kind for name, kind in CATALOGUE.items() if kind.thermal_rank and name not in exclude]
    thermal = pool.unmade([effect for kind in kinds for effect in kind.candidates(pool.record)])
    search = Search(pool.given(np.column_stack((pool.own, *pool.start)), thermal), anywhere=())
    search.run(most=1)
    return [cause for cause in by_worth(pool, search.terms(), search)[0] if cause.worth.both >= HELPFUL]


class _Offer:
    """A term in the forms that it may have."""

    def __init__(self, pool: Pool, term: Term, search: Search):
        effect = term.tried.explanation.effect
        self.term, self.before, self.after, self.size = term, np.nan, np.nan, 0.0
        self.asked = helps_evenly(effect), passes_twice(effect)
        self.moment, self.columns = pool.moment(effect), search.coarse(term.tried)
        self.fine = pool.with_columns([term.tried.explanation])[0].columns
        alike = [t for t in term.alike if not t.explanation.in_model and t.key[0] not in DATED]
        forms = _forms(pool, effect)
        made = [pool.coarse(each.columns) for each in pool.of(forms)]
        self.forms = [
            (effect, search.coarse(term.tried)),
            *((t.explanation.effect, search.coarse(t)) for t in alike),
            *zip(forms, made, strict=True),
        ]

    def weigh(self, held: OutOfSample) -> bool:
        """True if it is worth adding, in its best form."""
        worths = [held.worth([columns], self.moment)[0] for _, columns in self.forms]
        best = 0
        for k in range(1, len(worths)):
            if min(worths[k].rank - worths[best].rank, worths[k].both - worths[best].both) > GAIN:
                best = k
        (self.effect, self.columns), self.worth, self.plain = self.forms[best], worths[best], worths[0]
        if not self.term.tried.proven and self.worth.both < HELPFUL:
            return False
        return self.worth.adds(*self.asked)

    def settle(self, held: OutOfSample) -> None:
        """Final errors without it and with it."""
        self.weigh(held)
        self.before = held.later_rms(self.moment)
        self.after = held.with_columns(self.columns).later_rms(self.moment)

    @property
    def cause(self) -> Cause:
        """The cause, if it is worth adding."""
        return self._as(self.effect, self.worth)

    @property
    def small(self) -> Cause:
        """It, as it was found."""
        return self._as(self.forms[0][0], self.plain)

    def _as(self, effect: Effect, worth: Worth) -> Cause:
        return Cause(
            term=self.term, effect=effect, worth=worth, before=self.before, after=self.after, moment=self.moment,
            size=self.size,
        )  # fmt: skip


def _forms(pool: Pool, effect: Effect) -> list[Effect]:
    """A recorded column with a spectrum of lags."""
    if not isinstance(effect, Covariate | LaggedCovariate):
        return []
    power = effect.get_params(deep=False).get("power", 1)
    spectrum = time_grid(pool.record, 2.0, 0.2, 4.0)
    return [LaggedCovariate(effect.column, [float(tau) for tau in spectrum], power=power)]


def diagnose(
    model: DynamicBiasRegressor,
    X: Any,
    y: Any,
    *,
    columns: Sequence[Any] | None = None,
    exclude: Collection[str] = (),
    suspects: Sequence[Any] = (),
    progress: Progress = None,
) -> Diagnosis:
    """Find which physical effect is missing in a fitted model.

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
        Suspects of your own, besides the catalogue: effects, classes of effects (tried over what their `candidates`
        returns), or scikit-learn transformers as in the model's `effects`.
    progress : callable or True, optional
        Called with a line of text on what is being tried, and the best so far; True draws a bar (extra "progress").

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
    if not isinstance(model, DynamicBiasRegressor):
        raise TypeError(f"diagnose judges a fitted DynamicBiasRegressor. Got {type(model).__name__}.")
    check_is_fitted(model, "pipeline_")
    unknown = set(exclude) - set(CATALOGUE)
    if unknown:
        raise ValueError(f"The 'exclude' parameter names {sorted(unknown)}, which are no kinds: {sorted(CATALOGUE)}.")
    with one_blas_thread(), reporting(progress) as say:
        X = as_data(X)
        seen, read = as_fitted(model, X), record_of(model, X, y, given_effects(suspects))
        base = ThermalBase.of(model, read)
        record = suspect_record(model, read, X, y, columns)
        candidates = candidates_of(record, (*exclude, *DATED), suspects)
        pool = Pool(model, record, base, candidates)
        asked = {key_of(effect) for effect in given_effects(suspects)}  # these are tried, whatever the record shows
        pool.explanations = [
            each
            for each in pool.explanations
            if each.in_model or key_of(each.effect) in asked or is_shown(pool, each.effect)
        ]
        search = Search(pool, [kind for kind in ANYWHERE if kind not in exclude], say)
        search.run()
        terms = search.terms()
        missing = [term for term in map(_not_silently, terms) if not term.tried.explanation.in_model]
        causes, small = by_worth(pool, missing, search)
        if not missing:
            causes = lacking(pool, exclude)
        search.judged.let_go()
        return _conclude(model, y, seen, read, search, causes, small, _as_likely_as_the_start(terms))


def out_of_sample(model: DynamicBiasRegressor, X: Any, y: Any) -> OutOfSample:
    """Errors of a fitted model on unseen data, by time."""
    with one_blas_thread():
        read = record_of(model, X, y)
        base = ThermalBase.of(model, read)
        record = suspect_record(model, read, X, y, None)
        return Pool(model, record, base, []).out_of_sample


def _conclude(
    model: DynamicBiasRegressor,
    y: Any,
    seen: Any,
    read: Record,
    search: Search,
    causes: Sequence[Cause],
    small: Sequence[Cause],
    start_or: tuple[str, ...],
) -> Diagnosis:
    """Verdict, causes and other suspects, and what is left."""
    residual, rms = residuals_of(model, read, search.pool.record)
    copied = [effect_text(tried.explanation.effect) for tried in search.last if tried.copied]
    rest = replace(what_is_left(search, residual, copied), start_or=start_or)
    named = [*causes, *small]
    rounded = rest.rounding and not named
    floor = rms if search.pool.rows.exact or rounded else min(max(rest.floor, rest.rounding / np.sqrt(12)), rms)
    terms = [cause.term for cause in named]
    moments = [_dates(search.pool.record, ends) for ends in intervals(search.pool, search.judged, terms)]
    quiet = rms * quiet_share(residual, search.pool.record, [(loud.start, loud.end) for loud in rest.loud])
    if not named:  # what heavy tails add to the rms is no structure
        quiet /= max(rest.tails, 1.0)
    grades = ["confirmed"] * len(causes) + ["proven"] * len(small)
    shown = [_cause(*each, search.pool, rest.floor) for each in zip(named, grades, moments, strict=True)]
    found, slight = (as_one(part, search.pool.record) for part in (shown[: len(causes)], shown[len(causes) :]))
    keys = {cause.term.tried.key for cause in named}
    others = {t.key: t for t in reversed(search.last) if t.key not in keys and not t.explanation.in_model}
    grounds = Grounds(
        named=bool(found),
        ambiguous=bool(found and found[0].confusable_with),
        structure=rest.unknown or (bool(small) and not rest.filtered),  # a filter's noise is not quite that of the law
        spoiled=bool(search.pool.record.refused) and not model.screen,
    )
    ranked = [*found, *slight]
    ranked += [_other(tried, search) for tried in sorted(others.values(), key=lambda t: -t.score)][
        : max(RANKED - len(ranked), 0)
    ]
    start, degrees = search.pool.record.since_1970(), model.reading_.temperature_unit
    ranked = [replace(suspect, title=_title(suspect.effect, start, degrees)) for suspect in ranked]
    where, allan = where_it_fails(model, search.pool.record, residual, rms, floor)
    return Diagnosis(
        verdict=verdict_on(grounds).word,
        noise_floor=floor,
        explainable=float(np.clip(1 - (floor / quiet) ** 2, 0.0, 1.0)) if quiet > 0 else 0.0,
        where=where,
        allan=allan,
        suspects=tuple(ranked),
        n_causes=len(found),
        n_small=len(slight),
        left=rest,
        residual_rms=rms,
        unit=model.reading_.unit,
        moment=search.pool.own_moment,
        later_rms=search.pool.out_of_sample.later_rms(),
        held_out_rms=search.pool.out_of_sample.held_out_rms,
        ahead=search.pool.out_of_sample,
        record=(model, seen, y),
    )


def _not_silently(term: Term) -> Term:
    """A slow lag as a rival, where it is proven too.

    The model has taken for a slow body what may as well be a drift: that it has it already is not to be passed over.
    """
    proven = [t for t in term.alike if t.proven and not t.explanation.in_model and t.key[0] not in DATED]
    if not term.tried.explanation.in_model or term.tried.explanation.is_start or not proven:
        return term
    best = max(proven, key=lambda t: t.score)
    return replace(term, tried=best, alike=(term.tried, *(t for t in term.alike if t is not best)))


def _as_likely_as_the_start(terms: Sequence[Term]) -> tuple[str, ...]:
    """Labels of rivals of the record's start."""
    starts = [term for term in terms if term.tried.explanation.is_start]
    rivals = [t for start in starts for t in start.alike if t.proven and t.score >= start.tried.score]
    effects = [t.explanation.effect for t in rivals if not t.explanation.in_model]
    return tuple(effect_text(effect) for effect in effects if isinstance(effect, Drift | LogAgeing))


def _dates(record: Record, ends: Sequence[Interval]) -> tuple[tuple[Any, Any], ...]:
    """Intervals as dates, in UTC, where there are dates."""
    kind = record.times.kind
    since = record.since_1970()
    if since is None:
        return tuple(ends)
    zero = pd.Timestamp(round(since * 1e9), tz="UTC" if kind == "datetime with time zone" else None)
    low, high = ([(zero + pd.Timedelta(end[i], unit="s")).round("ms") for end in ends] for i in (0, 1))
    return tuple(zip(low, high, strict=True))


def _title(effect: Effect, start: float | None, degrees: str) -> str:
    """Title of an effect, with dates and units."""
    parameters = {} if effect.info is None else effect.info.parameters
    said = [name for name, what in parameters.items() if what in (SINCE_START, TEMPERATURE_DIFFERENCE)]
    if not said or any(isinstance(getattr(effect, name), list | tuple) for name in said):
        return effect.title()
    return f"{effect_text(effect)}: {parameters_text(effect, start, degrees)}"


def _cause(cause: Cause, standing: str, when: tuple[tuple[Any, Any], ...], pool: Pool, noise: float) -> FoundSuspect:
    """A cause as the reader sees it."""
    term, falls = cause.term, cause.worth.clearest
    rivals = list(term.alike)
    if any(t.explanation.effect is cause.effect for t in rivals):  # else the cause is what was found, in some form
        rivals.insert(0, term.tried)
    found = [t for t in rivals if not t.explanation.in_model]
    alike = [clone(t.explanation.effect) for t in found if t.explanation.effect is not cause.effect]
    if pool.runs_one_way and isinstance(cause.effect, Drift | InitialTransient | LogAgeing | SensitivityDrift):
        alike.append(StaticPolynomial(1))
    return FoundSuspect(
        effect=clone(cause.effect),
        standing=standing if term.tried.proven else "helps",
        gain_db=falls.blocks,
        later_db=falls.later,
        p_value=term.tried.p_value,
        confusable_with=tuple(alike),
        before=cause.before,
        after=cause.after,
        each=falls.each,
        moment=cause.moment,
        size=cause.size,
        matters_from=max(1, int(np.ceil(min(noise / max(cause.size, 1e-9 * noise, 1e-300), 1e6) ** 2))),
        lag_below=term.lag_below,
        in_model=any(t.explanation.in_model for t in term.alike),
        when=when,
    )


def _other(tried: Tried, search: Search) -> FoundSuspect:
    held, columns = search.pool.out_of_sample, search.coarse(tried)
    falls = held.worth([columns])[0].clearest
    return FoundSuspect(
        effect=clone(tried.explanation.effect),
        standing="",
        gain_db=falls.blocks,
        later_db=falls.later,
        p_value=tried.p_value,
        before=held.later_rms(),
        after=held.with_columns(columns).later_rms(),
        each=falls.each,
    )

"""Results of a diagnosis: causes, moments, and the rest."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from scipy import stats
from sklearn.base import clone

from ..effects import Disturbance, InitialTransient, Periodic, SeveralSteps, Step
from ..effects.protocol import Effect
from ..equations.noise import Kernel, inverse_kernel
from ..model.averages import rms
from ..model.heteroscedasticity import BURST
from ..model.out_of_sample import OutOfSample
from ..model.tables import VERDICTS
from ..output.report import DiagnosisPage
from ..output.words import (
    decide_sentence,
    each_row,
    effect_text,
    left_sentences,
    page_width,
    small_sentence,
    suspect_sentence,
    worst_sentence,
)
from ..records import Record, seconds_of
from ..records.errors import printable
from ..records.numbers import quantity_texts, scale_of
from ..records.screen import REPEAT
from .data import quiet_rows
from .levels import (
    DRIFT_TO_NOISE,
    DRIFT_TO_STEP,
    FILTER_LENGTH,
    FILTER_WHITE,
    LEVEL,
    MOMENTS,
    OF_THERMOMETER,
    PROVABLE,
    RANKED,
    SEVERAL,
    TAILS,
)
from .propose import Proposal, propose
from .scan import DATED, products_from
from .score import Comparison, solved
from .search import Search, Term, together
from .terms import Pool


class Loud(NamedTuple):
    """A stretch in which the noise is much larger than usual."""

    start: float
    """Since the record began [s]."""
    end: float
    size: float
    """Largest size over the usual one."""
    readings: int


@dataclass(frozen=True, kw_only=True)
class Left:
    """Residual that no cause explains."""

    structured: bool
    """True if it wanders clearly, beyond white noise."""
    floor: float
    """Standard deviation of one sample that nothing foresees, in the unit of y."""
    wandering: float
    """Standard deviation of the part that wanders, in the unit of y."""
    matters_from: int
    """Readings in the shortest mean in which that is larger than white noise; 0 where nothing wanders."""
    correlation_time: float
    """For how long that part remembers [s]; 0 where nothing wanders."""
    colour: float
    """Variance over innovation variance: 1 for white noise."""
    copied: tuple[str, ...]
    """Labels of effects of recorded columns that what is left follows hardly better than it follows copies of these
    columns moved in time: a few slow swings."""
    spikes: tuple[float, ...]
    """Times since the record began at which readings jump far out of the noise [s], at most ten: left out."""
    loud: tuple[Loud, ...]
    """Stretches of loud noise, the largest first, at most ten: their readings count less."""
    thermometers: pd.DataFrame = field(compare=False)
    """What the errors of the thermometers make in the reading, see `thermocorr.validation.thermometer_errors`; empty
    where nothing wanders, and where the record was judged by averages."""
    smallest_drift: float
    """Drift over the record that it could have shown, in the unit of y; infinite where it could have shown none."""
    smallest_step: float
    """Step in the middle of the record that it could have shown, in the unit of y."""
    spectrum: pd.DataFrame = field(compare=False)
    """Amplitude spectral densities by frequency [Hz], in the unit of y over sqrt(Hz): ``residual`` given all causes,
    ``noise`` as the judgement takes it, and its ``white`` part."""

    rounding: float = 0.0
    """Step of the reading, in its unit, where what is left is no more than its rounding; else 0."""
    tails: float = 1.0
    """Rms of the model's residual, stretches of loud noise aside, over what nine tenths of it say of Gaussian noise."""
    filtered: float = 0.0
    """How long the noise of an instrument remembers that filters or averages, a few samples [s]; else 0."""
    drift_hides: bool = False
    """True if a drift of several noises would pass for what model and causes have; False given a model that has
    effects of time alone, and where the reading is exact."""

    start_or: tuple[str, ...] = ()
    """Labels of effects that go on with time, as likely as the start of the record that the model takes for them."""

    @property
    def absurd(self) -> bool:
        """True if a few readings make most of the residual."""
        return self.tails > TAILS and not self.rounding

    @property
    def of_thermometers(self) -> bool:
        """True if thermometer errors explain the wandering."""
        return self.structured and self.wandering <= OF_THERMOMETER * together(self.thermometers)

    @property
    def unknown(self) -> bool:
        """True if there is structure whose cause is not known."""
        return (self.structured and not self.of_thermometers) or self.absurd


def what_is_left(search: Search, residual: np.ndarray, copied: Sequence[str] = ()) -> Left:
    """Describe the residual given the last base."""
    pool, judged = search.pool, search.judged
    loud = _loud(pool)
    theta, counts = judged.base.theta, float(np.median(pool.data.counts))
    innovation = judged.innovation
    total = float(np.average(judged.S(theta), weights=judged.bands.sizes))  # slow parts have not had their time
    wandering = float(np.sqrt(max(total - theta[0], 0.0))) * judged.unit
    floor = float(np.sqrt(innovation * counts)) * judged.unit
    times = pool.spacing * judged.bands.times
    # Structure below the noise of the longest mean, of which the record holds three, is no error that a user can see.
    longest = float(np.bincount(judged.bands.segment).max()) / 3
    matters_from = _matters_from(theta, judged.bands.times, counts, longest)
    wanders = bool(judged.wanders and not (pool.rows.exact or search.rounded) and matters_from)
    memory = float(np.average(times, weights=theta[1:])) if wanders else 0.0
    longest = FILTER_LENGTH[int(theta[0] > FILTER_WHITE * theta.sum())] * pool.record.usual_step()
    filtered = memory if memory <= longest and _is_gaussian(judged) else 0.0
    structured = wanders and not filtered
    if filtered:  # all of it is the instrument's
        floor = float(np.sqrt(total * counts)) * judged.unit
    seconds = pool.data.seconds
    middle = pool.rows.weighed(np.arange(judged.n) >= judged.n // 2)
    drift = pool.rows.weighed(seconds / max(float(np.ptp(seconds)), 1e-300))
    smallest_drift, smallest_step = judged.smallest(drift, PROVABLE), judged.smallest(middle, PROVABLE)
    own = pool.model.features_.effect_list()
    timed = any(effect.of_time_alone and not isinstance(effect, InitialTransient) for effect in own)
    return Left(
        structured=structured,
        filtered=filtered,
        floor=floor,
        wandering=wandering if structured else 0.0,
        matters_from=matters_from if structured else 0,
        correlation_time=float(np.exp(np.average(np.log(times), weights=theta[1:]))) if structured else 0.0,
        colour=total / innovation,
        copied=tuple(copied),
        spikes=_spikes(pool),
        loud=loud,
        rounding=pool.rounding if search.rounded else 0.0,
        tails=_tails(quiet_rows(residual, pool.record, [(each.start, each.end) for each in loud])),
        thermometers=pool.thermometers if structured else pd.DataFrame(),
        smallest_drift=smallest_drift,
        smallest_step=smallest_step,
        drift_hides=not (timed or pool.rows.exact)
        and smallest_drift > max(DRIFT_TO_STEP * smallest_step, DRIFT_TO_NOISE * floor),
        spectrum=_spectrum(pool, judged),
    )


def _matters_from(theta: np.ndarray, times: np.ndarray, counts: float, longest: float) -> int:
    """Readings in the shortest mean whose wandering exceeds white noise.

    `theta` (array): Variances of the parts of a row's noise, white first. `times` (array): Correlation times of the
    others [rows]. `counts` (float): Readings in a row. `longest` (float): Mean that is looked at [rows].
    """
    rows = np.geomspace(1 / counts, max(longest, 1.0), 200)
    x = np.maximum(rows[:, None] / times, 1e-3)
    wandering = 2 * (x + np.expm1(-x)) / x**2 @ theta[1:]  # variance of a mean of first-order Markov noise
    larger = np.flatnonzero(wandering >= theta[0] / rows)
    return int(np.ceil(rows[larger[0]] * counts - 1e-9)) if len(larger) else 0


def _is_gaussian(judged: Comparison) -> bool:
    """True for Gaussian fourth moments.

    What is switched has two levels or rare large steps: popcorn noise is no filter's.
    """
    left = judged.bands.back(judged.left(judged.base.theta)[:, None])[:, 0]
    moments = [float(stats.kurtosis(rows, fisher=False)) for rows in (left, np.diff(left))]
    return all(2.4 < moment < 4.5 for moment in moments)  # 3 for Gaussian noise, as a filter's is


def _spectrum(pool: Pool, judged: Comparison) -> pd.DataFrame:
    """Power smoothed over eight bands to a factor of ten in frequency."""
    bands, theta = judged.bands, judged.base.theta
    kept = bands.middle > 0
    frequency = bands.middle[kept] / (2 * np.pi * pool.spacing)
    rows = pd.DataFrame(
        {
            "rows": judged.share,
            "frequency": judged.share * np.maximum(bands.middle, 0.0) / (2 * np.pi * pool.spacing),
            "residual": bands.sums(judged.left(theta) ** 2),
            "noise": judged.share * judged.S(theta),
            "white": judged.share * theta[0],
        }
    )[kept]
    # Eight points to a factor of ten in frequency.
    sums = rows.groupby(np.floor(8 * np.log10(frequency / frequency.min())), sort=True).sum()
    means = sums.drop(columns="rows").div(sums["rows"], axis=0).reset_index(drop=True)
    densities = means[["residual", "noise", "white"]] * (2 * pool.spacing)  # one-sided
    means[["residual", "noise", "white"]] = judged.unit * np.sqrt(densities)
    return means


def _loud(pool: Pool) -> tuple[Loud, ...]:
    """Stretches of rows that are weighted as a burst of noise."""
    data, size = pool.data, 1 / pool.rows.weight
    edges = np.flatnonzero(np.diff(size > BURST, prepend=False, append=False)).reshape(-1, 2)
    found = [
        Loud(
            start=float(data.seconds[low]),
            end=float(data.seconds[high - 1]),
            size=float(size[low:high].max()),
            readings=int(data.counts[low:high].sum()),
        )
        for low, high in edges.tolist()
    ]
    return tuple(sorted(found, key=lambda loud: -loud.size)[:RANKED])


def _tails(residual: np.ndarray) -> float:
    """Rms over the Gaussian rms of the inner nine tenths."""
    sizes = residual[np.isfinite(residual)]
    np.abs(sizes, out=sizes)
    whole = rms(sizes)
    usual = float(np.quantile(sizes, 0.9, overwrite_input=True)) / 1.645 if len(sizes) else 0.0
    return whole / usual if usual > 0 else 1.0


def _spikes(pool: Pool) -> tuple[float, ...]:
    """Times of left-out readings, the farthest first."""
    rows, record = np.flatnonzero(pool.rows.spikes), pool.record
    refused = [found for found in record.refused if found.what == "reading" and found.reason != REPEAT]
    seconds = [*(found.seconds for found in refused), pool.data.seconds[rows]]
    values = np.concatenate([*(found.values for found in refused), pool.data.reading[rows]])
    far = np.argsort(-np.abs(values - np.median(pool.data.reading)))
    return tuple(dict.fromkeys(np.concatenate(seconds)[far].tolist()))[:RANKED]


def as_one(found: Sequence[FoundSuspect], record: Record) -> list[FoundSuspect]:
    """Causes, related ones joined."""
    return _waves(_steps(list(found)), record)


def _steps(found: list[FoundSuspect]) -> list[FoundSuspect]:
    """Many steps and disturbances as one cause, several steps."""
    steps = [cause for cause in found if cause.effect.kind in (Step.kind, Disturbance.kind)]
    if len(steps) < SEVERAL:
        return found
    ends = [cause.effect.get_params().get(name) for cause in steps for name in ("time", "start", "end")]
    effect = SeveralSteps(sorted({time for time in ends if time is not None}))
    return _joined(found, steps, replace(steps[0], effect=effect, confusable_with=(), in_model=False))


def _waves(found: list[FoundSuspect], record: Record) -> list[FoundSuspect]:
    """A wave joined with its harmonics."""
    apart = 1 / (2 * record.longest_read())  # frequencies that the record tells from one another
    waves = [cause for cause in found if isinstance(cause.effect, Periodic)]
    waves.sort(key=lambda cause: -_period(cause))
    while waves:
        slowest, *waves = waves
        overtones = {id(wave): _harmonic(slowest, wave, apart) for wave in waves}
        if any(overtones.values()):
            own = [cause for cause in found if cause is slowest or overtones.get(id(cause), 0)]
            highest = max(overtones.get(id(cause), 1) * cause.effect.harmonics for cause in own)
            wave = replace(slowest, effect=clone(slowest.effect).set_params(harmonics=highest))
            found = _joined(found, own, wave)
            waves = [wave for wave in waves if not overtones[id(wave)]]
    return found


def _harmonic(slowest: FoundSuspect, wave: FoundSuspect, apart: float) -> int:
    """Multiple of a wave's frequency; 0 for none."""
    multiple = round(_period(slowest) / _period(wave))
    off = abs(1 / _period(wave) - multiple / _period(slowest))
    # Harmonics of a switch fall as one over the multiple: none is looked for above the sixth.
    return multiple if 1 < multiple <= 6 and off < apart else 0


def _period(wave: FoundSuspect) -> float:
    return seconds_of(wave.effect.period, "period")


def _joined(found: Sequence[FoundSuspect], own: Sequence[FoundSuspect], one: FoundSuspect) -> list[FoundSuspect]:
    """Causes, some of them joined into one."""
    falls = [cause.before**2 - cause.after**2 for cause in own]  # each given the others
    size = float(np.sqrt(sum(cause.size**2 for cause in own)))
    together = replace(
        one,
        before=float(np.sqrt(max(one.after**2 + sum(falls), 0.0))),
        gain_db=sum(cause.gain_db for cause in own),
        later_db=sum(cause.later_db for cause in own),
        size=size,
        matters_from=min(cause.matters_from for cause in own),
        p_value=max(cause.p_value for cause in own),
        when=tuple(sorted(interval for cause in own for interval in cause.when)),
    )
    ours = {id(cause) for cause in own}
    return [together if cause is own[0] else cause for cause in found if cause is own[0] or id(cause) not in ours]


Interval = tuple[float, float]


def intervals(pool: Pool, judged: Comparison, causes: Sequence[Term]) -> list[tuple[Interval, ...]]:
    """Intervals (95 %) of each cause's moments [s].

    A moment may lie wherever the likelihood falls by no more than `MOMENTS`, the coefficients held. That is the
    quantile of its fall at the true moment, (1 - exp(-fall))^2 <= 95 %, for jumps that are small against the noise of a
    sample (Siegmund, Int. Stat. Rev. 56, 1988); a large jump is known better, to the sample.
    """
    with_moments = [k for k, cause in enumerate(causes) if cause.tried.key[0] in DATED]
    found: list[tuple[Interval, ...]] = [() for _ in causes]
    seconds = pool.data.seconds
    if not with_moments or np.any(np.diff(seconds) <= 0):  # runs that overlap: a time has several places
        return found
    heights, left = _heights(judged, [causes[k] for k in with_moments])
    kernel = inverse_kernel(judged.base.theta, judged.bands.times)
    for k, height in zip(with_moments, heights, strict=True):
        effect = causes[k].tried.explanation.effect
        shift = pool.rows.weight * (height[0] + (height[1] * pool.temperature if len(height) > 1 else 0.0))
        ends = effect.seconds_ if isinstance(effect.seconds_, list) else [effect.seconds_]
        found[k] = tuple(
            _interval(shift * sign, left, int(np.searchsorted(seconds, end)), kernel, seconds)
            for end, sign in zip(ends, (1.0, -1.0), strict=False)
        )
    return found


def _heights(judged: Comparison, causes: Sequence[Term]) -> tuple[list[np.ndarray], np.ndarray]:
    """Coefficients of dated columns, and the whitened residual.

    The adopted columns are mixtures with the base; here the plain ones stand in their places.
    """
    plain = [judged.bands.forward(cause.tried.explanation.columns) for cause in causes]
    places = [judged.causes[judged.adopted.index(cause.tried.number)] for cause in causes]
    mixed = [np.arange(judged.Q.shape[1])[place] for place in places]
    columns = np.column_stack([np.delete(judged.Q, np.concatenate(mixed), axis=1), *plain])
    W = 1 / judged.bands.each_row(judged.S(judged.base.theta))
    coef = solved(columns.T @ (columns * W[:, None]), columns.T @ (W * judged.z))
    left = judged.bands.back(((judged.z - columns @ coef) * W)[:, None])[:, 0]
    edges = np.cumsum([0, *(part.shape[1] for part in plain)]) + columns.shape[1] - sum(p.shape[1] for p in plain)
    return [coef[a:b] for a, b in pairwise(edges)], left


def _interval(shift: np.ndarray, left: np.ndarray, row: int, kernel: Kernel, seconds: np.ndarray) -> Interval:
    """Interval in which a shift may begin [s]."""
    reach, n = len(shift) // 4, len(shift)
    before, after = slice(max(row - reach, 1), row), slice(row, min(row + reach, n - 1))
    earlier = _falls(shift[before][::-1], -left[before][::-1], kernel) <= MOMENTS
    later = _falls(shift[after], left[after], kernel) <= MOMENTS
    low = row - 1 - int(np.flatnonzero(earlier).max(initial=-1))
    high = row + 1 + int(np.flatnonzero(later).max(initial=-1))
    return float(seconds[max(low - 1, 0)]), float(seconds[min(high, n - 1)])


def _falls(shift: np.ndarray, left: np.ndarray, kernel: Kernel) -> np.ndarray:
    """Fall of the likelihood as rows lose their shift."""
    own = products_from(shift[::-1, None], kernel, mirrored=False)[::-1, 0, 0]
    return np.asarray(np.cumsum(shift * left) + 0.5 * own)


RANKING = ["label", "kind", "column", "parameters", "standing", "gain_db", "later_db", "p_value", "share",
           "confusable_with", "sentence"]  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class FoundSuspect:
    """An effect under suspicion, and what is held against it."""

    effect: Effect
    """The effect, ready for ``model.with_effect``."""
    standing: str
    """ "confirmed": proven by the likelihood of the record, and it lowers the error of averages that were not learned
    from; "helps": it lowers that error much, and the likelihood does not prove it; "proven": by the likelihood alone;
    "": tried, and not named."""
    gain_db: float
    """Mean fall of the squared error of averages on blocks of time that are held out [dB]."""
    later_db: float
    """The same on later stretches, each predicted from all before it [dB]; NaN for a jump at the end."""
    p_value: float
    """P-value, corrected for the number of candidates tried."""
    confusable_with: tuple[Effect, ...] = ()
    """Effects that this record cannot tell it apart from."""
    before: float = np.nan
    """Rms error of readings on later stretches, of the model with the other causes and without this one [unit of y]."""
    after: float = np.nan
    """The same with this one."""
    each: tuple[float, ...] = ()
    """Fall of the squared error on each later stretch [dB]."""
    size: float = np.nan
    """Rms of what it explains of the reading that the model and the other causes do not, in the unit of y; NaN for one
    that is not named."""
    matters_from: int = 0
    """Readings in a mean whose noise is as small as `size`."""
    lag_below: float = 0.0
    """Largest lag that the record leaves possible for an effect at once [s]; 0 where it says nothing."""
    moment: float | None = None
    """Share of the record before the last moment at which it begins or ends; None for kinds without one."""
    in_model: bool = False
    """True if this record cannot tell it apart from slow lags that the model has: a slow body."""
    when: tuple[tuple[Any, Any], ...] = ()
    """Interval (95 %) of each moment at which a step, another law or a disturbance begins or ends, in order of time:
    dates where the record has dates, else seconds since it began. Empty for other kinds."""
    title: str = ""
    """Name in sentences, where it is more than `Effect.title` can know: dates, units of temperatures."""

    @property
    def label(self) -> str:
        """Kind and column."""
        return effect_text(self.effect)

    @property
    def share(self) -> float:
        """Share of the squared error of later averages removed."""
        fall = self.gain_db if np.isnan(self.later_db) else self.later_db
        return float(max(1 - 10 ** (-fall / 10), 0.0))


@dataclass(frozen=True, repr=False, kw_only=True)
class Diagnosis(DiagnosisPage):
    """Result of `diagnose`. Prints as a page."""

    verdict: str
    """ "nothing missing", "missing", "ambiguous" or "unexplained"."""
    noise_floor: float
    """Standard deviation of one sample that no effect can explain, in the unit of y."""
    explainable: float
    """Share of the residual variance that something could still explain."""
    where: pd.DataFrame
    """Conditions under which the model fails, worst first, see `thermocorr.judgement.where`."""
    allan: pd.DataFrame
    """Allan deviation of the residual against white noise, see `thermocorr.judgement.where`."""
    suspects: tuple[FoundSuspect, ...]
    """The causes, by what they are worth on later data and by how sure they are; then other suspects, best first."""
    n_causes: int
    n_small: int
    """How many effects behind the causes are significant, and too small to matter."""
    left: Left
    """What no cause explains: whether it wanders, for how long it remembers, spikes, and what could have been seen."""
    residual_rms: float
    """Rms residual of the model on these data, in the unit of y."""
    moment: float | None
    """Share of the record before the last moment at which an effect of the model begins or ends; None for none."""
    later_rms: float
    """Rms error of the model on a later stretch, predicted from all before it [unit of y]: mean over stretches."""
    held_out_rms: float
    """Rms error of the model on a block of time that is held out, in the unit of y: mean over blocks."""
    unit: str
    level: float = LEVEL
    """P-value of the whole family of suspects, below which one is named."""
    ahead: OutOfSample | None = field(default=None, compare=False)
    """The model's errors on data that it was not learned from, for `refine`; None in a pickled copy."""
    record: tuple[Any, Any, Any] | None = field(default=None, compare=False)
    """The model, X and y, for pictures; None in a pickled copy."""

    @property
    def causes(self) -> tuple[FoundSuspect, ...]:
        """Missing effects: each proven, or helpful on data not learned from."""
        return self.suspects[: self.n_causes]

    @property
    def small(self) -> tuple[FoundSuspect, ...]:
        """Proven effects too small to be added."""
        return self.suspects[self.n_causes : self.n_causes + self.n_small]

    @cached_property
    def proposal(self) -> Proposal | None:
        """The measurement that decides between rivals, within the range that the record showed, see `propose`.

        None for a diagnosis that is not ambiguous, for a pickled copy, and for a record too short to go on from.
        """
        if self.record is None or not self.causes or not self.causes[0].confusable_with:
            return None
        model, X, y = self.record
        try:
            return propose(model, self, X, y)
        except (ValueError, np.linalg.LinAlgError):
            return None

    @property
    def best(self) -> Effect | None:
        """The first cause for ``model.with_effect``, or None."""
        return self.suspects[0].effect if self.n_causes else None

    @property
    def ranking(self) -> pd.DataFrame:
        """`suspects` as a table: label, kind, column, parameters, standing, gain_db (blocks held out), later_db,
        p_value (of the whole family), share (of the later error), confusable_with (labels), sentence.
        """
        rows = [
            {
                "label": effect_text(suspect.effect),
                "kind": suspect.effect.kind,
                "column": next(iter(suspect.effect.inputs()), None),
                "parameters": suspect.effect.get_params(deep=False),
                "standing": suspect.standing,
                "gain_db": suspect.gain_db,
                "later_db": suspect.later_db,
                "p_value": suspect.p_value,
                "share": suspect.share,
                "confusable_with": tuple(effect_text(effect) for effect in suspect.confusable_with),
                "sentence": suspect_sentence(suspect),
            }
            for suspect in self.suspects
        ]
        return pd.DataFrame(rows, columns=RANKING).astype({"column": object})

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in self.__dict__.items() if name != "proposal"} | {
            "record": None,
            "ahead": None,
        }

    def __str__(self) -> str:
        residual, floor = quantity_texts((self.residual_rms, self.noise_floor), self.unit, 4)
        lines = [
            f"Verdict: {self.verdict}",
            f"Residual {residual}, noise floor {floor}: "
            f"{self.explainable:.0%} of the residual variance could still be explained.",
        ]
        if len(self.where) and not VERDICTS[self.verdict].calm:
            lines.append(worst_sentence(next(each_row(self.where))))
        if VERDICTS[self.verdict].unknown:
            lines.append(VERDICTS[self.verdict].sentence)
        said = self.causes or self.suspects[:3]
        word = "Cause" if self.causes else "Suspect"
        lines += [f"{word} {k}, {suspect_sentence(suspect)}" for k, suspect in enumerate(said, 1)]
        lines += [sentence for sentence in [decide_sentence(self), small_sentence(self)] if sentence]
        lines += left_sentences(self.left, scale_of((self.residual_rms, self.noise_floor), self.unit), self.verdict)
        if self.best is not None and self.best.info is not None:
            lines.append(f"How to confirm the first: {self.best.info.bench_check}")
            lines.append("To add it: better = model.with_effect(diagnosis.best).fit(X, y), or refine(model, X, y).")
        return "\n".join(textwrap.fill(printable(line), page_width(), subsequent_indent="    ") for line in lines)

    __repr__ = __str__

    def plot(self, X: Any = None) -> Any:
        """Draw the suspects, and where the model fails (extra "plot").

        `X`, the record, tells the units of its columns.
        """
        from ..output.diagnosis_displays import plot_diagnosis

        return plot_diagnosis(self, X)

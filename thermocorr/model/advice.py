"""Advice on a correction, by errors on unseen data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd
from sklearn.base import clone

from ..effects import Events, InitialTransient, SeveralSteps, StaticPolynomial, ThermalLag
from ..effects.protocol import Effect
from ..equations import reduction_db
from ..records import Record, read_record
from ..records.errors import printable
from ..records.history import strided
from ..records.numbers import Scale, number_text, numeric_reading, scale_of, span_text, unit_text
from ..records.screen import screened
from .averages import COARSE, Averages, averaged, averaged_columns
from .out_of_sample import FEWEST_STRETCHES, FORECASTS, GAIN, LONGEST, PIECES, OutOfSample, geometric_mean, later_pieces
from .surrogates import moved

FEWEST = 100
"""Readings below which nothing is advised."""
PROBED, LAGS, TOGETHER = 100_000, 14, 3
"""Rows, lags and lags at once at most of the laws by which temperature and copies are compared."""
LEVEL, LATEST, DRIFT = NEEDLESS = ("level", "latest level", "level and drift")
"""What needs no temperature: the mean of all readings so far, that of the last ones, a straight line."""
SIMPLER = 1.0
"""The simpler of two corrections is advised unless the other lowers the error by more [dB]."""
REFINED = "refined"
"""Choice of, and variant with, effects that were found to be missing."""


@dataclass(frozen=True, kw_only=True, repr=False)
class Advice:
    """Advice on which correction to use. Prints as a table."""

    choice: str
    """ "none", "static", "dynamic" or "refined"; "" where the record is too short to say: fewer than 100 readings."""
    variant: str
    """Name of the variant to use; "" for none."""
    table: pd.DataFrame
    """Rms error in the unit of the reading: a row for each correction, the simplest first, a column for each later
    stretch, predicted from all before it, "all", their geometric mean, and longer forecasts: "from 70 %" is that of the
    last 30 % of the record from the first 70 %. Empty where nothing is advised. Where a refined model has effects with
    a date, the stretches lie behind the last one."""
    ahead: float = np.nan
    """Length of a stretch [s]."""
    last: float = np.nan
    """Length of the last 30 % of the record [s]."""
    copies_db: float
    """Error of laws of the temperature over that of the best copy moved in time [dB]; negative is good. NaN where no
    copy differs enough from it, 0 where it was not asked."""
    unit: str

    @property
    def before(self) -> float:
        """Error of the best correction that needs no temperature."""
        return min(map(self._of, NEEDLESS))

    def _of(self, name: str) -> float:
        return float(self.table["all"].to_numpy(float)[list(self.table.index).index(name)])

    @property
    def after(self) -> float:
        """Error of what is advised."""
        return self._of(self.variant) if self.variant else self.before

    @property
    def range(self) -> tuple[float, float]:
        """Range in which a later error is expected.

        As far from the mean of later stretches as the least and the greatest error of these and of the longer
        forecasts, and as far again (`benchmarks/value.py --parts measured` counts how often it holds). NaN for fewer
        than three stretches: nobody knows.
        """
        own = self.table.iloc[list(self.table.index).index(self.variant or min(NEEDLESS, key=self._of))]
        mean, each = float(own["all"]), own.drop("all").dropna().to_numpy(float)
        if self.table.shape[1] - 1 - len(FORECASTS) < FEWEST_STRETCHES:
            return np.nan, np.nan
        return float(min(each.min(), mean) ** 2 / mean), float(max(each.max(), mean) ** 2 / mean)

    @property
    def longest(self) -> float:
        """Error on the last 30 %, predicted from the first 70 %."""
        name = self.variant or min(NEEDLESS, key=self._of)
        return float(self.table[LONGEST].to_numpy(float)[list(self.table.index).index(name)])

    def promise(self, scale: Scale) -> str:
        """The advised error, its range and its reach, in words."""
        after, low, high, longest = (scale.number(v, 2) for v in (self.after, *self.range, self.longest))
        unit = f" {unit_text(scale.unit)}" if scale.unit else ""
        if not np.isfinite(self.range[0]):
            return f"{after}{unit} rms on the last readings; the error further ahead is not known"
        spread = f" ({low} to {high})" if low != high else ""
        far = [f" {span_text(float(f'{each:.2g}'))}" if np.isfinite(each) else "" for each in (self.ahead, self.last)]
        said = f"{after}{unit} rms on the next{far[0] or ' tenth of the record'}{spread}"
        return f"{said}, {longest}{unit} on the next{far[1] or ' 30 %'}" if np.isfinite(self.longest) else said

    def scale(self) -> Scale:
        """The unit in which errors are printed."""
        return scale_of(self.table, printable(self.unit))

    @property
    def unproven(self) -> str:
        """A note where copies of the temperature prove nothing; else empty."""
        if not self.variant or not np.isnan(self.copies_db):
            return ""
        return (
            "A time-shifted temperature does just as well, so a coincidence cannot be excluded. A second run, up and "
            "down, would decide."
        )

    def using(self, name: str, models: Mapping[str, Any]) -> Advice:
        """The advice for a variant that the user chose."""
        return replace(self, choice=_kind(models[name]) if self.choice else "", variant=name)

    def sentence(self, scale: Scale | None = None) -> str:
        """Sentence on which correction to use, and its error."""
        if not self.choice:
            return "It is unknown whether a correction helps on unseen data: the record is too short."
        scale = scale or self.scale()
        whole = self.table["all"]
        best = str(whole.drop(list(NEEDLESS), errors="ignore").idxmin())
        if self.choice == "none":
            said = "Use no temperature correction. On later stretches the readings have an error of "
            said += f"{scale.text(self.before)} rms, and of {scale.text(whole[best])} after the best correction, {best}"
            if reduction_db(whole[best], self.before) > -GAIN:
                return f"{said}."
            longest = self.table[LONGEST]
            if reduction_db(longest[best], longest[list(NEEDLESS)].min()) > -GAIN:
                return f"{said}; on the last 30 % of the record it is no better."
            return f"{said}; a time-shifted temperature does just as well."
        said = f"Use the {self.variant} correction: it leaves {self.promise(scale)}; "
        return f"{said}no correction leaves {scale.text(self.before, 2)}."

    def __str__(self) -> str:
        if not self.choice:
            return self.sentence()
        scale = self.scale()
        shown = self.table.rename(index={self.variant: f"{self.variant} *"})
        text = (scale.factor * shown).to_string(float_format=number_text)
        head = "Rms error on later stretches, each predicted from everything before"
        return f"{head}{f' [{unit_text(scale.unit)}]' if scale.unit else ''}; * is advised:\n{text}"

    __repr__ = __str__


def advise(variants: Mapping[str, Any], X: Any, y: Any) -> Advice:
    """Choose between variants, and no temperature correction.

    Each is predicted on the same later stretches, from all before them, and on the last 30 % of the record. Chosen is
    the simplest within `SIMPLER` of the best, of those that are better by `GAIN` on both than what needs no
    temperature. It must also outdo laws of copies of the temperature that are moved in time, see
    `thermocorr.model.surrogates`.

    `variants` (mapping of str to fitted DynamicBiasRegressor): The simplest first. `X`, `y` (as for their `fit`).
    """
    last = list(variants.values())[-1]
    record = _record(last, X, numeric_reading(y, X))
    table, spans = _errors(variants, record)
    if table.empty:
        return Advice(choice="", variant="", table=table, copies_db=0.0, unit=last.reading_.unit)
    chosen, copies = "", 0.0
    better = [name for name in variants if _beats(table, name, NEEDLESS)]
    if better:
        copies = _against_copies(record, max(model.degree for model in variants.values()), _levels(last))
        if not copies < GAIN:
            best = table["all"][better].min()
            chosen = next(name for name in better if reduction_db(best, table["all"][name]) > -SIMPLER)
    return Advice(
        choice=_kind(variants[chosen]) if chosen else "none",
        variant=chosen,
        table=table,
        copies_db=-copies,
        unit=last.reading_.unit,
        **spans,
    )


def _beats(table: pd.DataFrame, name: str, others: Sequence[str]) -> bool:
    """True if a correction is better by `GAIN`, twice."""
    both = table[["all", LONGEST]].dropna(axis=1)
    return all(reduction_db(both[c][name], both[c][list(others)].min()) <= -GAIN for c in both)


def needless_rms(law: OutOfSample, moment: float | None = None) -> float:
    """Later rms error of the best law without temperature."""
    level = OutOfSample(law.reading, law.base[:, :1], law.unseen)
    drift = level.with_columns(law.base[:, :1] * np.linspace(-1.0, 1.0, len(law.reading))[:, None])
    latest = _Stretches(law.reading, law.unseen).of_latest(later_pieces(moment))
    return min(level.later_rms(moment), drift.later_rms(moment), float(np.sqrt(geometric_mean(latest))))


def advise_refined(
    advice: Advice, variants: Mapping[str, Any], refined: Any, moment: float | None, X: Any, y: Any
) -> Advice:
    """The advice with a refined model in the list.

    `moment` (float, optional): Share of the readings before the last of its effects that has a date.
    """
    if not advice.choice:
        return advice
    models = {**variants, REFINED: refined}
    table, spans = _errors(models, _record(refined, X, numeric_reading(y, X)), moment)
    advice = replace(advice, table=table, **spans)
    if not _beats(table, REFINED, [advice.variant] if advice.variant else NEEDLESS):
        return advice
    return replace(advice, choice=REFINED, variant=REFINED)


def _errors(
    variants: Mapping[str, Any], record: Record, moment: float | None = None
) -> tuple[pd.DataFrame, dict[str, Any]]:
    """`Advice.table`, and the lengths of its stretches.

    The last variant has the effects with dates and levels of all.
    """
    last = list(variants.values())[-1]
    effects = {name: _effects(model, record) for name, model in variants.items()}
    data = averaged(record, [effect for some in effects.values() for effect in some])
    if len(data.reading) < FEWEST:
        return pd.DataFrame(), {}
    groups = np.searchsorted(_levels(last), data.seconds, side="right")
    averages = iter(data.columns)
    own = {name: np.column_stack([next(averages) for _ in some]) for name, some in effects.items()}
    columns = {name: _level_free(each, groups) for name, each in own.items()}
    reading = _level_free(data.reading[:, None], groups)[:, 0]
    rows = np.asarray(record.reading, float)
    single = {name: float(model.residual_std_) ** 2 for name, model in variants.items()}
    single[LEVEL] = float(np.nanvar(rows)) - float(np.var(data.reading)) + float(np.var(reading))
    single[DRIFT] = single[LEVEL]
    drift = data.seconds[:, None] - data.seconds.mean()
    made = {LEVEL: reading[:, None][:, :0], DRIFT: drift, **columns}
    floor = _hidden(reading, columns[list(columns)[-1]], data)
    hidden = {name: max(single[name] - _left(reading, own), floor) for name, own in made.items()}
    hidden[DRIFT] = hidden[LEVEL]
    laws = {name: _Stretches(reading, hidden[name], moment).with_columns(own) for name, own in made.items()}
    known = _Stretches(reading, hidden[LEVEL], moment)
    table = {name: law.reading_errors(moment) for name, law in laws.items()}
    further = pd.DataFrame({name: law.forecast_errors(moment) for name, law in laws.items()}).T
    table[LATEST] = known.of_latest(later_pieces(moment))
    further.loc[LATEST] = known.of_latest(list(FORECASTS.values())) + 0 * further.loc[LEVEL]  # NaN where others are
    order = [*NEEDLESS, *columns]
    frame = pd.DataFrame({name: np.sqrt(table[name]) for name in order}).T
    frame = frame.set_axis(range(1, frame.shape[1] + 1), axis=1)
    frame["all"] = [np.sqrt(geometric_mean(table[name])) for name in order]
    frame = frame.join(further.pow(0.5))
    edges = np.linspace(0, len(data.seconds) - 1, PIECES + 1).astype(int)
    spans = [*(part for _, part in later_pieces(moment)[:1]), FORECASTS[LONGEST][1]]
    ahead, last = (float(np.ptp(data.seconds[edges[[part.start, part.stop]]])) for part in (spans[0], spans[-1]))
    timed = record.times.kind != "rows"
    return frame, {"ahead": ahead if timed else np.nan, "last": last if timed else np.nan}


def _kind(model: Any) -> str:
    """True if a fitted variant has lags."""
    return "dynamic" if any(map(len, model.thermometers_.values())) else "static"


def _record(model: Any, X: Any, reading: np.ndarray) -> Record:
    """The record with a model's columns, and its readings."""
    features = model.features_
    needed = [name for effect in features.effect_list() for name in effect.inputs()]
    read = read_record(X, features.layout(), y=reading, needed=needed, quiet=True)
    found: Record = model._without_spoilt(read)
    return screened(found, features.longest_step())[0] if model.screen else found


def _levels(model: Any) -> tuple[float, ...]:
    """Moments at which the reading's level changes [s]."""
    events = [effect for effect in model.features_.effect_list() if isinstance(effect, Events)]
    return tuple(sorted({*model._run_levels.times, *(float(time) for event in events for time in event.seconds_)}))


def _effects(model: Any, record: Record) -> list[Effect]:
    """Effects that carry over to other stretches."""
    own = [
        clone(effect)
        for effect in model.features_.effect_list()
        if not isinstance(effect, InitialTransient | Events)
        and not (isinstance(effect, SeveralSteps) and model._run_levels.times == tuple(effect.times))
    ]
    for effect in own:
        effect.learn(record)
    return own


def _level_free(columns: np.ndarray, groups: np.ndarray) -> np.ndarray:
    """Columns less their mean in each run with a level."""
    if not groups.any():
        return columns
    return np.asarray(columns - pd.DataFrame(columns).groupby(groups).transform("mean").to_numpy())


def _left(reading: np.ndarray, columns: np.ndarray) -> float:
    """Mean square that columns and a constant leave."""
    base = np.column_stack((np.ones(len(reading)), columns))
    size = np.linalg.norm(base, axis=0)
    base = base / np.where(size > 0, size, 1.0)
    left = reading - base @ np.linalg.lstsq(base, reading, rcond=1e-9)[0]
    return float(np.mean(left**2))


def _hidden(reading: np.ndarray, columns: np.ndarray, data: Averages) -> float:
    """Variance of single readings that their averages do not show."""
    count = float(np.median(data.counts))
    if count <= 1:
        return 0.0
    base = np.column_stack((np.ones(len(reading)), columns))
    size = np.linalg.norm(base, axis=0)
    left = reading - base @ (np.linalg.lstsq(base / np.where(size > 0, size, 1.0), reading, rcond=1e-9)[0] / size)
    return float(np.mean(np.diff(left) ** 2)) / 2 * (count - 1)


class _Stretches:
    """Errors of laws of a reading on unseen stretches."""

    def __init__(self, reading: np.ndarray, hidden: float = 0.0, moment: float | None = None):
        self.reading, self.hidden, self.moment = reading, hidden, moment

    def with_columns(self, columns: np.ndarray) -> OutOfSample:
        """A law of columns, shape (n, k), and a constant."""
        return OutOfSample(self.reading, np.column_stack((np.ones(len(columns)), columns)), self.hidden)

    def errors(self, columns: np.ndarray) -> np.ndarray:
        """Errors of a law, shape (stretches,)."""
        return self.with_columns(columns).reading_errors(self.moment)

    def of_latest(self, folds: Sequence[tuple[range, range]]) -> np.ndarray:
        """Errors of the mean of the last readings."""
        edges = np.linspace(0, len(self.reading), PIECES + 1).astype(int)
        found = []
        begin = 0 if self.moment is None else int(np.ceil(self.moment * PIECES))
        for learn, test in folds:
            before = self.reading[edges[max(learn.stop - 4, begin)] : edges[learn.stop]]
            level = before.mean() if len(before) else np.nan
            found.append(np.mean((self.reading[edges[test.start] : edges[test.stop]] - level) ** 2))
        return np.maximum(found, 1e-300) + self.hidden

    def least(self, static: np.ndarray, lags: np.ndarray) -> float:
        """Least error of static laws, and with lags."""
        law = self.with_columns(static)
        least = min(geometric_mean(self.errors(static[:, :1])), geometric_mean(law.reading_errors()))
        for _ in range(TOGETHER):
            law = law.with_columns(lags[:, [law.most_helpful(lags)]])
            least = min(least, geometric_mean(law.reading_errors()))
        return least


def _against_copies(record: Record, degree: int, levels: tuple[float, ...]) -> float:
    """Gain over laws of shifted temperatures [dB].

    NaN where the laws of all copies can make the temperature itself.
    """
    stride = max(1, -(-record.n_used // PROBED))
    short = record if stride == 1 else strided(record, stride)
    data = averaged(short, [])
    lags = np.geomspace(short.usual_step() / 2, short.longest_read() / 2, LAGS).tolist()
    groups = np.searchsorted(levels, data.seconds, side="right")
    known = _Stretches(_level_free(data.reading[:, None], groups)[:, 0])

    def laws(of: Record) -> list[np.ndarray]:
        effects: list[Effect] = [StaticPolynomial(degree), ThermalLag(lags)]
        for effect in effects:
            effect.learn(of)
        return [_level_free(part, groups) for part in averaged_columns(of, effects, COARSE)]

    own = laws(short)
    least, falls, alike = known.least(*own), list[float](), list[float]()
    for copy in map(laws, moved(short, [short.temperature_name])):
        fall = float(10 * np.log10(known.least(*copy) / least))
        # A copy whose laws reproduce three quarters of the temperature's variance proves nothing unless it does worse.
        # Without this, none of 20 exact daily cycles but one is corrected.
        (falls if _explained(np.column_stack(copy), own[0][:, 0]) <= 0.75 else alike).append(fall)
    if falls:
        return min(falls)
    return min(alike) if min(alike, default=0.0) >= GAIN else np.nan


def _explained(columns: np.ndarray, target: np.ndarray) -> float:
    """Share of a column's variance that least squares on others explains."""
    target, columns = target - target.mean(), columns - columns.mean(axis=0)
    size = columns.std(axis=0)
    columns = columns[:, size > 0] / size[size > 0]
    left = target - columns @ np.linalg.lstsq(columns, target, rcond=1e-6)[0]
    return float(1 - left @ left / max(float(target @ target), 1e-300))

"""Which measurement decides between causes that a record cannot distinguish.

Each profile of the coming hours continues the record. For each rival as the truth, with the coefficients that the
record gives it, the expected log likelihood ratio against every other rival and against nothing missing is computed,
each refitted on old and new rows together, noise included. The smallest ratio decides (KL-optimality: Lopez-Fidalgo,
Tommasi & Trandafir, J. R. Statist. Soc. B 69, 2007). What is not driven is expected to go on as the record did. Where
no profile of these hours decides, days may.
"""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from sklearn.base import clone

from ..effects import InitialTransient, StaticPolynomial, ThermalLag
from ..effects.expressions import traced
from ..effects.protocol import Effect
from ..effects.stream import own_starts, walk
from ..equations.noise import Bands, fitted_parts, whittle
from ..model.progress import one_blas_thread
from ..model.regressor import DynamicBiasRegressor
from ..output.words import effect_text
from ..records import Layout, Record, read_record
from ..records.errors import listing, option, printable
from ..records.numbers import number_text
from .data import record_of, suspect_record
from .levels import PROVABLE, TIE
from .search import LATE_FORM

UNDISTURBED = "log on, undisturbed"
NOTHING = "nothing missing"
SURE = 16.0
KEPT = ((SURE, 0.93, 0.8), (8.0, 0.8, 0.7), (4.0, 0.5, 0.45))
"""Least expected ratio, and the share of cases in which the right cause is then named, driven and undisturbed.

What the air will do is a guess (`benchmarks/propose.py`).
"""
WAITED = 0.9
"""Share of cases in which the days that are stated have decided (the same)."""
ROWS = 4000
"""Rows of the record at most: a longer one is averaged."""
HOURLY = 6.0
"""Fastest change of the temperature, if the user says nothing [K/h]."""
STAIRS = np.array([0.5, 0.75, 1.0, 0.75, 0.5, 0.25, 0.0, 0.25])
"""Levels between the limits, as shares."""
DAYS = (3, 5, 8, 13, 21, 34)
"""Lengths of further logging that are tried for laws of time [days]."""


@dataclass(frozen=True)
class Proposal:
    """Profiles of a new measurement, the best first. Prints as a page."""

    table: pd.DataFrame
    """A row for each profile: "ratio", the smallest expected log likelihood ratio between two rivals; "odds", the share
    of cases in which the right cause is then named, NaN where none is promised, as for laws of time; "hardest", the
    pair; "driven", the column."""
    frames: Mapping[str, pd.DataFrame]
    """By profile: the columns to come, by time."""
    rivals: tuple[str, ...]
    hours: float
    days: int | None = None
    """Days of undisturbed logging that decide where no profile surely does; 0 where 34 do not, None if one does."""
    nested: bool = False
    """True if the rivals are one law, at once and late."""

    @property
    def best(self) -> str:
        """Name of the first profile."""
        return str(self.table.index[0])

    @property
    def profile(self) -> pd.DataFrame | None:
        """The column to drive, by time; None where nothing is to be driven."""
        driven, odds = self.table.iloc[0][["driven", "odds"]]
        return None if pd.isna(driven) or np.isnan(odds) or self.nested else self.frames[self.best][[driven]]

    def sentence(self) -> str:
        """What to do, and how often it decides."""
        if self.nested:
            return f"No profile excludes a lag of {self.rivals[0]}: a new measurement bounds it."
        wait = f"log on for {self.days} days, without a gap: {_of_100(WAITED)}" if self.days else ""
        length = f"{number_text(self.hours)} h"
        if np.isnan(self.table["odds"].iloc[0]):
            *first, last = self.rivals
            between = f"{', '.join(first)} from {last}"
            time = f"; time does: {wait}" if wait else f", nor do {DAYS[-1]} days, undisturbed"
            return f"No profile within these limits distinguishes {between} in {length}{time}."
        quiet = float(self.table["odds"][UNDISTURBED])
        without = "" if self.best == UNDISTURBED else f"; undisturbed {_of_100(quiet)}"
        said = f"To decide: {self.best}, for {length}: {_of_100(self.table['odds'].iloc[0])}"
        return f"{said}{without}{wait and '; or ' + wait}."

    def __str__(self) -> str:
        shown = self.table.head(8).reset_index(names="profile")[["profile", "ratio", "odds", "hardest"]]
        shown["odds"] = [_of_100(value) for value in shown["odds"]]
        shown["ratio"] = [f"{value:.1f}" for value in shown["ratio"]]
        return f"{self.sentence()}\n{shown.to_string(index=False)}"

    def to_dict(self) -> dict[str, Any]:
        """The proposal as JSON has it."""
        rows = self.table.astype(object).where(self.table.notna(), None).reset_index(names="profile")
        return {
            "sentence": self.sentence(),
            "rivals": list(self.rivals),
            "hours": self.hours,
            "days": self.days,
            "profiles": rows.to_dict("records"),
        }

    def plot(self, ax: Any = None) -> Any:
        """Draw the first profile, or what is undisturbed; returns the Axes."""
        from ..output.axes import axes_grid, pyplot
        from ..output.style import STYLE

        frame = self.frames[UNDISTURBED] if self.profile is None else self.profile
        with pyplot().rc_context(STYLE):
            ax = axes_grid(ax, rows=1, columns=1, size=(8.0, 3.0))[0, 0]
            ax.plot(frame.index, frame.iloc[:, 0])
            ax.set(title=textwrap.fill(self.sentence(), 90), ylabel=str(frame.columns[0]))
        return ax


def _of_100(share: float) -> str:
    return "nothing promised" if np.isnan(share) else f"{100 * share:.0f} of 100"


def propose(
    model: DynamicBiasRegressor,
    diagnosis: Any,
    X: Any,
    y: Any,
    *,
    limits: Mapping[Any, tuple[float, float]] | None = None,
    hours: float = 24.0,
    fastest: Mapping[Any, float] | None = None,
) -> Proposal:
    """Find the measurement that decides between rivals.

    Parameters
    ----------
    model : DynamicBiasRegressor
        Fitted.
    diagnosis : Diagnosis
        Of this model, "ambiguous": its first cause and what it is confusable with are the rivals.
    X, y : as for `diagnose`
        The record.
    limits : mapping of column to (low, high), optional
        Columns that can be driven, and between what, in their units. By default the temperature and the columns of the
        rivals, within the range that the record showed.
    hours : float
        Length of the new measurement [h].
    fastest : mapping of column to float, optional
        Fastest change of a driven column [its unit per hour]; by default 6 K/h for the temperature, and the way between
        the limits in two hours for others.

    Returns
    -------
    Proposal

    Raises
    ------
    ValueError
        For a diagnosis without rivals, limits of a column that the record does not have, or that are in no order, fewer
        than 16 rows in these hours, or the fastest change of a column that is not driven.

    Examples
    --------
    >>> from thermocorr import DynamicBiasRegressor, diagnose, propose
    >>> from thermocorr.datasets import make_record
    >>> record = make_record(1200, effects={"hinge": 1.0}, device="plate", seed=3)
    >>> X, y = record.drop(columns="reading"), record["reading"]
    >>> model = DynamicBiasRegressor("temperature").fit(X, y)
    >>> diagnosis = diagnose(model, X, y)
    >>> print(diagnosis.verdict)
    ambiguous
    >>> propose(model, diagnosis, X, y, limits={"temperature": (18, 28)}, hours=6).table["driven"].iloc[0]
    'temperature'
    """
    if not diagnosis.causes or not diagnosis.causes[0].confusable_with:
        raise ValueError(
            f"There is nothing to decide: the diagnosis says {diagnosis.verdict!r}, and its first cause has no rivals."
        )
    cause = diagnosis.causes[0]
    with one_blas_thread():
        old = _History.of(model, X, y)
        rivals = Rivals(old, model, [cause.effect, *cause.confusable_with])
        limits, fastest = old.checked(limits, rivals.columns), dict(fastest or {})
        if not 0 < hours < np.inf:
            raise ValueError(f"{option('hours')} must be a positive number. Got {hours} instead.")
        for name, rate in fastest.items():
            if name not in limits or not rate > 0:
                raise ValueError(
                    f"{option('fastest')} takes a positive rate of a driven column, one of {listing(limits)}. Got "
                    f"{rate} for {name!r} instead."
                )
        profiles = old.profiles(limits, hours, fastest)
        rows = [(*rivals.judged(profile), driven) for profile, driven in profiles.values()]
        table = pd.DataFrame(rows, list(profiles), ["ratio", "hardest", "mean", "driven"])
        table.insert(1, "odds", [np.nan if rivals.of_time else odds(row[0], row[-1] is not None) for row in rows])
        table = table.sort_values(["ratio", "mean"], ascending=False).drop(columns="mean")
        nested = len(rivals.names()) == 1
        sure = not nested and not rivals.of_time and table["ratio"].iloc[0] >= SURE
        days = None if nested or sure else rivals.days()
    frames = {name: old.by_clock(profile) for name, (profile, _) in profiles.items()}
    return Proposal(table, frames, rivals.names(), float(hours), days, nested)


def calibration_profile(
    low: float, high: float, *, hours: float = 24.0, step: float = 60.0, fastest: float = HOURLY
) -> pd.Series:
    """Plan the temperature of a first calibration.

    Stairs of two rounds, long and short steps in turn, show fast and slow lags at each level. Of simulated devices that
    had settled before, 8 of 10 had a smaller error on later days than after as long in room air. It misleads where the
    limits are 8 K beyond the range of use (5 of 10), and a slow device that has not settled (4 of 10;
    `benchmarks/propose.py --calibrate`).

    Parameters
    ----------
    low, high : float
        The range of use, and 1 K on each side [degC].
    hours : float
        Length [h].
    step : float
        Sampling period [s].
    fastest : float
        Fastest change [K/h].

    Returns
    -------
    Series
        Temperature by seconds. It begins in the middle, where the instrument should have settled before.

    Raises
    ------
    ValueError
        For limits in no order or out of reach, lengths and rates that are not positive, or fewer samples than levels.

    Examples
    --------
    >>> from thermocorr import calibration_profile
    >>> calibration_profile(21, 25).iloc[[0, 400, 1439]].round(2).tolist()
    [23.0, 25.0, 22.0]
    """
    if not -np.inf < low < high < np.inf:
        raise ValueError(f"The limits must be a lower and an upper one. Got {low} and {high} instead.")
    for name, value in {"hours": hours, "step": step, "fastest": fastest}.items():
        if not 0 < value < np.inf:
            raise ValueError(f"{option(name)} must be a positive number. Got {value} instead.")
    levels = np.tile(STAIRS, 2)
    long, short = np.split(np.geomspace(32.0, 1.0, len(levels)), 2)
    ends = np.cumsum(np.column_stack([long, short[::-1]]))
    n = round(3600 * hours / step)
    if n < len(levels):
        raise ValueError(
            f"{n} samples of {step} s in {hours} h are fewer than the {len(levels)} levels: sample faster."
        )
    place = np.searchsorted(ends / ends[-1], np.arange(n) / n, side="right")
    values = _slewed(low + (high - low) * levels[place], (low + high) / 2, fastest * step / 3600)
    if np.ptp(values) < (high - low) * (1 - 1e-9):
        raise ValueError(
            f"At {fastest} K/h, {hours} h reach {values.min():.4g} to {values.max():.4g}, not {low} to {high}: "
            "take more hours, closer limits, or faster changes."
        )
    return pd.Series(values, pd.Index(step * np.arange(n), name="seconds"), name="temperature")


@dataclass(frozen=True)
class _History:
    """The record as a table on an even clock."""

    frame: pd.DataFrame
    """Temperature and columns under suspicion, by date."""
    reading: np.ndarray
    temperature: Any
    step: float
    kind: str
    """That of the record's times."""

    @classmethod
    def of(cls, model: DynamicBiasRegressor, X: Any, y: Any) -> _History:
        """The record's rows in the order of time, averaged to `ROWS`."""
        read = record_of(model, X, y)
        record = suspect_record(model, read, X, y, None)
        last = record.segments[-1].run  # levels of runs are no rivals
        places = [record.kept_places(each.start, each.stop) for each in record.segments if each.run == last]
        rows = record.rows_at(np.concatenate(places))
        began = record.since_1970()
        seconds = record.times.seconds(rows, record.first_stamp()) + (0.0 if began is None else began)
        frame = pd.DataFrame({name: np.asarray(column, float)[rows] for name, column in record.columns.items()})
        frame[_Y] = np.asarray(record.reading, float)[rows]
        size = -(-len(frame) // ROWS)
        groups = np.arange(len(frame)) // size
        frame = frame.groupby(groups).mean()
        frame.index = pd.to_datetime(pd.Series(seconds).groupby(groups).mean().to_numpy(), unit="s")
        known = frame.dropna()
        return cls(
            known.drop(columns=_Y), known[_Y].to_numpy(), record.temperature_name, record.usual_step() * size,
            record.times.kind,
        )  # fmt: skip

    def checked(self, limits: Mapping[Any, tuple[float, float]] | None, of_rivals: Sequence[Any]) -> dict[Any, Any]:
        """Limits of columns that can be driven."""
        if limits is None:
            names = dict.fromkeys([self.temperature, *of_rivals])
            return {name: (float(self.frame[name].min()), float(self.frame[name].max())) for name in names}
        for name, (low, high) in limits.items():
            if name not in self.frame.columns:
                raise ValueError(f"{option('limits')} names {name!r}; the record has {listing(self.frame.columns)}.")
            if not low < high:
                raise ValueError(
                    f"The limits of {name!r} must be a lower and an upper one. Got {low} and {high} instead."
                )
        return dict(limits)

    def continued(self, n: int) -> pd.DataFrame:
        """The columns to come if nobody drives them: the past, mirrored."""
        back = np.concatenate([self.frame.to_numpy()[::-1][1:], self.frame.to_numpy()])
        index = self.frame.index[-1] + pd.to_timedelta(self.step * np.arange(1, n + 1), unit="s")
        return pd.DataFrame(np.resize(back, (n, self.frame.shape[1])), index, self.frame.columns)

    def profiles(
        self, limits: Mapping[Any, tuple[float, float]], hours: float, fastest: Mapping[Any, float]
    ) -> dict[str, tuple[pd.DataFrame, Any]]:
        """Name -> the rows to come, and the column that is driven."""
        n = round(3600 * hours / self.step)
        if n < 2 * len(STAIRS):
            least = number_text(2 * len(STAIRS) * self.step / 3600)
            raise ValueError(
                f"{option('hours')} must be {least} or more: a row stands for {number_text(self.step / 3600)} h of "
                f"this record, and a profile needs {2 * len(STAIRS)} of them. Got {number_text(hours)} instead."
            )
        quiet = self.continued(n)
        found: dict[str, tuple[pd.DataFrame, Any]] = {UNDISTURBED: (quiet, None)}
        for name, (low, high) in limits.items():
            now = float(self.frame[name].iloc[-1])
            usual = HOURLY if name == self.temperature else (high - low) / 2
            most = fastest.get(name, usual) * self.step / 3600
            for shape, set_point in _shapes(n, self.step, low, high).items():
                found[f"drive {printable(name)}, {shape}"] = (_driven(quiet, name, _slewed(set_point, now, most)), name)
        return found

    def by_clock(self, profile: pd.DataFrame) -> pd.DataFrame:
        """A profile by date, or by seconds where the record has no dates."""
        if self.kind.startswith("datetime"):
            index = pd.DatetimeIndex(profile.index, name="time")
            return profile.set_axis(index.tz_localize("UTC") if "zone" in self.kind else index, axis=0)
        seconds = (pd.DatetimeIndex(profile.index) - pd.Timestamp(0)).total_seconds()
        return profile.set_axis(seconds, axis=0).rename_axis("seconds")


_Y = "reading of the record"


class Rivals:
    """Expected ratios between rivals when a record goes on."""

    def __init__(self, old: _History, model: DynamicBiasRegressor, effects: Sequence[Effect]):
        self.old, self.model = old, model
        record = self._record(old.frame)
        self.families: dict[str, list[Effect]] = {}
        for effect in effects:
            if not isinstance(effect, StaticPolynomial):  # which every model has
                known = next((label for label, own in self.families.items() if _law(own[0]) == _law(effect)), None)
                self.families.setdefault(known or effect_text(effect), []).append(clone(effect))
        self.columns = list(dict.fromkeys(name for effect in effects for name in effect.inputs()))
        for own in self.families.values():
            for effect in own:
                effect.learn(record)
            near = [each for effect in own for share in (0.3, 1.0) for each in effect.nearby(record, share)]
            for each in near:
                each.learn(record)
            own += near
        self.static = [effect_text(effect) for effect in effects if isinstance(effect, StaticPolynomial)][:1]
        self.of_time = all(_of_time(own[0]) for own in self.families.values()) and not self.static
        base, _, rivals = self._columns(old.frame)
        everything = np.column_stack([base, *(columns[0] for columns in rivals.values())])
        Q = _basis(everything)
        left = old.reading - Q @ (Q.T @ old.reading)
        bands = self._bands(len(left))
        share = bands.sizes * (1 - Q.shape[1] / len(left))
        power = bands.sums(bands.forward(left[:, None])[:, 0] ** 2)[:, None]
        self.theta = fitted_parts(bands.parts, share, power, np.full((bands.parts.shape[1], 1), 0.1 * left.var()))[:, 0]
        self.known = {label: self._learned(base, columns[0]) for label, columns in rivals.items()}

    def names(self) -> tuple[str, ...]:
        """What cannot be distinguished."""
        return (*self.families, *self.static)

    def _learned(self, base: np.ndarray, columns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Coefficients of a rival and their covariance."""
        B, C, r = (self._whitened(part) for part in (base, columns, self.old.reading[:, None]))
        B = _basis(B)
        C, r = (part - B @ (B.T @ part) for part in (C, r))
        inverse = np.linalg.pinv(C.T @ C, rcond=1e-8)
        return inverse @ C.T @ r, inverse

    def _record(self, frame: pd.DataFrame) -> Record:
        return read_record(frame, Layout(self.old.temperature), needed=list(frame.columns), quiet=True)

    @staticmethod
    def _bands(n: int) -> Bands:
        return Bands(np.zeros(n, int))

    def _columns(self, frame: pd.DataFrame) -> tuple[np.ndarray, np.ndarray, dict[str, list[np.ndarray]]]:
        """Columns of the base, of slow parts of a model, and of the rivals.

        The slow parts, decays from the start and slow lags, are what is called nothing missing.
        """
        record = self._record(frame)
        step, span = record.usual_step(), record.longest_read()
        further = [clone(effect) for _, effect in self.model.features_.further_effects()]
        base = [
            StaticPolynomial(max(2, self.model.degree_)),
            ThermalLag(list(np.geomspace(step, span / 10, 8))),
            *further,
        ]
        slow = [InitialTransient([span / 20, span / 6]), ThermalLag([span / 5])]
        own = [effect for family in self.families.values() for effect in family]
        for effect in [*base, *slow]:
            effect.learn(record)
        effects = [*base, *slow, *own]
        walked = np.concatenate([part.columns.copy() for part in walk(effects, record, starts=own_starts(record))])
        parts = iter(np.split(walked, np.cumsum([effect.n_columns() for effect in effects])[:-1], axis=1))
        laws, more = [np.ones((len(walked), 1)), *(next(parts) for _ in base)], [next(parts) for _ in slow]
        if not any(_of_time(own[0]) for own in self.families.values()):  # decays are no suspects
            laws.append(more[0])
        rivals = {label: [next(parts) for _ in family] for label, family in self.families.items()}
        return np.hstack(laws), np.hstack(more), rivals

    def _noise(self, n: int) -> tuple[Bands, np.ndarray]:
        """Bands of n rows, and the variances of the noise's parts, shape (parts, 1)."""
        bands = self._bands(n)
        return bands, np.resize(np.append(self.theta, np.zeros(9)), bands.parts.shape[1])[:, None]

    def _whitened(self, columns: np.ndarray) -> np.ndarray:
        """Columns in a transform in which the noise is white and of size one."""
        bands, theta = self._noise(len(columns))
        return np.asarray(bands.forward(columns) / np.sqrt(bands.each_row((bands.parts @ theta)[:, 0]))[:, None])

    def _beyond_noise(self, left: np.ndarray) -> float:
        """Log likelihood lost by what a rival leaves, the noise refitted."""
        bands, theta = self._noise(len(left))
        S = bands.parts @ theta
        usual = bands.sizes[:, None] * S
        power = usual + S * bands.sums(np.sum(left**2, axis=1))[:, None]
        other = fitted_parts(bands.parts, bands.sizes.astype(float), power, theta + 0.03 * theta.sum())
        return float((whittle(bands.sizes, usual, S) - whittle(bands.sizes, power, bands.parts @ other))[0])

    def judged(self, new: pd.DataFrame) -> tuple[float, str, float]:
        """Smallest ratio, the hardest pair, and the mean of log(1 + ratio)."""
        base, more, rivals = self._columns(pd.concat([self.old.frame, new]))
        B = _basis(self._whitened(base))
        out = {
            label: [part - B @ (B.T @ part) for part in map(self._whitened, columns)]
            for label, columns in {**rivals, NOTHING: [more]}.items()
        }
        bases = {label: [_basis(columns) for columns in parts] for label, parts in out.items()}
        worst, hardest, each = np.inf, "", list[float]()
        for truth, (mean, spread) in self.known.items():
            values, vectors = np.linalg.eigh(spread)
            draws = out[truth][0] @ np.column_stack([mean, vectors * np.sqrt(np.maximum(values, 0.0))])
            no_effect = self.of_time or isinstance(self.families[truth][0], InitialTransient)  # which the model has
            pairs = {}
            for label, spans in bases.items():
                if label == truth or (label == NOTHING and no_effect):
                    continue
                left = min(([draws - Q @ (Q.T @ draws) for Q in spans]), key=lambda part: float(np.sum(part**2)))
                if float(np.sum(left**2)) < 1e-6 * float(np.sum(draws**2)):  # a special case: the simpler one is named
                    continue
                pairs[label] = self._beyond_noise(left) - (PROVABLE - TIE if label == NOTHING else 0.0)
            if pairs:
                label = min(pairs, key=lambda name: pairs[name])
                ratio = max(pairs[label], 0.0)
                each.append(float(np.log1p(ratio)))
                if ratio < worst:
                    worst, hardest = ratio, f"{truth} / {label}"
        if not each:
            return 0.0, "", 0.0
        return worst, hardest, float(np.mean(each))

    def days(self) -> int:
        """Days of further logging that decide; 0 where none of `DAYS` does."""
        for days in DAYS:
            if self.judged(self.old.continued(round(86_400 * days / self.old.step)))[0] >= SURE:
                return days
        return 0


def _of_time(effect: Effect) -> bool:
    """True for a law of time alone: neither the temperature nor a column is in it."""
    if not effect.of_time_alone:
        return False
    expression = traced(effect)
    return not any(
        node.operator in ("T", "column") for column in expression.columns for node in expression.below(column)
    )


def odds(ratio: float, driven: bool = True) -> float:
    """Share of cases in which the right cause is named; NaN for no promise."""
    return next((share if driven else quiet for least, share, quiet in KEPT if ratio >= least), np.nan)


def _law(effect: Effect) -> tuple[str, Any]:
    """Kind and column; an effect that acts late is no other law than at once."""
    at_once = {late: kind for kind, late in LATE_FORM.items()}
    return at_once.get(effect.kind, effect.kind), next(iter(effect.inputs()), None)


def _basis(columns: np.ndarray) -> np.ndarray:
    """Orthonormal directions that columns span, shape (n, rank)."""
    U, s, _ = np.linalg.svd(columns / np.maximum(np.sqrt(np.mean(columns**2, axis=0)), 1e-300), full_matrices=False)
    return np.asarray(U[:, s > 1e-6 * s[0]])


def _shapes(n: int, step: float, low: float, high: float) -> dict[str, np.ndarray]:
    """Set points between two limits, n values `step` [s] apart."""
    time, share, middle = np.arange(n) * step, np.arange(n) / n, (low + high) / 2
    bits = np.random.default_rng(0).integers(0, 2, int(n * step / 3600) + 1)
    return {
        "one step up": np.full(n, high),
        "one step down": np.full(n, low),
        "half the time up, half down": np.where(share < 0.5, high, low),
        "stairs up and down": low + (high - low) * STAIRS[np.minimum((share * 8).astype(int), 7)],
        "four ramps up and down": low + (high - low) * (1 - np.abs((2 * (4 * share + 0.25)) % 2 - 1)),
        "square wave of 6 h": np.where(time / 3600 % 6 < 3, high, low),
        "square wave of 2 h": np.where(time / 3600 % 2 < 1, high, low),
        "random steps of 1 h": low + (high - low) * bits[(time / 3600).astype(int)],
        "growing swings": middle + (high - middle) * share * np.sin(2 * np.pi * 8 * share),
    }


def _driven(frame: pd.DataFrame, name: Any, values: np.ndarray) -> pd.DataFrame:
    frame = frame.copy()
    frame[name] = values
    return frame


def _slewed(set_point: np.ndarray, now: float, most: float) -> np.ndarray:
    """A set point followed from `now` by no more than `most` from row to row."""
    result, at = np.empty(len(set_point)), now
    for k, wanted in enumerate(set_point.tolist()):
        at += min(max(wanted - at, -most), most)
        result[k] = at
    return result

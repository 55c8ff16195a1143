"""`DiffusiveFeatures`: the paper's matrix Q, built from effects."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from numbers import Integral, Real
from typing import Any

import numpy as np
from sklearn.base import BaseEstimator, TransformerMixin
from sklearn.utils._param_validation import Interval, Options, StrOptions
from sklearn.utils.validation import check_is_fitted

from ..effects import InitialTransient, LagProducts, StaticPolynomial, ThermalLag
from ..effects.protocol import Effect
from ..effects.stream import Walked, needed_columns, own_starts, resume, walk
from ..effects.wrap import EffectsParameters, as_effects
from ..records import History, Layout, Record, SegmentStart, read_record
from ..records.errors import warn
from ..records.read import check_max_gap, check_order
from ..records.screen import screened
from .reading import check_columns, learned_readings
from .spectrum import DECAY_SHARE
from .thermometers import Thermometers

LAYOUT_CONSTRAINTS: dict[str, Any] = {
    "reference": "no_validation",
    "temperature": "no_validation",
    "time": "no_validation",
    "run": "no_validation",
    "sampling_period": "no_validation",
    "max_gap": "no_validation",
}
THERMAL_CONSTRAINTS: dict[str, Any] = {
    "degree": [Interval(Integral, 0, 9, closed="both")],
    "products": ["boolean", Options(Integral, {2, 3})],
    "reference_temperature": [Interval(Real, None, None, closed="neither"), StrOptions({"mean"})],
    "initial_state": [StrOptions({"equilibrium", "fit"})],
    "hold": [StrOptions({"first_order", "zero_order"})],
    "screen": ["boolean"],
    "effects": ["array-like", Effect],
    **LAYOUT_CONSTRAINTS,
}


class DiffusiveFeatures(TransformerMixin, EffectsParameters, BaseEstimator):
    """Columns of eqs. (19)-(23): T^i, lags, decays, products.

    Time is part of the data. Rows that follow on the fitted record in time (the test fold of a `TimeSeriesSplit`,
    tomorrow's log) continue its lags; rows that repeat it reproduce its columns; anything else starts afresh by
    `initial_state`.

    Parameters
    ----------
    time_constants : sequence, or mapping of thermometer to sequence, default (60, 600, 3600)
        Time constants of the lags: seconds, or anything pandas reads as a time span ("15 min"). With several
        thermometers a sequence holds for all of them.
    degree : int, default 1
        Highest power of T - T0 in the static law, eq. (3); 0 leaves the static law out.
    products : {False, True, 2, 3}
        Add the products Psi_j Psi_k of eq. (21) and (T - T0) Psi_j: the square of an inner temperature needs both. 3
        adds those of three, for its cube: many columns, which want a long record.
    effects : list, default ()
        Further effects or scikit-learn transformers, alone or as (name, effect) pairs.
    reference_temperature : float or "mean", default "mean"
        T0, in the unit of the temperature.
    initial_state : {"fit", "equilibrium"}, default "fit"
        Device at the start of a segment: at rest with the first temperature, plus fitted decay columns, eq. (18), for
        time constants up to 4 % of the record (an `InitialTransient` among the effects has slower ones); or at rest.
    hold : {"first_order", "zero_order"}, default "first_order"
        Temperature between samples: a straight line, or the earlier value as in eq. (25). Both are exact.
    screen : bool, default True
        Pass over temperatures that are not measurements, see `DynamicBiasRegressor`; their rows get NaN.
    temperature : str, int, or list of these, optional
        Column of the ambient temperature; by default the one called "temperature", else the first. Of a list, the first
        is the ambient temperature; the others are thermometers of further surroundings (a case, a room), which act
        linearly, each with lags of its own.
    time : str, optional
        Column of times (dates, or seconds); by default the index.
    run : str, optional
        Column that labels runs; each run is a segment.
    sampling_period : float or time span, optional
        Time between rows [s], for data without times.
    max_gap : float or time span, optional
        A longer step starts a new segment. By default temperature is taken as a straight line across gaps. Rows that
        lack a temperature, or a column that an effect uses, are passed over as if they had not been recorded.
    reference : str, optional
        Column that is no feature: what readings are compared with, see `DynamicBiasRegressor`.

    Attributes
    ----------
    effects_ : list of (str, Effect)
        The parts, learned.
    reference_temperature_ : float
    time_constants_ : ndarray of shape (J,)
        [s].
    n_features_in_, feature_names_in_ : as in scikit-learn

    Raises
    ------
    RecordError
        For a record that cannot be used; the message says what was found, where, and what to do.

    Examples
    --------
    >>> import pandas as pd
    >>> from thermocorr import DiffusiveFeatures
    >>> hours = pd.timedelta_range(0, periods=4, freq="1h")
    >>> room = pd.DataFrame({"temperature": [20.0, 21.0, 21.0, 21.0]}, index=hours)
    >>> lags = DiffusiveFeatures(["2 h"], initial_state="equilibrium").set_output(transform="pandas")
    >>> lags.fit_transform(room).round(3)
                     temperature  lag[7200 s]
    0 days 00:00:00        -0.75        0.000
    0 days 01:00:00         0.25       -0.787
    0 days 02:00:00         0.25       -0.477
    0 days 03:00:00         0.25       -0.289
    """

    _parameter_constraints: dict[str, Any] = {"time_constants": "no_validation", **THERMAL_CONSTRAINTS}

    decay_share: float = DECAY_SHARE
    """Decays slower than this share of all segments together are left out: they look like drift or ageing."""

    def __init__(
        self,
        time_constants: Any = (60.0, 600.0, 3600.0),
        degree: int = 1,
        *,
        products: bool | int = False,
        effects: Any = (),
        reference_temperature: Any = "mean",
        initial_state: str = "fit",
        hold: str = "first_order",
        screen: bool = True,
        temperature: Any = None,
        time: Any = None,
        run: Any = None,
        sampling_period: Any = None,
        max_gap: Any = None,
        reference: Any = None,
    ):
        self.time_constants = time_constants
        self.degree = degree
        self.products = products
        self.effects = effects
        self.reference_temperature = reference_temperature
        self.initial_state = initial_state
        self.hold = hold
        self.screen = screen
        self.temperature = temperature
        self.time = time
        self.run = run
        self.sampling_period = sampling_period
        self.max_gap = max_gap
        self.reference = reference

    def fit(self, X: Any, y: Any = None) -> DiffusiveFeatures:
        """Learn T0, the segments and their final states.

        Parameters
        ----------
        X : DataFrame or array of shape (n_rows, n_columns)
        y : ignored
        """
        record = self.learn(X)
        self.remember(record, self._end_states(self.walk_fitted(record)))
        return self

    def fit_transform(self, X: Any, y: Any = None, **fit_params: Any) -> np.ndarray:
        """Fit, and return the columns, in one pass."""
        record = self.learn(X)
        columns, ends = self._collect(record, self.walk_fitted(record))
        self.remember(record, ends)
        return columns

    def transform(self, X: Any) -> np.ndarray:
        """Columns of a record, NaN without a valid temperature.

        Shape (n_rows, n_columns_out).
        """
        record, starts, states = self.resume(X)
        return self._collect(record, self.walk_resumed(record, starts, states))[0]

    def get_feature_names_out(self, input_features: Any = None) -> np.ndarray:
        """Names of the columns: ``temperature``, ``temperature^2``, ``lag[900 s]``, ``decay[900 s]``, ..."""
        check_is_fitted(self, "effects_")
        return np.array([name for _, effect in self.effects_ for name in effect.names()], dtype=object)

    # What the estimators above use: the same steps, without materialising the matrix.

    def learn(self, X: Any, y: Any = None) -> Record:
        """Read data, and let every effect learn; returns the record."""
        record = self.read(X, y)
        self.learn_from(record)
        return record

    def read(self, X: Any, y: Any = None, weight: Any = None, mask: Any = None, quiet: bool = False) -> Record:
        """Check parameters and data; returns the record, screened.

        `X`, `y`, `weight`, `mask` (see `DynamicBiasRegressor.fit`). `quiet` (bool): Warn of nothing.
        """
        self._validate_params()
        if y is not None:
            y = learned_readings(X, y, self.layout(), mask, weight)
        X = check_columns(self, X, reset=True)
        needed = needed_columns([effect for _, effect in self.further_effects()])
        record = read_record(X, self.layout(), y=y, needed=needed, quiet=quiet)
        check_max_gap(record, self.layout())
        n_read, self.screen_ = len(record.notes), None
        self.__dict__.pop("history_", None)
        if self.screen:
            record, self.screen_ = screened(record, self.longest_step(), self.thermometers().further)
        check_order(record, self.layout())
        for note in () if quiet else record.notes[n_read:]:
            warn(note)
        return record

    def taking(self, reader: DiffusiveFeatures) -> DiffusiveFeatures:
        """These features, with what others learned from the data."""
        for name in ("n_features_in_", "feature_names_in_", "screen_"):
            if hasattr(reader, name):
                setattr(self, name, getattr(reader, name))
        return self

    def learn_from(self, record: Record) -> None:
        """Let every effect learn from a record."""
        self.effects_ = [
            *self._thermal_part(), *((name, _copy(effect)) for name, effect in self.further_effects()),
        ]  # fmt: skip
        for _, effect in self.effects_:
            if self.reference is not None and "removed_by_correct" in effect.get_params(deep=False):  # nothing is kept
                effect.removed_by_correct = True
            effect.learn(record)
        first = next((e for _, e in self.effects_ if isinstance(e, StaticPolynomial)))
        self.reference_temperature_ = first.reference_temperature_
        for _, effect in self.effects_:
            effect.refer_to(self.reference_temperature_)
        lags = next((e for _, e in self.effects_ if isinstance(e, ThermalLag)), None)
        self.time_constants_ = np.zeros(0) if lags is None else lags.time_constants_

    def walk_fitted(self, record: Record) -> Iterator[Walked]:
        """Columns of the record that is being fitted, block by block."""
        return walk(self.effect_list(), record, starts=own_starts(record))

    def walk_resumed(
        self, record: Record, starts: dict[int, SegmentStart], states: dict[int, list[Any]]
    ) -> Iterator[Walked]:
        """Columns of a record that continues the fitted one."""
        return walk(self.effect_list(), record, zero=self.history_.zero, starts=starts, states=states)

    def resume(self, X: Any, y: Any = None) -> tuple[Record, dict[int, SegmentStart], dict[int, list[Any]]]:
        """Validate a new record and tie it to the fitted one."""
        check_is_fitted(self, "history_")
        effects = self.effect_list()
        if isinstance(X, Record):
            return resume(effects, self.history_, X)
        X = check_columns(self, X, reset=False)
        layout = replace(self.layout(), reference=None)  # rows to be corrected have readings, and need no reference
        record = read_record(X, layout, y=y, needed=needed_columns(effects), quiet=True)
        return resume(effects, self.history_, record)

    def remember(self, record: Record, end_states: list[list[Any]]) -> None:
        """Keep what ties later rows to this record."""
        self.history_ = History.of(record, end_states, self.longest_step(), screen=self.screen_)

    def thermometers(self) -> Thermometers:
        """Thermometers among the columns."""
        return Thermometers.of(self.temperature)

    def further_effects(self) -> list[tuple[str, Effect]]:
        """Effects besides the static law and the lags."""
        own, named = as_effects(self.effects), self.thermometers().effects(self.time_constants, self.hold)
        taken = {name for name, _ in own}
        return [*((name if name not in taken else f"{name}_lags", effect) for name, effect in named), *own]

    def effect_list(self) -> list[Effect]:
        """The learned effects without their names."""
        return [effect for _, effect in self.effects_]

    def first_of(self, kind: type[Effect]) -> tuple[Any, slice]:
        """The first effect of a kind, or None, and its columns."""
        at = 0
        for effect in self.effect_list():
            if type(effect) is kind:
                return effect, slice(at, at + effect.n_columns())
            at += effect.n_columns()
        return None, slice(0, 0)

    def memory(self) -> float:
        """Longest time constant of any effect [s]."""
        return max((effect.memory() for effect in self.effect_list()), default=0.0)

    def longest_step(self) -> float | None:
        """Longest step inside a segment [s]; None for no limit."""
        return self.layout().longest_step()

    def _thermal_part(self) -> list[tuple[str, Effect]]:
        parts: list[tuple[str, Effect]] = [
            (StaticPolynomial.kind, StaticPolynomial(self.degree, self.reference_temperature))
        ]
        time_constants = self.thermometers().split(self.time_constants)[0]
        some = time_constants is not None and np.size(time_constants) > 0
        if some:
            lag = ThermalLag(time_constants, self.hold)
            parts.append((lag.kind, lag))
        of_all = self.thermometers().all_times(self.time_constants)
        if self.initial_state == "fit" and of_all:
            parts.append((InitialTransient.kind, InitialTransient(of_all, self.decay_share)))
        if self.products and some:
            parts.append(
                (
                    LagProducts.kind,
                    LagProducts(
                        time_constants,
                        self.hold,
                        self.reference_temperature,
                        temperature_products=True,
                        order=max(int(self.products), 2),
                    ),
                )
            )
        return parts

    def layout(self) -> Layout:
        """Layout of X: roles of columns, spacing of rows."""
        ambient = self.thermometers().ambient
        return Layout(ambient, self.time, self.run, self.sampling_period, self.max_gap, self.reference)

    def _collect(self, record: Record, steps: Iterator[Walked]) -> tuple[np.ndarray, list[list[Any]]]:
        columns: np.ndarray | None = None
        ends: list[list[Any]] = []
        for step in steps:
            if columns is None:
                shape = (record.n_rows, step.columns.shape[1])
                whole = record.n_used == record.n_rows
                columns = np.empty(shape, order="F") if whole else np.full(shape, np.nan, order="F")
            columns[step.block.rows] = step.columns
            _keep_end(ends, step)
        assert columns is not None  # a record has at least one segment
        return columns, ends

    def _end_states(self, steps: Iterator[Walked]) -> list[list[Any]]:
        ends: list[list[Any]] = []
        for step in steps:
            _keep_end(ends, step)
        return ends

    def __sklearn_tags__(self) -> Any:
        tags = super().__sklearn_tags__()
        tags.input_tags.allow_nan = True  # rows with NaN are passed over, and get NaN
        return tags


def _keep_end(ends: list[list[Any]], step: Walked) -> None:
    if step.block.stop == step.block.record.segments[step.block.segment].stop:
        ends.append(list(step.states))


def _copy(effect: Effect) -> Effect:
    """An unlearned copy of the user's object."""
    from sklearn.base import clone

    copy: Effect = clone(effect)
    return copy

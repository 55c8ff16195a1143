"""`DynamicBiasRegressor`: features, time constants and ridge."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from dataclasses import replace
from itertools import takewhile
from numbers import Integral, Real
from typing import Any

import numpy as np
import pandas as pd
from sklearn.base import BaseEstimator, RegressorMixin, clone
from sklearn.pipeline import Pipeline
from sklearn.utils._param_validation import Interval, StrOptions

from ..effects import ThermalLag
from ..effects.products import CoarseProducts
from ..effects.stream import equal_edges
from ..effects.wrap import EffectsParameters, as_effects
from ..equations import MovingAverage
from ..readers.form import Form
from ..records import Block, Record, RecordWarning
from ..records.errors import warn
from ..records.record import Flags
from .checks import doubts_of
from .features import THERMAL_CONSTRAINTS, DiffusiveFeatures
from .fitting import MergedRidge, Swept, require_rows, standard_errors, sweep_effects
from .input_errors import readings_left_out
from .progress import one_blas_thread
from .reading import Coverage, Reading, check_corrected, check_plausible, like, no_flags
from .runs import RunLevels, run_levels
from .search import SearchSettings, TimeConstantChoice, search, spectrum_table
from .signed import SignedModel
from .spectrum import POOL_SIZE
from .thermometers import Thermometers


class DynamicBiasRegressor(SignedModel, RegressorMixin, EffectsParameters, BaseEstimator):
    """Learn a late thermal bias and remove it, eqs. (21)-(24).

    Parameters
    ----------
    temperature : str, int, or list of these, optional
        Column of the ambient temperature; by default the one called "temperature", else the first. Of a list, the first
        is the ambient temperature; the others are thermometers of further surroundings (a case, a room), which act
        linearly, each with lags of its own.
    time_constants : "auto", int, sequence, or mapping of thermometer to sequence, default "auto"
        Sequence: the time constants, in seconds or anything pandas reads as a time span ("15 min"), for every
        thermometer; a mapping has those of each. A number: how many to choose, on average for each thermometer. "auto":
        choose their number too. The choice is by forecasting later blocks of time from earlier ones, see
        `thermocorr.model.search`.
    degree : int, default 2
        Highest power of T - T0 in the static law, eq. (3).
    effects : list, default ()
        Further effects or scikit-learn transformers, alone or as (name, effect) pairs.
    products : {False, True, 2, 3}, default False
        Add the products Psi_j Psi_k of eq. (21) and (T - T0) Psi_j: the square of an inner temperature needs both. 3
        adds those of three, for its cube: many columns, which want a long record.
    alpha : float or "auto", default "auto"
        Ridge penalty on coefficients times their columns' standard deviation, eps of eq. (13). "auto" takes the
        search's (at most 1e-4 per reading), and 0 for given time constants.
    screen : bool, default True
        Leave out values that are not measurements: codes for "no value" (9.9E37, -999, 85.0 of a thermometer at power-
        on) and isolated spikes, see `thermocorr.equations.outliers`. Such readings are not learned from; rows
        with such inputs are passed over. They are named in a warning and in `notes_`, and flagged "sentinel" or "spike"
        wherever they are met again. Later inputs that move as these never did are held back or doubted, see
        `thermocorr.records.gate`.
    reference_temperature, time, sampling_period, max_gap : see `DiffusiveFeatures`
    run : str, optional
        Column with the label of a run. Each run has a level (U0) of its own, which `correct` keeps; runs must not
        overlap in time. Where runs measure the same quantity, leave it out: a gap starts a new segment.
    reference : str, optional
        Column of a better instrument that measures the same quantity, in the unit of y. What is learned is how much the
        readings differ from it, U0 included: `correct` gives what the reference would have shown, and needs it no more.
        Missing values are not learned from. Its own uncertainty is that of every corrected reading, see `uncertainty`.

    Attributes
    ----------
    time_constants_ : ndarray of shape (J,)
        Those of the (first) thermometer [s].
    thermometers_ : dict of column to ndarray
        The time constants of each thermometer [s].
    coef_ : ndarray of shape (n_columns,)
    intercept_ : float
        U0, the reading at the reference temperature, device at rest.
    pipeline_ : Pipeline
        The fitted `DiffusiveFeatures` and `MergedRidge`.
    search_ : TimeConstantChoice or None
        How the time constants were chosen.
    alpha_ : float
        The ridge penalty used.
    residual_std_ : float
        Standard deviation of the residuals of the fitted record, in the unit of y.
    degree_ : int
        Highest power of T - T0 in the static law: no higher than the temperatures of the record determine.
    reading_ : Reading
        Names, units and ranges of the fitted readings and temperatures.
    washout_ : float
        How long rows are flagged after a start that the fit does not know [s]: three times the longest time constant.
    notes_ : tuple of str
        What the user should know about the record's quality, and about what it cannot determine.

    Examples
    --------
    >>> import numpy as np, pandas as pd
    >>> from thermocorr import DynamicBiasRegressor
    >>> minutes = pd.timedelta_range(0, periods=2000, freq="1min")
    >>> room = pd.DataFrame({"temperature": 23 + np.sin(np.arange(2000) / 150.0)}, index=minutes)
    >>> late = room["temperature"].shift(60).bfill()
    >>> model = DynamicBiasRegressor(time_constants=["30 min", "2 h"], degree=1).fit(room, 10 + 0.001 * late)
    >>> bool(abs(model.predict(room) - 10 - 0.001 * late).max() < 1e-4)
    True
    """

    _parameter_constraints: dict[str, Any] = {
        **THERMAL_CONSTRAINTS,
        "time_constants": "no_validation",
        "alpha": [Interval(Real, 0, None, closed="left"), StrOptions({"auto"})],
    }

    def __init__(
        self,
        temperature: Any = None,
        time_constants: Any = "auto",
        degree: int = 2,
        *,
        effects: Any = (),
        products: bool | int = False,
        alpha: float | str = "auto",
        reference_temperature: Any = "mean",
        screen: bool = True,
        time: Any = None,
        run: Any = None,
        sampling_period: Any = None,
        max_gap: Any = None,
        reference: Any = None,
    ):
        self.temperature = temperature
        self.time_constants = time_constants
        self.degree = degree
        self.effects = effects
        self.products = products
        self.alpha = alpha
        self.reference_temperature = reference_temperature
        self.screen = screen
        self.time = time
        self.run = run
        self.sampling_period = sampling_period
        self.max_gap = max_gap
        self.reference = reference

    def fit(self, X: Any, y: Any, sample_weight: Any = None, *, mask: Any = None) -> DynamicBiasRegressor:
        """Learn the bias from a record.

        Parameters
        ----------
        X : DataFrame or array of shape (n_rows, n_columns)
            Temperature and whatever else was recorded; `thermocorr.records.read_record` reads it once for all.
        y : array-like of shape (n_rows,)
            Readings; rows with NaN are left out of the fit, not of the lags.
        sample_weight : array of shape (n_rows,), optional
            How much each reading counts: numbers of averages, or one over the squares of known uncertainties. Only
            their ratios do. Zero leaves a reading out, not its temperature: the lags go on. Uncertainties are refused
            then, and a diagnosis takes all readings for equally good.
        mask : array of bool of shape (n_rows,), or list of (start, end), optional
            Readings that are not learned from, as if they were NaN: the measurand was changed, somebody was at work. A
            stretch is two moments, both included: dates, or seconds or spans since the record began.

        Raises
        ------
        RecordError
            For a record that cannot be used; the message says what was found, where, and what to do.
        """
        self._validate_params()
        if y is None:
            raise ValueError("This DynamicBiasRegressor requires y to be passed, but the target y is None.")
        with one_blas_thread():
            self._degree, self.search_ = self.degree, None
            reader = self._unfitted_features((), RunLevels())
            record = reader.read(X, y, sample_weight, mask)
            reading = Reading.of(X, y, record)
            self._learn_levels(record)
            self.search_ = self._choose(record, reading)
            accepted = self._learn(reader, record, reading)
            covered = Coverage.of(record, self.degree)
            if covered.degree < self.degree and not self._knows_highest_power():
                self._degree = covered.degree
                self.search_ = self._choose(record, reading)
                accepted = self._learn(reader, record, reading)
            if self.search_ is not None and accepted is not record:  # the first choice had to use all readings
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore", RecordWarning)  # they were said the first time
                    self.search_ = self._choose(accepted, Reading.of(None, None, accepted))
                accepted = self._learn(reader, record, reading)
        self.reading_ = replace(self.reading_, temperature_gaps=covered.gaps)
        form = getattr(X, "attrs", {}).get("form")
        self.form_ = form if isinstance(form, Form) else None
        self._conclude(record, accepted)
        return self

    def _choose(self, record: Record, reading: Reading) -> TimeConstantChoice | None:
        """Choose the time constants; None where they are given."""
        count, given = None, self.time_constants
        if not (isinstance(given, str) and given == "auto"):
            if isinstance(given, bool) or (isinstance(given, Integral) and not 1 <= int(given) <= POOL_SIZE):
                raise ValueError(
                    f"The 'time_constants' parameter must be 'auto', a number to choose from 1 to {POOL_SIZE}, or a "
                    f"list of times. Got {given!r} instead."
                )
            if not isinstance(given, Integral):
                return None
            count = int(given) * (1 + len(Thermometers.of(self.temperature).further))
        features = self._unfitted_features(()).set_params(products=False)
        if self.products:  # lags that are chosen with products of a coarse grid do not imitate these
            effects = [*as_effects(features.effects), ("products", CoarseProducts())]
            features = clone(features).set_params(effects=effects)
        found = search(features, record, reading, SearchSettings(count=count))
        spectrum = None
        if found.factored is not None and found.reference is not None:
            table = spectrum_table(found.factored, found.reference)
            spectrum = {str(name): column.to_numpy() for name, column in table.items()}
        return replace(found, factored=None, spectrum=spectrum)  # the factors hold the record: it would stay in memory

    def _knows_highest_power(self) -> bool:
        """True if the highest power's coefficient is clearly not zero."""
        errors = standard_errors(self._swept, self._solution, self.alpha_)
        # A power that the temperatures hardly determine stays in the law if it is three standard errors from zero.
        return bool(abs(self._solution.coef[self.degree - 1]) > 3.0 * errors[self.degree])

    def _learn(self, reader: DiffusiveFeatures, record: Record, reading: Reading) -> Record:
        """Learn the coefficients; returns the record without spoilt readings."""
        time_constants = self.time_constants if not self.search_ else self.search_.parameter
        features = self._unfitted_features(time_constants).taking(reader)
        features.learn_from(record)
        n_columns = sum(effect.n_columns() for effect in features.effect_list())
        require_rows(reading.n_readings, n_columns)
        check_plausible(record, reading)
        self.reading_ = reading
        searched = 0.0 if self.search_ is None else float(self.search_.alpha)
        self.alpha_ = searched if self.alpha == "auto" else float(self.alpha)
        self._solve(record, features)
        accepted = self._without_spoilt(record)  # what gaps spoil is known now
        if accepted is not record:
            self._solve(accepted, features)
        return accepted

    def _conclude(self, record: Record, accepted: Record) -> None:
        """Add warnings and names after a fit."""
        for of_old_fit in ("_known_standard_errors", "_known_errors", "_known_ranges", "provenance_"):
            self.__dict__.pop(of_old_fit, None)
        doubts = [*doubts_of(self, record, self._solution), *readings_left_out(record, accepted)]
        for text in doubts:
            warn(text)
        self.notes_ = (*record.notes, *doubts)
        self.n_features_in_ = self.features_.n_features_in_
        if hasattr(self.features_, "feature_names_in_"):
            self.feature_names_in_ = self.features_.feature_names_in_

    def predict(self, X: Any, return_std: bool = False) -> Any:
        """Modelled reading, eq. (22), shape (n_rows,); NaN without temperature.

        With a `reference` it is that plus the modelled bias, and NaN where X has none. With `return_std` a tuple: the
        standard uncertainty of one new reading as well, its noise included.
        """
        if return_std:
            value, u = self._uncertain(X, "reading")
            return value + (np.asarray(self._level(X)) - self.intercept_), u
        return np.asarray(self._contributions(X).sum(axis=1) + np.asarray(self._level(X)))

    def bias(self, X: Any, return_std: bool = False) -> Any:
        """Bias that `correct` removes.

        With a `reference` the modelled error, U0 included. With `return_std` a tuple, with its standard
        uncertainty, without the noise of readings.
        """
        if return_std:
            value, u = self._uncertain(X, "bias")
            return like(X, value, "bias"), like(X, u, "u")
        return like(X, self._removed_part(self._contributions(X)), "bias")

    def correct(self, X: Any, y: Any, return_std: bool = False, average: int | None = None) -> Any:
        """Corrected reading: reading minus bias, eq. (24).

        NaN where a reading or a temperature is missing or refused, see `screen`. Warns (`RecordWarning`) where it
        leaves all readings far behind. With `return_std` a tuple: its standard uncertainty as well, the model taken
        for complete; `uncertainty` has more to say. With `average` the mean of the last `average` corrected
        readings, or those so far, eqs. (9) (26), as `OnlineCorrector` has it; `Uncertainty.mean` has its uncertainty.
        """
        if average is not None and return_std:
            raise ValueError("correct() takes average or return_std. uncertainty(X, y).mean(rows) has that of a mean.")
        reading = self._reading_numbers(X, y)
        if return_std:
            corrected, u = self._uncertain(X, "corrected", np.asarray(reading, float))
        else:
            parts, accepted = self._parts(X, reading)
            corrected = accepted - self._removed_part(parts)
        self._check_corrected(corrected, reading)
        if average is not None:
            return like(X, MovingAverage(average).many(corrected), "smoothed")
        value = like(X, corrected, "corrected")
        return (value, like(X, u, "u")) if return_std else value

    def residuals(self, X: Any, y: Any) -> Any:
        """Measured minus modelled reading.

        NaN as in `correct`; a Series where X is a DataFrame.
        """
        parts, accepted = self._parts(X, self._reading_numbers(X, y))
        return like(X, accepted - (parts.sum(axis=1) + np.asarray(self._level(X))), "residual")

    def evaluate(self, X: Any, y: Any, return_std: bool = False) -> pd.DataFrame:
        """A record in one frame: corrected, model, residual, flag.

        Warns as `correct` does. With `return_std` a column more: `u`, the standard uncertainty of `corrected`.
        """
        reading = self._reading_numbers(X, y)
        n_rows = len(reading)
        columns: dict[str, Any] = {name: np.full(n_rows, np.nan) for name in ("corrected", "model", "residual")}
        flags = Flags(0)
        for block, values, flagged in self._evaluated_blocks(X, y):
            flags = flags if len(flags) else no_flags(block.record)
            flags[block.rows] = flagged
            for name, part in values.items():
                columns[name][block.rows] = part
        columns["flag"] = flags.column()
        self._check_corrected(columns["corrected"], reading)
        if return_std:
            columns["u"] = np.where(np.isfinite(columns["corrected"]), self._uncertain(X, "corrected")[1], np.nan)
        return pd.DataFrame(columns, index=X.index if isinstance(X, pd.DataFrame) else None)

    def evaluate_blocks(self, X: Any, y: Any) -> Iterator[pd.DataFrame]:
        """`evaluate` in blocks, for records larger than memory.

        Rows without a temperature, or with a refused one, are left out. The index is X's, or row numbers where it has
        none.
        """
        for block, values, flagged in self._evaluated_blocks(X, y):
            rows = block.rows
            if isinstance(X, pd.DataFrame):
                index = X.index[rows]
            else:
                index = pd.RangeIndex(rows.start, rows.stop) if isinstance(rows, slice) else pd.Index(rows)
            yield pd.DataFrame({**values, "flag": flagged.column()}, index=index)

    def _check_corrected(self, corrected: np.ndarray, reading: Any) -> None:
        """Warn of corrected readings far from all readings."""
        if self.features_.reference is None:
            check_corrected(self.reading_, corrected, reading, self._level_asked_for())

    def _level_asked_for(self) -> tuple[float, ...]:
        """U0 where T0 lies outside the fitted temperatures."""
        low, high = self.reading_.temperature_range
        return () if low <= self.reference_temperature_ <= high else (self.intercept_,)

    def _solve(self, record: Record, features: DiffusiveFeatures) -> None:
        """Learn the coefficients from a record."""
        self._swept = sweep_effects(record, features.effect_list(), equal_edges(record))
        if record.weight is not None:  # the noise is not that of the bins
            self._swept.binned = None
        features.remember(record, self._swept.end_states)
        self._take(features, self._swept)

    def _take(self, features: DiffusiveFeatures, swept: Swept) -> None:
        """Become the model with these columns and coefficients."""
        self._swept, self._solution = swept, swept.solution(self.alpha_)
        ridge = MergedRidge(self.alpha_).take(self._solution, swept.reading_offset)
        self.pipeline_ = Pipeline([("features", features), ("ridge", ridge)])
        # An unknown start is felt for three of the longest time constant: 5 % of it is left then.
        self.washout_ = 3.0 * features.memory()

    def _learn_levels(self, record: Record) -> None:
        """Give each run its level, the first step of `fit`."""
        self._run_levels = RunLevels() if self.run is None else run_levels(record)

    def _unfitted_features(self, time_constants: Any, levels: RunLevels | None = None) -> DiffusiveFeatures:
        """Unfitted features with these time constants.

        They have the steps between the runs of the record, or those given.
        """
        names = (set(DiffusiveFeatures._get_param_names()) & set(self._get_param_names())) - {"time_constants"}
        given = {name: getattr(self, name) for name in names}
        given["degree"] = min(self.degree, getattr(self, "_degree", self.degree))
        features = DiffusiveFeatures(time_constants, **given)
        levels = getattr(self, "_run_levels", RunLevels()) if levels is None else levels
        features.set_params(effects=levels.added_to(as_effects(self.effects)))
        features.set_output(transform="default")  # arrays inside, whatever scikit-learn is set to
        return features

    def _evaluated_blocks(self, X: Any, y: Any) -> Iterator[tuple[Block, dict[str, np.ndarray], Flags]]:
        """`evaluate` as arrays, block by block."""
        reading, level = self._reading_numbers(X, y), self._level(X)
        for block, parts in self._weighed_blocks(X, *self._resumed_with_gaps(X)):
            given = np.asarray(reading[block.rows], float)
            measured = self._screened(block, given)
            model = parts.sum(axis=1) + level[block.rows]
            yield (
                block,
                {"corrected": measured - self._removed_part(parts), "model": model, "residual": measured - model},
                self._block_flags(block, given, parts),
            )

    def __sklearn_tags__(self) -> Any:
        tags = super().__sklearn_tags__()
        tags.input_tags.allow_nan = True  # rows with NaN in the temperature are passed over
        tags.regressor_tags.poor_score = True  # of many columns it uses one, unless effects name others
        return tags


def largest_lag(model: DynamicBiasRegressor) -> float | None:
    """Time constant of the largest lag [s], or None."""
    if not len(model.time_constants_):
        return None
    before = takewhile(lambda effect: not isinstance(effect, ThermalLag), model.features_.effect_list())
    start = sum(effect.n_columns() for effect in before)
    mu = np.abs(model.coef_[start : start + len(model.time_constants_)])
    return float(model.time_constants_[int(mu.argmax())])

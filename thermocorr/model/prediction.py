"""What a fitted regressor gives: contributions, flags, inner temperatures."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from sklearn.pipeline import Pipeline
from sklearn.utils.validation import check_is_fitted

from ..effects import InitialTransient, StaticPolynomial, ThermalLag
from ..effects.stream import Walked
from ..effects.thermal import column_text
from ..readers.form import Form
from ..records import Block, Record, SegmentStart
from ..records.gate import JUMP, Doubt
from ..records.numbers import as_data, is_frame, numeric_column, numeric_reading
from ..records.record import Flags
from ..records.screen import left_out
from .checks import UnitGuard, learned_ranges
from .features import DiffusiveFeatures
from .fitting import standard_errors
from .input_errors import MOST_SPOILT, SPOILT, GapError, InputLaw, error_behind_gaps, laws_of_inputs
from .progress import one_blas_thread
from .reading import Reading, like, no_flags
from .tables import coefficient_table, distinct, equation_text


class Same:
    """One number for every row."""

    def __init__(self, value: float):
        self.value = value

    def __getitem__(self, rows: Any) -> float:
        return self.value

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        return np.asarray(self.value, dtype)


class Inner(NamedTuple):
    """Temperatures inside the device, one column per time constant."""

    block: Block
    temperature: np.ndarray
    """psi_j + psi_0j of eqs. (17) (18): what the part of the device with this time constant feels, shape (n, J)."""
    start: np.ndarray
    """psi_0j of eq. (18): what is left of its unknown temperature at the start of the segment, shape (n, J) [K]."""
    difference: np.ndarray
    """Psi_j of eq. (19): how much warmer it is than the ambient, shape (n, J) [K]."""


def inner_blocks(model: Any, steps: Iterator[Walked]) -> Iterator[Inner]:
    """Inner temperatures along a walk through a record.

    The start of a part follows from its two coefficients, psi_0j = nu_j / mu_j: where mu_j is small against its
    standard error, it is as uncertain as their ratio.

    `model` (DynamicBiasRegressor): Fitted, with lags of the temperature. `steps` (iterator of Walked): Of all effects
    of the model. Raises ValueError for a model without lags: a static model knows of nothing inside.
    """
    features = model.features_
    lag, lags = features.first_of(ThermalLag)
    if lag is None:
        raise ValueError("The model has no lags: a static model knows of no temperature inside of the device.")
    taus, mu = lag.time_constants_, model.coef_[lags]
    start, decays = features.first_of(InitialTransient)
    weights = np.zeros((decays.stop - decays.start, len(taus)))
    if start is not None:
        own = np.concatenate([*start.decays_.values(), np.zeros(0)])
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = model.coef_[decays, None] / mu
        weights = np.where((own[:, None] == taus) & (mu != 0), ratio, 0.0)
    for step in steps:
        psi_0 = step.columns[:, decays] @ weights  # eq. (18)
        difference = step.columns[:, lags] + psi_0  # eq. (19)
        yield Inner(step.block, difference + step.block.temperature[:, None], psi_0, difference)


class FittedModel:
    """The part of `DynamicBiasRegressor` that needs no data to be fitted."""

    pipeline_: Pipeline
    reading_: Reading
    form_: Form | None
    """How the log was written that it was fitted to, where `read_log` read it."""
    washout_: float
    alpha_: float
    _known_standard_errors: np.ndarray
    _solution: Any
    _swept: Any

    def coef_table(self) -> pd.DataFrame:
        """Coefficient, unit and standard error of every column.

        Standard errors stay true for residuals that are correlated in time (delete-a-block jackknife), as long as
        they forget within a twentieth of the record.
        """
        errors = self._standard_errors()
        return coefficient_table(self.features_.effect_list(), self._all_coefficients(), errors, self.reading_)

    def _standard_errors(self, combinations: np.ndarray | None = None) -> np.ndarray:
        """Standard errors of U0 and coefficients, (1 + n_columns,).

        With `combinations` of shape (k, n_columns) those of linear combinations of `coef_`, shape (k,). Raises
        ValueError for one read from a file, which does not hold the factors of its record.
        """
        check_is_fitted(self, "pipeline_")
        if combinations is None and hasattr(self, "_known_standard_errors"):
            return self._known_standard_errors
        if not hasattr(self, "_swept"):
            raise ValueError("A model read from a file does not hold the factors of its record. Fit it again.")
        with one_blas_thread():
            if combinations is not None:
                rows = np.column_stack((np.zeros(len(combinations)), combinations))
                return standard_errors(self._swept, self._solution, self.alpha_, rows)
            self._known_standard_errors = standard_errors(self._swept, self._solution, self.alpha_)
        return self._known_standard_errors

    def equation(self) -> str:
        """The fitted formula as text."""
        check_is_fitted(self, "pipeline_")
        temperature = column_text(self.features_.history_.record.temperature_name)
        reading, reference = self.reading_, self.features_.reference
        learned = reading if reference is None else replace(reading, name=f"{reading.name} - {reference}")
        return equation_text(self.features_.effect_list(), self._all_coefficients(), learned, temperature)

    @property
    def features_(self) -> DiffusiveFeatures:
        """The fitted features of `pipeline_`."""
        check_is_fitted(self, "pipeline_")
        features: DiffusiveFeatures = self.pipeline_[0]
        return features

    @property
    def coef_(self) -> np.ndarray:
        """Coefficients of `pipeline_`, shape (n_columns,)."""
        return np.asarray(self.pipeline_[1].coef_)

    @property
    def intercept_(self) -> float:
        """U0: reading at the reference temperature, device at rest."""
        return float(self.pipeline_[1].intercept_)

    @property
    def residual_std_(self) -> float:
        """Standard deviation of the fitted residuals [unit of y]."""
        return float(self.pipeline_[1].residual_std_)

    @property
    def degree_(self) -> int:
        """Highest power of T - T0 that the temperatures determine."""
        return next((e.degree for e in self.features_.effect_list() if isinstance(e, StaticPolynomial)), 0)

    @property
    def time_constants_(self) -> np.ndarray:
        """Time constants of the lags [s]."""
        return self.features_.time_constants_

    @property
    def thermometers_(self) -> dict[Any, np.ndarray]:
        """Time constants of the bodies that follow each thermometer [s]."""
        features = self.features_
        ambient = features.history_.record.temperature_name
        return {ambient: self.time_constants_, **features.thermometers().times_in(features.effects_)}

    def _fixed_time_constants(self) -> Any:
        """The time constants as the parameter `time_constants`."""
        found = {name: times.tolist() for name, times in self.thermometers_.items()}
        return found if len(found) > 1 else self.time_constants_.tolist()

    @property
    def reference_temperature_(self) -> float:
        """T0."""
        return self.features_.reference_temperature_

    def contributions(self, X: Any) -> pd.DataFrame:
        """Contribution of each effect to the bias [unit of y].

        One column per effect, in the order of the effects.
        """
        parts = self._contributions(X)
        labels = distinct([effect.label() for effect in self.features_.effect_list()])
        return pd.DataFrame(parts, columns=labels, index=X.index if isinstance(X, pd.DataFrame) else None)

    def inner_temperatures(self, X: Any) -> pd.DataFrame:
        """Temperatures inside the device, that follow the ambient one.

        Parameters
        ----------
        X : as for `predict`

        Returns
        -------
        DataFrame
            Columns of two levels. The first: "temperature" (psi_j + psi_0j of eqs. (17) (18), unit of X's temperature),
            "start" (psi_0j of eq. (18): what is left of an unknown start, [K]) and "difference" (Psi_j of eq. (19):
            inner less ambient temperature, [K]). The second: the time constants [s]. NaN in rows that are passed over.

        Raises
        ------
        ValueError
            For a model without lags.

        Examples
        --------
        >>> from thermocorr import DynamicBiasRegressor
        >>> from thermocorr.datasets import make_record
        >>> record = make_record(2000, seed=1)
        >>> model = DynamicBiasRegressor("temperature", [300.0, 5400.0]).fit(record, record["reading"])
        >>> inner = model.inner_temperatures(record)["temperature"]
        >>> bool(inner[5400.0].std() < inner[300.0].std() < record["temperature"].std())  # the slower, the calmer
        True
        """
        record, starts, states = self._resumed(X)
        found: dict[str, np.ndarray] = {}
        for inner in inner_blocks(self, self.features_.walk_resumed(record, starts, states)):
            for name, part in zip(("temperature", "start", "difference"), inner[1:], strict=True):
                whole = found.setdefault(name, np.full((inner.block.record.n_rows, part.shape[1]), np.nan))
                whole[inner.block.rows] = part
        index = X.index if isinstance(X, pd.DataFrame) else None
        parts = [pd.DataFrame(part, columns=self.time_constants_, index=index) for part in found.values()]
        return pd.concat(parts, axis=1, keys=found, names=["", "time constant [s]"])

    def flags(self, X: Any, y: Any = None) -> Any:
        """Why a row deserves no trust, or "".

        "no temperature", "no reading", "sentinel" or "spike" (of an input or the reading, see `screen`), "other unit"
        (a single temperature that looks like kelvin where degC was fitted, or the other way round), "washout", "outside
        fitted range": of the temperature, or of what an effect makes of its columns, by more than three standard
        deviations of the residuals. "jump": an input moved faster than it ever did, and the value before stands in its
        place until the next row speaks for it. "doubtful
        input": what stands still or has jumped, in this row or before, may move the bias by more than the
        residuals' standard deviation: late bodies feel it for a while. "behind gap": what the temperature may have done
        in gaps between rows moves it by as much.
        """
        reading = None if y is None else self._reading_numbers(X, y)
        record, starts, states = self._resumed_with_gaps(X)
        flags = no_flags(record)
        for block, parts in self._weighed_blocks(X, record, starts, states):
            flags[block.rows] = self._block_flags(block, None if reading is None else reading[block.rows], parts)
        return like(X, flags.column() if isinstance(X, pd.DataFrame) else flags.texts(), "flag")

    def _reading_numbers(self, X: Any, y: Any) -> NDArray[Any]:
        """Readings as numbers; RecordError for another named unit."""
        UnitGuard.of(self).check_readings(y, X)
        return numeric_reading(y, X)

    def _all_coefficients(self) -> np.ndarray:
        return np.concatenate(([self.intercept_], self.coef_))

    def _contribution_blocks(self, X: Any) -> Iterator[tuple[Block, np.ndarray]]:
        """Contributions block by block, (n, n_effects)."""
        yield from self._weighed_blocks(X, *self._resumed(X))

    def _weighed_blocks(self, X: Any, record: Record, starts: Any, states: Any) -> Iterator[tuple[Block, np.ndarray]]:
        UnitGuard.of(self).check_record(record, X)
        return self._weighed(self.features_.walk_resumed(record, starts, states))

    def _residual_blocks(self, record: Record) -> Iterator[tuple[Block, np.ndarray]]:
        """Residuals of a record, block by block."""
        assert record.reading is not None
        for block, parts in self._contribution_blocks(record):
            measured = self._screened(block, np.asarray(record.reading[block.rows], float))
            yield block, measured - (parts.sum(axis=1) + self.intercept_)

    def _contributions(self, X: Any) -> np.ndarray:
        """Contribution of each effect at each row, shape (n_rows, n_effects)."""
        return self._parts(X)[0]

    def _parts(self, X: Any, reading: Any = None) -> tuple[np.ndarray, np.ndarray]:
        """`_contributions`, and the readings that the screen believes, shape (n_rows,)."""
        parts: np.ndarray | None = None
        accepted = np.array([] if reading is None else reading[:], float)
        for block, values in self._contribution_blocks(X):
            if parts is None:
                parts = np.full((block.record.n_rows, values.shape[1]), np.nan, order="F")
            parts[block.rows] = values
            if reading is not None:
                accepted[block.rows] = self._screened(block, accepted[block.rows])
        assert parts is not None  # a record has at least one block
        return parts, accepted

    def _removed_part(self, contributions: np.ndarray) -> np.ndarray:
        """The bias that `correct` removes, shape (n,)."""
        removed = [effect.removed_by_correct for effect in self.features_.effect_list()]
        return np.asarray(contributions[:, removed].sum(axis=1) + self._removed_level)

    @property
    def _removed_level(self) -> float:
        """Part of U0 that is bias: all or nothing."""
        return 0.0 if self.features_.reference is None else self.intercept_

    def _level(self, X: Any) -> Any:
        """U0 in each row, shape (n_rows,).

        NaN where X has no reference.
        """
        name = self.features_.reference
        if name is None:
            return Same(self.intercept_)
        X = as_data(X)
        if not is_frame(X) or name not in X.columns:
            return Same(np.nan)
        return np.asarray(numeric_column(X, name, "reference")[:], float) + self.intercept_

    def _weighed(self, steps: Iterator[Walked]) -> Iterator[tuple[Block, np.ndarray]]:
        """Blocks of a walk with all contributions, (n, n_effects)."""
        effects, coef = self.features_.effect_list(), self.coef_
        edges = np.cumsum([0, *(effect.n_columns() for effect in effects)])
        for step in steps:
            parts = np.empty((len(step.block), len(effects)), order="F")  # sums over effects go column by column
            for i, (low, high) in enumerate(pairwise(edges)):
                alive = effects[i].alive(step.block)
                parts[:, i] = _weighted(step.columns[:, low:high][:, alive], coef[low:high][alive])
            yield step.block, parts

    def _gap_error(self) -> GapError:
        """Propagates what happened in gaps of later rows to the bias."""
        gaps = self.features_.history_.gaps
        return GapError([*self._laws_of_inputs(gaps.squares)], gaps)

    def _resumed(self, X: Any, y: Any = None) -> tuple[Record, dict[int, SegmentStart], dict[int, list[Any]]]:
        """A new record tied to the fitted one, doubts included."""
        record, starts, states = self.features_.resume(X, y)
        if record.twins and record.doubt is None:
            record = replace(record, doubt=self._doubt_of(record, starts, states))
        return record, starts, states

    def _doubt_of(
        self, record: Record, starts: dict[int, SegmentStart], states: dict[int, list[Any]]
    ) -> NDArray[np.float64]:
        """Change of the bias by doubted inputs, (n_rows,).

        0 where all that was doubted is accepted (`thermocorr.records.gate.Doubt`).
        """
        columns = {
            name: np.where(np.isnan(twin), np.asarray(record.columns[name], float), twin)
            for name, twin in record.twins.items()
        }
        other = replace(record, columns={**record.columns, **columns}, twins={}, known_moments={})
        doubt, walked = np.zeros(record.n_rows), self.features_.walk_resumed
        inputs, none = list(record.twins), np.zeros(record.n_rows, bool)
        doubted = np.column_stack([np.isfinite(twin) for twin in record.twins.values()])
        accepted = np.column_stack([record.accepted.get(name, none) for name in inputs])
        judged = Doubt(len(inputs), self.residual_std_, self.washout_)
        with np.errstate(over="ignore", invalid="ignore"):  # powers of what is far outside
            both = (self._weighed(walked(each, starts, states)) for each in (record, other))
            for (block, one), (_, two) in zip(*both, strict=True):
                if block.start == record.segments[block.segment].start:
                    judged.put()
                difference = self._removed_part(one) - self._removed_part(two)
                doubt[block.rows] = judged.rows(doubted[block.rows], accepted[block.rows], difference, block.seconds)
        return doubt

    def _resumed_with_gaps(self, X: Any, y: Any = None) -> tuple[Record, dict[int, SegmentStart], dict[int, list[Any]]]:
        """`_resumed`, with the errors of gaps."""
        record, starts, states = self._resumed(X, y)
        if record.gap_variance is None:
            record = replace(record, gap_variance=self._gap_error().of_record(record, starts))
        return record, starts, states

    def _without_spoilt(self, record: Record) -> Record:
        """The record without readings that gaps have spoilt.

        By a share of the residuals' deviation: in their own rows, and for a while after these.
        """
        if record.reading is None:
            return record
        limit = SPOILT * self.residual_std_
        rows, error = error_behind_gaps(record, self._laws_of_inputs(record.columns), limit)
        rows = rows[np.argsort(-error, kind="stable")[: int(MOST_SPOILT * record.n_used)]]
        if not len(rows):
            return record
        return replace(record, reading=left_out(record.reading, rows))

    def _mark_doubted(self, flags: Flags, block: Block) -> None:
        """Flag rows in which doubted inputs matter."""
        record = block.record
        if record.held is not None:
            flags[record.held[block.rows]] = JUMP
        if record.doubt is not None:
            doubted = flags.are("", "outside fitted range")
            flags[doubted & (record.doubt[block.rows] > self.residual_std_)] = "doubtful input"
        if record.gap_variance is not None:
            self._mark_behind_gaps(flags, record.gap_variance[block.rows])

    def _mark_behind_gaps(self, flags: Flags, variance: np.ndarray) -> None:
        """Flag rows whose bias is uncertain behind a gap."""
        flags[flags.are("", "outside fitted range") & (variance > self.residual_std_**2)] = "behind gap"

    def _laws_of_inputs(self, columns: Iterable[Any]) -> Iterator[InputLaw]:
        """Made when they are asked for."""
        features = self.features_
        temperature = features.history_.record.temperature_name
        yield from laws_of_inputs(features.effect_list(), self.coef_, temperature, columns, self.residual_std_)

    def _learned_ranges(self) -> np.ndarray:
        """`learned_ranges` of this model, found once."""
        if "_known_ranges" not in self.__dict__:
            self._known_ranges = learned_ranges(self)
        return self._known_ranges

    def _block_flags(self, block: Block, reading: np.ndarray | None, parts: np.ndarray) -> Flags:
        """Flags of a block's rows, from the contributions."""
        T = block.temperature
        flags = Flags(len(block))
        low, high = self._learned_ranges().T
        outside = self.reading_.outside(T) | np.any((parts < low) | (parts > high), axis=1)
        if outside.any():
            flags[outside] = "outside fitted range"
        flags[self._in_washout(block)] = "washout"
        if reading is not None:
            if np.isnan(reading.sum()):
                flags[np.isnan(reading)] = "no reading"
            for rows, reason in self._refused(block, reading):
                flags[rows] = reason
        self._mark_doubted(flags, block)
        return flags

    def _in_washout(self, block: Block) -> NDArray[np.bool_]:
        """Rows of a block that feel an unknown start."""
        return (block.elapsed < self.washout_) & (block.segment_key is None)

    def _screened(self, block: Block, reading: np.ndarray) -> np.ndarray:
        """Readings of a block that pass the screen, (n,)."""
        refused = self._refused(block, reading)
        if refused:
            reading = reading.copy()
            for rows, _ in refused:
                reading[rows] = np.nan
        return reading

    def _refused(self, block: Block, reading: np.ndarray) -> list[tuple[np.ndarray, str]]:
        """Numbers of a block's readings that are refused, by reason."""
        screen = self.features_.history_.screen
        if screen is None:
            return []
        return screen.reading.reasons(reading, lambda k: block.record.stamp(int(block.places[k])))


def _weighted(columns: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """``columns @ weights``, equal in every block."""
    total = np.zeros(len(columns))
    for column, weight in zip(columns.T, weights, strict=True):
        if column[0] or column[-1] or column.any():  # decays that are over are zero
            total += column * weight
    return total

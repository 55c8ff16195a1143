"""Readings that a model is fitted to; coverage of its inputs.

A row can lie between the lowest and the highest temperature and still be far from any of them, as between two plateaus:
a hidden extrapolation. Its leverage in the static law is larger there than that of any row of the record (Montgomery,
Peck & Vining, Introduction to Linear Regression Analysis, section 3.8).
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.polynomial import legendre
from numpy.typing import NDArray
from sklearn.utils.validation import _num_samples, validate_data

from ..effects import Covariate, Interaction, LaggedCovariate
from ..effects.grids import since_start
from ..effects.protocol import Effect
from ..records import Layout, Record, RecordError, read_record
from ..records.errors import quoted, times_word, warn
from ..records.numbers import as_data, as_pandas, check_same_rows, is_frame, numeric_reading
from ..records.read import refuse_labels_of_rows
from ..records.record import Flags
from ..records.screen import WeightedReading
from ..records.types import Number, Size, within
from ..records.units import unit_of, units_differ

RESOLVED_SHARE = 1e-9
"""Share of its size to which a recorded number can be resolved, at best.

Nobody measures a part in 1e9 of a temperature, and few of anything: a microkelvin at 300 K is three times that. What a
constant number shows below it is rounding: a double ends at 2e-16 of its size, and what sums and differences make of
that stays below 1e-12. A coefficient for it is the noise of the reading divided by rounding: 1e25 per kelvin.
With half or twice of it nothing changes: between rounding and the finest thermometers there are three decades.
"""


def resolved(low: float, high: float) -> float:
    """Resolution of numbers between two limits."""
    # Smaller numbers count as this large: a constant less its mean is rounding about zero. Not larger, for a
    # temperature may come in volts of a thermocouple or amperes of a sensor.
    return RESOLVED_SHARE * max(abs(low), abs(high), 1e-3)


def is_flat(low: float, high: float) -> bool:
    """True if numbers between two limits never change beyond their rounding."""
    return high - low <= resolved(low, high)


def flat_text(low: float, high: float, n_rows: int) -> str:
    """Description of constant numbers, to follow "The temperature never changes"."""
    if low == high:
        return f": it is {low:.6g} in all {n_rows} rows"
    return (
        f" beyond its rounding: its span is {high - low:.2g} about {low:.6g} in all {n_rows} rows, where a number of "
        f"this size can be resolved to about {resolved(low, high):.1g}"
    )


def flat_effects(record: Record, effects: Sequence[Effect]) -> list[Any]:
    """Effects whose recorded column never changes.

    They get no coefficient (`thermocorr.model.fitting.sweep_effects`). A user's own effects may make anything of a
    column and are not among them.
    """
    found = []
    for effect in effects:
        if type(effect) in (Covariate, LaggedCovariate, Interaction):
            values = record.moments(effect.column, getattr(effect, "power", 1))
            if is_flat(values.low, values.high):
                found.append(effect)
    return found


def flat_columns(record: Record, effects: Sequence[Effect]) -> list[str]:
    """Sentence on each column that never changes."""
    said = {}
    for column in dict.fromkeys(effect.column for effect in flat_effects(record, effects)):
        values = record.moments(column)
        said[column] = (
            f"The column {quoted(column)} never changes{flat_text(values.low, values.high, record.n_used)}. Nothing "
            "can be learned about its effect, whose coefficients are 0. Leave it out, or record while the column moves."
        )
    return list(said.values())


BINS = 100
"""Parts of the range of temperatures; what a part holds counts as its middle."""
FARTHER = 10.0
"""Leverage between the temperatures of a record, over the largest at any of them, at which a law is not determined:
there, it is more than three times as uncertain as wherever the record has been."""


class Coverage(NamedTuple):
    """Range of the temperatures, gaps, and the degree they determine."""

    degree: int
    """The highest power of the static law that they do, at most the one that is wanted."""
    gaps: tuple[tuple[float, float], ...]
    """Stretches between them in which one power more, by which the law could be checked, would not be known."""

    @classmethod
    def of(cls, record: Record, degree: int) -> Coverage:
        """Of the temperatures of a record, in one pass."""
        name = record.temperature_name
        moments = record.moments(name)
        edges = np.linspace(moments.low, moments.high, BINS + 1)
        if degree < 1 or not moments.low < moments.high:
            return cls(degree, ())
        counts = np.zeros(BINS, int)
        for values in record.chunks(record.columns[name]):
            known = values[np.isfinite(values)]
            part = ((known - moments.low) * (BINS / (moments.high - moments.low))).astype(np.intp)
            counts += np.bincount(np.minimum(part, BINS - 1), minlength=BINS)
        empty = counts == 0
        if not empty.any():
            return cls(degree, ())
        while degree > 1 and _leverage(counts, degree)[empty].max() > FARTHER:
            degree -= 1
        unknown = empty & (_leverage(counts, degree + 1) > FARTHER)
        ends = np.flatnonzero(np.diff(unknown, prepend=False, append=False)).reshape(-1, 2)
        return cls(degree, tuple((float(edges[low]), float(edges[high])) for low, high in ends))


def _leverage(counts: np.ndarray, degree: int) -> np.ndarray:
    """Relative leverage of each bin's middle, (BINS,).

    Infinite where the bins that hold rows do not determine the law.
    """
    middle = (np.arange(BINS) + 0.5) / (BINS / 2) - 1
    basis = legendre.legvander(middle, degree)
    rows = np.sqrt(counts)[:, None] * basis
    half = np.asarray(np.linalg.qr(rows, mode="r"))
    sizes = np.abs(np.diag(half))
    if not sizes.min() > 1e-9 * sizes.max():
        return np.where(counts > 0, 1.0, np.inf)
    found = np.sum(np.linalg.solve(half.T, basis.T) ** 2, axis=0)
    return np.asarray(found / found[counts > 0].max())


def check_columns(estimator: Any, X: Any, reset: bool) -> Any:
    """scikit-learn's checks of X, for frames and arrays.

    The reference of the readings is no feature: rows that are corrected need none.
    """
    given = X = as_data(X)
    if estimator.reference is not None and isinstance(X, pd.DataFrame):
        X = X.drop(columns=[estimator.reference], errors="ignore")
    if isinstance(X, pd.Series):
        raise RecordError(
            "X is a Series. Reshape your data: pass a DataFrame, for example with X.to_frame(), whose columns are the "
            "temperature and whatever else was recorded."
        )
    if isinstance(X, pd.DataFrame):
        if X.shape[1] == 0:
            raise RecordError(
                f"Found array with 0 feature(s) (shape={X.shape}) while a minimum of 1 is required: the data have no "
                "columns. The temperature is needed."
            )
        if len(X) == 0:
            raise RecordError("The data have 0 rows. Check the file, or the selection that made them.")
        if not X.columns.is_unique:
            twice = X.columns[X.columns.duplicated()][0]
            raise RecordError(f"Several columns are called {twice!r}. Give columns unique names.")
        _check_names(estimator, X, reset)
        return given
    return validate_data(
        estimator, X, reset=reset, dtype=np.float64, ensure_all_finite="allow-nan", accept_sparse=False
    )


def _check_names(estimator: Any, X: pd.DataFrame, reset: bool) -> None:
    """Set or compare names and number of columns.

    Names that are text are set here, and are found to be the fitted ones: scikit-learn's way to them, which has any
    library's frames in mind, takes a twentieth of a fit. It is asked, and raises, wherever there is more to say.
    """
    names = np.array(X.columns.tolist(), dtype=object)
    plain = all(type(name) is str for name in names)
    if plain and reset:
        estimator.feature_names_in_, estimator.n_features_in_ = names, len(names)
    elif not (plain and np.array_equal(getattr(estimator, "feature_names_in_", ()), names)):
        validate_data(estimator, X, skip_check_array=True, reset=reset)


def no_flags(record: Record) -> Flags:
    """Flags of rows outside any block."""
    flags = Flags(record.n_rows, "no temperature")
    for refused in record.refused:
        flags[refused.rows] = refused.reason
    return flags


def like(X: Any, values: np.ndarray, name: str) -> Any:
    """Values as a Series for a DataFrame, else an array."""
    return pd.Series(values, index=X.index, name=name) if isinstance(X, pd.DataFrame) else values


@dataclass(frozen=True, kw_only=True)
class Reading:
    """Names, units and ranges of what was fitted."""

    name: str
    unit: str
    temperature_unit: str
    n_readings: Annotated[int, within(1, 1 << 53)]
    mean: Number
    std: Size
    temperature_range: tuple[Number, Number]
    temperature_gaps: tuple[tuple[Number, Number], ...] = ()
    """Stretches of that range in which no row was, and the static law is not known, see
    `thermocorr.model.reading`."""
    unit_named: bool = True
    """True if the record names the unit of its temperature; else its values were taken for degC or K by their size."""

    @classmethod
    def of(cls, X: Any, y: Any, record: Record) -> Reading:
        """Look once through readings and temperatures, block by block."""
        name = getattr(y, "name", None)
        if isinstance(y, pd.DataFrame):
            name = y.columns[0]
        unit = unit_of(name, y) or unit_of(name, X) if name is not None else ""
        readings, temperatures = record.reading_moments(), record.moments(record.temperature_name)
        if readings.n == 0:
            raise RecordError(
                f"All {record.n_rows} readings are missing (NaN). Check the name of the reading's column and the file."
            )
        degrees = unit_of(record.temperature_name, X)
        return cls(
            name="reading" if name is None else str(name),
            unit=unit,
            temperature_unit=degrees or unit_by_size(temperatures.low),
            n_readings=readings.n,
            mean=readings.mean,
            std=readings.std,
            temperature_range=(temperatures.low, temperatures.high),
            unit_named=bool(degrees),
        )

    def outside(self, temperature: np.ndarray) -> NDArray[np.bool_]:
        """Mask of temperatures outside the fitted ones."""
        low, high = self.temperature_range
        found = (temperature < low) | (temperature > high)
        for low, high in self.temperature_gaps:
            found |= (temperature > low) & (temperature < high)
        return np.asarray(found)


def unit_by_size(low: float) -> str:
    """The unit of temperatures that have none named."""
    # Temperatures without a unit that are all above 150 are taken as kelvin, others as degC.
    return "K" if low > 150.0 else "degC"


def check_plausible(record: Record, reading: Reading) -> None:
    """Refuse a constant temperature; warn of implausible ones."""
    low, high = reading.temperature_range
    if reading.n_readings > 1 and is_flat(low, high):
        raise RecordError(
            f"The temperature never changes{flat_text(low, high, record.n_used)}. Nothing can be learned about its "
            f"effect. Is {quoted(record.temperature_name)} the right column?"
        )
    if low < -460.0 or high > 5000.0:
        warn(
            f"The temperature {quoted(record.temperature_name)} runs from {low:.6g} to {high:.6g}: that is neither "
            "degC, K nor degF. The fit is valid, but coefficients are per unit of that column. Is it the right one?"
        )
    if reading.n_readings > 1 and reading.std == 0:
        warn(
            f"The reading never changes: it is {reading.mean:.10g} in all {reading.n_readings} rows. Is it the right "
            "column, and was the instrument running?"
        )


def _check_reference(reference: Any, X: Any, y: Any) -> None:
    """Refuse a reference with a wrong name or unit."""
    if reference is None:
        return
    if not isinstance(reference, str):
        raise RecordError(f"The reference is the name of a column. Got {reference!r:.60}.")
    name = y.columns[0] if isinstance(y, pd.DataFrame) and y.shape[1] == 1 else getattr(y, "name", None)
    if name == reference:
        raise RecordError(f"{quoted(name)} cannot be the reading and its own reference. Name the better instrument.")
    one, other = "" if name is None else unit_of(name, y) or unit_of(name, X), unit_of(reference, X)
    if units_differ(str(name), one, reference, other):
        raise RecordError(
            f"The reading {quoted(name)} is in {one}, and its reference {quoted(reference)} in {other}. Convert one of "
            "them."
        )


def check_corrected(fitted: Reading, corrected: np.ndarray, given: Any, expected: tuple[float, ...] = ()) -> None:
    """Warn about corrected readings that leave all readings far behind.

    Readings are those given, and the fitted ones (mean +- 10 standard deviations); far is more than the width of that
    range beyond it. Where nothing is far, this is two looks at the corrected readings.

    `fitted` (Reading). `corrected` (array of shape (n_rows,)): NaN where there is none. `given` (array-like of shape
    (n_rows,)): Readings before the correction. `expected` (tuple of float): Levels that corrected readings may have
    for a reason of their own.
    """
    # A corrected reading is usual within ten standard deviations of the fitted ones.
    usual = 10.0 * fitted.std
    levels = (fitted.mean - usual, fitted.mean + usual, *expected)
    ends = np.fmin.reduce(corrected, initial=np.inf), np.fmax.reduce(corrected, initial=-np.inf)
    if not _far(levels, *ends):
        return
    readings = np.asarray(given[:], float)
    levels = (*levels, np.fmin.reduce(readings, initial=np.inf), np.fmax.reduce(readings, initial=-np.inf))
    levels = tuple(level for level in levels if np.isfinite(level))
    if not _far(levels, *ends):
        return
    low, high = min(levels), max(levels)
    beyond = np.maximum(low - corrected, corrected - high)
    rows = np.flatnonzero(beyond > _width(low, high))
    worst = int(np.nanargmax(beyond))
    warn(
        f"The corrected reading leaves the readings far behind in {times_word(len(rows), 'row')} of {len(corrected)}, "
        f"the first is row {rows[0]}: it comes to {corrected[worst]:.10g} in row {worst}, and the readings, those "
        f"given and those fitted, lie between {low:.10g} and {high:.10g}. What was taken away there is no bias of this "
        "instrument: see with contributions(X) which effect makes it, and with flags(X) whether the temperature is "
        "outside the fitted range."
    )


def _far(levels: tuple[float, ...], low: float, high: float) -> bool:
    """True if values lie beyond all levels."""
    width = _width(min(levels), max(levels))
    return low < min(levels) - width or high > max(levels) + width


def _width(low: float, high: float) -> float:
    """Width of a range; of one number its resolution."""
    return max(high - low, resolved(low, high))


def learned_readings(X: Any, y: Any, layout: Layout, mask: Any, weight: Any) -> Any:
    """The readings to learn from, NaN where masked, and weights.

    `X`, `y`, `mask`, `weight` (see `DynamicBiasRegressor.fit`). `layout` (Layout): Where things stand in X. Raises
    RecordError for a reference, masks and weights that do not fit the record.
    """
    _check_reference(layout.reference, X, y)
    _refuse_short_runs(X, layout)
    if mask is not None:
        y = masked_readings(X, y, layout, mask)
    if weight is None:
        return y
    data = as_data(X)
    check_same_rows(as_pandas(weight), data, "sample_weight")
    return WeightedReading(y, _checked(weight, _num_samples(data)))


def _refuse_short_runs(X: Any, layout: Layout) -> None:
    """Refuse a column of runs that holds no labels."""
    X = as_data(X)
    if layout.run is None or not is_frame(X) or layout.run not in X.columns:
        return  # the record says what is wrong with it
    labels = X[layout.run]
    if np.ndim(labels) == 1:
        refuse_labels_of_rows(pd.Series(labels), layout.run)


def masked_readings(X: Any, y: Any, layout: Layout, mask: Any) -> Any:
    """The readings with NaN where they are masked."""
    X, y = as_data(X), as_pandas(y)
    check_same_rows(as_pandas(mask), X, "mask")
    values = np.array(numeric_reading(y, X), float)
    known = np.isfinite(values).any()
    values[_rows(X, layout, mask, len(values))] = np.nan
    if known and not np.isfinite(values).any():
        raise RecordError(
            f"The mask leaves out all readings of the {len(values)} rows: nothing is left to learn from. Mask less."
        )
    if isinstance(y, pd.DataFrame):
        y = y.iloc[:, 0]
    if not isinstance(y, pd.Series):
        return values
    masked = pd.Series(values, index=y.index, name=y.name)
    masked.attrs = dict(y.attrs)
    return masked


def _rows(X: Any, layout: Layout, mask: Any, n: int) -> np.ndarray:
    """Rows that are masked, shape (n,), booleans."""
    marks = isinstance(mask, list) and all(isinstance(mark, bool | np.bool_) for mark in mask)
    given = mask if isinstance(mask, list) and not marks else np.asarray(mask)
    if isinstance(given, np.ndarray) and given.dtype == object:
        given = given.astype(float)
    if isinstance(given, np.ndarray) and given.dtype.kind in "bif" and given.ndim == 1:
        if len(given) != n or not np.isin(given, (0, 1)).all():
            raise RecordError(
                f"The mask must say of each of the {n} rows whether it is left out, True or False. Got an array of "
                f"{len(given)}, with values such as {given[:1].tolist()}."
            )
        return np.asarray(given.astype(bool))
    record = read_record(X, layout, quiet=True)
    found = np.zeros(n, bool)
    seconds = record.times.seconds(slice(0, n), record.first_stamp())
    for stretch in mask:
        if isinstance(stretch, str) or np.ndim(stretch) != 1 or len(stretch) != 2:
            raise RecordError(
                "The mask must be an array of True and False, one for each row, or a list of (start, end). Got "
                f"{stretch!r} in a list."
            )
        start, end = (since_start(moment, record, "mask", "fit") for moment in stretch)
        if not start <= end:
            raise RecordError(f"The mask has a stretch that ends before it starts: {stretch!r}.")
        # a date alone is a whole day, as in slices of pandas
        whole_day = isinstance(stretch[1], str) and re.fullmatch(r"\d{4}-\d{2}-\d{2}", stretch[1].strip())
        inside = (seconds >= start) & (seconds < end + 86_400.0 if whole_day else seconds <= end)
        if not inside.any():
            warn(f"The mask has a stretch in which there are no rows: {stretch!r}.")
        found |= inside
    return found


def _checked(weight: Any, n: int) -> np.ndarray:
    """Weights as numbers of mean 1 where they count, shape (n,)."""
    values = np.asarray(weight, float)
    if values.ndim == 0:
        values = np.full(n, float(values))
    if values.shape != (n,):
        raise ValueError(f"sample_weight.shape == {values.shape}, expected {(n,)}: one weight for each row.")
    wrong = ~(np.isfinite(values) & (values >= 0))
    if wrong.any():
        raise RecordError(
            f"sample_weight must be finite and not negative. Row {int(wrong.argmax())} has {values[wrong][0]} "
            f"({times_word(int(wrong.sum()), 'such row')} of {n})."
        )
    if not values.any():
        raise RecordError("All weights of the readings are zero: there is nothing to learn from.")
    values = values / values.max()
    return np.asarray(values / values[values > 0].mean())

"""Residuals of a model, and the base that a judgement stands on."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from sklearn.base import clone

from ..effects import LagProducts, StaticPolynomial, ThermalLag
from ..effects.protocol import Effect
from ..estimators.holdout import rms
from ..estimators.input_errors import MANY, GapError
from ..estimators.regressor import DynamicBiasRegressor
from ..records import Block, Record
from ..records.history import Thinned
from ..records.screen import LeftOut
from .levels import APART, FASTEST, FEWEST_SAMPLES, LAGS, SLOWEST


@dataclass(frozen=True)
class ThermalBase:
    """The base: what the model has, with lags of its own in the place of the model's slow ones."""

    effects: list[Effect]
    """Static law, fast and middle lags, the model's further effects."""
    slow: list[Effect]
    """The model's slow lags, which compete with drift and ageing."""
    slowest: float
    """Time constant of the slowest lag [s]."""

    @classmethod
    def of(cls, model: DynamicBiasRegressor, record: Record) -> ThermalBase:
        """Unlearned effects, for this record or its averages."""
        slowest, own = _slowest(record), np.asarray(model.time_constants_, float)
        grid = np.geomspace(FASTEST * record.usual_step(), slowest, LAGS)
        further = [clone(effect) for _, effect in model.features_.further_effects()]
        if model.products_:
            further += [clone(effect) for effect in model.features_.effect_list() if isinstance(effect, LagProducts)]
        static = StaticPolynomial(model.degree, model.reference_temperature)
        taus = np.unique(np.concatenate((grid, own[own <= slowest])))
        taus = taus[np.concatenate(([True], np.diff(np.log(taus)) > APART))]
        slow: list[Effect] = [ThermalLag([tau]) for tau in own[own > slowest]]
        return cls([static, ThermalLag(taus.tolist()), *further], slow, slowest)


def _slowest(record: Record) -> float:
    """Time constant of the slowest lag of the base [s]: a share of all segments together, none longer than a segment.

    It is at least a few samples long, however short the segments.
    """
    together = sum(record.read_duration(segment) for segment in record.segments)
    return max(min(SLOWEST * together, record.longest_read()), FEWEST_SAMPLES * record.usual_step())


def residuals_of(model: DynamicBiasRegressor, read: Record, judged: Record) -> tuple[np.ndarray, float]:
    """Residual of each row of the judged record, NaN where there is none, and the rms residual of single readings.

    `model` (DynamicBiasRegressor): Fitted. `read` (Record): The user's record with its readings, see `record_of`.
    `judged` (Record): What `suspect_record` made of it.
    """
    if isinstance(judged, Thinned) and not isinstance(read, Thinned):
        return _averages(model, read, judged)
    residual = np.full(read.n_rows, np.nan)
    for block, values in _blocks(model, read, judged):
        residual[block.rows] = values
    return residual, single_rms(residual, judged) if isinstance(judged, Thinned) else rms(residual)


def beyond_judgement(model: DynamicBiasRegressor, read: Record) -> tuple[float, float]:
    """Share of the readings that gaps or filled cells have spoilt, where it is large, and the rms that is left of them.

    (0, 0) where they are few. They are neither learned from nor judged, and corrected all the same.
    """
    if not isinstance(read.reading, LeftOut):
        return 0.0, 0.0
    whole, spoilt = replace(read, reading=read.reading.column), np.zeros(read.n_rows, bool)
    rows = read.reading.rows
    spoilt[rows] = np.isfinite(np.asarray(read.reading.column[rows], float))
    share = float(spoilt.sum() / max(whole.reading_moments().n, 1))
    if share <= MANY:
        return 0.0, 0.0
    return share, rms(np.concatenate([values[spoilt[block.rows]] for block, values in model.residual_blocks(whole)]))


def felt_in_gaps(model: DynamicBiasRegressor, read: Record, slowest: float) -> float:
    """Sum of the variances of the judged readings by what the temperature did in gaps, in the unit of y squared.

    By lags up to the `slowest` [s]: slower ones may be there for a drift, and have weights that no body has. 0 where
    gaps have spoilt no reading: what is left of them in others is small.
    """
    if not isinstance(read.reading, LeftOut):
        return 0.0
    laws = [
        replace(law, weights=np.where(law.time_constants <= slowest, law.weights, 0.0))
        for law in model.gap_error().laws
    ]
    variance = GapError(laws, model.features_.history_.gaps).of_record(read, {})
    return 0.0 if variance is None else float(variance[np.isfinite(read.reading[:])].sum())


def _averages(model: DynamicBiasRegressor, read: Record, judged: Thinned) -> tuple[np.ndarray, float]:
    """`residuals_of` a record that is judged by averages of its rows."""
    sums, counts, squares, n = np.zeros(judged.n_rows), np.zeros_like(judged.counts), 0.0, 0
    for block, values in _blocks(model, read, judged):
        known = values[np.isfinite(values)]
        squares, n = squares + float(known @ known), n + len(known)
        _added(judged, block.places, values, sums, counts)
    means = np.divide(sums, counts, out=sums, where=counts > 0)
    means[counts == 0] = np.nan
    return means, float(np.sqrt(squares / max(n, 1)))


def _blocks(model: DynamicBiasRegressor, read: Record, judged: Record) -> Iterator[tuple[Block, np.ndarray]]:
    """Residuals block by block, NaN where the screen of a model's fit would refuse the reading or the temperature."""
    refused = np.concatenate([np.zeros(0, np.intp), *(found.rows for found in judged.refused if model.screen)])
    places = refused if read.order is None else np.flatnonzero(np.isin(read.order, refused))
    for block, values in model.residual_blocks(read):
        if len(places):
            values[np.isin(block.places, places)] = np.nan
        yield block, values


def _added(record: Thinned, rows: np.ndarray, values: np.ndarray, sums: np.ndarray, counts: np.ndarray) -> None:
    """Add values of rows of the longer record, in time order, to the sums and counts of the rows they fall into."""
    place = record.places_of(rows)
    inside = (place >= 0) & np.isfinite(values)
    if inside.any():
        place = place[inside]
        low, high = int(place.min()), int(place.max()) + 1
        sums[low:high] += np.bincount(place - low, values[inside], high - low)
        counts[low:high] += np.bincount(place - low, minlength=high - low).astype(counts.dtype)


def quiet_share(residual: np.ndarray, record: Record, loud: Sequence[tuple[float, float]]) -> float:
    """Rms residual outside of stretches of loud noise, first and last time [s], over that of all rows."""
    quiet = quiet_rows(residual, record, loud)
    return rms(quiet) / max(rms(residual), 1e-300) if loud and np.isfinite(quiet).any() else 1.0


def quiet_rows(residual: np.ndarray, record: Record, loud: Sequence[tuple[float, float]]) -> np.ndarray:
    """The residual of rows outside of stretches of loud noise, first and last time [s]."""
    if not loud:
        return residual
    seconds = record.times.seconds(np.arange(len(residual)), record.first_stamp())
    return residual[np.all([(seconds < start) | (seconds > end) for start, end in loud], axis=0)]


def single_rms(residual: np.ndarray, record: Thinned) -> float:
    """Rms residual of single readings, from that of averages and what they do not show."""
    known = np.isfinite(residual)
    return float(np.sqrt(np.average(residual[known] ** 2, weights=record.counts[known]) + record.unseen))

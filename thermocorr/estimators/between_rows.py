"""What the temperature may do between two rows, where a model takes it for a straight line."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ..effects import ThermalLag
from ..equations import lag_differences
from ..records import Record
from ..records.gaps import least_gap


class BetweenRows(NamedTuple):
    """What the temperature may do between rows."""

    curve: float
    """Standard deviation of what a model's lags would add if it were a curve, in the unit of y."""
    turning: float
    """Rms change of its slope from row to row over its rms slope: 0 for a straight line, 1.4 for a random walk, 2 for
    what goes up and down by turns. Where it is large, a jump somewhere between two rows is as likely as a curve."""


def felt_between_rows(model: Any, record: Record) -> BetweenRows:
    """What a model's lags would add if the temperature were a curve from row to row, and how sharply it turns.

    The curve is the cubic through two rows that has in each the slope of the parabola through it and its neighbours
    (Catmull & Rom 1974). Over a step h, along which the slope falls from s to s', it rises above the straight line by
    about ``h (s - s') / 8``, and encloses the area ``h^2 (s - s') / 12`` with it; a lag takes that up over the step,
    and forgets it as exp(-t/tau). Where rows are close enough to resolve the temperature that is next to nothing. What
    leaves no trace in any row, such as a heating that begins and ends between two, adds to it, and is not seen here;
    nor is what happens in gaps, see `thermocorr.estimators.gap_error`.

    Parameters
    ----------
    model : DynamicBiasRegressor
        Fitted. Products of its lags are left out.
    record : Record
        As the model reads it.

    Returns
    -------
    BetweenRows
        ``curve`` is no more than the rms rise of the curve at the gain that the reading has on the whole (its
        standard deviation over that of the temperature): a body feels what is quick less than what is slow, whatever
        lags that stand for something else make of it. Both are 0.0 for a model without lags, or one that takes the
        temperature for a staircase (hold).
    """
    effects = model.features_.effect_list()
    starts = np.cumsum([0, *(effect.n_columns() for effect in effects)])
    own = next((k for k, effect in enumerate(effects) if isinstance(effect, ThermalLag)), None)
    if own is None or model.hold != "first_order":
        return BetweenRows(0.0, 0.0)
    least, taus = least_gap(record, record.usual_step()), effects[own].time_constants_
    areas_felt, rises, lines = [], [], []
    weights = model.coef_[starts[own] : starts[own] + len(taus)] / taus
    for segment in record.segments:
        rows = record.kept(segment.start, segment.stop)
        T, steps = np.asarray(record.columns[record.temperature_name][rows], float), record.times.steps(rows)
        if len(T) < 3:
            continue
        slopes = np.gradient(T, np.cumsum(steps))
        turns = np.append(0.0, steps[1:] * (slopes[:-1] - slopes[1:]))
        turns[steps > least] = 0.0
        rises.append(turns / 8)
        line = np.where(steps[1:] > least, np.nan, np.diff(T) / steps[1:])
        lines.append(np.column_stack((line[1:], np.diff(line))))
        areas_felt.append(lag_differences(np.cumsum(steps * turns / 12), steps, taus)[0] @ weights)
    if not rises:
        return BetweenRows(0.0, 0.0)
    usual_gain = record.reading_moments().std / (record.moments(record.temperature_name).std or 1.0)
    most = usual_gain * np.sqrt(np.mean(np.concatenate(rises) ** 2))
    moved, turned = np.sqrt(np.nansum(np.concatenate(lines) ** 2, axis=0))
    return BetweenRows(float(min(np.concatenate(areas_felt).std(), most)), float(turned / (moved or 1.0)))

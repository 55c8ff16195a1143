"""Columns whose errors are counted: those of the model, and those that may be there unseen.

A model that has searched its time constants has left out all others of the grid. One that fits the starts of several
segments has left out the decays of its slow bodies, which over a record look like drift; after a gap they are there all
the same. (For a single start they would double the uncertainty of later readings and hold no more of them, see
`benchmarks/signed_cases.py`.)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from sklearn.base import clone

from ...effects import InitialTransient, LaggedCovariate
from ...effects.protocol import Effect
from ...effects.thermal import ThermalLag
from ...equations import TriangularFactor
from ...equations.noise import spans
from ...records import History
from ..fused import Binned, binned_columns
from ..screening import evenness
from ..time_constants.folds import MOST_SEGMENTS
from .restricted import Within

SPECTRUM_SHARE = 1 / 12
"""Longest time constant that may be there unseen, as a share of the longest segment: slower bodies are noise as far as
the record is not likelier with them. With 1/8, 1/12, 1/16 of it, readings in a random walk are covered in 90, 92, 89 %,
the bias in white noise in 98, 98, 97 % (searched time constants, seeds 600 to 659):
`python benchmarks/interval_coverage.py --first 600 --seeds 60`."""
BEYOND_CHOSEN = 1.3
"""Where slower ones were chosen: the slowest body that may be there is this many times slower than any of them."""


@dataclass(frozen=True, kw_only=True)
class Basis:
    """Effects, and their columns in the bins of the record."""

    effects: list[Effect]
    history: History
    """The fitted record's, with the states of these effects at its end."""
    own: bool
    """Whether these are the model's own effects."""
    columns: np.ndarray
    """Means of the columns that have an error, 1 first, shape (bins, p)."""
    free: np.ndarray
    """Where these stand among the intercept and all columns, shape (p,)."""
    width: int
    """The intercept and all columns."""
    reading: np.ndarray
    """Means of the readings, shape (bins,); the starts of many segments are taken out."""
    offset: float
    """What was taken off the readings."""
    segment: np.ndarray
    begins: np.ndarray
    count: np.ndarray
    inside: tuple[float, float]
    """Lowest and highest fitted temperature, about the reference [K]."""
    time_constants: np.ndarray
    """Those of the model's lags of the temperature [s], also where a whole grid of lags stands for them here."""
    rows: int
    """Rows of a bin."""
    groups: list[np.ndarray]
    """Coefficients that have a prior: 1 for those drawn alike, 0 for others, shape (p,) each."""
    in_fit: np.ndarray
    """Where each of the columns stands in the fit's factors, -1 for those that the model leaves out, shape (p,)."""
    searched: bool
    """Whether the lags of a whole grid stand for those of the model."""
    slow: np.ndarray
    """Lags of that grid beyond `SPECTRUM_SHARE`, shape (p,): True for those."""

    def without_slow(self) -> Basis:
        """A basis in which these have no error and no coefficient."""
        kept = ~self.slow
        return replace(
            self, columns=self.columns[:, kept], free=self.free[kept], in_fit=self.in_fit[kept], slow=self.slow[kept],
            groups=[group[kept] for group in self.groups],
        )  # fmt: skip

    def bin_seconds(self) -> float:
        """Usual time from bin to bin [s]."""
        steps = np.diff(self.begins)[np.diff(self.segment) == 0]
        return float(np.median(steps)) if len(steps) else self.history.usual_step


def basis_of(model: Any, bins: Binned, offset: float) -> Basis:
    """The basis of a fitted model, from the bins of its record and what was taken off the readings there."""
    effects, history = model.features_.effect_list(), model.features_.history_
    grid, usual_longest = _spectrum(model)
    if bins.columns is not None:
        means, own = bins.columns, True
    else:
        searched = () if model.search_ is None else tuple(model.search_.further)
        wide = [_widened(effect, grid, searched, history) for effect in effects]
        own = all(one is other for one, other in zip(effects, wide, strict=True))
        effects = wide
        means, ends = binned_columns(effects, history, bins)
        history = replace(history, end_states=tuple(ends))
    columns = np.column_stack((np.ones(len(means)), means))
    names = ["", *(name for effect in effects for name in effect.names())]
    fitted_names = ["", *model.features_.get_feature_names_out()]
    free, starts = np.arange(columns.shape[1]), np.zeros(len(columns))
    if len(history.record.segments) > MOST_SEGMENTS:  # their starts have no say on the rest
        decays = np.array([False, *(isinstance(e, InitialTransient) for e in effects for _ in e.names())])
        fitted = np.array([isinstance(e, InitialTransient) for e in model.features_.effect_list() for _ in e.names()])
        free, starts = np.flatnonzero(~decays), columns[:, decays] @ model.coef_[fitted]
    usual = float(np.median(bins.count[bins.count > 0]))  # of readings: a record may have few, or nothing but bursts
    known = bins.count >= usual / 2
    low, high = model.temperature_range_
    return Basis(
        effects=effects, history=history, own=own, columns=columns[known][:, free], free=free, width=columns.shape[1],
        reading=(bins.reading - starts)[known], offset=offset, segment=bins.segment[known],
        begins=bins.begins[known], count=bins.count[known], rows=max(1, round(usual)),
        inside=(low - model.reference_temperature_, high - model.reference_temperature_),
        time_constants=model.time_constants_,
        searched=not own and len(grid) > 0, slow=_slower(effects, grid, usual_longest)[free],
        in_fit=np.array([fitted_names.index(names[i]) if names[i] in fitted_names else -1 for i in free]),
        groups=[group[free] for group in _priors(effects, model.features_.effect_list())],
    )  # fmt: skip


def _slower(effects: Sequence[Effect], grid: np.ndarray, longest: float) -> np.ndarray:
    """Lags with all time constants of a grid that are slower than the longest one, shape (1 + p,)."""
    slow = [np.zeros(1, bool)]
    for effect in effects:
        wide = np.array_equal(getattr(effect, "time_constants", ()), grid) and effect.n_columns() == len(grid)
        slow.append(grid > longest if wide and len(grid) else np.zeros(effect.n_columns(), bool))
    return np.concatenate(slow)


def _priors(effects: Sequence[Effect], own: Sequence[Effect]) -> list[np.ndarray]:
    """Columns of the lags and of the decays that are not the model's own: 1 for those, 0 for others, shape (1 + p,)."""
    edges = np.cumsum([1, *(effect.n_columns() for effect in effects)])
    groups = []
    for start, effect, narrow in zip(edges, effects, own, strict=False):
        known = narrow.names()
        if effect.names() == known:
            continue
        if not isinstance(effect, InitialTransient):  # the lags chosen are not known better than their neighbours
            known = effect.names()[:1] if isinstance(effect, LaggedCovariate) else []
        drawn = [name not in known for name in effect.names()]
        group = np.zeros(edges[-1])
        group[start : start + len(drawn)] = drawn
        groups.append(group)
    return groups


def _spectrum(model: Any) -> tuple[np.ndarray, float]:
    """Time constants that may be there, for a model that has searched its own, and the longest without doubt [s].

    Empty for others.
    """
    choice, record = model.search_, model.features_.history_.record
    if (
        choice is None
        or choice.reference is None
        or model.products_
        or not (choice.further or len(choice.time_constants))
    ):
        return np.zeros(0), np.inf
    span = record.longest_read()
    slowest = max(taus.max(initial=0.0) for taus in (choice.time_constants, *choice.further.values()))
    usual = SPECTRUM_SHARE * span
    return np.unique(choice.grid[choice.grid <= max(usual, BEYOND_CHOSEN * slowest)]), usual


def _widened(effect: Effect, grid: np.ndarray, searched: Sequence[Any], history: History) -> Effect:
    """A lag with all time constants of a grid, start-up decays with those that the model leaves out; others as are.

    So are lags of further thermometers, the columns `searched`.
    """
    lags = isinstance(effect, ThermalLag) or (isinstance(effect, LaggedCovariate) and effect.column in searched)
    if lags and len(grid):
        changed: dict[str, Any] = {"time_constants": grid}
    elif isinstance(effect, InitialTransient) and 1 < len(history.record.segments) <= MOST_SEGMENTS:
        changed = {"longest_share": 1.0}
    else:
        return effect
    wide: Effect = clone(effect).set_params(**changed)
    wide.learn(history.record)
    return effect if wide.names() == effect.names() else wide


@dataclass(frozen=True, kw_only=True)
class ScaledBasis:
    """A basis in columns of unit length and a reading of unit noise, of the same size at all times."""

    columns: np.ndarray
    reading: np.ndarray
    norms: np.ndarray
    """Shape (p,): a column is that many times `columns` times `size`."""
    unit: float
    mean: float
    """Mean of the reading, taken off."""
    size: np.ndarray
    """Size of the noise at each bin, over its usual one, shape (bins,)."""
    span: np.ndarray

    @classmethod
    def of(cls, basis: Basis) -> ScaledBasis:
        """Scale the columns and readings of a basis."""
        norms = np.linalg.norm(basis.columns, axis=0)
        norms[norms == 0] = 1.0
        columns, mean = basis.columns / norms, float(basis.reading.mean())
        reading = basis.reading - mean
        rest = reading - columns @ np.linalg.lstsq(columns, reading, rcond=1e-10)[0]
        runs = [segment.run for segment in basis.history.record.segments]
        size = 1 / evenness(rest, basis.segment)
        unit = float(np.std(rest)) or 1.0
        return cls(
            columns=columns / size[:, None], reading=reading / unit / size, norms=norms, unit=unit, mean=mean,
            size=size, span=spans(basis.segment, basis.begins, runs),
        )  # fmt: skip

    def only(self, kept: np.ndarray) -> ScaledBasis:
        """Some of the columns, shape (p,): True for those that stay."""
        return replace(self, columns=self.columns[:, kept], norms=self.norms[kept])


def within_bins(factor: TriangularFactor, basis: Basis, scaled: ScaledBasis) -> Within | None:
    """What rows say beside their bins, from the factor of all rows; None where nobody knows, or a bin is a row."""
    if basis.rows == 1 or basis.searched or len(basis.free) < basis.width:
        return None
    own = basis.in_fit >= 0  # decays that the model leaves out hardly change within a bin
    r = factor.r[:, [*basis.in_fit[own], -1]]
    r[:, -1] -= scaled.mean * r[:, 0]
    whole, columns, y, norms = r.T @ r, basis.columns[:, own], basis.reading - scaled.mean, scaled.norms[own]
    values, vectors = np.linalg.eigh(
        (whole[:-1, :-1] - columns.T @ (basis.count[:, None] * columns)) / norms[:, None] / norms
    )
    half, moments = np.zeros((len(own), len(values))), np.zeros(len(own))
    half[own] = vectors * np.sqrt(np.maximum(values, 0.0))
    moments[own] = (whole[:-1, -1] - columns.T @ (basis.count * y)) / norms / scaled.unit
    return Within(
        columns=half @ half.T,
        moments=moments,
        power=max(float(whole[-1, -1] - basis.count @ y**2), 0.0) / scaled.unit**2,
        freedom=factor.n_rows - len(columns),
    )

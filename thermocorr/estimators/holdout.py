"""Errors on data that a model has not seen: held-out blocks, and later blocks predicted from all earlier data."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np
import pandas as pd

from ..effects import Events
from ..records import RecordError, read_record
from ..records.errors import check_int, printable, said_once
from ..records.numbers import number_text, scale_of
from ..records.record import where_read
from .progress import Progress, told
from .regressor import DynamicBiasRegressor
from .run_levels import unlearned
from .screening import believed_readings

MIN_BLOCK = 8
"""Rows below which a block of time says nothing."""


def time_blocks(reading: np.ndarray, n_blocks: int) -> list[slice]:
    """Contiguous blocks of nearly equal numbers of rows, in the order of the rows.

    Where readings, shape (n_rows,), hold less than half of the rows, the blocks are those of that part.
    """
    first, stop = where_read(reading, len(reading), slice)
    n_rows = stop - first
    count = min(n_blocks, max(n_rows // MIN_BLOCK, 2))
    return [slice(first + low, first + high) for low, high in pairwise(n_rows * k // count for k in range(count + 1))]


@said_once()
def held_out_residuals(model: Any, X: Any, y: Any, *, n_blocks: int = 5, progress: Progress = None) -> np.ndarray:
    """Residuals of each block of time under a model that was fitted, time constants and all, without its readings.

    The lags run through the whole record (temperature is known everywhere), so no block starts with unknown states.
    Rows that the model flags (no reading, a refused one, washout of an unknown start) are NaN.

    Parameters
    ----------
    model : DynamicBiasRegressor
        Cloned for each block.
    X, y : as for `DynamicBiasRegressor.fit`
    n_blocks : int, default 5
        Number of blocks, 2 or more.
    progress : callable or True, optional
        Called with a line of text before each fit; True draws a bar (extra "progress").

    Returns
    -------
    array of shape (n_rows,)
        Measured minus modelled reading, in the unit of y.

    Examples
    --------
    >>> import numpy as np
    >>> from thermocorr import DynamicBiasRegressor, held_out_residuals
    >>> from thermocorr.datasets import make_record
    >>> record = make_record(4000, seed=1)
    >>> model = DynamicBiasRegressor("temperature", ["5 min", "90 min"])
    >>> residuals = held_out_residuals(model, record[["temperature"]], record["reading"])
    >>> print(f"{np.nanstd(residuals):.1f} ppm, noise {record.attrs['noise']:.1f} ppm")
    0.2 ppm, noise 0.2 ppm
    """
    check_int("held_out_residuals", "n_blocks", n_blocks, 2)
    reading = believed_readings(model, X, y)
    with told(progress, len(time_blocks(reading, n_blocks))) as tell:
        return residuals_of_blocks(model, X, reading, n_blocks, tell)


def residuals_of_blocks(
    model: Any, X: Any, reading: np.ndarray, n_blocks: int, tell: Callable[[str], None]
) -> np.ndarray:
    """`held_out_residuals` of believed readings."""
    result = np.full(len(reading), np.nan)
    blocks = time_blocks(reading, n_blocks)
    for number, block in enumerate(blocks):
        tell(f"held-out block {number + 1} of {len(blocks)}")
        known = reading.copy()
        known[block] = np.nan
        if np.isfinite(known).any():
            try:
                fitted = model.settled().fit(X, known)
            except RecordError as error:
                counts = " of ".join(f"{np.isfinite(values).sum()}" for values in (known, reading))
                raise RecordError(
                    f"{counts} readings are outside of held-out block {number + 1} of {len(blocks)}. {error}"
                ) from None
            missed = reading[block] - fitted.predict(X)[block]
            result[block] = np.where(unlearned(fitted, X, known)[block], np.nan, missed)
            result[block][_unknown_start(fitted, block, len(reading))] = np.nan
    return result


def rms(values: np.ndarray) -> float:
    """Root mean square of what is known; NaN where nothing is."""
    known = values[np.isfinite(values)]
    return float(np.sqrt(known @ known / len(known))) if len(known) else np.nan


def _unknown_start(fitted: Any, block: slice, n_rows: int) -> np.ndarray:
    """Rows of a left-out block that still feel a start-up whose decay columns had no readings to learn from."""
    record = fitted.features_.history_.record
    washed = np.zeros(block.stop - block.start, bool)
    elapsed_rows = int(np.ceil(fitted.washout_ / max(fitted.features_.history_.usual_step, 1e-12)))
    stride = n_rows / max(record.n_rows, 1)
    for segment in record.segments:
        start = round(segment.start * stride)
        if block.start <= start < block.stop:
            length = min(elapsed_rows, (block.stop - start) // 2)
            washed[start - block.start : start - block.start + length] = True
    return washed


BEFORE = "before correction"
FEWEST = 3
"""Later blocks without which nothing is said."""
LIKE = 1.03
"""Error over the least one, up to which a variant is as good as the best."""


@dataclass(frozen=True, kw_only=True, repr=False)
class LaterErrors:
    """Errors on later blocks of time, each foretold from everything before it."""

    table: pd.DataFrame
    """Rms error, offset included, in the unit of the reading: a row for each variant, `BEFORE` first, a column for each
    block, and "all", which are the blocks that every variant could foretell."""
    unit: str
    dynamic: tuple[str, ...]
    """Variants with a memory, which the others are rivals of."""

    @property
    def best(self) -> str:
        """The variant with the least error on all blocks together; "" where there is none."""
        return min(self._all, key=self._all.__getitem__) if self.blocks.shape[1] else ""

    @property
    def blocks(self) -> pd.DataFrame:
        """The blocks alone, without those that some variant could not foretell."""
        return self.table.drop(columns="all").dropna(axis=1)

    def helps(self, variant: str) -> bool | None:
        """Whether a variant does better than its rivals without memory: together, and in most of the blocks.

        None where there are too few blocks to tell.
        """
        if self.blocks.shape[1] < FEWEST:
            return None
        rival = self._rival()
        return self._all[variant] < self._all[rival] and self._wins(variant) > 0.5

    def advice(self, variant: str) -> str:
        """A sentence on a dynamic variant: use it, or not."""
        helps, blocks = self.helps(variant), self.blocks
        if helps is None:
            return "Whether a correction helps on later data cannot be told: the record is too short."
        rival = self._rival()
        scale = scale_of([self._all[variant]], printable(self.unit))
        own, others, best = (scale.text(self._all[name]) for name in (variant, rival, self.best))
        each = scale.factor * blocks.loc[variant].to_numpy(float)
        least, most = _around(scale.factor * self._all[variant], float(each.min()), float(each.max()))
        error = f"{own} rms ({least} to {most})"
        other = f"{others} {'uncorrected' if rival == BEFORE else 'static'}"
        count = f"{round(self._wins(variant) * blocks.shape[1])} of {blocks.shape[1]}"
        said = f"better in {count} later blocks, each foretold from everything before it, the {variant} correction"
        if helps:
            said = f"Use it: {said} leaves {error} instead of {other}."
            if self._all[variant] > LIKE * self._all[self.best]:
                said += f" The {self.best} one does better there: {best}."
            return said
        return f"Not shown to help: {said} leaves {error} against {other}."

    @property
    def _all(self) -> dict[str, float]:
        """Error on all blocks together."""
        return dict(zip(map(str, self.table.index), self.table["all"].to_numpy(float).tolist(), strict=True))

    def _rival(self) -> str:
        """The best of what has no memory."""
        return min((name for name in self._all if name not in self.dynamic), key=self._all.__getitem__)

    def _wins(self, variant: str) -> float:
        return float(np.mean(self.blocks.loc[variant] < self.blocks.loc[self._rival()]))

    def __str__(self) -> str:
        shown = self.table.rename(index={self.best: f"{self.best} *"})
        scale = scale_of(self.table, printable(self.unit))
        head = "Error on later blocks of time, offset included"
        text = (scale.factor * shown).to_string(float_format=number_text, na_rep="-")
        return f"{head}{f' [{scale.unit}]' if scale.unit else ''}; * is the least:\n{text}"

    __repr__ = __str__


def _around(value: float, least: float, most: float) -> tuple[str, str]:
    """The ends of a range, with two digits, or as many more as it takes to hold the value in three."""
    said = float(number_text(value))
    ends = [(number_text(least, digits), number_text(most, digits)) for digits in range(2, 6)]
    return next((end for end in ends if float(end[0]) <= said <= float(end[1])), ends[-1])


@said_once()
def later_errors(
    variants: Mapping[str, DynamicBiasRegressor], X: Any, y: Any, *, n_blocks: int = 5, progress: Progress = None
) -> LaterErrors:
    """Foretell the later half of a record, block by block, from all readings before each block.

    Parameters
    ----------
    variants : mapping of str to DynamicBiasRegressor
        Fitted, such as `VariantComparison.models`; cloned for each block. Those without time constants
        are the rivals of those that have some.
    X, y : as for `DynamicBiasRegressor.fit`
    n_blocks : int, default 5
        Blocks of equal numbers of rows, in the order of time.
    progress : callable or True, optional
        Called with a line of text before each fit; True draws a bar (extra "progress").

    Returns
    -------
    LaterErrors

    Examples
    --------
    >>> from thermocorr import DynamicBiasRegressor, later_errors
    >>> from thermocorr.datasets import make_record
    >>> record = make_record(4000, seed=1)
    >>> X, y = record[["temperature"]], record["reading"]
    >>> variants = {"static": DynamicBiasRegressor("temperature", ()).fit(X, y),
    ...             "dynamic": DynamicBiasRegressor("temperature", ["5 min", "90 min"]).fit(X, y)}
    >>> later = later_errors(variants, X, y)
    >>> later.best, later.helps("dynamic")
    ('dynamic', True)
    """
    check_int("later_errors", "n_blocks", n_blocks, 1)
    if not variants:
        raise ValueError("later_errors() needs fitted variants to compare. Got none.")
    reading = believed_readings(next(iter(variants.values())), X, y)
    missed: dict[str, list[np.ndarray]] = {name: [] for name in (BEFORE, *variants)}
    later = list(later_blocks(next(iter(variants.values())), X, reading, n_blocks))
    with told(progress, n_blocks * len(variants)) as tell:
        for known, block in later:
            missed[BEFORE].append(reading[block] - (np.nanmean(known) if np.isfinite(known).any() else np.nan))
        for name, variant in variants.items():
            missed[name] = _missed(variant, X, reading, later, partial(_tell, tell, name, n_blocks))
    blocks = pd.DataFrame({name: [rms(part) for part in parts] for name, parts in missed.items()}).T
    common = np.flatnonzero(blocks.notna().all())
    together = [rms(np.concatenate([np.zeros(0), *(parts[k] for k in common)])) for parts in missed.values()]
    table = blocks.set_axis(range(1, n_blocks + 1), axis=1).assign(all=together)
    dynamic = tuple(name for name, each in variants.items() if any(map(len, each.thermometers_.values())))
    return LaterErrors(table=table, unit=next(iter(variants.values())).reading_.unit, dynamic=dynamic)


def later_rms(model: DynamicBiasRegressor, X: Any, y: Any, n_blocks: int = 5) -> np.ndarray:
    """Rms error of a fitted model on blocks of the later half of its record, then on all of these together.

    Each block is foretold from everything before it; NaN where that is too short.
    """
    reading = believed_readings(model, X, y)
    parts = _missed(model, X, reading, list(later_blocks(model, X, reading, n_blocks)))
    return np.array([rms(part) for part in (*parts, np.concatenate(parts))])


def later_blocks(
    model: DynamicBiasRegressor, X: Any, reading: np.ndarray, n_blocks: int
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Blocks of the later half in the order of time: readings before each (NaN from there on), and its rows."""
    record = read_record(X, model.features_.layout(), y=reading, quiet=True)
    low, high = record.read_places
    if high - low < 2 * n_blocks * MIN_BLOCK:
        low, high = 0, record.n_rows
    rows = np.arange(len(reading))[record.rows(low, min(high, record.n_used))]
    edges = [len(rows) * k // (2 * n_blocks) for k in range(n_blocks, 2 * n_blocks + 1)]
    for low, high in pairwise(edges):
        known = np.full(len(reading), np.nan)
        known[rows[:low]] = reading[rows[:low]]
        yield known, rows[low:high]


def _after_events(fitted: DynamicBiasRegressor, X: Any, known: np.ndarray, block: np.ndarray) -> np.ndarray:
    """Rows of a block behind an event of which no reading is known: the measurand is another one, shape (n,)."""
    moments = [moment for e in fitted.features_.effect_list() if isinstance(e, Events) for moment in e.seconds_]
    if not moments:
        return np.zeros(len(block), bool)
    record = read_record(X, fitted.features_.layout(), quiet=True)
    seconds = record.times.seconds(np.arange(len(known)), record.first_stamp())
    last = seconds[np.isfinite(known)].max()
    return np.asarray(seconds[block] >= min((m for m in moments if m > last), default=np.inf))


def _missed(
    model: DynamicBiasRegressor,
    X: Any,
    reading: np.ndarray,
    later: Sequence[tuple[np.ndarray, np.ndarray]],
    tell: Callable[[int], None] = lambda number: None,
) -> list[np.ndarray]:
    """What models of the known readings miss in the block behind these; NaN where these are too few."""
    missed = []
    for number, (known, block) in enumerate(later, 1):
        tell(number)
        missed.append(_missed_in(model, X, known, reading, block))
    return missed


def _missed_in(
    model: DynamicBiasRegressor, X: Any, known: np.ndarray, reading: np.ndarray, block: np.ndarray
) -> np.ndarray:
    try:
        fitted: DynamicBiasRegressor = model.settled().fit(X, known)
        missed = np.asarray(reading[block] - fitted.predict(X)[block])
        missed[unlearned(model, X, known)[block] | _after_events(fitted, X, known, block)] = np.nan
        return missed
    except RecordError:
        return np.full(len(block), np.nan)


def _tell(say: Callable[[str], None], name: str, n_blocks: int, number: int) -> None:
    """How far the work is."""
    say(f"later block {number} of {n_blocks}: {name}")

"""Several readings beside one temperature: one model each, from one walk through what they share."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np
import pandas as pd

from ..effects.protocol import Effect
from ..effects.stream import own_starts, walk
from ..estimators.cutting import block_rows
from ..estimators.fitting import Swept, decays_first, reading_offset, sweep_readings
from ..estimators.regressor import DynamicBiasRegressor
from ..estimators.time_constants.remembered import digest
from ..records import Layout, Log, Record, RecordError, read_record
from ..records.errors import warn
from ..records.numbers import as_pandas, numeric_reading
from ..records.screen import screened
from .fleet import Fleet, fit_fleet

READING = "the reading of this channel"
"""Name under which a channel gives its reading."""


def fit_channels(
    X: Any, Y: Any, model: DynamicBiasRegressor | None = None, *, shared_time_constants: bool = False
) -> Fleet:
    """Fit one model for each column of readings, recorded beside the same temperature.

    Each model is the one that ``model.fit(X, Y[name])`` gives. Columns of the model that several channels ask for are
    made, and swept into factors, for all of them at once: those from which time constants are chosen above all.

    Parameters
    ----------
    X : DataFrame
        As for `DynamicBiasRegressor.fit`.
    Y : DataFrame, or array of shape (n_rows, n_channels)
        Readings; NaN where there is none. Channels that lack the same rows share most.
    model : DynamicBiasRegressor, optional
        Cloned for each channel.
    shared_time_constants : bool
        Choose one set of time constants for all channels, see `fit_fleet`.

    Returns
    -------
    Fleet
        A dict of channel (column of Y, or its number) to fitted `DynamicBiasRegressor`.

    Raises
    ------
    RecordError
        For a record that cannot be used; the message names the channel.

    Examples
    --------
    >>> from thermocorr import DynamicBiasRegressor
    >>> from thermocorr.cluster.channels import fit_channels
    >>> from thermocorr.datasets import make_record
    >>> record = make_record(2000, seed=1)
    >>> readings = record[["reading"]].assign(doubled=2 * record["reading"])
    >>> models = fit_channels(record[["temperature"]], readings, DynamicBiasRegressor("temperature"))
    >>> bool(abs(models["doubled"].coef_ - 2 * models["reading"].coef_).max() < 1e-6)
    True
    """
    X, Y = as_pandas(X), as_pandas(Y)
    if not isinstance(X, pd.DataFrame):
        raise TypeError(f"X must be a DataFrame, whose columns have names. Got {type(X).__name__}.")
    if not isinstance(Y, pd.DataFrame):
        Y = np.asarray(Y)
        if Y.ndim != 2 or len(Y) != len(X):
            raise RecordError(f"X has {len(X)} rows, Y the shape {Y.shape}. Each row needs a reading of each channel.")
        Y = pd.DataFrame(Y, index=X.index)
    model = DynamicBiasRegressor() if model is None else model
    table = ChannelTable(X, {name: Y[name] for name in Y.columns}, bool(model.screen))
    channels = {name: Channel(table, name) for name in Y.columns}
    return fit_fleet(1, channels, READING, model, shared_time_constants=shared_time_constants)


class Channel(Log):
    """One reading of a table, beside the columns that all readings share."""

    word = "Channel"

    def __init__(self, table: ChannelTable, name: Any):
        self.table, self.name = table, name

    @property
    def columns(self) -> list[str]:
        """Names of the shared columns."""
        return list(self.table.X.columns)

    @property
    def attrs(self) -> dict[str, Any]:
        """What is noted of the shared columns."""
        return {str(name): value for name, value in self.table.X.attrs.items()}

    def __len__(self) -> int:
        return len(self.table.X)

    def __getitem__(self, name: Any) -> Any:
        return self.table.Y[self.name] if isinstance(name, str) and name == READING else self.table.X[name].to_numpy()

    def to_record(self, layout: Any, y: Any, needed: Any) -> Record:
        """The validated record with this channel's reading."""
        record = self.table.record(layout, tuple(needed))
        reading = None if y is None else numeric_reading(y, self.table.X)
        return ChannelRecord(
            **{each.name: getattr(record, each.name) for each in fields(Record) if each.name != "reading"},
            reading=reading,
            channel=self,
        )


@dataclass(frozen=True)
class ChannelRecord(Record):
    """A record whose columns others have too."""

    channel: Channel | None = field(default=None, repr=False)

    def sweep_effects(self, effects: Sequence[Effect], edges: np.ndarray) -> Swept:
        """Factors of this channel, see `thermocorr.estimators.fitting.sweep_effects`."""
        assert self.channel is not None
        return self.channel.table.swept(self, effects, edges)


class ChannelTable:
    """Columns and readings of all channels, and what was computed for several of them at once.

    Parameters
    ----------
    X : DataFrame
    Y : dict of name to Series
        Readings.
    screen : bool
        Whether the models leave out readings that are none.
    """

    def __init__(self, X: pd.DataFrame, Y: dict[Any, pd.Series], screen: bool):
        self.X, self.Y, self.screen = X, Y, screen
        self._records: dict[tuple[Layout, tuple[Any, ...]], Record] = {}
        self._believed: dict[Any, np.ndarray] = {}
        self._asked: dict[bytes, Any] = {}
        self._swept: dict[tuple[bytes, Any], Swept] = {}

    def record(self, layout: Layout, needed: tuple[Any, ...]) -> Record:
        """The shared columns, validated once."""
        if (layout, needed) not in self._records:
            found = read_record(self.X, layout, needed=needed, quiet=True)
            for note in () if self._records else found.notes:
                warn(note)
            self._records[layout, needed] = found
        return self._records[layout, needed]

    def swept(self, record: ChannelRecord, effects: Sequence[Effect], edges: np.ndarray) -> Swept:
        """Factors for one channel; where a second one asks for the same columns, for all that have the same rows."""
        assert record.channel is not None and record.reading is not None
        own = record.channel.name
        self._believed[own] = np.asarray(record.reading[:], float)
        known = np.isfinite(self._believed[own])
        key = digest([(type(effect), vars(effect)) for effect in effects], edges, record.skipped, known)
        if (key, own) in self._swept:
            return self._swept.pop((key, own))
        names = [own]
        if self._asked.setdefault(key, own) != own:
            others = (name for name in self.Y if name not in (own, self._asked[key]))
            names += [name for name in others if self._alike(name, record, known)]
        order, columns = decays_first(effects)
        walked = [effects[i] for i in order]
        steps = walk(walked, record, starts=own_starts(record), size=block_rows(record.n_used), extra=1 + len(names))
        readings = [self._believed[name] for name in names]
        offsets = [reading_offset(replace(record, reading=reading)) for reading in readings]
        found = sweep_readings(record, readings, steps, edges, offsets)
        for name, swept in zip(names, found, strict=True):
            self._swept[key, name] = swept.ordered(order, columns)
        return self._swept.pop((key, own))

    def _alike(self, name: Any, record: Record, known: np.ndarray) -> bool:
        """Whether a channel has readings in the same rows, once those that are none are left out."""
        if name not in self._believed:
            try:
                plain = replace(record, reading=numeric_reading(self.Y[name], self.X), refused=(), notes=())
                believed = screened(plain)[0] if self.screen else plain
            except RecordError:  # said when its turn comes
                return False
            self._believed[name] = np.asarray(believed.reading[:], float)  # type: ignore[index]  # it was given
        return np.array_equal(np.isfinite(self._believed[name]), known)

"""One model for each of many devices, or of several channels beside one temperature."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, fields, replace
from numbers import Integral
from typing import Any

import numpy as np
import pandas as pd
from joblib import Parallel, delayed
from sklearn.base import clone

from ..effects.protocol import Effect
from ..effects.stream import own_starts, walk
from ..estimators.cutting import block_rows
from ..estimators.features import DiffusiveFeatures
from ..estimators.fitting import Swept, decays_first, reading_offset, sweep_readings
from ..estimators.prior import LawPrior
from ..estimators.progress import Progress, one_blas_thread, told
from ..estimators.regressor import DynamicBiasRegressor
from ..estimators.time_constants.folds import digest
from ..estimators.time_constants.search import SearchSettings, factors_of, final_alpha, learned, reference_spectrum
from ..estimators.time_constants.spectrum import POOL_SIZE, Projected, log_grid, project
from ..records import Layout, Log, ParquetLog, Record, RecordError, read_record
from ..records.errors import listing, quoted, warn
from ..records.numbers import as_pandas, numeric_reading
from ..records.screen import screened

Part = Any
"""What a device's record is given as: a `ParquetLog` or a DataFrame."""
BATCHES = 64
"""Batches into which an executor's tasks are cut: it hands them over one by one otherwise."""


class Fleet(dict[Any, DynamicBiasRegressor]):
    """Fitted models by the names of their devices."""

    @property
    def prior(self) -> LawPrior:
        """What the fleet tells of one more device of its make; ValueError where it tells nothing."""
        return LawPrior.of(list(self.values()))

    def __sklearn_clone__(self) -> Fleet:
        return self  # a parameter of other models, whose fit is its worth


def fit_fleet(
    workers: Any,
    devices: Mapping[Any, Any],
    reading: str,
    model: DynamicBiasRegressor | None = None,
    *,
    shared_time_constants: bool = False,
    shrinkage: bool = False,
    history_rows: int | None = None,
    progress: Progress = None,
) -> Fleet:
    """Fit one model for each device, in parallel.

    Parameters
    ----------
    workers : int, concurrent.futures.Executor, dask.distributed.Client, or None
        Who does it: so many processes (joblib's ``n_jobs``; None for what joblib is set to), an executor, or a cluster
        (extra "dask").
    devices : mapping of name to ParquetLog, DataFrame, path, or future of one of these
        The devices' records.
    reading : str
        Column of the readings.
    model : DynamicBiasRegressor, optional
        Cloned for each device.
    shared_time_constants : bool
        Devices of one make have the same bodies inside: choose one set of time constants for all (with
        ``time_constants="auto"`` or a number), by the sum of the devices' misfits over their noise. Each device keeps
        its own coefficients and ridge penalty.
    shrinkage : bool
        Fit each device once more, with what all of them tell as its prior (`LawPrior`): devices whose records
        determine their law badly are drawn to the others. They need the same time constants.
    history_rows : int, optional
        Keep so many rows of each device's record at most, see `DynamicBiasRegressor.slim`.
    progress : callable or True, optional
        Called with a line of text for each device that is waited for; True draws a bar (extra "progress").

    Returns
    -------
    Fleet
        A dict of name to fitted `DynamicBiasRegressor`. ``DynamicBiasRegressor(prior=fleet)`` calibrates one more
        device from an hour.

    Raises
    ------
    RecordError
        For a device's record that cannot be used; the message names the device.
    TypeError, ValueError
        For devices that have no names, and for no workers.
    """
    model = DynamicBiasRegressor() if model is None else model
    _check_workers(workers)
    if not isinstance(devices, Mapping):
        raise TypeError(
            f"The 'devices' parameter must be a dict of name to record. Got a {type(devices).__name__}: give each "
            "device its name, as in {'box 1': record}."
        )
    names = list(devices)
    if history_rows is not None and history_rows < 1:
        raise ValueError(f"The 'history_rows' parameter must be at least 1. Got {history_rows!r} instead.")
    if not names:
        raise RecordError("The fleet has no devices.")
    parts = []
    for name, device in devices.items():
        with _Named(name, device):
            is_path = isinstance(device, str) or hasattr(device, "__fspath__")
            parts.append(ParquetLog(device) if is_path else device)
    if shared_time_constants and isinstance(model.temperature, list):
        raise ValueError(
            "Devices with several thermometers have time constants of their own: shared_time_constants=False."
        )
    own = [model] * len(parts)
    if shared_time_constants and model.count_to_choose() != 0:
        own = _with_shared_times(workers, parts, names, reading, model)
    with told(progress, len(names) * (1 + shrinkage)) as tell:
        heard = tell if progress else None
        fleet = _each(workers, _fit, parts, names, [(reading, one, history_rows) for one in own], heard)
        if shrinkage:
            prior = LawPrior.of(fleet)
            own = [clone(one).set_params(prior=prior) for one in own]
            fleet = _each(workers, _fit, parts, names, [(reading, one, history_rows) for one in own], heard)
    return Fleet(zip(names, fleet, strict=True))


def _check_workers(workers: Any) -> None:
    """Refuse what cannot fit a fleet; ValueError in the words of scikit-learn's parameter checks."""
    is_number = isinstance(workers, Integral) and not isinstance(workers, bool) and workers != 0
    if not (workers is None or is_number or isinstance(workers, Executor) or hasattr(workers, "gather")):
        raise ValueError(
            "The 'workers' parameter must be a number of processes (1 for this one, -1 for one per core), an executor, "
            f"a client of Dask, or None. Got {workers!r} instead."
        )


def _reading(part: Part, reading: str) -> Any:
    """The readings of a device; RecordError where it has no such column."""
    if isinstance(part, pd.DataFrame) and reading not in part.columns:
        raise RecordError(
            f"There is no reading {quoted(reading)} in the data. Its columns are {listing(part.columns)}."
        )
    return part[reading]


def _with_shared_times(
    workers: Any, parts: list[Part], names: list[Any], reading: str, model: DynamicBiasRegressor
) -> list[DynamicBiasRegressor]:
    """An unfitted model for each device, with one set of time constants for all."""
    looks = _each(workers, _span, parts, names, [(reading, model)] * len(parts))
    grid = log_grid(min(step for step, _ in looks), max(span for _, span in looks), POOL_SIZE)
    found: list[tuple[Projected, float]] = _each(
        workers, _spectrum, parts, names, [(reading, model, grid)] * len(parts)
    )
    path = project([projected for projected, _ in found], model.count_to_choose())
    chosen = grid[list(path[-1])] if path else np.zeros(0)
    own = [clone(model).set_params(time_constants=chosen) for _ in parts]
    if model.alpha == "auto":
        own = [one.set_params(alpha=alpha) for one, (_, alpha) in zip(own, found, strict=True)]
    return own


def _each(
    workers: Any,
    function: Any,
    parts: list[Part],
    names: list[Any],
    arguments: list[Any],
    tell: Callable[[str], None] | None = None,
) -> list[Any]:
    """``function(part, name, *arguments)`` for each device, by the workers; `tell` hears what is waited for."""
    jobs = [(part, name, *own) for part, name, own in zip(parts, names, arguments, strict=True)]
    answers: Iterator[Any]
    if hasattr(workers, "gather"):
        futures = [workers.submit(function, *job, pure=False) for job in jobs]
        answers = iter(workers.gather(futures)) if tell is None else (future.result() for future in futures)
    elif isinstance(workers, Executor):
        answers = workers.map(function, *zip(*jobs, strict=True), chunksize=max(1, len(jobs) // BATCHES))
    else:
        answers = Parallel(n_jobs=workers, return_as="generator")(delayed(function)(*job) for job in jobs)
    found = []
    for name in names:
        if tell is not None:
            tell(f"device {name}")
        found.append(next(answers))
    return found


def _fit(
    part: Part, name: Any, reading: str, model: DynamicBiasRegressor, history_rows: int | None
) -> DynamicBiasRegressor:
    with _Named(name, part):
        own: DynamicBiasRegressor = clone(model)
        own.fit(part, _reading(part, reading))
    return own if history_rows is None else own.slim(history_rows)


def _span(part: Part, name: Any, reading: str, model: DynamicBiasRegressor) -> tuple[float, float]:
    """Usual step and length of a device's record [s]."""
    with _Named(name, part):
        record = _plain(model).learn(part, _reading(part, reading))
        return record.usual_step(), record.longest_read()


def _spectrum(
    part: Part, name: Any, reading: str, model: DynamicBiasRegressor, grid: np.ndarray
) -> tuple[Projected, float]:
    """What `project` needs of a device, and its ridge penalty."""
    with _Named(name, part), one_blas_thread():
        settings = SearchSettings(candidates=grid)
        own = clone(model)
        y = _reading(part, reading)
        own.learn_levels(part, y)
        features = _plain(own)
        factored = factors_of(features, *learned(features, part, y), grid, settings)
        reference = reference_spectrum(factored)
        return factored.projected(reference), final_alpha(factored, reference)


def _plain(model: DynamicBiasRegressor) -> DiffusiveFeatures:
    """Static law and further effects of a model."""
    return model.unfitted_features(())


class _Named:
    """Puts the name of a device, or of what else a part is, before an error."""

    def __init__(self, name: Any, part: Part):
        self.name, self.word = name, getattr(part, "word", "Device")

    def __enter__(self) -> None:
        pass

    def __exit__(self, kind: Any, error: Any, trace: Any) -> None:
        if isinstance(error, RecordError):
            raise RecordError(f"{self.word} {self.name!r}: {error}") from None


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
    >>> from thermocorr.cluster.fleet import fit_channels
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

    `X` (DataFrame). `Y` (dict of name to Series): Readings. `screen` (bool): Whether the models leave out readings
    that are none.
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

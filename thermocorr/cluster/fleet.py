"""One model for each of many devices."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Executor
from numbers import Integral
from typing import Any

import numpy as np
import pandas as pd
from joblib import Parallel, delayed
from sklearn.base import clone

from ..estimators.choosing import count_to_choose
from ..estimators.features import DiffusiveFeatures
from ..estimators.prior import LawPrior
from ..estimators.progress import Progress, one_blas_thread, reporting
from ..estimators.reading import Reading
from ..estimators.regressor import DynamicBiasRegressor
from ..estimators.time_constants.search import (
    SearchSettings,
    factors_of,
    final_alpha,
    learn_checked,
    reference_spectrum,
)
from ..estimators.time_constants.spectrum import POOL_SIZE, Projected, log_grid, project
from ..records import ParquetLog, RecordError
from ..records.errors import listing, quoted

Part = Any
"""What a device's record is given as: a `ParquetLog` or a DataFrame."""


class Fleet(dict[Any, DynamicBiasRegressor]):
    """Fitted models by the names of their devices."""

    @property
    def prior(self) -> LawPrior:
        """Prior for one more device of the same make; ValueError where the fleet gives none."""
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
        A number of processes (joblib's ``n_jobs``; None for what joblib is set to), an executor, or a cluster (extra
        "dask").
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
        Rows of each device's record to keep, at most: small to send and to store.
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
        with _Named(name):
            is_path = isinstance(device, str) or hasattr(device, "__fspath__")
            parts.append(ParquetLog(device) if is_path else device)
    if shared_time_constants and isinstance(model.temperature, list):
        raise ValueError(
            "Devices with several thermometers have time constants of their own: shared_time_constants=False."
        )
    own = [model] * len(parts)
    if shared_time_constants and count_to_choose(model.time_constants) != 0:
        own = _with_shared_times(workers, parts, names, reading, model)
    with reporting(progress, len(names) * (1 + shrinkage)) as tell:
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
    path = project([projected for projected, _ in found], count_to_choose(model.time_constants))
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
        # Batches into which an executor's tasks are cut: it hands them over one by one otherwise
        answers = workers.map(function, *zip(*jobs, strict=True), chunksize=max(1, len(jobs) // 64))
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
    with _Named(name):
        own: DynamicBiasRegressor = clone(model)
        own.fit(part, _reading(part, reading))
    return own if history_rows is None else own._slim(history_rows)


def _span(part: Part, name: Any, reading: str, model: DynamicBiasRegressor) -> tuple[float, float]:
    """Usual step and length of a device's record [s]."""
    with _Named(name):
        record = _plain(model).read(part, _reading(part, reading))
        return record.usual_step(), record.longest_read()


def _spectrum(
    part: Part, name: Any, reading: str, model: DynamicBiasRegressor, grid: np.ndarray
) -> tuple[Projected, float]:
    """Spectrum of a device as `project` needs it, and its ridge penalty."""
    with _Named(name), one_blas_thread():
        settings = SearchSettings(candidates=grid)
        own = clone(model)
        y = _reading(part, reading)
        record = _plain(own).read(part, y)
        own._learn_levels(record)
        features, kept = _plain(own), Reading.of(part, y, record)
        learn_checked(features, record, kept)
        factored = factors_of(features, record, kept, grid, settings)
        reference = reference_spectrum(factored)
        return factored.projected(reference), final_alpha(factored, reference)


def _plain(model: DynamicBiasRegressor) -> DiffusiveFeatures:
    """Static law and further effects of a model."""
    return model._unfitted_features(())


class _Named:
    """Puts the name of a device before an error."""

    def __init__(self, name: Any):
        self.name = name

    def __enter__(self) -> None:
        pass

    def __exit__(self, kind: Any, error: Any, trace: Any) -> None:
        if isinstance(error, RecordError):
            raise RecordError(f"Device {self.name!r}: {error}") from None

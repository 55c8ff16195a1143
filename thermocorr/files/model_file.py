"""A fitted model as a JSON file: every digit, no pickle, nothing that runs when it is read.

What `predict`, `correct`, `flags`, rows that follow on the fitted record and `OnlineCorrector` need is in it, and where
it all came from. Reading checks a digest of the content first, and then the type, length and range of every value.
"""

from __future__ import annotations

import hashlib
import os
import platform
import re
import textwrap
from collections.abc import Collection
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from sklearn.utils.validation import check_is_fitted

from ..estimators import DynamicBiasRegressor
from ..records import History, read_record
from ..records.numbers import numeric_reading
from . import write_file
from .codec import LARGEST_FILE, ModelFileError, fields, integer, parse, read_bytes, render
from .effect_nodes import EffectCodec
from .model_nodes import pack_model, unpack_model

FORMAT = "thermocorr model"
VERSION = 1
HISTORY_ROWS = 4096
"""Rows of the fitted record that a file keeps unless it is told otherwise."""
_HEAD = re.compile(rb'\{"format": "thermocorr model", "version": ([0-9]{1,9}), "digest": "(sha256:[0-9a-f]{64})",\n')
"""First line of a file; the digest is that of all bytes behind it."""


class LaterVersionError(ModelFileError):
    """A model file was written by a later version of thermocorr."""

    remedy = "Update thermocorr: pip install -U thermocorr."


def save(
    model: DynamicBiasRegressor,
    path: str | os.PathLike[str],
    *,
    history_rows: int | None = HISTORY_ROWS,
    data: tuple[Any, Any] | None = None,
    force: bool = False,
) -> Path:
    """Write a fitted model to a JSON file.

    Parameters
    ----------
    model : DynamicBiasRegressor
        Fitted. Its effects may be those of the catalogue, or your own if they can be imported.
    path : str or Path
        Written as a whole, or left as it was if anything goes wrong. A file that is there is refused, unless forced.
    history_rows : int or None, default 4096
        Rows of the fitted record to keep. They serve one thing: new data that *begin in the middle* of the fitted
        record take their states from them, exactly where the record has no more rows than this, else with the
        temperature as a straight line between kept rows; they are known by the kept rows among them. Data that repeat
        the fitted record from the start of a segment, or follow on it, are exact always. None keeps all that the model
        has.
    data : (X, y), optional
        The record that the model was fitted to: its digest is noted in the file. Without it, that of the kept rows is.
    force : bool, default False
        Overwrite a file that is there already.

    Returns
    -------
    Path

    Raises
    ------
    ModelFileError
        For a model that cannot be written safely: transformers as effects, classes that cannot be imported; for one
        that gives a file above 32 MiB.
    OutputError
        An OSError: the file cannot be written, or must not be.
    TypeError
        For something else than a `DynamicBiasRegressor`.
    """
    return write_file(path, content_of(model, history_rows=history_rows, data=data), force=force)


def content_of(
    model: DynamicBiasRegressor, *, history_rows: int | None = HISTORY_ROWS, data: tuple[Any, Any] | None = None
) -> bytes:
    """The bytes of the model file that `save` writes."""
    if not isinstance(model, DynamicBiasRegressor):
        raise TypeError(f"Only a DynamicBiasRegressor can be saved as a model file. Got {type(model).__name__}.")
    check_is_fitted(model, "pipeline_")
    if history_rows is not None and history_rows < 1:
        raise ValueError(f"The 'history_rows' parameter must be at least 1, or None. Got {history_rows!r} instead.")
    content = signed({"provenance": _provenance(model, data), "model": pack_model(model, history_rows)})
    if len(content) > LARGEST_FILE:
        raise ModelFileError(
            f"The model file would have {len(content)} bytes, and at most {LARGEST_FILE} are read again (32 MiB). Keep "
            "fewer rows of the fitted record: history_rows=4096."
        )
    return content


def signed(content: dict[str, Any]) -> bytes:
    """A model file: its first line holds the digest of the bytes behind it."""
    body = (render(content) + "\n").removeprefix("{\n").encode("ascii")
    digest = hashlib.sha256(body).hexdigest()
    return f'{{"format": "{FORMAT}", "version": {VERSION}, "digest": "sha256:{digest}",\n'.encode("ascii") + body


def load(path: str | os.PathLike[str], *, allow_imports: Collection[str] = ()) -> DynamicBiasRegressor:
    """Read a model that `save` wrote: it predicts, corrects, flags and continues bit for bit as the one saved.

    Parameters
    ----------
    path : str or Path
    allow_imports : collection of str
        Import paths of a user's own effects that may be imported, such as ``["mypackage.effects.FanNoise"]``. Nothing
        else in the file can make anything run.

    Returns
    -------
    DynamicBiasRegressor
        Fitted. `search_` is None: how the time constants were found is not in the file. `provenance_` says where the
        model came from.

    Raises
    ------
    ModelFileError
        A ValueError: the file is damaged, foreign, of a later version, or needs an import that is not allowed. The
        message says what was found, where in the file, and what to do.
    """
    path = Path(path)
    try:
        return _model_of(read_bytes(path), EffectCodec(allow_imports))
    except OSError as error:
        raise ModelFileError(f"{path} cannot be read: {error.strerror}. Check its name and folder.") from None
    except ModelFileError as error:
        # Characters of what is said about a file's content, which may be anything
        found = textwrap.shorten(str(error), 400, placeholder=" ...")
        raise ModelFileError(f"{path} is no model that can be loaded: {found}. {error.remedy}") from None


save_model, load_model = save, load
"""`save` and `load` under the names that `thermocorr` shows."""


def _model_of(content: bytes, codec: EffectCodec) -> DynamicBiasRegressor:
    head = _HEAD.match(content)
    if head is not None:  # nothing is parsed of a file that is not as it was written
        _refuse_later(int(head[1]))
        if head[2].decode() != f"sha256:{hashlib.sha256(content[head.end() :]).hexdigest()}":
            raise ModelFileError("$.digest does not fit the content: something was changed or lost")
    node = parse(content)
    if node.get("format") != FORMAT:
        raise ModelFileError(f"$.format is {str(node.get('format'))[:60]!r} where {FORMAT!r} belongs: a foreign file")
    _refuse_later(integer(node.get("version"), "$.version", VERSION))
    if head is None:
        raise ModelFileError("its first line is not as it was written")
    node = fields(node, "$", ("format", "version", "digest", "provenance", "model"))
    model = unpack_model(node["model"], "$.model", codec)
    model.provenance_ = fields(node["provenance"], "$.provenance", ("versions", "data"))
    return model


def _refuse_later(found: int) -> None:
    if found > VERSION:
        raise LaterVersionError(f"it was written by a later version (format {found}, this one reads up to {VERSION})")


# --------------------------------------------------------------------------------------------------------- provenance


def _provenance(model: DynamicBiasRegressor, data: tuple[Any, Any] | None) -> dict[str, Any]:
    """Provenance of the model: packages, and the record that it was fitted to."""
    if data is None and hasattr(model, "provenance_"):
        known: dict[str, Any] = model.provenance_
        return known
    from .._version import __version__

    versions = {"thermocorr": __version__, "python": platform.python_version()}
    versions |= {package: version(package) for package in ("numpy", "scipy", "scikit-learn", "pandas")}
    history = model.features_.history_
    record, times = history.record, history.record.times
    last = record.n_rows - 1
    noted: dict[str, Any] = {
        "rows": history.n_fitted,
        "readings": model.reading_.n_readings,
        "first": times.label(0),
        "last": times.label(last),
        "span_s": float(history.between(record.stamp(last), record.stamp(0))),
        "columns": [str(column) for column in record.columns],
    }
    if data is None:
        noted |= {"sha256": history_digest(history), "sha256_of": "times and columns of the rows that the model keeps"}
    else:
        noted |= {"sha256": data_digest(model, *data), "sha256_of": "times, columns and readings of all rows"}
    return {"versions": versions, "data": noted}


def history_digest(history: History) -> str:
    """sha256 of the kept rows: times, then the columns that the model uses, as little-endian numbers of 8 bytes."""
    return _hashed(history.record.times.stamps(), *history.record.columns.values())


def data_digest(model: DynamicBiasRegressor, X: Any, y: Any) -> str:
    """sha256 of a record's times, of the columns that `model` uses, and of the readings: compare it with a file's.

    Dates and spans count in nanoseconds, whatever the unit of the data.
    """
    features = model.features_
    needed = [name for name in features.history_.record.columns if name != features.history_.record.temperature_name]
    record = read_record(X, features.layout(), needed=needed, quiet=True)
    if record.n_rows != features.history_.n_fitted:
        raise ValueError(
            f"data has {record.n_rows} rows, and the model was fitted to {features.history_.n_fitted}. Pass the record "
            "that it was fitted to."
        )
    columns = [np.asarray(record.columns[name][:]) for name in features.history_.record.columns]
    return _hashed(record.times.stamps(), *columns, np.asarray(numeric_reading(y, X)[:]))


def _hashed(stamps: np.ndarray, *columns: np.ndarray) -> str:
    digest = hashlib.sha256()
    digest.update(np.ascontiguousarray(stamps, "<f8" if stamps.dtype.kind == "f" else "<i8").tobytes())
    for column in columns:
        digest.update(np.ascontiguousarray(column, "<f8").tobytes())
    return digest.hexdigest()

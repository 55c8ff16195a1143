"""The report page in a file: what a model makes of a record, what is missing in it, and what to do."""

from __future__ import annotations

from os import PathLike
from pathlib import Path
from typing import Any

from ..estimators import DynamicBiasRegressor, VariantComparison
from ..judgement import Diagnosis, Refinement
from ..judgement.page import PageData, page
from ..records import RecordError


def write_report(
    path: str | PathLike[str],
    model: DynamicBiasRegressor,
    X: Any,
    y: Any,
    *,
    diagnosis: Diagnosis | None = None,
    refinement: Refinement | None = None,
    comparison: VariantComparison | None = None,
    unjudged: str = "",
    source: str = "",
    command: str = "",
) -> Path:
    """Write one self-contained HTML page that needs no network, at most 5 MB for a record of any length.

    Parameters
    ----------
    path : path
        File to write.
    model : DynamicBiasRegressor
        Fitted; the one that is kept.
    X, y : as for `DynamicBiasRegressor.evaluate_blocks`
        The record. A `ParquetLog` is read block by block, in bounded memory.
    diagnosis, refinement, comparison : optional
        What `diagnose`, `refine` and `compare_variants` returned for this record.
    unjudged : str
        Why there is no diagnosis.
    source, command : str
        Name of the data's file, and the command that made the page; shown at its end.

    Returns
    -------
    Path

    Raises
    ------
    RecordError
        Where the file cannot be written.
    """
    kept = refinement.diagnoses[-1] if refinement is not None else diagnosis
    data = kept.data if kept is not None and kept.data is not None else PageData.of(model, X, y)
    text = page(
        data,
        diagnosis=diagnosis,
        refinement=refinement,
        comparison=comparison,
        unjudged=unjudged,
        source=source,
        command=command,
    )
    path = require_writable(path)
    path.write_text(text, encoding="utf-8")
    return path


def require_writable(path: str | PathLike[str]) -> Path:
    """The path, its folder made; RecordError where no file can be written there."""
    path = Path(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("a", encoding="utf-8"):
            pass
    except OSError as error:
        raise RecordError(
            f"The report cannot be written to {path}: {error.strerror}. Name another file with --report."
        ) from None
    return path

"""The report page in a file: what a model makes of a record, what is missing in it, and what to do."""

from __future__ import annotations

from os import PathLike
from pathlib import Path
from typing import Any

from ..estimators import DynamicBiasRegressor, VariantComparison
from ..files import write_file
from . import Answer, PageData, page


def write_report(
    path: str | PathLike[str],
    model: DynamicBiasRegressor,
    X: Any,
    y: Any,
    *,
    diagnosis: Any = None,
    refinement: Any = None,
    comparison: VariantComparison | None = None,
    unjudged: str = "",
    source: str = "",
    command: str = "",
    force: bool = False,
) -> Path:
    """Write one self-contained HTML page that needs no network, at most 5 MB for a record of any length.

    Parameters
    ----------
    path : path
        File to write.
    model : DynamicBiasRegressor
        Fitted; the one that is kept.
    X, y : as for `DynamicBiasRegressor.evaluate_blocks`
        The record. It is read block by block.
    diagnosis, refinement, comparison : optional
        What `diagnose`, `refine` and `compare_variants` returned for this record.
    unjudged : str
        Why there is no diagnosis.
    source, command : str
        Name of the data's file, and the command that made the page; shown at its end.
    force : bool, default False
        Overwrite a file that is there already.

    Returns
    -------
    Path

    Raises
    ------
    OutputError
        An OSError and a RecordError: the file cannot be written, or must not be.
    """
    answer = Answer.of(
        X,
        y,
        diagnosis=diagnosis,
        refinement=refinement,
        comparison=comparison,
        unjudged=unjudged,
        source=source,
        command=command,
    )
    return write_file(path, report_text(model, X, y, answer), force=force)


def report_text(model: DynamicBiasRegressor, X: Any, y: Any, answer: Answer) -> str:
    """The page that `write_report` writes."""
    kept = answer.last
    data = kept.data if kept is not None and kept.data is not None else PageData.of(model, X, y)
    return page(data, answer)

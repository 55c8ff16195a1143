"""What users give a search, checked before the record is read."""

from __future__ import annotations

from typing import Any

import numpy as np


def check_candidates(candidates: Any) -> None:
    """Raise ValueError unless candidates are "auto", times, or lists of times."""
    if isinstance(candidates, str) and candidates == "auto":
        return
    listed = not isinstance(candidates, str) and hasattr(candidates, "__len__")
    if listed and len(candidates) == 0:
        raise ValueError("The 'candidates' parameter is empty: name time constants to choose from, or 'auto'.")
    if not listed or len({isinstance(item, str) or not hasattr(item, "__len__") for item in candidates}) > 1:
        raise ValueError(
            "The 'candidates' parameter must be 'auto', a list of times, or a list of lists of times. "
            f"Got {candidates!r} instead."
        )


def check_alphas(alphas: Any) -> None:
    """Raise ValueError unless alphas are "auto", or ridge penalties that are finite and not negative."""
    if isinstance(alphas, str) and alphas == "auto":
        return
    try:
        values = np.atleast_1d(np.asarray(alphas, float))
    except (TypeError, ValueError):
        values = np.zeros(0)
    if values.ndim != 1 or not len(values) or not (np.isfinite(values) & (values >= 0)).all():
        raise ValueError(
            "The 'alphas' parameter must be 'auto' or ridge penalties that are finite and not negative. "
            f"Got {alphas!r} instead."
        )

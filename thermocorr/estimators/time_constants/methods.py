"""The methods of `TimeConstantSearch`: a new one is an entry here, with its function."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from ..features import DiffusiveFeatures
from .search import SearchSettings, TimeConstantChoice, search
from .spectrum import MAX_COUNT


@dataclass(frozen=True, kw_only=True)
class SearchMethod:
    """A way to choose time constants."""

    search: Callable[[DiffusiveFeatures, Any, Any, SearchSettings], TimeConstantChoice] = search
    """Features without lags, X, y and settings -> the choice."""
    most: int | None = None
    """Most time constants that it can take, whatever is asked for."""
    refines: bool = True
    """Whether ``refine="auto"`` moves the time constants that it took from a pool."""


METHODS = {
    "spectrum": SearchMethod(most=MAX_COUNT, refines=False),
    "cross_validation": SearchMethod(),
    "exhaustive": SearchMethod(),
    "greedy": SearchMethod(),
}
"""Name of a method -> what it does."""

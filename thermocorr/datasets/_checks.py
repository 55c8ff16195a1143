"""One-sentence checks of the parameters of the data set functions."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

import numpy as np


def check_float(function: str, name: str, value: Any, interval: str) -> float:
    """Return `value` as a finite float inside `interval`, written as "[0.0, 1.0)", or raise ValueError."""
    low, high = (float(end) for end in interval[1:-1].split(","))
    if (
        isinstance(value, int | float | np.integer | np.floating)
        and not isinstance(value, bool)
        and np.isfinite(float(value))
    ):
        number = float(value)
        above = number >= low if interval[0] == "[" else number > low
        below = number <= high if interval[-1] == "]" else number < high
        if above and below:
            return number
    raise ValueError(
        f"The '{name}' parameter of {function} must be a float in the range {interval}. Got {value!r} instead."
    )


def check_choice(function: str, name: str, value: Any, choices: Collection[str | None]) -> None:
    """Raise ValueError unless `value` is one of `choices`."""
    if value not in choices:
        options = ", ".join(repr(choice) for choice in choices)
        raise ValueError(f"The '{name}' parameter of {function} must be one of {options}. Got {value!r} instead.")

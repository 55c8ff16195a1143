"""One-sentence checks of the parameters of functions, in the words of scikit-learn's checks of estimators."""

from __future__ import annotations

from typing import Any

import numpy as np


def check_int(function: str, name: str, value: Any, low: int) -> int:
    """Return `value` as an int of at least `low`, or raise ValueError."""
    if isinstance(value, int | np.integer) and not isinstance(value, bool) and value >= low:
        return int(value)
    raise ValueError(
        f"The '{name}' parameter of {function} must be an int in the range [{low}, inf). Got {value!r} instead."
    )


def check_bool(function: str, name: str, value: Any) -> bool:
    """Return `value` as a bool, or raise ValueError: text such as "False" would count as true."""
    if isinstance(value, bool | np.bool_):
        return bool(value)
    raise ValueError(f"The '{name}' parameter of {function} must be True or False. Got {value!r} instead.")

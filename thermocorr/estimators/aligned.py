"""Values in the rows of what the user gave."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from ..records import Record
from ..records.flags import Flags


def no_flags(record: Record) -> Flags:
    """Flags of rows that belong to no block: why they have no temperature."""
    flags = Flags(record.n_rows, "no temperature")
    for refused in record.refused:
        flags[refused.rows] = refused.reason
    return flags


def like(X: Any, values: np.ndarray, name: str) -> Any:
    """Values as a Series beside a DataFrame, as an array beside an array."""
    return pd.Series(values, index=X.index, name=name) if isinstance(X, pd.DataFrame) else values

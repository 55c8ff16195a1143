"""Streams for a live corrector, and whether what it says of them agrees with the whole record."""

import numpy as np
from effect_records import log

CLOSE = 1e-13
"""Share of the readings' range. The live path adds the columns' shares in another order and takes exponentials from C:
both are good to the last digit or two of a reading of some tens, whose range is a few units."""


def stream(n=3000, seed=0, holes=True):
    """A log with irregular steps, gaps, and missing temperatures and readings."""
    X = log(n, seed, 0.5, holes=[n // 3, n // 2, n - 40] if holes else [])
    rng = np.random.default_rng(seed)
    y = X["temperature"] + rng.normal(0, 0.1, n)
    if holes:
        X.iloc[[n // 4, n // 4 + 1, n - 20], 0] = np.nan
        X.iloc[n // 5, 1] = np.nan
        y.iloc[[7, n // 2, n - 1]] = np.nan
    return X, y


def one_by_one(live, X, y, **columns):
    """What the corrector says of each row; `columns` are what its effects need besides the temperature."""
    rows = zip(X.index, X["temperature"], y, *columns.values(), strict=True)
    return [live.update(t, T, U, **dict(zip(columns, more, strict=True))) for t, T, U, *more in rows]


def agree(model, X, y, corrected, flags):
    """The whole record says the same; after a gap inside a segment a stream has a flag of its own."""
    expected = model.evaluate(X, y)
    scale = np.nanmax(y) - np.nanmin(y)
    np.testing.assert_allclose(corrected, expected["corrected"], rtol=0, atol=CLOSE * scale + 4e-15 * np.nanmax(y))
    for said, meant in zip(flags, expected["flag"], strict=True):
        assert said == meant or (meant == "" and said == "gap")

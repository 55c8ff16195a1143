"""Numbers that stand in many rows and are no reading of each: repeated ones, and the ends of an instrument's range.

A logger that asks more often than its instrument measures writes readings down more than once: such a record has fewer
readings than rows, and several rows share the noise of one. What is written down again is equal to the last digit, and
the next value is many digits away, after as many rows; readings that are merely coarse stand still as well, but move on
by a digit or two, and now and then. Where the rows between two readings were filled in by straight lines, as
`pandas.DataFrame.interpolate` does, each of them is the mean of its neighbours, and says nothing of its own.
At the end of its range an instrument shows one number again and again, though noise goes on.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Booleans = NDArray[np.bool_]

OFTEN = 0.15
"""Share of the readings that stand in more than one row, from which they may be repeated: those of white noise of 1.9
digits do as often, and move on by two digits or less in two of three steps."""
DIGIT, FEW_DIGITS, COARSE = 0.1, 2.5, 0.5
"""Quantile of the steps beside what stands still that is a digit where readings are coarse; steps of so many digits at
most are theirs; share of such steps from which readings are coarse. Of white noise of many digits it is a quarter."""
TRIMMED = 0.02
"""Share of the readings that stand longest, and as many that stand shortest, whose rows are not asked."""
UNEVEN, JITTER, JUST = 1.25, 0.15, 0.02
"""How unevenly repeated readings may stand: variance of their numbers of rows over that of a logger that asks at even
times, standard deviation as a share of their mean that is added, and variance that is added."""
FEWEST = 30
"""Readings that stand in more than one row, below which nothing is said."""
DIFFERENT = 30
"""Different numbers among these readings, below which they are states or setpoints."""
ARITHMETIC, OF_TIMES = 8.0, 1e-7
"""Distances up to which they are rounding of the arithmetic: in units of the last place of the largest reading, and,
for times are rounded, too, as a share of the largest distance."""
MOSTLY_ON_LINES = 0.3
"""Share of the readings that are the mean of their neighbours, from which rows may be filled in. Of coarse readings one
in six is; where every second row is filled in, half."""
BENDS = 0.05
"""Share of the readings that are farther from that mean than what counts as far: more than spikes, and fewer than bends
where at most nineteen rows in twenty are filled in."""
ROUNDED_LINE = 0.1
"""A digit over that distance, up to which lines may be rounded to it."""
AT_MULTIPLES = 0.8
"""Share of the distances between bends that must be multiples of the usual one: rows are filled in evenly."""
OUTLYING = 10.0
"""Distance of a bend over the median one, beyond which it is a spike."""
LOOK, NEAR_AT_ONCE = 4000, 0.025
"""Rows that are looked at first, for hardly any record is filled in; share of the largest distance that is near."""
FINE = 0.5
"""Share of the readings that are different numbers, from which one is hardly ever met twice."""
MET = 10
"""Rows with the largest or smallest reading, below which it is no end of a range."""
BESIDE, NEAR = 10, 3.0
"""Rows to either side whose mean tells that a reading is near an end of the range; how near, in noises."""
FEW_VISITS = 3
"""Times that it is met anew at least: noise goes on at the end of a range, and not where a device is at rest."""
MORE_OFTEN = 4.0
"""Times as often as any other reading that the end of a range is met."""


def repeated(values: Floats) -> Booleans:
    """Which of consecutive readings are equal to the one before, shape (n,), booleans."""
    found = np.zeros(len(values), bool)
    found[1:] = values[1:] == values[:-1]
    return found


def is_repeated(values: Floats) -> bool:
    """Whether readings are written down more than once each.

    Parameters
    ----------
    values : array of shape (n,)
        Consecutive readings, NaN where there is none, or rows were not looked at.

    Examples
    --------
    >>> import numpy as np
    >>> noise = np.random.default_rng(0).normal(size=400)
    >>> is_repeated(np.repeat(noise, 3)), is_repeated(noise), is_repeated(noise.round())
    (True, False, False)
    """
    again = repeated(values)
    if np.count_nonzero(again) < FEWEST:
        return False
    first = np.flatnonzero(~again)
    shown, rows = values[first], np.diff(first, append=len(values))
    stands = rows > 1
    if stands.sum() < max(FEWEST, OFTEN * len(shown)) or len(np.unique(shown[stands])) < DIFFERENT:
        return False
    steps = np.abs(np.diff(shown))
    beside = steps[stands[1:] | stands[:-1]]
    beside = beside[np.isfinite(beside)]
    if _coarse(beside):
        return False
    whole = np.isfinite(steps[1:]) & np.isfinite(steps[:-1])  # not cut by the end of a stretch
    return _evenly(rows[1:-1][whole])


def on_lines(values: Floats, near: float) -> Booleans:
    """Which of consecutive readings stand on the line between their neighbours, and not still, shape (n,), booleans.

    `near` is how far from it at most; NaN for none.
    """
    found = np.zeros(len(values), bool)
    found[1:-1] = (_off_lines(values) <= near) & (values[1:-1] != values[:-2])
    return found


def _off_lines(values: Floats) -> Floats:
    """Distance of consecutive readings from the mean of their neighbours, but for the first and last."""
    return np.asarray(np.abs(values[1:-1] - (values[:-2] + values[2:]) / 2))


def filled_in(values: Floats) -> float:
    """How near to the line between its neighbours a reading stands that was filled in; NaN where none were.

    Parameters
    ----------
    values : array of shape (n,)
        Consecutive readings, NaN where there is none, or rows were not looked at.

    Examples
    --------
    >>> import numpy as np
    >>> noise = np.random.default_rng(0).normal(size=400)
    >>> lines = np.interp(np.arange(1200) / 3, np.arange(400), noise)
    >>> bool(filled_in(lines) > 0), filled_in(noise), filled_in(noise.round())
    (True, nan, nan)
    """
    first = _off_lines(values[:LOOK])
    if np.count_nonzero(first <= NEAR_AT_ONCE * np.nanmax(first, initial=0.0)) < MOSTLY_ON_LINES * len(first) / 2:
        return np.nan
    off = np.full(len(values), np.nan)
    off[1:-1] = _off_lines(values)
    near = _near_lines(values, off[np.isfinite(off)])
    on = on_lines(values, near)
    if on.sum() < max(FEWEST, MOSTLY_ON_LINES * np.isfinite(off).sum()):
        return np.nan
    still = repeated(values)
    still[:-1] |= still[1:]
    return near if _bends_evenly(np.where(on | still, np.nan, off), np.cumsum(np.isnan(off))) else np.nan


def _near_lines(values: Floats, off: Floats) -> float:
    """How far off a line rounding takes a reading, from their distances: the arithmetic's, or that to a digit."""
    single = bool(np.array_equal(values.astype(np.float32), values, equal_nan=True))
    last_place = float(np.finfo(np.float32 if single else float).eps * np.nanmax(np.abs(values)))
    exact = max(ARITHMETIC * last_place, OF_TIMES * float(off.max(initial=0.0)))
    away = off[off > exact]
    if len(away) < FEWEST:
        return np.nan
    far, digit = max(float(np.quantile(off, 1 - BENDS)), float(np.median(away))), 2 * float(away.min())
    return 2 * digit if 2 * digit <= ROUNDED_LINE * far else exact


def _bends_evenly(off: Floats, stretch: NDArray[np.intp]) -> bool:
    """Whether bends, readings whose distance from the line is no NaN, come after multiples of one number of rows.

    `stretch` is the number of the stretch of known readings that each is in.
    """
    bends = np.flatnonzero(np.isfinite(off))
    if len(bends) < FEWEST:
        return False
    bends = bends[off[bends] <= OUTLYING * np.median(off[bends])]
    rows = np.diff(bends)[stretch[bends[1:]] == stretch[bends[:-1]]]
    if len(rows) < FEWEST or _coarse(off[bends]):
        return False
    usual = int(np.bincount(rows).argmax())
    return usual > 1 and bool(np.mean(rows % usual == 0) >= AT_MULTIPLES)


def _coarse(steps: Floats) -> bool:
    """Whether most steps are of a digit or two."""
    return bool(np.mean(steps <= FEW_DIGITS * np.quantile(steps, DIGIT)) > COARSE)


def _evenly(rows: NDArray[np.intp]) -> bool:
    """Whether readings stand in as many rows as those that a logger asks for at even times, or nearly so."""
    low, high = np.quantile(rows, [TRIMMED, 1 - TRIMMED]) if len(rows) else (0, 0)
    rows = rows[(rows >= low) & (rows <= high)]
    mean = float(rows.mean()) if len(rows) else 0.0
    most = UNEVEN * (mean % 1) * (1 - mean % 1) + (JITTER * mean) ** 2 + JUST
    return len(rows) >= FEWEST and bool(np.var(rows) <= most)


def ends_of_range(values: Floats) -> tuple[float, ...]:
    """The largest or smallest of the readings, where it is met far more often than any other: they are clipped there.

    Parameters
    ----------
    values : array of shape (n,)
        Consecutive readings, NaN where there is none, or rows were not looked at.

    Examples
    --------
    >>> import numpy as np
    >>> noise = np.random.default_rng(0).normal(size=400)
    >>> ends_of_range(np.minimum(noise, 1.0)), ends_of_range(noise), ends_of_range(np.sign(noise))
    ((1.0,), (), ())
    """
    known = np.isfinite(values)
    every, changed = values[known], values[known & ~repeated(values)]
    if not len(every) or max(np.sum(every == every.min()), np.sum(every == every.max())) < MET:
        return ()
    different, visits = np.unique(changed, return_counts=True)
    if len(different) < DIFFERENT:
        return ()
    rows = np.unique(every, return_counts=True)[1]
    times = rows if len(different) > FINE * visits[1:-1].sum() else visits  # a coarse reading stands still anywhere
    clipped = (times >= max(MET, MORE_OFTEN * times[1:-1].max())) & (visits >= FEW_VISITS)
    return tuple(float(different[end]) for end in (0, -1) if clipped[end])


def at_ends(values: Floats, ends: tuple[float, ...], noise: float) -> Booleans:
    """Which of consecutive readings are at an end of the range, or near one, shape (n,), booleans.

    Near it noise is cut on one side, so that what is left there is wrong on the average. By the mean of the neighbours,
    of which a reading's own noise is a small part: to leave out what is high would cut the noise again.
    """
    found = np.isin(values, ends)
    if ends:
        known = np.isfinite(values)
        window = np.ones(2 * BESIDE + 1)
        counts = np.convolve(known, window, "same")
        mean = np.convolve(np.where(known, values, 0.0), window, "same") / np.maximum(counts, 1)
        for end in ends:
            found |= known & (np.abs(mean - end) < NEAR * noise)
    return found

"""Columns that are made from the reading: they carry its own noise, which no cause does.

Counts, a rounded copy, a value of some rows ago, a running mean, a low pass: each of them follows the reading wherever
it goes, and explains whatever is asked. What tells is the instrument's white noise, at frequencies at which no room
changes any more. A cause that is white itself, by far above the instrument's noise, is in the reading as it is in the
column; a mean of the reading has less of it, the faster the less.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.signal import csd

from .statistics import white_part

Floats = NDArray[np.float64]

PARTS = 5
"""Parts of a record in each of which its white noise is measured: a pause, or a jump, is in few of them."""
OF_NOISE = 0.125
"""Share of the reading's white noise that a line of a column leaves of it, below which it was made from the reading."""
COPY = 1e-9
"""Share of a column beside a line of the reading below which it may be the reading: its small steps tell whether."""
SMALL_STEPS = 0.5
"""Share of the reading's steps from row to row that are noise: the smaller half."""
SAME_NOISE = 0.9
"""Squared correlation of these steps above which the column carries the reading's own noise."""
WINDOW, STRETCH, STRETCHES = 128, 4096, 16
"""Rows of a window in which spectra are measured, half of it overlapping the next; rows of a stretch of a long record,
and stretches of it, in which they are."""
FEWEST = 512
"""Rows below which spectra are not asked: in seven windows, chance alone makes a mean coherence of a seventh."""
UPPER = 4
"""Part of the frequencies, from zero on, above which they are the upper two octaves."""
WHITE = 1.5
"""Ratio of the powers in the two upper octaves up to which the reading is white there."""
COHERENT = 0.45
"""Mean coherence in these octaves from which a column has the reading's noise. A mean of 100 rows has 0.5: the other
half is that of the rows that go."""
SLOW, FOLLOWS = 64, 0.8
"""Rows of a block, and squared correlation of the means of blocks from which a column follows the reading where it is
slow, too. A quick cause, of which a slow sensor has as much of the noise, is not all that is slow in the reading."""
SMOOTHED = 2.0
"""Ratio of the reading's response to the column in the upper octaves, over that below a quarter of their lower end,
from which the column is smoother than what it would cause."""
LATE = 0.9
"""Correlation of the steps with those of the reading some rows before from which the column is an earlier reading."""
ALIKE = 0.5
"""Squared correlation from which a column may show what the reading shows."""
SAME_SCALE = 1.25
"""Ratio of their standard deviations up to which it shows it on one scale."""


def made_from(column: Floats, reading: Floats) -> bool:
    """Whether a column was made from the reading.

    Parameters
    ----------
    column, reading : arrays of shape (n,)
        In the order of time; rows in which either is missing are passed over.

    Examples
    --------
    >>> import numpy as np
    >>> rng = np.random.default_rng(0)
    >>> cause, noise = rng.normal(size=(2, 2000))
    >>> reading = np.cumsum(cause) + noise
    >>> made_from(np.convolve(reading, np.ones(10) / 10)[:2000], reading), made_from(np.cumsum(cause), reading)
    (True, False)
    """
    if len(column) != len(reading):
        return False
    sound = np.isfinite(column) & np.isfinite(reading)
    column, reading = column[sound], reading[sound]
    if len(column) < 3 or not np.ptp(column) or not np.ptp(reading):
        return False
    return _is_line(column, reading) or _is_smoothed(column, reading)


def shows_the_same(column: Floats, reading: Floats) -> bool:
    """Whether a column shows the numbers that the reading shows, as a second meter on the same source does.

    Parameters
    ----------
    column, reading : arrays of shape (n,)
        Rows in which either is missing are passed over.

    Examples
    --------
    >>> import numpy as np
    >>> source, one, other = np.random.default_rng(0).normal(size=(3, 1000)) * [[1.0], [0.1], [0.1]]
    >>> shows_the_same(source + one, source + other), shows_the_same(3 * source + one, source + other)
    (True, False)
    """
    sound = np.isfinite(column) & np.isfinite(reading)
    if sound.sum() < 3:
        return False
    column, reading = column[sound], reading[sound]
    spread, own = np.std(reading), np.std(column)
    if not spread / SAME_SCALE < own < SAME_SCALE * spread or abs(np.mean(column) - np.mean(reading)) > spread:
        return False
    return bool(np.corrcoef(column, reading)[0, 1] ** 2 > ALIKE)


def _is_line(column: Floats, reading: Floats) -> bool:
    """Whether a column is the reading in other units, or rounded: a cause never explains all of the noise too."""
    left = 1 - np.corrcoef(reading, column)[0, 1] ** 2
    if left < OF_NOISE and left * np.var(reading) < OF_NOISE * _white(reading):  # counts, a rounded copy
        return True
    if left > COPY:
        return False
    steps, own = np.diff(reading), np.diff(column)  # a setpoint has nothing of the reading's noise
    small = np.abs(steps) <= np.quantile(np.abs(steps), SMALL_STEPS)
    if not np.ptp(steps[small]) or not np.ptp(own[small]):
        return False
    return bool(np.corrcoef(steps[small], own[small])[0, 1] ** 2 > SAME_NOISE)


def _white(reading: Floats) -> float:
    """Variance of the white noise in most parts of a reading."""
    return float(np.median([white_part([part]) for part in np.array_split(reading, PARTS) if len(part)]))


def _is_smoothed(column: Floats, reading: Floats) -> bool:
    """Whether a column is a mean, a low pass or an earlier value of the reading.

    By the spectra of their steps: a step has less of what is slow, which would leak into everything.
    """
    if len(column) < FEWEST or not _follows(column, reading):
        return False
    steps, own = (np.diff(_stretches(values), axis=1) for values in (reading, column))
    frequency, power = _spectrum(steps, steps)
    of_column, cross = _spectrum(own, own)[1].real, _spectrum(steps, own)[1]
    upper, low = slice(len(frequency) // UPPER, None), slice(1, len(frequency) // UPPER // UPPER)
    if not _is_white(frequency[upper], power.real[upper]) or not of_column[upper].any():
        return False
    shared = np.abs(cross[upper]) ** 2 / np.maximum(power.real[upper] * of_column[upper], np.finfo(float).tiny)
    if shared.mean() < COHERENT:
        return False
    slow, fast = (np.abs(cross[part]).sum() / of_column[part].sum() for part in (low, upper))
    together, own_alone, alone = (np.fft.irfft(each) for each in (cross, of_column, power))  # by Wiener-Khinchin
    later = together[1 : WINDOW // 4].max() / np.sqrt(own_alone[0] * alone[0])
    return bool(fast > SMOOTHED * slow or later > LATE)


def _follows(column: Floats, reading: Floats) -> bool:
    """Whether a column follows the reading where both are slow."""
    means = [values[: len(values) // SLOW * SLOW].reshape(-1, SLOW).mean(axis=1) for values in (column, reading)]
    return bool(min(map(np.ptp, means)) > 0 and np.corrcoef(*means)[0, 1] ** 2 > FOLLOWS)


def _stretches(values: Floats) -> Floats:
    """The values, or stretches of them that are evenly spread, shape (stretches, rows)."""
    if len(values) <= STRETCH * STRETCHES:
        return values[None]
    starts = np.linspace(0, len(values) - STRETCH, STRETCHES).astype(int)
    return np.stack([values[start : start + STRETCH] for start in starts])


def _spectrum(one: Floats, other: Floats) -> tuple[Floats, NDArray[np.complex128]]:
    """Frequencies, and the cross spectrum over all stretches."""
    frequency, each = csd(one, other, nperseg=WINDOW)
    return frequency, np.asarray(each.mean(axis=0), complex)


def _is_white(frequency: Floats, power: Floats) -> bool:
    """Whether a reading whose steps have this power has as much noise in either of two octaves."""
    own = power / (2 - 2 * np.cos(2 * np.pi * frequency))
    half = len(own) // 3
    return bool(1 / WHITE < np.mean(own[:half]) / np.mean(own[half:]) < WHITE)

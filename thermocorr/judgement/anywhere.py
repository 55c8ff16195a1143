"""A step at every row, and a wave of every period: what they would explain, all at once.

Under a noise that the cosine transform makes diagonal, the step at row k has a closed form in the transform, and its
moments with base and reading are sums from row k on. So all rows cost as much as a few columns; and so do all waves, by
Fourier transforms.
"""

from __future__ import annotations

import numpy as np
from scipy.fft import next_fast_len, rfft

from ..effects import Periodic
from .levels import ALIVE, AROUND_WAVE, AS_USUAL, LEAST_OWN, LONG_WAVE, LOUDEST, MEDIAN_SQUARE, NYQUIST, ROWS_AROUND
from .likelihood import Comparison
from .pool import Pool


def filtered(judged: Comparison, theta: np.ndarray) -> np.ndarray:
    """Residual beside the base, and the base, times the inverse covariance of a noise, shape (n, 1 + p)."""
    W = 1 / judged.bands.each_row(judged.S(theta))
    return judged.bands.back(np.column_stack((judged.left(theta), judged.Q)) * W[:, None])


def step_gains(judged: Comparison, theta: np.ndarray, weight: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Log likelihood that a step at each row gains under a given noise; 0 at the first row.

    `weight` is what rows are weighted with, shape (n,); where it is not 1, the result is an approximation. `rows` is
    what `filtered` says.
    """
    W = 1 / judged.bands.each_row(judged.S(theta))
    sums = np.cumsum((rows * weight[:, None])[::-1], axis=0)[::-1]
    full = _squares(judged, W) * np.cumsum(weight[::-1] ** 2)[::-1] / np.arange(judged.n, 0, -1)
    own = full - judged.taken(theta, sums[:, 1:])
    alive = own > ALIVE**2 * full
    gains = np.where(alive, 0.5 * sums[:, 0] ** 2 / np.where(alive, own, 1.0), 0.0)
    gains[0] = 0.0
    return gains


def _squares(judged: Comparison, W: np.ndarray) -> np.ndarray:
    """Weighted sum of squares of the step at each row: ones from there to the end of the record."""
    plain, result, later = np.empty(judged.n), np.empty(judged.n), 0.0
    plain[judged.bands.order] = W
    for piece in reversed(judged.bands.pieces):
        size, w = piece.stop - piece.start, plain[piece]
        m = np.arange(1, size)
        # dct of a step at row k: -sqrt(2/M) sin(pi m k/M) / (2 sin(pi m/2M)); squared, a cosine of twice the angle
        inner = np.concatenate(([0.0], w[1:] / (2 * size * np.sin(np.pi * m / (2 * size)) ** 2)))
        result[piece] = later + (inner.sum() - np.fft.fft(inner).real) / 2 + w[0] * (size - np.arange(size)) ** 2 / size
        later += w[0] * size
    return result


def best_period(
    judged: Comparison, theta: np.ndarray, place: np.ndarray, most: float, rows: np.ndarray
) -> float | None:
    """Period of the wave that gains most under a given noise, at most `most`; None where none can be told.

    `place`, shape (n,), is where the rows lie on an even grid, in whole steps; periods are in these steps. Moments of
    waves of all periods with reading and base are Fourier transforms. A wave's own weighted square is that of one that
    fits into the record. `rows` is what `filtered` says.
    """
    even = np.zeros((next_fast_len(2 * int(place.max() + 1), real=True), rows.shape[1]))
    np.add.at(even, place, rows)
    angle = 2 * np.pi * np.arange(len(even) // 2 + 1) / len(even)
    tried = (angle >= 2 * np.pi / most) & (angle < NYQUIST * np.pi)
    if not tried.any():
        return None
    angle, moments = angle[tried], rfft(even, axis=0)[tried]
    own = judged.n / 2 / np.interp(angle, judged.bands.middle, judged.S(theta))
    x, y = moments[:, 0].real, moments[:, 0].imag
    a, b = own - judged.taken(theta, moments[:, 1:].real), own - judged.taken(theta, moments[:, 1:].imag)
    alive = np.minimum(a, b) > LEAST_OWN * own  # what is taken by both together is little where each keeps most
    if not alive.any():
        return None
    gains = np.where(alive, x**2 / np.where(alive, a, 1.0) + y**2 / np.where(alive, b, 1.0), 0.0)
    best = int(gains.argmax())
    if 0 < best < len(gains) - 1:  # between the frequencies that were looked at: on a parabola
        below, at, above = gains[best - 1 : best + 2]
        bend = max(2 * at - below - above, 1e-300)
        return float(2 * np.pi / (angle[best] + (angle[1] - angle[0]) * np.clip((above - below) / bend, -1, 1) / 2))
    return float(2 * np.pi / angle[best])


def waves(pool: Pool, judged: Comparison, theta: np.ndarray, rows: np.ndarray) -> list[Periodic]:
    """The wave that gains most of those that fit three times into the record, if there is one."""
    most = pool.record.longest_read() / pool.spacing / 3
    period = best_period(judged, theta, pool.place, most, rows)
    return [] if period is None else [Periodic(six_digits(period * pool.spacing), 1)]


def louder(judged: Comparison, theta: np.ndarray, angle: float) -> float:
    """How much louder what is left is near an angular frequency [rad per row] than under an assumed noise; at least 1.

    That noise falls smoothly with frequency; a running mean's does in lobes, whose tops are no waves. By the median
    power of the nearest rows: a wave, and others nearby, are a few of them only. Waves of many rows, as a day has, or
    near which it is far louder, are asked nothing: their heights change.
    """
    if angle < 2 * np.pi / LONG_WAVE:
        return 1.0
    bands = judged.bands
    off = np.abs(np.log(np.maximum(bands.angle[bands.order], 1e-300) / angle))
    near = np.flatnonzero(off < AROUND_WAVE)
    if len(near) < ROWS_AROUND:
        return 1.0
    near = near[np.argpartition(off[near], ROWS_AROUND - 1)[:ROWS_AROUND]]
    power = judged.left(theta)[near] ** 2 / bands.each_row(judged.S(theta))[near]
    louder_by = float(np.median(power)) / MEDIAN_SQUARE
    return 1.0 if louder_by > LOUDEST else max(1.0, louder_by / AS_USUAL)


def six_digits(seconds: float) -> float:
    """A time as it is told: no finer than it is found."""
    return float(f"{seconds:.6g}")

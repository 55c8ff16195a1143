"""A step at every row, and a wave of every period: what they would explain, all at once.

Under a noise that the cosine transform makes diagonal, the step at row k has a closed form in the transform, and its
moments with base and reading are sums from row k on. So all rows cost as much as a few columns.
"""

from __future__ import annotations

import numpy as np

from .likelihood import Comparison


def step_gains(judged: Comparison, theta: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Log likelihood that a step at each row gains under a given noise; 0 at the first row.

    `weight` is what rows are weighted with, shape (n,); where it is not 1, the result is an approximation.
    """
    bands, W = judged.bands, 1 / judged.bands.each_row(judged.S(theta))
    weighted = bands.back(np.column_stack((judged.left(theta), judged.Q)) * W[:, None]) * weight[:, None]
    sums = np.cumsum(weighted[::-1], axis=0)[::-1]
    full = _squares(judged, W) * np.cumsum(weight[::-1] ** 2)[::-1] / np.arange(judged.n, 0, -1)
    own = full - judged.taken(theta, sums[:, 1:])
    alive = own > 1e-8 * full
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


def best_period(judged: Comparison, theta: np.ndarray, most: float) -> float | None:
    """Period of the strongest wave in what the base leaves [rows], at most `most` rows; None where there is none.

    A wave of period 2 n/m rows is the row m of the cosine transform and its neighbours.
    """
    bands = judged.bands
    power = np.empty(judged.n)
    power[bands.order] = judged.left(theta) ** 2 / bands.each_row(judged.S(theta))
    piece = max(bands.pieces, key=lambda piece: piece.stop - piece.start)
    size = piece.stop - piece.start
    summed = np.convolve(power[piece], np.ones(3), "same")
    lowest = int(np.ceil(2 * size / most))
    if size - 2 <= lowest:
        return None
    return float(2 * size / (lowest + int(np.argmax(summed[lowest : size - 1]))))

"""The temperature of a while ago, at every delay of whole rows: what each would explain, all at once.

Beside the lags of the base, what is left of a delayed temperature is sharp in the delay: its neighbours on a grid of
delays explain a tenth of what the true one does. Moments with base and reading are cross correlations, by Fourier
transforms; weighted squares are sums over bands of frequency, which stay the same whatever the noise and the base.
"""

from __future__ import annotations

import numpy as np
from scipy.fft import irfft, next_fast_len, rfft

from ..effects import Delay
from .anywhere import six_digits
from .levels import ALIVE, BETWEEN, LATEST
from .likelihood import Comparison
from .pool import Pool

_TOGETHER = 32
"""Delays that are transformed at a time."""


class Shifts:
    """Delays of 1, 2, ... rows.

    Parameters
    ----------
    judged : Comparison
    T : array of shape (n,)
        Temperature of each row [K].
    segment : array of shape (n,)
        Number of the segment of each row; before a segment began, the temperature was that of its first row.
    weight : array of shape (n,)
        What rows are weighted with.
    """

    def __init__(self, judged: Comparison, T: np.ndarray, segment: np.ndarray, weight: np.ndarray):
        starts = np.flatnonzero(np.diff(segment, prepend=segment[0] - 1))
        sizes = np.diff([*starts, len(T)])
        self.most = int(LATEST * sizes.max())
        """Longest delay [rows]."""
        number = np.repeat(np.arange(len(starts)), sizes)
        place = np.arange(len(T)) + self.most * (number + 1)  # a segment's end does not reach into the next
        risen = T - T[starts][number]
        even = np.zeros(next_fast_len(int(place[-1]) + 1 + self.most, real=True))
        even[place] = risen
        self.place, self.weight, self.size = place, weight, len(even)
        self.T = rfft(even)
        delays = np.arange(1, self.most + 1)
        parts = [delays[k : k + _TOGETHER] for k in range(0, self.most, _TOGETHER)]
        squares = [
            judged.bands.sums(judged.bands.forward(((even[place - part[:, None]] - risen) * weight).T) ** 2)
            for part in parts
        ]
        self.squares = np.concatenate([np.zeros((len(judged.zz), 0)), *squares], axis=1)
        """Sums of squares of each delay's column in each band, shape (bands, most)."""

    def gains(self, judged: Comparison, theta: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """Log likelihood that each delay gains under a given noise, shape (most,).

        Where rows are left out as spikes, the result is an approximation. `rows` is what `anywhere.filtered` says.
        """
        moments = np.empty((self.most, rows.shape[1]))
        for j, column in enumerate((rows * self.weight[:, None]).T):
            even = np.zeros(self.size)
            even[self.place] = column
            together = irfft(rfft(even) * self.T.conj(), self.size)
            moments[:, j] = together[1 : self.most + 1] - together[0]
        full = self.squares.T @ (1 / judged.S(theta))
        own = full - judged.taken(theta, moments[:, 1:])
        alive = own > ALIVE**2 * full
        return np.asarray(np.where(alive, 0.5 * moments[:, 0] ** 2 / np.where(alive, own, 1.0), 0.0))


def delays(pool: Pool, shifts: Shifts, judged: Comparison, theta: np.ndarray, rows: np.ndarray) -> list[Delay]:
    """The delay of whole rows that gains most, and some to either side of it."""
    delay = pool.lapse(1 + int(shifts.gains(judged, theta, rows).argmax()))
    return [Delay(six_digits(delay + share * pool.spacing)) for share in BETWEEN]

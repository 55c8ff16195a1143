"""What begins at a row: products of columns cut there, for every row at once.

A column that is nought before row k has, under a noise of white and Ornstein-Uhlenbeck parts, products that follow from
those of row k + 1: the inverse of the noise's covariance is made of exponentials, and each needs one number to be
carried along (equations.noise.inverse_kernel). So all rows cost a few passes over the record.
"""

from __future__ import annotations

import numpy as np

from ..equations.noise import Kernel, decaying_sums, inverse_kernel
from .levels import FAINT, LEAST_OWN, TAKEN
from .likelihood import Comparison


def products_from(columns: np.ndarray, kernel: Kernel, mirrored: bool = True) -> np.ndarray:
    """Products ``columns[k:]' C^-1 columns[k:]`` at each row k of one span, C the covariance of the noise.

    `columns` (array of shape (n, c)). `kernel` (Kernel): Inverse covariance of the noise. `mirrored` (bool): Beyond
    its ends the span goes on as in a mirror, as the cosine transform has it. False: it is a part of a longer one.
    Returns array of shape (n, c, c).
    """
    white, sizes, ratios = kernel
    n = len(columns)
    later, own = columns.copy(), np.ones(n)
    for size, ratio in zip(sizes, ratios, strict=True):
        if size < FAINT * (1 - ratio):
            continue
        reach = min(n, int(-np.log(FAINT) / -np.log(ratio)) + 1) if mirrored else 0  # of the mirrors at either end
        carried = size * decaying_sums(columns[::-1], ratio)[::-1]
        own -= size
        if reach:
            power = ratio ** np.arange(reach)
            images = size * power * power * ratio
            own[:reach] -= images
            own[n - reach :] -= images[::-1]
            last = np.cumsum(columns[n - reach :][::-1] * power[:, None], axis=0)
            later[n - reach :] -= size * ratio * (last * power[:, None])[::-1]
            later[:reach] -= carried[:reach] * (power * power * ratio)[:, None]
        later -= carried
    one, other = columns[:, :, None], columns[:, None, :]
    each = one * later[:, None, :] + later[:, :, None] * other - one * other * own[:, None, None]
    return np.asarray(white * np.cumsum(each[::-1], axis=0)[::-1])


def cut_products(judged: Comparison, theta: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Products of columns, shape (n, c), that are nought before each row; noise of different spans is independent."""
    kernel = inverse_kernel(theta, judged.bands.times)
    result, later = np.empty((judged.n, columns.shape[1], columns.shape[1])), 0.0
    for piece in reversed(judged.bands.pieces):
        result[piece] = later + products_from(columns[piece], kernel)
        later = result[piece.start]
    return result


def change_gains(
    judged: Comparison, theta: np.ndarray, weight: np.ndarray, temperature: np.ndarray, rows: np.ndarray
) -> np.ndarray:
    """Log likelihood that another offset and sensitivity from each row on gain under a given noise, shape (n,).

    `judged` (Comparison). `theta` (array of shape (parts,)). `weight`, `temperature` (arrays of shape (n,)): What
    rows are weighted with, and the temperature less its mean. `rows` (array of shape (n, 1 + p)): What
    `anywhere.filtered` says.
    """
    bent = temperature / max(float(np.std(temperature)), 1e-300) * weight
    columns = np.column_stack((weight, bent))
    a, b = np.cumsum((rows[:, :1] * columns)[::-1], axis=0)[::-1].T
    full = cut_products(judged, theta, columns)
    left = full - _held(judged, theta, rows[:, 1:], columns)
    aa, ab, bb = left[:, 0, 0], left[:, 0, 1], left[:, 1, 1]
    determinant = aa * bb - ab**2
    alive = (aa > LEAST_OWN**2 * full[:, 0, 0]) & (bb > LEAST_OWN**2 * full[:, 1, 1])
    alive &= determinant > LEAST_OWN**2 * aa * bb
    squares = a**2 * bb - 2 * a * b * ab + b**2 * aa
    return np.where(alive, 0.5 * squares / np.where(alive, determinant, 1.0), 0.0)


def _held(judged: Comparison, theta: np.ndarray, base: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """What the base holds of the products of two columns cut at each row, shape (n, 2, 2).

    It changes slowly from row to row: it is computed at some rows, and straight lines go between.
    """
    some = np.unique(np.linspace(0, judged.n - 1, min(judged.n, TAKEN)).astype(int))
    parts = [np.add.reduceat(base * column[:, None], some, axis=0) for column in columns.T]
    one, other = (np.cumsum(part[::-1], axis=0)[::-1] for part in parts)
    aa, bb, both = (judged.taken(theta, part) for part in (one, other, one + other))
    pairs = np.array([[aa, (both - aa - bb) / 2], [(both - aa - bb) / 2, bb]])
    rows = np.arange(judged.n)
    return np.stack([np.stack([np.interp(rows, some, part) for part in line], -1) for line in pairs], -2)

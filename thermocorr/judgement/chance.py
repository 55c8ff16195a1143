"""Help that noise like the base's gives to some explanation or other."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .levels import BY_CHANCE, DRAWS, LEAST, USUAL
from .likelihood import Comparison
from .pool import Explanation, Key, Pool
from .worth import HeldOut, Worth


class HelpOfNoise:
    """What records drawn from the noise of a base make explanations seem to be worth.

    Help is measured for each kind and column by what the noise usually gives it (Westfall & Young 1993).

    `pool` (Pool). `judged` (Comparison): Its noise is drawn from, with a fixed seed. `held` (HeldOut): The base that
    help is beside. `tried` (sequence of Explanation). `coarse` (sequence of array): Their columns, as data not
    learned from are judged on.
    """

    def __init__(
        self, pool: Pool, judged: Comparison, held: HeldOut, tried: Sequence[Explanation], coarse: Sequence[np.ndarray]
    ):
        self.held = held
        root = np.sqrt(judged.bands.each_row(judged.S(judged.base.theta)))[:, None]
        draws = judged.unit * judged.bands.back(root * np.random.default_rng(0).standard_normal((judged.n, DRAWS)))
        drawn = HeldOut(pool.coarse(draws), held.base)
        which = [i for i in range(len(tried)) if judged.width(i) and not tried[i].effect.of_time_alone]
        helps: dict[Key, np.ndarray] = {}
        for i, values in zip(which, np.minimum(*drawn.falls([coarse[i] for i in which])), strict=True):
            key = tried[i].key
            helps[key] = np.maximum(helps[key], values) if key in helps else values
        self.usual = {key: max(float(np.quantile(values, USUAL)), LEAST) for key, values in helps.items()}
        """What the noise usually gives to each kind and column, but for time alone [dB]."""
        most = np.max([values / self.usual[key] for key, values in helps.items()], axis=0)
        self.limit = float(np.quantile(most, 1 - BY_CHANCE))
        """Multiple of it that some kind or other is given in few records only."""

    def gives(self, key: Key, worth: Worth) -> bool:
        """Whether noise gives some explanation or other so much help in more than a few records."""
        return worth.both / self.usual[key] <= self.limit

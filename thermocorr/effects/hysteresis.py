"""Hysteresis of friction and stress: a play operator."""

from __future__ import annotations

from collections.abc import Sequence
from numbers import Real
from typing import Any

import numpy as np
from sklearn.utils._param_validation import Interval

from ..records import Record
from .grids import temperature_quantiles
from .protocol import TEMPERATURE_DIFFERENCE, Effect, EffectInfo
from .signals import Signals


class Hysteresis(Effect):
    """Play of width w, less T [K].

    ``p[k] = min(max(p[k-1], T[k] - w/2), T[k] + w/2)``, the play operator (Visintin, Differential Models of
    Hysteresis, 1994, ch. III). It does not depend on how fast T moves. Each segment starts with p = T in the middle
    of the play, and a swing of T by more than w makes that start forgotten.

    Parameters
    ----------
    width : float
        w, in the unit of the temperature [K].

    Raises
    ------
    ValueError
        By `learn`, for a width that is not a positive number.
    """

    kind = "hysteresis"
    unit = "K"
    learned = {}
    info = EffectInfo(
        physics="Friction, solder creep or packaging stress makes the reading depend on whether the temperature was "
        "reached from above or from below.",
        bench_check="Go to the same temperature from above and from below and wait: the difference stays, however "
        "long the wait and however slow the approach.",
        formula="hysteresis[w] = p - T, where the play p stays put until T is w/2 away and is then dragged along",
        parameters={"width": TEMPERATURE_DIFFERENCE},
        tuned=("width",),
        example={"width": 0.8},
        place=4.0,
    )
    _parameter_constraints = {"width": [Interval(Real, 0, None, closed="neither")]}

    def __init__(self, width: float):
        self.width = width

    @classmethod
    def candidates(cls, record: Record, columns: Sequence[Any] | None = None) -> list[Effect]:
        """Widths from 3 % to 90 % of the range of temperatures."""
        low, high = temperature_quantiles(record, (0.02, 0.98))
        return [cls(float(f"{width:.3g}")) for width in np.geomspace(0.03, 0.9, 10) * (high - low) if width > 0]

    def learn(self, record: Record) -> None:
        """Check the width."""
        self._validate_params()

    def names(self) -> list[str]:
        """``hysteresis[0.5]``."""
        return [f"hysteresis[{self.width:.6g}]"]

    def signals(self, x: Signals) -> Sequence[Any]:
        """Play less temperature [K], within +- w/2."""
        return [x.play(x.T, self.width) - x.T]

    def label(self) -> str:
        """``hysteresis: width 0.5``."""
        return f"hysteresis: width {self.width:.6g}"

"""`Sensor` and `Reference`: what the user declares, type B in the words of the GUM."""

from __future__ import annotations

from dataclasses import dataclass
from numbers import Real

import numpy as np


@dataclass(frozen=True, kw_only=True)
class Sensor:
    """Standard uncertainties of the thermometer, type B; what is not declared counts as zero, and is listed so.

    Parameters
    ----------
    drift_since_learning : float, default 0.0
        How far its error may have moved since the record was fitted [K]. A constant error cancels: the model has
        learned what the reading does at the temperatures that this thermometer shows.
    calibration : float, default 0.0
        Of its calibration [K]. It cancels where the same thermometer, uncalibrated since, serves for learning and for
        correcting; it counts where `exchanged`.
    exchanged : bool, default False
        Whether another thermometer served for learning.
    noise : float or "auto", default "auto"
        Of one of its readings, beyond the noise it had while learning [K]. "auto": it is the thermometer of the fitted
        record, whose noise is in the residuals already.
    time_constant : float, default 0.0
        How far its lag may differ from the one it had while learning [s].
    """

    drift_since_learning: float = 0.0
    calibration: float = 0.0
    exchanged: bool = False
    noise: float | str = "auto"
    time_constant: float = 0.0

    def __post_init__(self) -> None:
        """Refuse what is no uncertainty."""
        if not isinstance(self.exchanged, bool):
            raise ValueError(
                f"The 'exchanged' parameter of Sensor must be True or False. Got {self.exchanged!r} instead."
            )
        for name in ("drift_since_learning", "calibration", "noise", "time_constant"):
            value = getattr(self, name)
            if name == "noise" and isinstance(value, str) and value == "auto":
                continue
            if isinstance(value, bool) or not isinstance(value, Real) or not 0 <= float(value) < np.inf:
                unit = "s" if name == "time_constant" else "K"
                raise ValueError(
                    f"The {name!r} parameter of Sensor must be a standard uncertainty in {unit}, zero or above. "
                    f"Got {value!r} instead."
                )

    @property
    def offset(self) -> float:
        """Standard uncertainty of an error that stays while readings are corrected [K]."""
        return float(np.hypot(self.drift_since_learning, self.calibration if self.exchanged else 0.0))

    @property
    def own_noise(self) -> float:
        """Noise of one temperature, beyond what was learned [K]."""
        return 0.0 if isinstance(self.noise, str) else float(self.noise)


@dataclass(frozen=True, kw_only=True)
class Reference:
    """What the level of the readings was set with."""

    uncertainty: float = 0.0
    """Standard uncertainty, in the unit of the reading."""
    dof: float = np.inf
    declared: bool = False

"""Which columns are thermometers, and the time constants of the bodies that follow each of them."""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Mapping
from dataclasses import asdict, dataclass
from numbers import Real
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from ..effects import Covariate, LaggedCovariate
from ..effects.protocol import Effect
from ..effects.thermal import column_text, seconds_array
from ..records import seconds_of

PREFIX = "thermometer_"
"""How the effects of further thermometers are called."""


@dataclass(frozen=True)
class Thermometer:
    """A column of temperatures, and what its thermometer is known to do wrong: an item of the parameter `temperature`.

    What is not declared is estimated where a record shows it, see `thermocorr.thermometer_errors`. A diagnosis takes
    it for the cause of what it explains.

    Parameters
    ----------
    column : str or int, optional
        As `temperature` itself; None for the one called "temperature", else the first.
    noise : float, optional
        Standard deviation of the noise of one of its readings, in its unit.
    resolution : float, optional
        Step of its readings, in its unit.
    time_constant : float or time span, default 0.0
        How late it is itself [s]. What the reading does is learned from what the thermometer shows, late or not, and is
        corrected hardly worse (measured up to 20 minutes at a row a minute); but "after a step of the temperature" is
        said of the air then.

    Raises
    ------
    ValueError
        For what is negative or no number.

    Examples
    --------
    >>> from thermocorr import DynamicBiasRegressor, Thermometer
    >>> model = DynamicBiasRegressor(Thermometer("case", noise=0.02, resolution=0.0625))
    """

    column: Any = None
    noise: float | None = None
    resolution: float | None = None
    time_constant: Any = 0.0

    def __post_init__(self) -> None:
        """Refuse what is no size."""
        for name in ("noise", "resolution"):
            value = getattr(self, name)
            if value is None:
                continue
            if isinstance(value, bool) or not isinstance(value, Real) or not 0 <= float(value) < np.inf:
                raise ValueError(
                    f"The {name!r} parameter of Thermometer must be a size in the unit of its column, zero or above. "
                    f"Got {value!r} instead."
                )
        if self.time_constant != 0:
            seconds_of(self.time_constant, "time_constant")

    @property
    def late(self) -> float:
        """Time constant [s]."""
        return 0.0 if self.time_constant == 0 else seconds_of(self.time_constant, "time_constant")

    @classmethod
    def given(cls, plain: Any) -> Any:
        """The parameter `temperature` from its form in a model file, see `plain`."""
        if isinstance(plain, list):
            return [cls.given(item) for item in plain]
        return cls(**plain) if isinstance(plain, dict) else plain

    @classmethod
    def plain(cls, temperature: Any) -> Any:
        """The parameter `temperature` in lists, dicts, texts and numbers."""
        if isinstance(temperature, list):
            return [cls.plain(item) for item in temperature]
        return asdict(temperature) if isinstance(temperature, Thermometer) else temperature


class Thermometers(NamedTuple):
    """The parameter `temperature`: one column, or a list of several."""

    ambient: Any
    """The temperature of the model, T; None where it has yet to be found."""
    further: tuple[Any, ...]
    """Columns beside it, each with lags of its own."""
    declared: Mapping[Any, Thermometer]
    """Properties that the user declares, by column."""

    @classmethod
    def of(cls, temperature: Any) -> Thermometers:
        """What was given; ValueError for an empty list, and for a column that stands in it twice."""
        if isinstance(temperature, np.ndarray | pd.Index):
            temperature = temperature.tolist()
        given = temperature if isinstance(temperature, list) else [temperature]
        declared = {item.column: item for item in given if isinstance(item, Thermometer)}
        names = [item.column if isinstance(item, Thermometer) else item for item in given]
        if not isinstance(temperature, list):
            return cls(names[0], (), declared)
        hashable = all(isinstance(name, Hashable) for name in names)
        if not names or not hashable or len(set(names)) < len(names):
            raise ValueError(
                "The 'temperature' parameter must be a column, or a list of different ones, the one nearest to the "
                f"device's surroundings first. Got {temperature!r} instead."
            )
        return cls(names[0], tuple(names[1:]), declared)

    def of_column(self, column: Any) -> Thermometer:
        """What is said of a column."""
        of_unnamed = self.declared.get(None, Thermometer()) if column not in self.further else Thermometer()
        return self.declared.get(column, of_unnamed)

    def split(self, time_constants: Any) -> tuple[Any, dict[Any, Any]]:
        """Time constants of the first thermometer, and of each further one.

        Parameters
        ----------
        time_constants : sequence, or mapping of column to sequence
            A sequence holds for every thermometer; one that a mapping leaves out acts at once.

        Raises
        ------
        ValueError
            For a column that is no thermometer.
        """
        if not isinstance(time_constants, Mapping):
            return time_constants, dict.fromkeys(self.further, time_constants)
        known = (self.ambient, *self.further)
        for name in time_constants:
            if name not in known:
                raise ValueError(
                    f"The 'time_constants' parameter names {name!r}, which is not among the thermometers "
                    f"temperature={list(known)!r}."
                )
        return time_constants.get(self.ambient, ()), {name: time_constants.get(name, ()) for name in self.further}

    def effects(self, time_constants: Any, hold: str) -> list[tuple[str, Effect]]:
        """The further thermometers as named effects."""
        return [
            (
                f"{PREFIX}{column_text(name)}",
                LaggedCovariate(name, taus, hold) if np.size(taus) else Covariate(name),
            )
            for name, taus in self.split(time_constants)[1].items()
        ]

    def times_in(self, effects: Iterable[tuple[str, Effect]]) -> dict[Any, np.ndarray]:
        """Time constants of each further thermometer [s], from the named effects of a model."""
        found = {effect.inputs()[0]: effect for name, effect in effects if name.startswith(PREFIX) and effect.inputs()}
        return {name: seconds_array(getattr(found.get(name), "time_constants", ())) for name in self.further}

    def all_times(self, time_constants: Any) -> list[float]:
        """Time constants of all thermometers together [s], each once, increasing."""
        first, further = self.split(time_constants)
        some = [seconds_array(taus) for taus in (first, *further.values()) if np.size(taus)]
        return np.unique(np.concatenate(some)).tolist() if some else []

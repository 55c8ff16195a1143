"""Which columns are thermometers, and the time constants of the bodies that follow each of them."""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from ..effects import Covariate, LaggedCovariate
from ..effects.protocol import Effect
from ..effects.thermal import column_text, seconds_array

PREFIX = "thermometer_"
"""How the effects of further thermometers are called."""


class Thermometers(NamedTuple):
    """The parameter `temperature`: one column, or a list of several."""

    ambient: Any
    """The temperature of the model, T; None where it has yet to be found."""
    further: tuple[Any, ...]
    """Columns beside it, each with lags of its own."""

    @classmethod
    def of(cls, temperature: Any) -> Thermometers:
        """What was given; ValueError for an empty list, and for a column that stands in it twice."""
        if isinstance(temperature, np.ndarray | pd.Index):
            temperature = temperature.tolist()
        if not isinstance(temperature, list):
            return cls(temperature, ())
        hashable = all(isinstance(name, Hashable) for name in temperature)
        if not temperature or not hashable or len(set(temperature)) < len(temperature):
            raise ValueError(
                "The 'temperature' parameter must be a column, or a list of different ones, the one nearest to the "
                f"device's surroundings first. Got {temperature!r} instead."
            )
        return cls(temperature[0], tuple(temperature[1:]))

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
                    f"The 'time_constants' parameter has some for {name!r}, which is none of the thermometers in "
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

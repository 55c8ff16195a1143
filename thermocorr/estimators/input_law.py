"""How the bias that a model knows depends on one recorded column: at once, and late."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..effects import Covariate, StaticPolynomial, ThermalLag
from ..effects.expressions import reads_temperature
from ..effects.protocol import Effect

FELT = 0.05
"""Share of the residuals' standard deviation below which a late error is forgotten."""


@dataclass(frozen=True)
class InputLaw:
    """How the bias depends on one column."""

    column: Any
    powers: tuple[tuple[int, float, float], ...]
    """Power, coefficient and origin of each static term."""
    time_constants: np.ndarray
    weights: np.ndarray
    """Time constants [s] and coefficients of the lags."""
    least: float
    """What the bias need not be told of."""
    known: bool
    """False where some other effect reads the column."""

    def slope(self, value: float) -> float:
        """Change of the static law with the column."""
        if np.isnan(value):
            return 0.0
        return sum(power * weight * (value - origin) ** (power - 1) for power, weight, origin in self.powers)


def law_of_inputs(
    effects: Sequence[Effect], coef: np.ndarray, temperature: Any, columns: Sequence[Any], deviation: float
) -> list[InputLaw]:
    """How the bias depends on each of some columns.

    Parameters
    ----------
    effects : sequence of Effect
        Learned.
    coef : array of shape (n_columns,)
    temperature : column
        The ambient temperature.
    columns : sequence of columns
    deviation : float
        Standard deviation of the residuals, beside which late errors are forgotten.
    """
    edges = np.cumsum([0, *(effect.n_columns() for effect in effects)])
    parts = [(effect, coef[low:high]) for effect, low, high in zip(effects, edges, edges[1:], strict=False)]
    return [_law(column, parts, temperature, FELT * deviation) for column in columns]


def _law(column: Any, parts: Sequence[tuple[Effect, np.ndarray]], temperature: Any, least: float) -> InputLaw:
    powers: list[tuple[int, float, float]] = []
    taus, weights, known = [], [], True
    for effect, coef in parts:
        if isinstance(effect, StaticPolynomial) and column == temperature:
            powers += [
                (power, float(weight), float(effect.reference_temperature_))
                for power, weight in zip(effect.powers(), coef, strict=True)
            ]
        elif isinstance(effect, ThermalLag) and column == temperature:
            taus += effect.time_constants_.tolist()
            weights += coef.tolist()
        elif isinstance(effect, Covariate) and effect.column == column:
            powers.append((effect.power, float(coef[0]), 0.0))
            if len(coef) > 1 and effect.power == 1:
                taus += list(getattr(effect, "time_constants_", ()))
                weights += coef[1:].tolist()
            known &= len(coef) == 1 or effect.power == 1
        elif column in effect.inputs() or (column == temperature and reads_temperature(effect)):
            known = known and not coef.any()
    return InputLaw(
        column=column,
        powers=tuple(powers),
        time_constants=np.array(taus, float),
        weights=np.array(weights, float),
        least=least,
        known=known,
    )

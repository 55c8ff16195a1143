"""A recorded column whose effect does not change its sign with it: curvature about the usual value."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ..records import Record
from .covariates import has_middle
from .protocol import Effect, EffectInfo, suspects
from .signals import Signals
from .thermal import column_text, column_unit


class QuadraticCovariate(Effect):
    """A recorded column that acts by the square of its distance from its mean: ``(column - mean)^2``.

    `Covariate` with ``power=2`` squares the column itself, as a current dissipates heat; of a column that swings little
    about a large mean (a supply of 230 V, a pressure of 1000 hPa) that is nearly a straight line. This is the rest.

    Parameters
    ----------
    column : str or int
        Name (frames) or number (arrays) of the column.
    """

    kind = "quadratic_covariate"
    is_product = True
    learned = {"mean_": "number", "variance_": "number"}
    info = EffectInfo(
        physics="The reading depends on another recorded quantity along a curve: it moves the same way whether that "
        "quantity rises or falls, as where a bridge leaves its balance, or a second law has its own curvature.",
        bench_check="Raise that quantity and lower it by the same amount, at constant temperature: the reading moves "
        "the same way both times, and four times as far for twice the amount.",
        formula="column curved = (column - its mean)^2 less its mean",
        example={"column": "supply"},
        place=2.45,
    )

    def __init__(self, column: Any = None):
        self.column = column

    @classmethod
    def candidates(cls, record: Record, columns: Sequence[Any] | None = None) -> list[Effect]:
        """Every suspect column but switches, whose squares are copies of them."""
        return [cls(name) for name in suspects(record, columns) if has_middle(record, name)]

    def learn(self, record: Record) -> None:
        """Fix the column's mean and variance, so that U0 stays the reading under usual conditions."""
        moments = record.moments(self.column)
        self.mean_, self.variance_ = moments.mean, moments.std**2

    def names(self) -> list[str]:
        """``supply curved``."""
        return [f"{column_text(self.column)} curved"]

    def units(self) -> list[str]:
        """The square of the column's unit where its name tells it, else of "unit"."""
        unit = column_unit(self.column)
        return [f"{unit}^2" if unit else ""]

    def means(self) -> dict[str, float]:
        """Mean of the column, and of the square of its distance from it."""
        name = column_text(self.column)
        return {name: self.mean_, f"({name} - its mean)^2": self.variance_}

    def signals(self, x: Signals) -> Sequence[Any]:
        """The square of the distance from the mean, less its own mean."""
        return [(x[self.column] - self.mean_) ** 2 - self.variance_]

    def label(self) -> str:
        """``quadratic covariate: supply``."""
        return f"quadratic covariate: {self.column}"

"""A recorded column whose effect is used up: adsorption and other saturation."""

from __future__ import annotations

from collections.abc import Sequence
from numbers import Real
from typing import Any

from sklearn.utils._param_validation import Interval

from ..records import Record
from .covariates import swings
from .protocol import Effect, EffectInfo, suspects
from .signals import BlockSignals, Signals
from .thermal import column_text


class SaturatingCovariate(Effect):
    """A recorded column that acts less the larger it is: c/(c + half), the isotherm of Langmuir (J. Am. Chem. Soc. 40).

    Parameters
    ----------
    column : str or int
        Name (frames) or number (arrays) of the column; values below 0 count as 0.
    half : float, default 50.0
        Value of the column at which half of the effect is reached, in its unit.
    """

    kind = "saturating_covariate"
    learned = {"mean_": "number"}
    info = EffectInfo(
        physics="Another recorded quantity acts until its effect is used up: a film of adsorbed moisture that grows "
        "full, a core or an amplifier near saturation.",
        bench_check="Raise that quantity in equal steps at constant temperature: each step moves the reading by less "
        "than the one before.",
        formula="column saturated[half] = column/(column + half) less its mean",
        parameters={"half": "unit of the column"},
        tuned=("half",),
        example={"column": "humidity", "half": 15.0},
        place=2.4,
    )
    _parameter_constraints = {"half": [Interval(Real, 0, None, closed="neither")]}

    def __init__(self, column: Any = None, half: float = 50.0):
        self.column = column
        self.half = half

    @classmethod
    def candidates(cls, record: Record, columns: Sequence[Any] | None = None) -> list[Effect]:
        """Columns that swing by more than a tenth of a positive mean, bent strongly and mildly."""
        found = [name for name in suspects(record, columns) if swings(record, name)]
        means = {name: record.moments(name).mean for name in found}
        # Halves to try, as shares of a column's mean: strongly and mildly bent
        return [cls(name, float(f"{s * mean:.3g}")) for name, mean in means.items() if mean > 0 for s in (0.3, 1.5)]

    def learn(self, record: Record) -> None:
        """Fix the mean."""
        self._validate_params()
        self.mean_ = 0.0
        parts = (self.signals(BlockSignals(block, None))[0] for block in record.blocks())
        self.mean_ = sum(float(part.sum()) for part in parts) / record.n_used

    def names(self) -> list[str]:
        """``humidity saturated[50]``."""
        return [f"{column_text(self.column)} saturated[{self.half:.6g}]"]

    def means(self) -> dict[str, float]:
        """Mean of the share."""
        name = column_text(self.column)
        return {f"{name}/({name} + {self.half:.6g})": self.mean_}

    def signals(self, x: Signals) -> Sequence[Any]:
        """The share of the effect that is reached, less its mean."""
        value = x.maximum(x[self.column], 0.0)
        return [value / (value + self.half) - self.mean_]

    def label(self) -> str:
        """``saturating covariate: humidity, half at 50``."""
        return f"saturating covariate: {self.column}, half at {self.half:.6g}"

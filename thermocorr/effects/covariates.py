"""Effects of other recorded columns: static, with lags of their own, and as a partner of T."""

from __future__ import annotations

from collections.abc import Sequence
from numbers import Integral
from typing import Any

from sklearn.utils._param_validation import Interval

from ..records import Record
from .grids import time_grid
from .protocol import Effect, EffectInfo, suspects, time_text
from .signals import Signals
from .thermal import HOLD, column_text, column_unit, seconds_array


class Covariate(Effect):
    """A recorded column that acts at once: humidity, pressure, supply voltage, a second temperature, ...

    Parameters
    ----------
    column : str or int
        Name (frames) or number (arrays) of the column.
    power : int, default 1
        2 takes the square of the column: the power that a current dissipates.
    """

    kind = "covariate"
    learned = {"mean_": "number"}
    info = EffectInfo(
        physics="Another recorded quantity acts on the reading at once.",
        bench_check="Change that quantity alone, at constant temperature: the reading follows without delay.",
        formula="a recorded column stands for itself (or its power) less its mean",
        example={"column": "humidity"},
        place=2.0,
    )
    _parameter_constraints = {"power": [Interval(Integral, 1, 9, closed="both")]}

    def __init__(self, column: Any = None, power: int = 1):
        self.column = column
        self.power = power

    @classmethod
    def candidates(cls, record: Record, columns: Sequence[Any] | None = None) -> list[Effect]:
        """Every suspect column; its square too where that is no copy of the column."""
        return [cls(name, power) for name in suspects(record, columns) for power in _powers(record, name)]

    def learn(self, record: Record) -> None:
        """Fix the column's mean, so that U0 stays the reading under usual conditions."""
        self._validate_params()
        self.mean_ = record.moments(self.column, self.power).mean

    def names(self) -> list[str]:
        """The column's own name; ``current^2``."""
        return [column_text(self.column) + (f"^{self.power}" if self.power > 1 else "")]

    def units(self) -> list[str]:
        """The column's unit where its name tells it (``room_rh_pct``), else "unit"."""
        unit = column_unit(self.column)
        return [(f"{unit}^{self.power}" if self.power > 1 and unit else unit)] * self.n_columns()

    def means(self) -> dict[str, float]:
        """Mean of the column, or of its power."""
        return {Covariate.names(self)[0]: self.mean_}

    def _value(self, x: Signals) -> Any:
        return x[self.column] if self.power == 1 else x[self.column] ** self.power

    def signals(self, x: Signals) -> Sequence[Any]:
        """The column less its mean."""
        return [self._value(x) - self.mean_]

    def label(self) -> str:
        """``covariate: humidity``, ``lagged covariate: current^2``."""
        return super().label() + (f"^{self.power}" if self.power > 1 else "")


class LaggedCovariate(Covariate):
    """A recorded column that acts late: moisture uptake, self-heating by power, a second thermal environment.

    Columns are the recorded one (less its mean) and its lag differences, eq. (19) with the column in place of T.

    Parameters
    ----------
    column, power : see `Covariate`
    time_constants : sequence, default (3600,)
        [s], or spans such as "2 h".
    hold : {"first_order", "zero_order"}, default "first_order"
        See `ThermalLag`.
    """

    kind = "lagged_covariate"
    learned = {"mean_": "number", "time_constants_": "times"}
    info = EffectInfo(
        physics="Another recorded quantity acts on the reading late: moisture that is taken up, heat that a current "
        "dissipates, a second thermal environment.",
        bench_check="Step that quantity alone, at constant temperature: the reading creeps to its new value with the "
        "stated time constant.",
        formula="column = the recorded one less its mean; column lag[tau] = lagged column - column, where "
        "tau d(lagged)/dt = column - lagged",
        parameters={"time_constants": "s"},
        tuned=("time_constants",),
        example={"column": "humidity", "time_constants": [21_600.0]},
        place=2.1,
    )
    _parameter_constraints = {**Covariate._parameter_constraints, "hold": HOLD}

    def __init__(
        self, column: Any = None, time_constants: Sequence[Any] = (3600.0,), hold: str = "first_order", power: int = 1
    ):
        self.column = column
        self.time_constants = time_constants
        self.hold = hold
        self.power = power

    @classmethod
    def candidates(cls, record: Record, columns: Sequence[Any] | None = None) -> list[Effect]:
        """Every suspect column (and square) with one time constant, from two steps to a fifth of the segment."""
        times = time_grid(record, 2.0, 0.2, 2.5)
        return [
            cls(name, [tau], power=power)
            for name in suspects(record, columns)
            for power in _powers(record, name)
            for tau in times
        ]

    def learn(self, record: Record) -> None:
        """Fix the mean; convert time constants to seconds."""
        super().learn(record)
        self.time_constants_ = seconds_array(self.time_constants)

    def names(self) -> list[str]:
        """``humidity``, ``humidity lag[3600 s]``, ..."""
        name = super().names()[0]
        return [name, *(f"{name} lag[{time_text(tau)}]" for tau in self.time_constants_)]

    def signals(self, x: Signals) -> Sequence[Any]:
        """The column and its lag differences."""
        value = self._value(x)
        return [value - self.mean_, *x.lag(value, self.time_constants_, self.hold)]


class ColumnLags(LaggedCovariate):
    """The lag differences of a recorded column without the column itself."""

    def names(self) -> list[str]:
        """``humidity lag[3600 s]``, ..."""
        return super().names()[1:]

    def signals(self, x: Signals) -> Sequence[Any]:
        """The lag differences."""
        return super().signals(x)[1:]


class Interaction(Effect):
    """A sensitivity to temperature that depends on a recorded column: (T - T0) (column - its mean).

    Parameters
    ----------
    column : str or int
        Name (frames) or number (arrays) of the column.
    """

    kind = "interaction"
    is_product = True
    learned = {"mean_": "number", "reference_temperature_": "temperature", "temperature_name_": "column"}
    info = EffectInfo(
        physics="The temperature coefficient depends on another recorded quantity, such as supply or load.",
        bench_check="Measure the temperature coefficient at two values of that quantity: it differs.",
        formula="temperature*column = (T less its mean) * (column less its mean)",
        example={"column": "supply"},
        place=2.2,
    )

    def __init__(self, column: Any = None):
        self.column = column

    @classmethod
    def candidates(cls, record: Record, columns: Sequence[Any] | None = None) -> list[Effect]:
        """Every suspect column."""
        return [cls(name) for name in suspects(record, columns)]

    def learn(self, record: Record) -> None:
        """Fix both means, so that the static coefficients keep their meaning."""
        self.mean_ = record.moments(self.column).mean
        self.reference_temperature_ = record.moments(record.temperature_name).mean
        self.temperature_name_ = record.temperature_name

    def names(self) -> list[str]:
        """``temperature*supply``."""
        return [f"{column_text(self.temperature_name_)}*{column_text(self.column)}"]

    def units(self) -> list[str]:
        """K times the column's unit where its name tells it, else "unit"."""
        return [f"K {column_unit(self.column)}".strip()]

    def means(self) -> dict[str, float]:
        """Means of the temperature and of the column."""
        of_temperature = {column_text(self.temperature_name_): self.reference_temperature_}
        return {**of_temperature, column_text(self.column): self.mean_}

    def signals(self, x: Signals) -> Sequence[Any]:
        """Product of temperature and column, both less their means."""
        return [(x.T - self.reference_temperature_) * (x[self.column] - self.mean_)]


def _powers(record: Record, column: Any) -> tuple[int, ...]:
    """Powers of a column worth trying: its square where that is no copy of it."""
    return (1, 2) if swings(record, column) else (1,)


def swings(record: Record, column: Any) -> bool:
    """True if bent copies of a column are no copies: it swings by over a tenth of its mean, and is not on or off."""
    known = record.moments(column)
    # Spread over mean of a column above which its square is no copy of itself
    return known.std > 0.1 * abs(known.mean) and has_middle(record, column)


def has_middle(record: Record, column: Any) -> bool:
    """True if a column knows more than two values: one that does not is a copy of any function of it."""
    known = record.moments(column)
    return any(bool(((block[column] > known.low) & (block[column] < known.high)).any()) for block in record.blocks())

"""Effects of other recorded columns, at once or late."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from numbers import Integral, Real
from typing import Any

from sklearn.utils._param_validation import Interval

from ..records import Record
from ..records.numbers import span_text
from .grids import time_grid
from .protocol import Effect, EffectInfo, suspects, time_text
from .signals import BlockSignals, Signals
from .thermal import HOLD, column_text, column_unit, seconds_array


class OfColumn(Effect):
    """A function of one recorded column, less its mean."""

    column: Any

    def learn(self, record: Record) -> None:
        """Fix the mean."""
        self._validate_params()
        self.mean_ = 0.0
        parts = (self.signals(BlockSignals(block, None))[0] for block in record.blocks())
        self.mean_ = sum(float(part.sum()) for part in parts) / record.n_used

    def _text(self) -> str:
        """The function, in a column's name."""
        raise NotImplementedError

    def _value(self, x: Signals) -> Any:
        """The function."""
        raise NotImplementedError

    def names(self) -> list[str]:
        """``humidity``, ``current^2``, ``humidity saturated[50]``, ``supply curved``."""
        return [self._text()]

    def means(self) -> dict[str, float]:
        """Mean of the function."""
        return {self._text(): self.mean_}

    def signals(self, x: Signals) -> Sequence[Any]:
        """The function less its mean."""
        return [self._value(x) - self.mean_]


class Covariate(OfColumn):
    """A recorded column that acts at once: humidity, pressure, ...

    Parameters
    ----------
    column : str or int
        Name (frames) or number (arrays) of the column.
    power : int, default 1
        1 to 9; 2 takes the square of the column: the power that a current dissipates. A diagnosis tries 1 and 2.
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
        """Every suspect column, and its square."""
        return [cls(name, power) for name in suspects(record, columns) for power in _powers(record, name)]

    def learn(self, record: Record) -> None:
        """Learn the column's mean."""
        self._validate_params()
        self.mean_ = record.moments(self.column, self.power).mean

    def _text(self) -> str:
        return column_text(self.column) + (f"^{self.power}" if self.power > 1 else "")

    def units(self) -> list[str]:
        """The column's unit where its name tells it (``room_rh_pct``), else "unit"."""
        unit = column_unit(self.column)
        return [(f"{unit}^{self.power}" if self.power > 1 and unit else unit)] * self.n_columns()

    def _value(self, x: Signals) -> Any:
        return x[self.column] if self.power == 1 else x[self.column] ** self.power

    def label(self) -> str:
        """``covariate: humidity``, ``lagged covariate: current^2``."""
        return super().label() + (f"^{self.power}" if self.power > 1 else "")


class LaggedCovariate(Covariate):
    """A recorded column that acts late: moisture, self-heating, ...

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
        """Every suspect column and square, with one time constant."""
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
        return [self._text(), *(f"{self._text()} lag[{time_text(tau)}]" for tau in self.time_constants_)]

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


class SaturatingCovariate(OfColumn):
    """A column that saturates: c/(c + half), Langmuir's isotherm.

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
        """Columns that swing by a tenth of a positive mean."""
        found = [name for name in suspects(record, columns) if swings(record, name)]
        means = {name: record.moments(name).mean for name in found}
        # A half at 0.3 of the column's mean is strongly bent, one at 1.5 mildly.
        return [cls(name, float(f"{s * mean:.3g}")) for name, mean in means.items() if mean > 0 for s in (0.3, 1.5)]

    def _text(self) -> str:
        return f"{column_text(self.column)} saturated[{self.half:.6g}]"

    def _value(self, x: Signals) -> Any:
        value = x.maximum(x[self.column], 0.0)
        return value / (value + self.half)

    def label(self) -> str:
        """``saturating covariate: humidity, half at 50``."""
        return f"saturating covariate: {self.column}, half at {self.half:.6g}"


class QuadraticCovariate(OfColumn):
    """The squared deviation of a column from its mean.

    `Covariate` with ``power=2`` squares the column itself, as a current dissipates heat; of a column that swings little
    about a large mean (a supply of 230 V, a pressure of 1000 hPa) that is nearly a straight line. This is the rest.

    Parameters
    ----------
    column : str or int
        Name (frames) or number (arrays) of the column.
    """

    kind = "quadratic_covariate"
    is_product = True
    learned = {"centre_": "number", "mean_": "number"}
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
        """Fix the column's mean and variance."""
        moments = record.moments(self.column)
        self.centre_, self.mean_ = moments.mean, moments.std**2

    def _text(self) -> str:
        return f"{column_text(self.column)} curved"

    def _value(self, x: Signals) -> Any:
        return (x[self.column] - self.centre_) ** 2

    def units(self) -> list[str]:
        """The square of the column's unit, or "unit"."""
        unit = column_unit(self.column)
        return [f"{unit}^2" if unit else ""]

    def means(self) -> dict[str, float]:
        """Mean of the column, and of its squared deviation."""
        return {column_text(self.column): self.centre_, **super().means()}


class Interaction(Effect):
    """Sensitivity that depends on a column: (T - T0) (column - mean).

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
        """K times the column's unit, or "unit"."""
        return [f"K {column_unit(self.column)}".strip()]

    def means(self) -> dict[str, float]:
        """Means of the temperature and of the column."""
        of_temperature = {column_text(self.temperature_name_): self.reference_temperature_}
        return {**of_temperature, column_text(self.column): self.mean_}

    def signals(self, x: Signals) -> Sequence[Any]:
        """Product of temperature and column, both less their means."""
        return [(x.T - self.reference_temperature_) * (x[self.column] - self.mean_)]


def _powers(record: Record, column: Any) -> tuple[int, ...]:
    """Powers of a column worth trying: one, or two."""
    return (1, 2) if swings(record, column) else (1,)


def swings(record: Record, column: Any) -> bool:
    """True if a column swings enough for curvature to show."""
    known = record.moments(column)
    # The square of a column that spreads by a tenth of its mean or less is a copy of it.
    return known.std > 0.1 * abs(known.mean) and has_middle(record, column)


def has_middle(record: Record, column: Any) -> bool:
    """True if a column has more than two values."""
    known = record.moments(column)
    return any(bool(((block[column] > known.low) & (block[column] < known.high)).any()) for block in record.blocks())


class LaggedModulation(Effect):
    """A fast quantity times a slow one that acts late.

    `Interaction` is the same without a lag, and `LagProducts` has the products of the temperature with its own lags.

    Parameters
    ----------
    fast : str, int or None, default None
        Column whose influence on the reading changes; None for the temperature.
    slow : str, int or None, default None
        Column that changes it, late; None for the temperature.
    time_constant : float or time span, default "6 h"
        How late [s].

    Raises
    ------
    ValueError
        By `learn`, for a time constant that is not a positive time, and where neither column is named.
    """

    kind = "lagged_modulation"
    is_product = True
    learned = {"time_constant_": "positive", "temperature_name_": "column", "means_": "numbers"}
    info = EffectInfo(
        physics="The sensitivity to one quantity depends on another one that acts late: moisture that is taken up "
        "changes the temperature coefficient, the inner temperature changes the influence of the supply.",
        bench_check="Step the slow quantity and measure the sensitivity to the fast one at once and much later: it "
        "creeps to its new value with the stated time constant.",
        formula="fast*slow[tau] = (fast less its mean) (lagged slow less the mean of slow), where "
        "tau d(lagged)/dt = slow - lagged",
        parameters={"time_constant": "s"},
        tuned=("time_constant",),
        example={"slow": "humidity", "time_constant": 21_600.0},
        place=2.3,
    )

    def __init__(self, fast: Any = None, slow: Any = None, time_constant: Any = "6 h"):
        self.fast = fast
        self.slow = slow
        self.time_constant = time_constant

    @classmethod
    def candidates(cls, record: Record, columns: Sequence[Any] | None = None) -> list[Effect]:
        """Temperature by each late column, and the reverse.

        Time constants go from 20 steps (shorter ones are `Interaction` by another name) to a tenth of the longest
        segment.
        """
        times = time_grid(record, 20.0, 0.1, 5.0)
        pairs = [pair for name in suspects(record, columns) for pair in ((None, name), (name, None))]
        return [cls(fast, slow, tau) for fast, slow in pairs for tau in times]

    def inputs(self) -> list[Any]:
        """The columns besides the temperature."""
        return list(dict.fromkeys(name for name in (self.fast, self.slow) if name is not None))

    def learn(self, record: Record) -> None:
        """Fix both means; convert the time constant to seconds."""
        if not self.inputs():
            raise ValueError(
                "LaggedModulation needs a column as 'fast' or 'slow'. For products of the temperature with its own "
                "lags take LagProducts(..., temperature_products=True)."
            )
        self.time_constant_ = float(seconds_array([self.time_constant])[0])
        self.temperature_name_ = record.temperature_name
        self.means_ = [float(record.moments(self._name(given)).mean) for given in (self.fast, self.slow)]

    def _name(self, given: Any) -> Any:
        return self.temperature_name_ if given is None else given

    def names(self) -> list[str]:
        """``temperature*humidity[21600 s]``."""
        fast, slow = (column_text(self._name(given)) for given in (self.fast, self.slow))
        return [f"{fast}*{slow}[{time_text(self.time_constant_)}]"]

    def units(self) -> list[str]:
        """K times the column's unit, or "unit"."""
        return [" ".join("K" if given is None else column_unit(given) for given in (self.fast, self.slow)).strip()]

    def means(self) -> dict[str, float]:
        """Means of both quantities."""
        names = (column_text(self._name(given)) for given in (self.fast, self.slow))
        return dict(zip(names, self.means_, strict=True))

    def signals(self, x: Signals) -> Sequence[Any]:
        """Product of the fast and the lagged slow quantity."""
        fast, slow = (x.T if given is None else x[given] for given in (self.fast, self.slow))
        late = slow + x.lag(slow, [self.time_constant_])[0]  # eq. (19): lagged = slow + its difference
        return [(fast - self.means_[0]) * (late - self.means_[1])]

    def label(self) -> str:
        """``lagged modulation: temperature by humidity, 21600 s late``."""
        return self._named(time_text)

    def title(self) -> str:
        """``lagged modulation: temperature by humidity, 6 h late``."""
        return self._named(span_text)

    def _named(self, said: Callable[[float], str]) -> str:
        fast, slow = ("temperature" if given is None else str(given) for given in (self.fast, self.slow))
        return f"lagged modulation: {fast} by {slow}, {said(float(seconds_array([self.time_constant])[0]))} late"

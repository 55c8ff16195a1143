"""The effect protocol: record in, named columns out, with a state."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import Any, ClassVar

import numpy as np
from sklearn.base import BaseEstimator, clone

from ..records import Block, Record, seconds_of
from ..records.errors import option
from .expressions import words_of
from .signals import BlockSignals, Signals

SINCE_START = "s since the start"
"""Unit of a parameter that is a moment of the record, for which a date will do as well."""
TEMPERATURE = "unit of the temperature"
"""Unit of a parameter that is a temperature, and no difference of temperatures."""
TEMPERATURE_DIFFERENCE = "K, or degF where the temperature is in degF"
"""Unit of a parameter that is a difference of temperatures."""


@dataclass(frozen=True)
class EffectInfo:
    """Catalogue entry of a kind of effect."""

    physics: str
    """What it stands for in an instrument, one sentence."""
    bench_check: str
    """How to confirm it on the bench, one sentence."""
    formula: str
    """What its columns are, in the words of their names."""
    parameters: Mapping[str, str] = field(default_factory=dict)
    """Unit of each parameter of the constructor that has one: "s" for time spans, `SINCE_START` for moments,
    `TEMPERATURE` for temperatures, `TEMPERATURE_DIFFERENCE` for their differences."""
    tuned: tuple[str, ...] = ()
    """Positive parameters (or lists of them) that a local search may scale."""
    example: Mapping[str, Any] = field(default_factory=dict)
    """Parameters that show well what it does, for its page."""
    place: float = 9.0
    """In the catalogue: thermal kinds from 1, recorded columns from 2, time from 3, history and place from 4."""


class ParametersOnce(BaseEstimator):
    """Parameter names of a constructor, read once per class."""

    @classmethod
    @cache
    def _get_param_names(cls) -> list[str]:
        return super()._get_param_names()  # type: ignore[no-any-return]


class Effect(ParametersOnce):
    """Base class of effects, the catalogue's and the user's own.

    An effect of your own needs a constructor that stores its parameters, `names`, and `signals`, its formula::

        class FanNoise(Effect):
            kind = "fan_noise"
            def __init__(self, column="fan_rpm"):
                self.column = column
            def names(self):
                return [f"{self.column}^2"]
            def signals(self, x):
                return [x[self.column] ** 2]

    It then takes part in a model through ``DynamicBiasRegressor(effects=[FanNoise()])``, in its live correction, its
    file and its C code. What `signals` may use is listed in `thermocorr.effects.Signals`; a formula that cannot be
    written this way goes into `columns` instead, and has all of this but the C code.

    The kinds of `thermocorr.datasets.make_record` are planted in a simulated record under the same name and with the
    same parameters, by formulas of its own: ``make_record(effects={"hysteresis": 2.0})``.
    """

    kind: ClassVar[str] = "own"
    """Stable identifier of the physical cause."""
    info: ClassVar[EffectInfo | None] = None
    """What the catalogue says about it."""
    unit: ClassVar[str] = ""
    """Unit of all columns, where they have one in common; else see `units`."""
    learned: ClassVar[Mapping[str, str] | None] = None
    """What `learn` fixes, in order: attribute -> "number", "temperature", "positive", "text", "column" (a name or
    number), or "times" (those of the parameter `time_constants`). A model file that holds anything else is refused. A
    class that does not say it itself is saved and loaded as well, and what a file says of it is not checked."""
    of_time_alone: ClassVar[bool] = False
    """True for what needs nothing but the clock: a noise that wanders can look like it."""
    is_product: ClassVar[bool] = False
    """True for a product of two signals, which is largest where both leave their usual range: what it seems to help
    elsewhere says little of there."""
    foresees: ClassVar[bool] = False
    """True for what looks at later samples: a record has them, a stream and a device do not, nor a part of a record."""
    instead: ClassVar[str] = ""
    """What to do where there are no later samples, for kinds that look at them."""
    thermal_rank: ClassVar[int] = 0
    """Place among the kinds that a better thermal part, or thermometer, could do without, the most usual one 1; 0 for
    all others."""
    tried: ClassVar[bool] = True
    """False for what a diagnosis does not try as such: what somebody knows, or what it puts together from others."""
    removed_by_correct: bool = True
    """False for what the user wants to keep in the corrected reading, such as the drift of a standard."""
    _parameter_constraints: ClassVar[dict[str, Any]] = {}
    """Checked by ``self._validate_params()``, the first line of `learn`, in scikit-learn's words."""

    @classmethod
    def candidates(cls, record: Record, columns: Sequence[Any] | None = None) -> list[Effect]:
        """Unlearned effects of this kind worth trying, static ones first.

        Parameters
        ----------
        record : Record
            Holds the temperature and the recorded columns that are suspects.
        columns : sequence of column names, optional
            Suspects; by default all of the record's columns but the temperature.
        """
        return []

    def nearby(self, record: Record, share: float = 0.25) -> list[Effect]:
        """Unlearned copies with one parameter changed either way.

        No time constant grows beyond a quarter of the longest stretch that was read: of such a lag the record shows
        little more than a drift.

        Parameters
        ----------
        record : Record
            Sets the scale of parameters that can be zero (a knee, a moment).
        share : float
            How far: 0.25 multiplies and divides positive parameters by 1.25.
        """
        copies: list[Effect] = []
        for name in self.info.tuned if self.info else ():
            value = getattr(self, name)
            if value is None:
                continue
            # No time constant is moved beyond a quarter of the longest stretch; `candidates` go to a fifth.
            most = 0.25 * record.longest_read() if name.startswith("time_constant") else np.inf
            single = isinstance(value, str) or np.ndim(value) == 0
            numbers = [seconds_of(item, name) for item in ([value] if single else value)]
            for i, number in enumerate(numbers):
                for factor in (1 / (1 + share), 1 + share):
                    there = min(number * factor, max(number, most))
                    moved = [*numbers[:i], there, *numbers[i + 1 :]]
                    if there != number and len(set(moved)) == len(moved):  # not one on top of the other
                        copies.append(clone(self).set_params(**{name: moved[0] if single else moved}))
        return copies

    def inputs(self) -> list[Any]:
        """Recorded columns that it needs besides the temperature."""
        return [self.column] if hasattr(self, "column") else []

    def learn(self, record: Record) -> None:
        """Learn constants from the fitted record."""

    def refer_to(self, temperature: float) -> None:
        """Take the reference temperature T0, after `learn`.

        A column that is 0 with the device at rest at T0 leaves U0 what it is called: the reading there.
        """

    def names(self) -> list[str]:
        """Names of the columns, known after `learn`."""
        raise NotImplementedError

    def n_columns(self) -> int:
        """Number of the names."""
        return len(self.names())

    def terms(self) -> list[str]:
        """The columns as an equation writes them."""
        return self.names()

    def units(self) -> list[str]:
        """Unit of each column; "unit" where it is unknown."""
        return [self.unit] * self.n_columns()

    def explained(self, temperature: str) -> str:
        """Meaning of the columns' names, or "".

        Parameters
        ----------
        temperature : str
            Name of the temperature's column.
        """
        return self.info.formula if self.info else ""

    def means(self) -> dict[str, float]:
        """Means in the formula, by quantity, after `learn`."""
        return {}

    def signals(self, x: Signals) -> Sequence[Any]:
        """The formula: one expression over `x` for each of the `names`."""
        raise NotImplementedError

    def says_signals(self) -> bool:
        """True if `signals` is the formula."""
        return type(self).columns is Effect.columns

    def alive(self, block: Block) -> slice:
        """Columns that may be nonzero in a block."""
        return slice(None)

    def fill(self, block: Block, state: Any, columns: np.ndarray) -> Any:
        """Write a block's columns into an array; returns the state."""
        if self.says_signals():
            return self._fill_said(block, state, columns)
        part, state = self.columns(block, state)
        part = np.asarray(part)
        if part.shape != columns.shape and not (part.ndim == 1 and columns.shape[1] == 1):
            raise ValueError(
                f"{type(self).__name__}.columns returned an array of shape {part.shape} for {len(block)} rows and "
                f"{columns.shape[1]} names. Return one row per sample and one column per name."
            )
        columns[:] = part.reshape(columns.shape)
        return state

    def _fill_said(self, block: Block, state: Any, columns: np.ndarray) -> Any:
        """`fill` by the formula."""
        x = BlockSignals(block, state)
        for i, column in enumerate(self._said(x, columns.shape[1])):
            columns[:, i] = column
        return x.state()

    def _said(self, x: BlockSignals, width: int) -> Sequence[Any]:
        """Values of the formula, arrays of shape (n,) or numbers."""
        said = self.signals(x)
        if len(said) != width:
            raise ValueError(
                f"{type(self).__name__}.signals returned {len(said)} columns for {width} names. Return one for each "
                "name."
            )
        return said

    def each_column(self, block: Block, state: Any) -> tuple[Sequence[Any], Any]:
        """Columns one by one: numbers or read-only arrays."""
        width = self.n_columns()
        if self.says_signals():
            x, usual = BlockSignals(block, state), ((), (len(block),))
            said = [np.asarray(column, float) for column in self._said(x, width)]
            return [c if c.shape in usual else np.broadcast_to(c, len(block)) for c in said], x.state()
        columns, state = self.columns(block, state)
        return list(np.asarray(columns, float).reshape(len(block), width).T), state

    def columns(self, block: Block, state: Any) -> tuple[np.ndarray, Any]:
        """Columns of one block, and the state for the next.

        Parameters
        ----------
        block : Block
            Consecutive rows of one segment: ``block.temperature``, ``block["humidity"]``, ``block.steps`` [s],
            ``block.elapsed`` [s] since the segment began, ``block.seconds`` [s] since the fitted record began.
        state : object
            What this method returned for the block before; None where a segment begins.

        Returns
        -------
        columns : array of shape (n,) or (n, len(names()))
        state : object
        """
        columns = np.empty((len(block), self.n_columns()), order="F")
        return columns, self._fill_said(block, state, columns)

    def memory(self) -> float:
        """Longest time constant of the state [s]; 0 for none."""
        return max((word.memory for word in words_of(self) or ()), default=0.0)

    def label(self) -> str:
        """Name of the contribution in tables and plots."""
        return self.kind.replace("_", " ") + "".join(f": {name}" for name in self.inputs())

    def title(self) -> str:
        """Name in sentences, time spans in suitable units."""
        return self.label()


def refuse_foresight(effects: Sequence[Effect], who: str) -> None:
    """Raise ValueError for effects that need later samples."""
    for effect in effects:
        if effect.foresees:
            raise ValueError(
                f"The effect {effect.label()!r} looks at samples that come later, which {who} does not have. "
                f"Refine with {option('deployable', 'True')}, which adds no such effect. {effect.instead}".rstrip()
            )


def suspects(record: Record, columns: Sequence[Any] | None) -> list[Any]:
    """The recorded columns to try."""
    if columns is not None:
        return list(columns)
    return [name for name in record.columns if name != record.temperature_name]


def time_text(seconds: float) -> str:
    """A time span in a column's name: ``lag[900 s]``."""
    return f"{seconds:.6g} s"

"""The paper's own effects: static law, thermal lags, start-up decays, products of lags: eqs. (3) (18) (19) (21)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..equations import LagState, decays, lag_differences, paper_form
from ..records import BLOCK_ROWS, Block, Record, Segment, seconds_of
from .protocol import Effect, time_text


def seconds_array(time_constants: Any) -> np.ndarray:
    """Time constants in seconds, from numbers or anything that pandas reads as spans; increasing and distinct.

    Raises ValueError that names the first bad one.
    """
    if isinstance(time_constants, str) or np.ndim(time_constants) == 0:
        time_constants = [time_constants]
    values = np.array([seconds_of(value, "time_constants") for value in time_constants], float)
    values = np.sort(values)
    if (np.diff(values) == 0).any():
        twice = values[1:][np.diff(values) == 0][0]
        raise ValueError(f"The 'time_constants' parameter must hold distinct times. Got {twice:.10g} s twice.")
    return values


class StaticPolynomial(Effect):
    """Static law of the temperature, eq. (3): ``(T - T0)^i`` for i = 1..degree."""

    kind = "static_polynomial"

    def __init__(self, degree: int = 2, reference_temperature: float | str = "mean"):
        self.degree = degree
        self.reference_temperature = reference_temperature

    def learn(self, record: Record) -> None:
        """Fix T0 [K or degC]."""
        self.temperature_name_ = record.temperature_name
        if self.reference_temperature == "mean":
            self.reference_temperature_ = record.moments(record.temperature_name).mean
        else:
            self.reference_temperature_ = float(self.reference_temperature)

    def names(self) -> list[str]:
        """``temperature``, ``temperature^2``, ..."""
        name = column_text(self.temperature_name_)
        return [name if i == 1 else f"{name}^{i}" for i in range(1, self.degree + 1)]

    def units(self) -> list[str]:
        """K, K^2, ..."""
        return ["K" if i == 1 else f"K^{i}" for i in range(1, self.degree + 1)]

    def columns(self, block: Block, state: Any) -> tuple[np.ndarray, Any]:
        """Powers of T - T0 [K^i]."""
        powers = np.empty((len(block), self.degree), order="F")
        if self.degree:
            deviation = block.temperature - self.reference_temperature_
            powers[:, 0] = deviation
            for i in range(1, self.degree):
                np.multiply(powers[:, i - 1], deviation, out=powers[:, i])  # eq. (3)
        return powers, state


def column_text(name: object) -> str:
    """A column as it stands in feature names: array columns are x0, x1, ... as in scikit-learn."""
    return f"x{name}" if isinstance(name, int | np.integer) else str(name)


class ThermalLag(Effect):
    """Lag differences Psi_j = lagged_j - T of eq. (19): parts of the device that follow late.

    Parameters
    ----------
    time_constants : sequence
        [s], or spans such as "15 min".
    hold : {"first_order", "zero_order"}
        Temperature between samples: a straight line or the earlier value.
    initial_state : {"equilibrium", "zero", "fit"}
        A device at rest with the first temperature ("fit" starts there too and leaves the rest to `InitialTransient`),
        or one at the reference temperature.
    form : {"unit_gain", "paper"}
        "paper" gives eqs. (19) (25) as printed, psi in K s, for comparison.
    """

    kind = "thermal_lag"

    def __init__(
        self,
        time_constants: Sequence[Any] = (),
        hold: str = "first_order",
        initial_state: str = "fit",
        form: str = "unit_gain",
        reference_temperature: float | str = "mean",
    ):
        self.time_constants = time_constants
        self.hold = hold
        self.initial_state = initial_state
        self.form = form
        self.reference_temperature = reference_temperature

    def learn(self, record: Record) -> None:
        """Convert time constants to seconds; fix T0, where a device with the initial state "zero" starts."""
        self.time_constants_ = seconds_array(self.time_constants)
        if self.initial_state == "zero":
            given = self.reference_temperature
            self.reference_temperature_ = (
                record.moments(record.temperature_name).mean if given == "mean" else float(given)
            )

    def names(self) -> list[str]:
        """``lag[900 s]``, ..."""
        return [f"lag[{time_text(tau)}]" for tau in self.time_constants_]

    def units(self) -> list[str]:
        """K; K s for the paper's form."""
        return ["K" if self.form == "unit_gain" else "K s"] * len(self.time_constants_)

    def columns(self, block: Block, state: LagState | None) -> tuple[np.ndarray, LagState]:
        """Lag differences [K]."""
        T, steps = block.temperature, block.steps
        if state is None and self.initial_state == "zero":
            steps = np.concatenate((np.zeros(1), steps[1:]))  # the first sample is the start itself
            state = LagState(np.full(len(self.time_constants_), self.reference_temperature_ - T[0]), float(T[0]))
        Psi, state = lag_differences(T, steps, self.time_constants_, state, hold=self.hold)  # eq. (19)
        return (Psi if self.form == "unit_gain" else paper_form(Psi, T, self.time_constants_)), state

    def memory(self) -> float:
        """The longest time constant [s]."""
        return float(self.time_constants_.max(initial=0.0))


class InitialTransient(Effect):
    """Start-up columns exp(-t/tau) of eq. (18), one set per fitted segment.

    They stand for the unknown temperature field inside the device when a segment starts, and belong to that segment:
    other segments have zeros there.

    Parameters
    ----------
    time_constants : sequence
        [s], or spans such as "15 min".
    longest_share : float
        A decay longer than this share of its segment is left out: over the record it looks like drift or ageing, and
        would swallow them without a word.
    """

    kind = "initial_transient"

    def __init__(self, time_constants: Sequence[Any] = (), longest_share: float = 1.0):
        self.time_constants = time_constants
        self.longest_share = longest_share

    def learn(self, record: Record) -> None:
        """List the decays of each segment: ``decays_[key]`` holds their time constants [s]."""
        time_constants = seconds_array(self.time_constants)
        self.decays_: dict[int, np.ndarray] = {}
        self.first_column_: dict[int, int] = {}
        self.labels_: dict[int, str] = {}
        at = 0
        runs = [segment.run for segment in record.segments]
        for key, segment in enumerate(record.segments):
            limit = self.longest_share * record.duration(segment)
            chosen = time_constants[time_constants <= limit]
            chosen = chosen[chosen > _first_reading(record, segment)]  # what is over before can't be known
            if len(chosen) == 0 or segment.stop - segment.start <= 2 * len(chosen):
                continue
            self.decays_[key], self.first_column_[key] = chosen, at
            at += len(chosen)
            named = segment.run is not None and runs.count(segment.run) == 1
            self.labels_[key] = str(segment.run) if named else f"segment {key}"
        self.n_columns_ = at

    def names(self) -> list[str]:
        """``decay[900 s]``, or ``decay[900 s, run9]`` where there are several segments."""
        single = len(self.decays_) == 1 and not any(self.decays_) and next(iter(self.labels_.values())) == "segment 0"
        return [
            f"decay[{time_text(tau)}]" if single else f"decay[{time_text(tau)}, {self.labels_[key]}]"
            for key, taus in self.decays_.items()
            for tau in taus
        ]

    def columns(self, block: Block, state: Any) -> tuple[np.ndarray, Any]:
        """Decays of the block's segment, zeros elsewhere [1]."""
        result = np.zeros((len(block), self.n_columns_), order="F")
        taus = self.decays_.get(-1 if block.segment_key is None else block.segment_key)
        if taus is not None:
            at = self.first_column_[block.segment_key]
            result[:, at : at + len(taus)] = decays(block.elapsed, taus)  # eq. (18)
        return result, state


def _first_reading(record: Record, segment: Segment) -> float:
    """Time from the start of a segment to its first reading [s]; infinite where it has none."""
    if record.reading is None:
        return 0.0
    for start in range(segment.start, segment.stop, BLOCK_ROWS):
        rows = record.rows(start, min(start + BLOCK_ROWS, segment.stop))
        known = np.isfinite(np.asarray(record.reading[rows], float))
        if known.any():
            return record.times.between(record.stamp(start + int(known.argmax())), record.stamp(segment.start))
    return np.inf


class LagProducts(Effect):
    """Products Psi_j Psi_k of eq. (21), j <= k: nonlinear dynamic transfer."""

    kind = "lag_products"

    def __init__(
        self,
        time_constants: Sequence[Any] = (),
        hold: str = "first_order",
        initial_state: str = "fit",
        reference_temperature: float | str = "mean",
    ):
        self.time_constants = time_constants
        self.hold = hold
        self.initial_state = initial_state
        self.reference_temperature = reference_temperature

    def learn(self, record: Record) -> None:
        """Convert time constants to seconds."""
        self.lags_ = ThermalLag(
            self.time_constants, self.hold, self.initial_state, reference_temperature=self.reference_temperature
        )
        self.lags_.learn(record)
        n = len(self.lags_.time_constants_)
        self.pairs_ = [(j, k) for j in range(n) for k in range(j, n)]

    def names(self) -> list[str]:
        """``lag[60 s]*lag[900 s]``, ..."""
        lag = self.lags_.names()
        return [f"{lag[j]}*{lag[k]}" for j, k in self.pairs_]

    def units(self) -> list[str]:
        """K^2."""
        return ["K^2"] * len(self.pairs_)

    def columns(self, block: Block, state: LagState | None) -> tuple[np.ndarray, LagState]:
        """Products of lag differences [K^2]."""
        Psi, state = self.lags_.columns(block, state)
        result = np.empty((len(block), len(self.pairs_)), order="F")
        for column, (j, k) in enumerate(self.pairs_):
            np.multiply(Psi[:, j], Psi[:, k], out=result[:, column])  # eq. (21)
        return result, state

    def memory(self) -> float:
        """The longest time constant [s]."""
        return self.lags_.memory()

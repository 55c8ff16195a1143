"""Effects sample by sample, in plain Python: what a live corrector (or a microcontroller) does between two samples.

An effect's columns are computed in one place, `Effect.columns`, on blocks of rows. A block of one row costs a hundred
times what its arithmetic costs, so each kind of the catalogue has a *stepper* beside it: the same recursion on plain
floats, taking the same state in and giving the same state out. `columns` is the definition; tests compare every stepper
with it, over the whole catalogue. An effect without a stepper (a user's own) is stepped by blocks of one row.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..equations import LagState
from ..records import Block, Record, Segment
from ..records.times import Times
from .catalogue import CATALOGUE
from .protocol import Effect
from .rates import DelayState
from .time import DAY

_KEPT_STEPS = 64
"""Different steps whose decays are remembered; a clock that jitters does not fill the memory."""


class Sample:
    """One sample as steppers see it: the counterpart of a `Block` of one row."""

    __slots__ = ("begins", "elapsed", "key", "seconds", "segment_zero", "stamp", "step", "temperature", "values")

    def __init__(self) -> None:
        self.begins = True
        """True where a segment begins without a known state."""
        self.step = 1.0
        """Time since the sample before [s]; 1 where `begins`."""
        self.temperature = math.nan
        self.values: Mapping[Any, float] = {}
        """All needed columns, the temperature among them."""
        self.seconds = 0.0
        """Time since the fitted record began [s]."""
        self.elapsed = 0.0
        """Time since the segment began [s]."""
        self.key: int | None = None
        """Fitted segment that the sample belongs to."""
        self.stamp: float = 0
        self.segment_zero: float = 0


@dataclass(frozen=True)
class Stepper:
    """One effect, one sample at a time."""

    step: Callable[[Sample], Sequence[float]]
    """The effect's columns at the next sample."""
    start: Callable[[Any], None] = lambda state: None
    """Takes over a state of `Effect.columns`; None where a segment begins."""
    state: Callable[[], Any] = lambda: None
    """The state after the last sample, as `Effect.columns` would return it; None before the first."""
    over: Callable[[int | None], float] = lambda key: math.inf
    """Time in a segment (one that belongs to the fitted one `key`) after which all columns are zero [s]."""


def stepper_of(effect: Effect, times: Times, zero: float, temperature_name: object) -> Stepper:
    """The stepper of a learned effect.

    Parameters
    ----------
    effect : Effect
    times : Times
        Of the fitted record: what a stamp means.
    zero : float
        Stamp of the first fitted row.
    temperature_name : str or int
    """
    if CATALOGUE.get(effect.kind) is not type(effect):
        return _by_blocks(effect, times, zero, temperature_name)
    return STEPPERS[effect.kind](effect, times.between(zero, 0))


# ----------------------------------------------------------------------------------------------------------- the lags


def decay_and_gain_of_step(step: float, time_constant: float, first_order: bool) -> tuple[float, float]:
    """`thermocorr.equations.lags.decay_and_gain` for a single step, in plain floats: see there for the formulas."""
    ratio = step / time_constant
    if ratio < 0.1:
        half = 0.5 * ratio
        square = half * half
        top = 105.0 + 10.0 * square
        gain = top / (half * top + (square + 45.0) * square + 105.0)
        decay = 1.0 - ratio * gain
    else:
        decay = math.exp(-ratio)
        gain = (1.0 - decay) / ratio
    return decay, gain if first_order else 1.0


class Lags:
    """Lag differences of one column, eqs. (19) (25), from sample to sample."""

    def __init__(self, time_constants: np.ndarray, hold: str):
        self.time_constants: list[float] = time_constants.tolist()
        self.first_order = hold == "first_order"
        self.known: dict[float, list[tuple[float, float]]] = {}
        self.differences: list[float] = [0.0] * len(self.time_constants)
        self.last: float | None = None

    def start(self, state: LagState | None) -> None:
        """Take over a state; None for equilibrium with the first sample."""
        if state is None:
            self.differences, self.last = [0.0] * len(self.time_constants), None
        else:
            self.differences, self.last = np.asarray(state.lag_difference, float).tolist(), float(state.temperature)

    def state(self) -> LagState | None:
        """The state after the last sample."""
        return None if self.last is None else LagState(np.array(self.differences), self.last)

    def step(self, value: float, step: float) -> list[float]:
        """Lag differences at the next sample; the list is replaced, never changed."""
        last, self.last = self.last, value
        if last is None:
            return self.differences
        factors = self.known.get(step)
        if factors is None:
            factors = [decay_and_gain_of_step(step, tau, self.first_order) for tau in self.time_constants]
            if len(self.known) < _KEPT_STEPS:
                self.known[step] = factors
        change = value - last
        # d_next = a d - g (T_next - T): eq. (25) for d = lagged - T
        self.differences = [a * d - g * change for (a, g), d in zip(factors, self.differences)]  # noqa: B905
        return self.differences


def _thermal_lag(effect: Any, zero_seconds: float) -> Stepper:
    lags = Lags(effect.time_constants_, effect.hold)
    first = effect.reference_temperature_ if effect.initial_state == "zero" else None
    paper = effect.form == "paper"

    def step(sample: Sample) -> list[float]:
        T = sample.temperature
        if first is not None and lags.last is None:
            lags.differences = [first - T] * len(lags.time_constants)
        differences = lags.step(T, sample.step)
        if paper:
            return [(d + T) * tau - T for d, tau in zip(differences, lags.time_constants, strict=True)]
        return differences

    return Stepper(step, lags.start, lags.state)


def _lag_products(effect: Any, zero_seconds: float) -> Stepper:
    lags, pairs = _thermal_lag(effect.lags_, zero_seconds), effect.pairs_
    reference = effect.reference_temperature_ if effect.temperature_products else None

    def step(sample: Sample) -> list[float]:
        d = lags.step(sample)
        products = [d[j] * d[k] for j, k in pairs]  # eq. (21)
        if reference is not None:
            deviation = sample.temperature - reference
            products += [deviation * difference for difference in d]
        return products

    return Stepper(step, lags.start, lags.state)


def _lagged_covariate(effect: Any, zero_seconds: float) -> Stepper:
    lags = Lags(effect.time_constants_, effect.hold)
    column, power, mean = effect.column, effect.power, effect.mean_

    def step(sample: Sample) -> list[float]:
        value = sample.values[column] ** power
        return [value - mean, *lags.step(value, sample.step)]

    return Stepper(step, lags.start, lags.state)


def _hinge(effect: Any, zero_seconds: float) -> Stepper:
    lags, knee = Lags(effect.time_constants_, effect.hold), float(effect.knee)
    clip = max if effect.side == "above" else min

    def step(sample: Sample) -> list[float]:
        value = clip(sample.temperature - knee, 0.0)
        return [value, *lags.step(value, sample.step)]

    return Stepper(step, lags.start, lags.state) if lags.time_constants else Stepper(step)


def _rate(effect: Any, zero_seconds: float) -> Stepper:
    tau = effect.time_constant_
    if tau is not None:
        lags = Lags(np.array([tau]), "first_order")
        return Stepper(lambda s: (lags.step(s.temperature, s.step)[0] / -tau,), lags.start, lags.state)  # eq. (17)
    last: float | None = None

    def step(sample: Sample) -> tuple[float]:
        nonlocal last
        before, last = last, sample.temperature
        return (0.0 if before is None else (last - before) / sample.step,)

    def start(state: float | None) -> None:
        nonlocal last
        last = state

    return Stepper(step, start, lambda: last)


# ------------------------------------------------------------------------------------------ other kinds with a state


def _delay(effect: Any, zero_seconds: float) -> Stepper:
    delay: float = effect.delay_
    samples: deque[tuple[float, float]] = deque()  # those of the last `delay` seconds, and one before them

    def step(sample: Sample) -> tuple[float]:
        T, then = sample.temperature, sample.elapsed - delay
        samples.append((sample.elapsed, T))
        while len(samples) > 1 and samples[1][0] <= then:
            samples.popleft()
        t0, T0 = samples[0]
        if then <= t0 or len(samples) == 1:
            return (T0 - T,)
        t1, T1 = samples[1]
        return ((T1 - T0) / (t1 - t0) * (then - t0) + T0 - T,)

    def start(state: DelayState | None) -> None:
        samples.clear()
        if state is not None:
            samples.extend(zip(state.elapsed.tolist(), state.temperature.tolist(), strict=True))

    def state() -> DelayState | None:
        if not samples:
            return None
        elapsed, temperature = zip(*samples, strict=True)
        return DelayState(np.array(elapsed), np.array(temperature))

    return Stepper(step, start, state)


def _hysteresis(effect: Any, zero_seconds: float) -> Stepper:
    half = effect.width / 2
    position: float | None = None

    def step(sample: Sample) -> tuple[float]:
        nonlocal position
        T = sample.temperature
        position = T if position is None else min(max(position, T - half), T + half)
        return (position - T,)

    def start(state: float | None) -> None:
        nonlocal position
        position = state

    return Stepper(step, start, lambda: position)


# ------------------------------------------------------------------------------------------- kinds without a state


def _static_polynomial(effect: Any, zero_seconds: float) -> Stepper:
    reference, lowest, degree = effect.reference_temperature_, effect.lowest_power, effect.degree

    def step(sample: Sample) -> list[float]:
        power = deviation = sample.temperature - reference
        powers = []
        for i in range(1, degree + 1):
            if i > 1:
                power *= deviation
            if i >= lowest:
                powers.append(power)  # eq. (3)
        return powers

    return Stepper(step)


def _initial_transient(effect: Any, zero_seconds: float) -> Stepper:
    decays, first = {key: taus.tolist() for key, taus in effect.decays_.items()}, effect.first_column_
    over = {key: 46.0 * max(taus) for key, taus in decays.items()}
    zeros = [0.0] * effect.n_columns_

    def step(sample: Sample) -> list[float]:
        key = sample.key
        if key is None or key not in decays or sample.elapsed > over[key]:
            return zeros
        columns = zeros.copy()
        for i, tau in enumerate(decays[key], first[key]):
            exponent = sample.elapsed / -tau
            columns[i] = math.exp(exponent) if exponent >= -46.0 else 0.0  # eq. (18)
        return columns

    return Stepper(step, over=lambda key: -1.0 if key is None else over.get(key, -1.0))


def _covariate(effect: Any, zero_seconds: float) -> Stepper:
    column, power, mean = effect.column, effect.power, effect.mean_
    return Stepper(lambda sample: (sample.values[column] ** power - mean,))


def _interaction(effect: Any, zero_seconds: float) -> Stepper:
    column, mean, reference = effect.column, effect.mean_, effect.reference_temperature_
    return Stepper(lambda sample: ((sample.temperature - reference) * (sample.values[column] - mean),))


def _drift(effect: Any, zero_seconds: float) -> Stepper:
    centre = effect.centre_
    return Stepper(lambda sample: ((sample.seconds - centre) / DAY,))


def _log_ageing(effect: Any, zero_seconds: float) -> Stepper:
    onset, mean = effect.onset_, effect.mean_
    return Stepper(lambda sample: (math.log1p(max(sample.seconds, 0.0) / onset) - mean,))


def _sensitivity_drift(effect: Any, zero_seconds: float) -> Stepper:
    centre, reference = effect.centre_, effect.reference_temperature_
    return Stepper(lambda sample: ((sample.seconds - centre) / DAY * (sample.temperature - reference),))


def _step(effect: Any, zero_seconds: float) -> Stepper:
    moment = effect.seconds_
    return Stepper(lambda sample: (1.0 if sample.seconds >= moment else 0.0,))


def _periodic(effect: Any, zero_seconds: float) -> Stepper:
    began, rate = zero_seconds % effect.period_, 2.0 * math.pi / effect.period_
    orders, waves = range(1, effect.harmonics + 1), (math.sin, math.cos)

    def step(sample: Sample) -> list[float]:
        angle = rate * (began + sample.seconds)
        return [wave(h * angle) for h in orders for wave in waves]

    return Stepper(step)


STEPPERS: dict[str, Callable[[Any, float], Stepper]] = {
    "static_polynomial": _static_polynomial,
    "thermal_lag": _thermal_lag,
    "initial_transient": _initial_transient,
    "lag_products": _lag_products,
    "rate": _rate,
    "delay": _delay,
    "covariate": _covariate,
    "lagged_covariate": _lagged_covariate,
    "interaction": _interaction,
    "drift": _drift,
    "log_ageing": _log_ageing,
    "sensitivity_drift": _sensitivity_drift,
    "step": _step,
    "hysteresis": _hysteresis,
    "hinge": _hinge,
    "periodic": _periodic,
}
"""Kind -> what makes the stepper of an effect, given the absolute time at which the fitted record began [s]."""


# ------------------------------------------------------------------------------------------------- any other effect


def _by_blocks(effect: Effect, times: Times, zero: float, temperature_name: object) -> Stepper:
    """Any effect, by blocks of one row: right for all, quick for none."""
    now: Any = None
    divisor = 1_000_000_000 // times.per_second if times.kind not in ("rows", "seconds") else 1
    dtype = float if times.kind == "seconds" else np.int64

    def step(sample: Sample) -> list[float]:
        nonlocal now
        stamp = sample.stamp if times.kind == "seconds" else sample.stamp // divisor
        one = replace(times, n=1, ticks=np.array([stamp], dtype))
        columns: dict[Any, Any] = {name: np.array([value]) for name, value in sample.values.items()}
        record = Record(one, temperature_name, columns, (Segment(0, 1),))
        steps = np.array([sample.step])
        block = Block(record, 0, 0, 1, sample.begins, steps, zero, sample.segment_zero, sample.key)
        part, now = effect.columns(block, now)
        return np.asarray(part, float).ravel().tolist()  # type: ignore[no-any-return]

    def start(state: Any) -> None:
        nonlocal now
        now = state

    return Stepper(step, start, lambda: now)

"""Simulated temperatures, and what else a logger records.

Every history is a function of the sample times [s since the start], so steps may be irregular, and of a numpy
Generator, so that each column of a record has its own stream.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.signal import lfilter

from ._heat import Array, modal_differences

DAY = 86_400.0  # [s]
HOUR = 3_600.0  # [s]


@dataclass(frozen=True)
class LabClimate:
    """A laboratory's air temperature; amplitudes in K."""

    mean: float = 22.5  # [degC]
    weather: float = 0.5  # standard deviation of what walls and windows let in
    daily: float = 0.4  # amplitude of the daily wave of the building
    people: float = 0.6  # warming by people and lamps in working hours
    setback: float = 0.9  # fall from Friday evening to Monday morning, when the heating is turned down
    draught: float = 0.03  # standard deviation of doors and turbulence, minutes
    cycling: float = 0.05  # amplitude of the air conditioner's cycles
    cycle_period: float = 540.0  # typical period of these cycles [s]


def smooth_noise(rng: np.random.Generator, time: Array, time_constant: float) -> Array:
    """Stationary Gaussian noise of unit variance at `time` [s]."""
    span = float(time[-1] - time[0])
    step = max(time_constant / 10, span / max(time.size - 1, 1) if span > 0 else time_constant / 10)
    burn_in = int(np.ceil(10 * time_constant / step))
    count = burn_in + int(np.ceil(span / step)) + 4
    decay = float(np.exp(-step / time_constant))
    scale = np.sqrt((1 - decay**2) ** 3 / (1 + decay**2))  # unit variance of the two lags in series
    white = rng.standard_normal(count)
    coarse = lfilter([scale], [1.0, -2 * decay, decay**2], white)[burn_in:]
    return np.asarray(CubicSpline(step * np.arange(coarse.size), coarse)(time - time[0]), dtype=float)


def follow(time: Array, driver: Array, time_constant: float) -> Array:
    """Follow `driver` with one lag, eq. (17), from equilibrium."""
    rates = np.array([1.0 / time_constant])
    later = modal_differences(rates, np.diff(time), np.diff(driver), np.zeros(1))[:, 0]
    return np.asarray(driver + np.concatenate([[0.0], later]))


def working_hours(time: Array, weekday: float, time_of_day: float) -> NDArray[np.bool_]:
    """True in working hours, 8 h to 18 h, Monday to Friday."""
    hours = (weekday * DAY + time_of_day + time) / HOUR
    return np.asarray((hours % 24 >= 8) & (hours % 24 < 18) & (hours // 24 % 7 < 5))


def _weekend(time: Array, weekday: float, time_of_day: float) -> NDArray[np.bool_]:
    """Tell the weekend, from Friday 18 h to Monday 6 h."""
    hours = (weekday * DAY + time_of_day + time) / HOUR % 168
    return np.asarray((hours >= 114) | (hours < 6))


def _cycling(rng: np.random.Generator, time: Array, period: float) -> Array:
    """Uneven wave of an air conditioner, unit amplitude."""
    momentary = period * np.exp(0.2 * smooth_noise(rng, time, 2 * HOUR))
    turns = np.concatenate([[0.0], np.cumsum(np.diff(time) / momentary[1:])])
    angle = 2 * np.pi * (turns + rng.uniform())
    strength = np.exp(0.3 * smooth_noise(rng, time, 3 * HOUR))
    return np.asarray(strength * (np.sin(angle) + 0.25 * np.sin(2 * angle + 0.6)))


def lab_temperature(
    rng: np.random.Generator, time: Array, weekday: float, time_of_day: float, climate: LabClimate | None = None
) -> Array:
    """Air temperature of a laboratory [degC]."""
    c = climate or LabClimate()
    hour = (time_of_day + time) / HOUR
    weather = c.weather * smooth_noise(rng, time, 1.2 * DAY)
    strength = c.daily * (1 + 0.4 * smooth_noise(rng, time, DAY))
    daily = strength * np.sin(2 * np.pi * (hour - 10) / 24)
    presence = working_hours(time, weekday, time_of_day) * (1 + 0.5 * smooth_noise(rng, time, 0.5 * HOUR))
    people = c.people * follow(time, presence, 1.2 * HOUR)
    setback = -c.setback * follow(time, _weekend(time, weekday, time_of_day).astype(float), 5 * HOUR)
    draught = c.draught * smooth_noise(rng, time, 120.0)
    cycles = c.cycling * _cycling(rng, time, c.cycle_period)
    return np.asarray(c.mean + weather + daily + people + setback + draught + cycles)


def outdoor_temperature(rng: np.random.Generator, time: Array, weekday: float, time_of_day: float) -> Array:
    """Air temperature outdoors, from spring on [degC]."""
    hour = (time_of_day + time) / HOUR
    season = 8.0 + 10.0 * np.sin(2 * np.pi * time / (365.25 * DAY))
    weather = 3.5 * smooth_noise(rng, time, 1.5 * DAY)
    clear_sky = 1 / (1 + np.exp(-1.5 * smooth_noise(rng, time, 0.6 * DAY)))
    angle = 2 * np.pi * (hour - 9) / 24
    daily = (1.5 + 7.0 * clear_sky) * (np.sin(angle) + 0.2 * np.sin(2 * angle + 0.8))
    gusts = 0.4 * smooth_noise(rng, time, 0.5 * HOUR)
    return np.asarray(season + weather + daily + gusts)


def chamber_temperature(rng: np.random.Generator, time: Array, weekday: float, time_of_day: float) -> Array:
    """Air temperature of a chamber on a staircase [degC]."""
    stairs = (20.0, 25.0, 30.0, 35.0, 30.0, 25.0, 20.0, 15.0)
    knots, levels = [0.0], [15.0]
    while knots[-1] <= time[-1] - time[0]:
        level = stairs[(len(levels) // 2) % len(stairs)] + rng.normal(0.0, 0.5)
        plateau, ramp = rng.uniform(1.5, 5.0) * HOUR, abs(level - levels[-1]) / rng.uniform(0.3, 1.0) * 60.0
        knots += [knots[-1] + plateau, knots[-1] + plateau + ramp]
        levels += [levels[-1], level]
    set_point = np.interp(time - time[0], knots, levels)
    air = follow(time, set_point, 240.0)
    regulation = 0.03 * smooth_noise(rng, time, 150.0) + 0.02 * _cycling(rng, time, 420.0)
    return np.asarray(air + regulation)


TEMPERATURES: dict[str, Callable[[np.random.Generator, Array, float, float], Array]] = {
    "lab": lab_temperature,
    "outdoor": outdoor_temperature,
    "chamber": chamber_temperature,
}


def saturation_pressure(temperature: Array) -> Array:
    """Vapour pressure over water [hPa] at `temperature` [degC], Magnus formula."""
    return np.asarray(6.112 * np.exp(17.62 * temperature / (243.12 + temperature)))


def room_humidity(rng: np.random.Generator, time: Array, temperature: Array) -> Array:
    """Relative humidity of a room [%].

    Vapour comes and goes with the weather; the room's mean temperature, not the air at the sensor, sets its
    share.
    """
    room = follow(time, temperature, 0.5 * HOUR)
    supply = 0.12 * smooth_noise(rng, time, 0.8 * DAY) + 0.03 * smooth_noise(rng, time, 1.5 * HOUR)
    buffered = np.sqrt(saturation_pressure(np.full(1, room.mean())) / saturation_pressure(room))
    return np.asarray(np.clip(42.0 * np.exp(supply) * buffered, 3.0, 97.0))


def outdoor_humidity(rng: np.random.Generator, time: Array, temperature: Array) -> Array:
    """Relative humidity outdoors [%]."""
    dew_point = follow(time, temperature, 1.5 * DAY) - 5.0 + 4.5 * smooth_noise(rng, time, 1.2 * DAY)
    share = saturation_pressure(dew_point) / saturation_pressure(temperature)
    return np.asarray(np.clip(100.0 * share, 8.0, 100.0))


def air_pressure(rng: np.random.Generator, time: Array) -> Array:
    """Air pressure [hPa]: weather and the half-daily tide."""
    return np.asarray(1013.0 + 7.0 * smooth_noise(rng, time, DAY) + 0.6 * np.sin(4 * np.pi * time / DAY))


def supply_voltage(rng: np.random.Generator, time: Array) -> Array:
    """Supply voltage of a 5 V regulator [V]."""
    wander = 2e-3 * smooth_noise(rng, time, 2 * HOUR)
    load = -3e-3 * (smooth_noise(rng, time, 0.7 * HOUR) > 1.0)
    return np.asarray(5.0 + wander + load + 3e-4 * rng.standard_normal(time.size))


def mains_voltage(rng: np.random.Generator, time: Array, time_of_day: float) -> Array:
    """Mains voltage [V]: load, wander, tap changer, flicker."""
    hour = (time_of_day + time) / HOUR
    load = -1.5 * np.sin(2 * np.pi * (hour - 8) / 24) * (1 + 0.5 * smooth_noise(rng, time, 0.7 * DAY))
    taps = 1.4 * np.round(1.2 * smooth_noise(rng, time, 0.4 * DAY))
    wander = 1.2 * smooth_noise(rng, time, 2.5 * HOUR)
    return np.asarray(230.0 + load + taps + wander + 0.2 * rng.standard_normal(time.size))

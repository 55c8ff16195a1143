"""The founding record, simulated: a MEMS voltage reference."""

from __future__ import annotations

from functools import lru_cache
from typing import Any, Literal

import numpy as np
import pandas as pd

from ._climate import DAY, LabClimate, air_pressure, follow, lab_temperature, room_humidity, supply_voltage
from ._devices import Device, package_stack
from ._heat import Array, check_choice, compose_reading, stream, truth_frame

_ROWS = 84_000
_PREHISTORY = 5_760  # samples, one day: the device is not at equilibrium when the record starts
_START = pd.Timestamp("2024-03-04 00:00")
_SEED = 17
_BASE = 0.1040  # [mV]
_NOISE = 5.85e-5  # [mV]
_DEVICE = Device(
    package_stack(50.0),
    linear={"package": 0.9435, "base": 0.0565},
    quadratic={"package": -0.0040},
    sensitivity=1.1206e-3,
    reference_temperature=22.5,
)
_MOISTURE_TIME_CONSTANT = 1.5 * DAY  # [s]
_MOISTURE = 1e-4  # [mV], rms of what a static quadratic in temperature leaves of it
_UNITS = {"temperature": "degC", "humidity": "%", "pressure": "hPa", "supply": "V", "voltage": "mV"}


def load_voltage_reference(*, hidden: Literal["moisture"] | None = None, return_truth: bool = False) -> Any:
    """Load the simulated MEMS voltage reference: 84 000 samples.

    The record is simulated, the same on every call. Heat conduction through a package, its board, a filling
    and a metal base is solved by finite volumes; the voltage depends on the temperatures of package and
    base, and slightly on the square of the former. The size of the effects is that of the founding paper:
    1.114e-3 mV before correction, about -27.3 dB and -27.9 dB after a static linear and a static quadratic
    correction and a moving average of 25 samples. The temperature column is what the device feels, without
    error of the thermometer. The device has been in the room for a day when the record starts.

    The noise is white, 5.85e-5 mV. The paper's residuals before and after smoothing (6.725e-5 and 1.173e-5
    mV) differ by more than the factor 5 that 25 samples of white noise allow, so white noise can match one
    of them only: it matches the smoothed one.

    Parameters
    ----------
    hidden : {None, "moisture"}, default=None
        "moisture" adds a slow uptake of moisture to the voltage: the recorded humidity through one lag of
        1.5 days (a one-pole stand-in for diffusion into a moulded package), of such a size that a static
        quadratic in temperature leaves 1e-4 mV rms of it. The other columns stay the same.
    return_truth : bool, default=False
        Whether to return the noise-free voltage and its parts as well.

    Returns
    -------
    record : DataFrame of shape (84000, 5)
        Columns temperature [degC], humidity [%], pressure [hPa], supply [V] and voltage [mV]; a
        DatetimeIndex named "time". Pressure, supply and, without `hidden`, humidity play no part in the
        voltage. `record.attrs` holds "units", "noise" [mV], "description" and "reading".
    truth : DataFrame of shape (84000, 3 or 4)
        Only if `return_truth`. Columns noise_free, device, moisture (if hidden) and noise [mV];
        `truth.attrs` holds "noise" [mV], "base" [mV] and "device", the parameters of the device.

    Examples
    --------
    >>> record = load_voltage_reference()
    >>> record.shape, record.attrs["reading"]
    ((84000, 5), 'voltage')
    """
    check_choice("load_voltage_reference", "hidden", hidden, (None, "moisture"))
    record, truth = _simulate(hidden)
    return (record.copy(), truth.copy()) if return_truth else record.copy()


@lru_cache(maxsize=2)
def _simulate(hidden: str | None) -> tuple[pd.DataFrame, pd.DataFrame]:
    time = 15.0 * np.arange(-_PREHISTORY, _ROWS, dtype=np.float64)
    weekday = (_START.weekday() - 1) % 7  # of the day before
    air = lab_temperature(stream(_SEED, 0, "temperature"), time - time[0], weekday, 0.0, LabClimate(cycling=0.093))
    columns = {"temperature": air}
    columns["humidity"] = room_humidity(stream(_SEED, 0, "humidity"), time, air)
    columns["pressure"] = air_pressure(stream(_SEED, 0, "pressure"), time)
    columns["supply"] = supply_voltage(stream(_SEED, 0, "supply"), time)
    device = _DEVICE.respond(time, air)[_PREHISTORY:]
    columns = {name: column[_PREHISTORY:] for name, column in columns.items()}
    contributions = {}
    if hidden == "moisture":
        contributions["moisture"] = _moisture(time[_PREHISTORY:], columns["humidity"], columns["temperature"])
    noise = _NOISE * stream(_SEED, 0, "noise").standard_normal(_ROWS)
    voltage, parts = compose_reading(device, contributions, noise, _BASE)

    index = pd.DatetimeIndex(_START + pd.to_timedelta(time[_PREHISTORY:], unit="s"), name="time")
    record = pd.DataFrame({**columns, "voltage": voltage}, index=index)
    record.attrs = {
        "units": dict(_UNITS),
        "noise": _NOISE,
        "reading": "voltage",
        "temperature": "temperature",
        "hidden": hidden,
        "description": "Simulated AC voltage reference (MEMS) in a laboratory, 350 h at 15 s.",
    }
    truth = truth_frame(parts, index, {"noise": _NOISE, "base": _BASE, "device": _DEVICE.parameters()})
    if hidden == "moisture":
        truth.attrs["moisture"] = {"time_constant": _MOISTURE_TIME_CONSTANT, "rms": _MOISTURE}
    return record, truth


def _moisture(time: Array, humidity: Array, temperature: Array) -> Array:
    """Voltage of moisture [mV], one lag of humidity."""
    uptake = follow(time, humidity - humidity.mean(), _MOISTURE_TIME_CONSTANT)
    excess = temperature - temperature.mean()
    static = np.stack([np.ones_like(excess), excess, excess**2], axis=1)
    left = uptake - static @ np.linalg.lstsq(static, uptake, rcond=None)[0]
    return np.asarray(_MOISTURE / left.std() * uptake)

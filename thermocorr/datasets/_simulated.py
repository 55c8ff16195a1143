"""Simulated records with their truth."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from ..records.errors import check_int
from ..records.times import date_of
from ._climate import TEMPERATURES, air_pressure, mains_voltage, outdoor_humidity, room_humidity, supply_voltage
from ._devices import DEVICE_NAMES, Device, make_device
from ._heat import Array, check_choice, check_float, compose_reading, stream, truth_frame
from ._heat import coloured_noise as make_coloured_noise
from ._planted import Run
from ._planting import plant, read_plantings

_BASE = 250.0  # [ppm]
_REFERENCE_TEMPERATURES = {"lab": 22.5, "outdoor": 12.0, "chamber": 25.0}  # [degC]
_UNITS = {"temperature": "degC", "humidity": "%", "pressure": "hPa", "supply": "V", "mains": "V", "reading": "ppm"}


class _Noise(NamedTuple):
    white: float
    coloured: tuple[float, float] | None


class _Simulated(NamedTuple):
    """A simulated run, part by part."""

    run: Run
    response: Array
    contributions: dict[str, Array]
    white: Array


def make_record(
    n: int = 20_000,
    *,
    sampling_period: float = 60.0,
    setting: str = "lab",
    device: str = "layered",
    noise: float = 0.2,
    coloured_noise: tuple[float, float] | None = None,
    nonlinearity: float = 0.0,
    initial_offset: float = 0.0,
    effects: Any = None,
    irregular: float = 0.0,
    gaps: int = 0,
    runs: int = 1,
    start: str | pd.Timestamp = "2024-03-04",
    seed: int = 0,
    return_truth: bool = False,
) -> Any:
    """Make a record of a simulated device.

    Parameters
    ----------
    n : int, default=20000
        Number of rows of each run.
    sampling_period : float, default=60.0
        Time between samples [s]. Typical are 60 s in the lab, 600 s outdoors and 30 s in the chamber.
    setting : {"lab", "outdoor", "chamber"}, default="lab"
        Days, weekends and air conditioning; season, weather and days; a staircase of ramps and plateaus.
    device : {"slab", "plate", "layered", "box"}, default="layered"
        Block of resin (half an hour), ceramic plate (minutes), package with a base behind insulation (a
        minute and an hour), instrument in a lagged box (minutes and hours).
    noise : float, default=0.2
        Standard deviation of the white noise [ppm]; the static sensitivity is 10 ppm/K.
    coloured_noise : tuple of (float, float), optional
        Standard deviation [ppm] and correlation time [s] of an autoregressive noise of first order.
    nonlinearity : float, default=0.0
        Curvature of the sensitivity to the innermost layer [1/K]; it makes static curvature and lag products.
    initial_offset : float, default=0.0
        Temperature of the device above that of the air when a run starts [K]; 0.0 is equilibrium.
    effects : dict or list, optional
        Effects to plant besides the device: {"hysteresis": 2.0}, or a list of (kind, strength), (kind, strength,
        parameters) or (effect, strength). Kinds are those of `thermocorr.effects.CATALOGUE` that this simulation has
        a formula of its own for, and two causes that none explains: "random_telegraph" and "random_walk". Effects of
        other kinds, a user's too, are planted by their own columns: pass the effect itself. The strength is the rms
        of the contribution, after a static quadratic in temperature has taken its share, over the standard deviation
        of the white noise. Sign and parameters that are not given are drawn from the seed inside a plausible range;
        parameters are named as in the effect's constructor (of an effect's own, those that shape the contribution
        count; "hold" and the like do not). Effects act in gaps too, each run starts afresh,
        and effects of time alone count from the first sample of the record.
    irregular : float, default=0.0
        Jitter of the sample times, as a share of a step, in [0.0, 1.0).
    gaps : int, default=0
        Number of gaps in each run. The device goes on following the air in a gap.
    runs : int, default=1
        Number of runs, a day apart, each with its own history and start; more than one adds the column "run".
    start : str or Timestamp, default="2024-03-04"
        Time of the first sample.
    seed : int, default=0
        Seed. Climate, noise, each recorded column and the sample times have their own streams, so that for
        example another `noise` leaves the temperature as it was.
    return_truth : bool, default=False
        Whether to return the parts of the reading as well.

    Returns
    -------
    record : DataFrame of shape (n * runs, 6 or 7)
        Columns temperature [degC], humidity [%], pressure [hPa], supply [V], mains [V] and reading [ppm], and run
        (1, 2, ...) if `runs` is above 1; a DatetimeIndex named "time". Humidity, pressure, supply and mains play no
        part in the reading unless a planted effect uses one of them. In the chamber they are those of the room
        around it.
    truth : DataFrame of shape (n * runs, 3 or more)
        Only if `return_truth`. Columns noise_free, device, one per further contribution, and noise [ppm];
        noise_free + noise is the reading. `truth.attrs` holds "noise" [ppm], "base" [ppm], "device", a
        dictionary with the layers, "time_constants" [s] and "lag_coefficients" [ppm/K] of the device, and
        "effects": for each planted one its kind, parameters, strength, coefficient and rms [ppm].

    Raises
    ------
    ValueError
        For a parameter outside its range, in one sentence.

    Examples
    --------
    >>> record, truth = make_record(2000, effects={"hysteresis": 2.0}, seed=1, return_truth=True)
    >>> list(truth)
    ['noise_free', 'device', 'hysteresis', 'noise']
    >>> truth.attrs["effects"]["hysteresis"]["parameters"]["width"] > 0.1  # [K]
    True
    """
    who = "make_record"
    n, gaps, runs, seed = (
        check_int(who, label, value, low)
        for label, value, low in (("n", n, 2), ("gaps", gaps, 0), ("runs", runs, 1), ("seed", seed, 0))
    )
    sampling_period = check_float(who, "sampling_period", sampling_period, "(0.0, inf)")
    check_choice(who, "setting", setting, tuple(TEMPERATURES))
    check_choice(who, "device", device, DEVICE_NAMES)
    noises = _Noise(check_float(who, "noise", noise, "[0.0, inf)"), _checked_coloured(coloured_noise))
    nonlinearity = check_float(who, "nonlinearity", nonlinearity, "(-inf, inf)")
    initial_offset = check_float(who, "initial_offset", initial_offset, "(-inf, inf)")
    irregular = check_float(who, "irregular", irregular, "[0.0, 1.0)")
    if gaps > n - 1:
        raise ValueError(f"The 'gaps' parameter of make_record must be at most n - 1 = {n - 1}. Got {gaps} instead.")

    body = make_device(
        device, sensitivity=10.0, nonlinearity=nonlinearity, reference_temperature=_REFERENCE_TEMPERATURES[setting]
    )
    began = first = _checked_start(start)
    plantings = read_plantings(effects, began)
    simulated, indices = [], []
    for run in range(runs):
        grid, kept = _sample_times(stream(seed, run, "times"), n, sampling_period, irregular, gaps)
        seconds = (first - began).total_seconds()
        simulated.append(_simulate_run(body, setting, grid, kept, first, seconds, noises, initial_offset, seed, run))
        indices.append(pd.DatetimeIndex(first + pd.to_timedelta(grid[kept], unit="s"), name="time"))
        first = indices[-1][-1].round("s") + pd.Timedelta(days=1)
    planted, about = plant(plantings, [part.run for part in simulated], sampling_period, noises.white, seed)

    records, truths = [], []
    for number, (part, index, further) in enumerate(zip(simulated, indices, planted, strict=True), start=1):
        kept = part.run.kept
        reading, parts = compose_reading(part.response, {**part.contributions, **further}, part.white, _BASE)
        columns = {**part.run.columns, "reading": reading}
        labels = {"run": np.full(n, number)} if runs > 1 else {}
        records.append(pd.DataFrame({**labels, **{name: column[kept] for name, column in columns.items()}}, index))
        truths.append(truth_frame({name: values[kept] for name, values in parts.items()}, index, {}))
    record, truth = pd.concat(records), pd.concat(truths)
    record.attrs = {
        "units": dict(_UNITS),
        "noise": noises.white,
        "reading": "reading",
        "temperature": "temperature",
        "description": f"Simulated {device!r} device, setting {setting!r}.",
    }
    truth.attrs = {"noise": noises.white, "base": _BASE, "device": body.parameters(), "effects": about}
    return (record, truth) if return_truth else record


def _simulate_run(
    device: Device,
    setting: str,
    time: Array,
    kept: np.ndarray[Any, np.dtype[np.intp]],
    start: pd.Timestamp,
    seconds: float,
    noises: _Noise,
    initial_offset: float,
    seed: int,
    run: int,
) -> _Simulated:
    """Columns of one run, and the device's bias."""
    clock = (start - start.normalize()).total_seconds()
    air = TEMPERATURES[setting](stream(seed, run, "temperature"), time, start.weekday(), clock)
    humidity_rng = stream(seed, run, "humidity")
    if setting == "outdoor":
        humidity = outdoor_humidity(humidity_rng, time, air)
    else:
        room = air if setting == "lab" else np.full_like(air, _REFERENCE_TEMPERATURES["lab"])
        humidity = room_humidity(humidity_rng, time, room)
    columns = {
        "temperature": air,
        "humidity": humidity,
        "pressure": air_pressure(stream(seed, run, "pressure"), time),
        "supply": supply_voltage(stream(seed, run, "supply"), time),
        "mains": mains_voltage(stream(seed, run, "mains"), time, clock),
    }
    contributions: dict[str, Array] = {}
    if noises.coloured is not None:
        rng = stream(seed, run, "coloured_noise")
        contributions["coloured_noise"] = make_coloured_noise(rng, time, *noises.coloured)
    white = noises.white * stream(seed, run, "noise").standard_normal(time.size)
    response = device.respond(time, air, initial_offset)
    return _Simulated(Run(time, seconds, columns, kept), response, contributions, white)


def _sample_times(
    rng: np.random.Generator, n: int, sampling_period: float, irregular: float, gaps: int
) -> tuple[Array, np.ndarray[Any, np.dtype[np.intp]]]:
    """Times of all samples [s], and the positions kept."""
    lost = np.zeros(n, dtype=np.intp)
    if gaps:
        before = rng.choice(np.arange(1, n), gaps, replace=False)
        lost[before] = rng.integers(max(5, n // 200), max(10, n // 50), gaps, endpoint=True)
    kept = np.arange(n) + np.cumsum(lost)
    steps = np.arange(kept[-1] + 1, dtype=float)
    if irregular:
        steps += irregular * rng.uniform(-0.5, 0.5, steps.size)
    times = np.round(sampling_period * (steps - steps[0]), 6)
    return times, kept


def _checked_start(value: Any) -> pd.Timestamp:
    """Start of the record; ValueError for an invalid date."""
    start = pd.NaT if isinstance(value, int | float | np.number) else date_of(value)
    if not isinstance(start, pd.Timestamp):
        raise ValueError(f"The 'start' parameter of make_record must be a date. Got {value!r} instead.")
    return start


def _checked_coloured(value: Any) -> tuple[float, float] | None:
    if value is None:
        return None
    try:
        deviation, correlation_time = value
    except (TypeError, ValueError):
        raise ValueError(
            "The 'coloured_noise' parameter of make_record must be None or a tuple (standard deviation "
            f"[ppm], correlation time [s]). Got {value!r} instead."
        ) from None
    return (
        check_float("make_record", "coloured_noise[0]", deviation, "[0.0, inf)"),
        check_float("make_record", "coloured_noise[1]", correlation_time, "(0.0, inf)"),
    )

"""Heat conduction of simulated devices.

The heat equation is cut into finite volumes (second order in the cell size) and integrated in time exactly,
for an air temperature that is linear between samples. The modes of the cut equation are computed, not
chosen.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import eigh_tridiagonal

Array = NDArray[np.float64]


def modal_differences(rates: Array, steps: Array, changes: Array, start: Array) -> Array:
    """Propagate each mode exactly under linear air temperature.

    `rates` (ndarray of shape (m,)): Rates of the modes [1/s]. `steps` (ndarray of shape (n,)): Lengths of the steps
    [s]. `changes` (ndarray of shape (n,)): Change of the air temperature over each step [K]. `start` (ndarray of
    shape (m,)): Mode minus air temperature before the first step [K]. Returns differences (ndarray of shape (n, m)):
    `differences[k, j]` is mode j minus air temperature after step k [K].
    """
    regular = steps.size > 0 and np.ptp(steps) <= 1e-12 * steps[0]
    exponent = np.outer(steps[:1] if regular else steps, rates)
    gain = -np.expm1(-exponent) / exponent  # first-order hold: (1 - exp(-x)) / x
    return scan(np.exp(-exponent), -gain * changes[:, None], start)


def scan(decay: Array, increment: Array, start: Array) -> Array:
    """Solve d[k] = decay[k] d[k-1] + increment[k], vectorised.

    Rows are dealt into blocks; all blocks run side by side from zero, then the true starts are passed on.
    """
    n, m = increment.shape
    length = max(1, int(np.sqrt(n)))
    blocks = -(-n // length)
    values = np.zeros((blocks * length, m))
    values[:n] = increment
    values = values.reshape(blocks, length, m)
    factors = np.ones((blocks * length, m))
    factors[:n] = decay
    factors = factors.reshape(blocks, length, m)
    for k in range(1, length):
        values[:, k] += factors[:, k] * values[:, k - 1]
        factors[:, k] *= factors[:, k - 1]  # from here on the product since the block's start
    state = np.asarray(start, dtype=float)
    for block in range(blocks):
        values[block] += factors[block] * state
        state = values[block, -1]
    return np.asarray(values.reshape(-1, m)[:n])


_CHUNK = 32_768  # samples propagated at once; bounds the memory to _CHUNK * cells numbers


@dataclass(frozen=True)
class Layer:
    """One homogeneous layer of a device.

    Parameters
    ----------
    name : str
        Name by which a sensitivity refers to the layer.
    thickness : float
        Thickness [m].
    conductivity : float
        Thermal conductivity [W/(m K)].
    heat_capacity : float
        Density times specific heat capacity [J/(m3 K)].
    cells : int, default=10
        Number of finite volumes.
    contact_resistance : float, default=0.0
        Thermal resistance of the joint on the layer's outer side [m2 K/W].
    """

    name: str
    thickness: float
    conductivity: float
    heat_capacity: float
    cells: int = 10
    contact_resistance: float = 0.0

    def __post_init__(self) -> None:
        """Check the parameters."""
        for label in ("thickness", "conductivity", "heat_capacity"):
            value = getattr(self, label)
            if not (np.isfinite(value) and value > 0):
                raise ValueError(
                    f"The '{label}' parameter of Layer must be a float in the range (0.0, inf). Got {value!r} instead."
                )
        if not (np.isfinite(self.contact_resistance) and self.contact_resistance >= 0):
            raise ValueError(
                "The 'contact_resistance' parameter of Layer must be a float in the range [0.0, inf). "
                f"Got {self.contact_resistance!r} instead."
            )
        if self.cells < 1:
            raise ValueError(
                f"The 'cells' parameter of Layer must be an int in the range [1, inf). Got {self.cells!r} instead."
            )


class HeatStack:
    """Heat conduction in a stack of layers, eqs. (14)-(16).

    The outer face of the first layer exchanges heat with the air; the inner face of the last one is
    insulated, or exchanges heat with the same air when `inner_convection` is given.

    Parameters
    ----------
    layers : sequence of Layer
        From the outer face inwards.
    outer_convection : float
        Heat transfer coefficient of the outer face [W/(m2 K)].
    inner_convection : float, default=0.0
        Heat transfer coefficient of the inner face [W/(m2 K)]; 0.0 is an insulated face.

    Attributes
    ----------
    positions : ndarray of shape (cells,)
        Distance of the cell centres from the outer face [m].
    rates : ndarray of shape (cells,)
        Decay rates of the modes, slowest first [1/s].
    modes : ndarray of shape (cells, cells)
        `modes[c, j]` is the share of cell c's temperature that follows the air with rate j; every row sums
        to 1.
    """

    def __init__(self, layers: Sequence[Layer], outer_convection: float, inner_convection: float = 0.0) -> None:
        if not layers:
            raise ValueError("The 'layers' parameter of HeatStack must hold at least one Layer. Got none.")
        if not (np.isfinite(outer_convection) and outer_convection > 0):
            raise ValueError(
                "The 'outer_convection' parameter of HeatStack must be a float in the range (0.0, inf). "
                f"Got {outer_convection!r} instead."
            )
        if not (np.isfinite(inner_convection) and inner_convection >= 0):
            raise ValueError(
                "The 'inner_convection' parameter of HeatStack must be a float in the range [0.0, inf). "
                f"Got {inner_convection!r} instead."
            )
        self.layers = tuple(layers)
        self.outer_convection = float(outer_convection)
        self.inner_convection = float(inner_convection)
        cells = [layer.cells for layer in self.layers]
        width = np.repeat([layer.thickness / layer.cells for layer in self.layers], cells)
        self.positions: Array = np.cumsum(width) - width / 2
        self.capacities: Array = width * np.repeat([layer.heat_capacity for layer in self.layers], cells)
        self.conductances: Array = _conductances(self.layers, width, self.outer_convection, self.inner_convection)
        self.rates, self.modes = _unit_gain_modes(self.capacities, self.conductances)

    @property
    def time_constants(self) -> Array:
        """Time constants of the modes, slowest first [s]."""
        return np.asarray(1.0 / self.rates)

    def layer_mean(self, name: str) -> Array:
        """Weights, shape (cells,), of the mean temperature of a layer."""
        names = np.repeat([layer.name for layer in self.layers], [layer.cells for layer in self.layers])
        chosen = names == name
        if not chosen.any():
            known = ", ".join(layer.name for layer in self.layers)
            raise ValueError(f"There is no layer {name!r} in this stack. The layers are: {known}.")
        return np.asarray(chosen / chosen.sum())

    def field(self, time: ArrayLike, temperature: ArrayLike, initial_offset: float = 0.0) -> Array:
        """Temperature of every cell at every sample.

        Parameters
        ----------
        time : array-like of shape (n,)
            Times of the samples, increasing, steps may be irregular [s].
        temperature : array-like of shape (n,)
            Air temperature, linear between the samples [degC].
        initial_offset : float, default=0.0
            Uniform difference between the device and the air at the first sample [K].

        Returns
        -------
        field : ndarray of shape (n, cells)
            `field[k, c]` is the temperature of cell c at sample k [degC].
        """
        blocks = [block for _, block in self._field_blocks(time, temperature, initial_offset)]
        return np.concatenate(blocks)

    def respond(
        self,
        time: ArrayLike,
        temperature: ArrayLike,
        linear: ArrayLike,
        quadratic: ArrayLike | None = None,
        *,
        reference_temperature: float = 0.0,
        initial_offset: float = 0.0,
    ) -> Array:
        """Output of the device, U = F(field) of eq. (16).

        Parameters
        ----------
        time, temperature, initial_offset
            As for `field`.
        linear : array-like of shape (cells,)
            Weights of the cells' temperatures above the reference [unit/K].
        quadratic : array-like of shape (cells,), optional
            Weights of the squares of the same temperatures [unit/K2].
        reference_temperature : float, default=0.0
            Temperature at which the output is zero [degC].

        Returns
        -------
        output : ndarray of shape (n,)
            In the unit of the weights.
        """
        first = np.asarray(linear, dtype=float)
        second = np.zeros_like(first) if quadratic is None else np.asarray(quadratic, dtype=float)
        needed = np.flatnonzero((first != 0) | (second != 0))
        output = np.zeros(np.shape(temperature))
        for rows, field in self._field_blocks(time, temperature, initial_offset, needed):
            excess = field - reference_temperature
            output[rows] = excess @ first[needed] + excess**2 @ second[needed]  # eq. (16), F of second degree
        return output

    def _field_blocks(
        self, time: ArrayLike, temperature: ArrayLike, initial_offset: float, cells: NDArray[np.intp] | None = None
    ) -> Iterator[tuple[slice, Array]]:
        """Blocks of rows of the field, state carried on."""
        times, air = _checked(time, temperature)
        shares = (self.modes if cells is None else self.modes[cells]).T
        difference = np.full((1, self.rates.size), float(initial_offset))
        yield slice(0, 1), air[:1, None] + difference @ shares
        for begin in range(0, times.size - 1, _CHUNK):
            end = min(begin + _CHUNK, times.size - 1)
            difference = modal_differences(
                self.rates, np.diff(times[begin : end + 1]), np.diff(air[begin : end + 1]), difference[-1]
            )
            yield slice(begin + 1, end + 1), air[begin + 1 : end + 1, None] + difference @ shares


def _conductances(layers: Sequence[Layer], width: Array, outer: float, inner: float) -> Array:
    """Conductances from cell to cell [W/(m2 K)]."""
    cells = [layer.cells for layer in layers]
    half = width / 2 / np.repeat([layer.conductivity for layer in layers], cells)  # resistance of half a cell
    joint = np.zeros(width.size)
    joint[np.cumsum([0, *cells[:-1]])] = [layer.contact_resistance for layer in layers]
    between = 1.0 / (half[:-1] + joint[1:] + half[1:])  # harmonic mean of neighbours, joint in series
    last = 0.0 if inner == 0 else 1.0 / (half[-1] + 1.0 / inner)
    return np.concatenate([[1.0 / (1.0 / outer + joint[0] + half[0])], between, [last]])


def _unit_gain_modes(capacities: Array, conductances: Array) -> tuple[Array, Array]:
    """Rates [1/s] and shares of the modes, eq. (14) in cells."""
    root = np.sqrt(capacities)
    diagonal = (conductances[:-1] + conductances[1:]) / capacities
    side = -conductances[1:-1] / (root[:-1] * root[1:])
    rates, vectors = eigh_tridiagonal(diagonal, side)  # of C^-1/2 K C^-1/2: symmetric, so real and positive
    shares = vectors / root[:, None] * (vectors.T @ root)  # a uniform field has the share 1 in every cell
    return np.asarray(rates, dtype=float), shares


def _checked(time: ArrayLike, temperature: ArrayLike) -> tuple[Array, Array]:
    times, air = np.asarray(time, dtype=float), np.asarray(temperature, dtype=float)
    if times.ndim != 1 or times.size == 0 or times.shape != air.shape:
        raise ValueError(
            "Times and temperatures must be two vectors of one length of at least 1. "
            f"Got shapes {times.shape} and {air.shape}."
        )
    if not (np.isfinite(times).all() and np.isfinite(air).all()):
        raise ValueError("Times and temperatures must be finite. Fill or drop the missing values first.")
    if (np.diff(times) <= 0).any():
        row = int(np.argmax(np.diff(times) <= 0)) + 1
        raise ValueError(f"Times must increase. Row {row} does not come after row {row - 1}.")
    return times, air


# Each part of a record has its own random stream: changing one part leaves the others as they were.
STREAMS = (
    "temperature",
    "humidity",
    "pressure",
    "supply",
    "noise",
    "coloured_noise",
    "times",
    "contributions",
    "mains",
)  # new ones go to the end: the place in this list is part of the seed


def stream(seed: int, run: int, part: str) -> np.random.Generator:
    """Random generator of one part of one run."""
    return np.random.default_rng([seed, run, STREAMS.index(part)])


def coloured_noise(rng: np.random.Generator, time: Array, deviation: float, correlation_time: float) -> Array:
    """First-order autoregressive noise at any times [s]: correlation exp(-|t - s|/correlation_time)."""
    decay = np.exp(-np.diff(time) / correlation_time)[:, None]
    white = rng.standard_normal(time.size)
    later = scan(decay, np.sqrt(1 - decay**2) * white[1:, None], white[:1])[:, 0]
    return deviation * np.concatenate([white[:1], later])


def compose_reading(
    device: Array, contributions: Mapping[str, Array], noise: Array, base: float = 0.0
) -> tuple[Array, dict[str, Array]]:
    """Add up a reading and keep its parts.

    `device` (ndarray of shape (n,)): Thermal bias of the device. `contributions` (mapping of str to ndarray of shape
    (n,)): Further effects that a thermal model does not know; each becomes a column of the truth. `noise` (ndarray of
    shape (n,)): White noise. `base` (float, default=0.0): The unbiased reading U0. Returns reading (ndarray of shape
    (n,)): what the logger keeps. Returns truth (dict of str to ndarray): "noise_free", "device", one entry per
    contribution, "noise"; noise_free + noise is the reading.
    """
    noise_free = base + device + sum(contributions.values(), np.zeros_like(device))
    return noise_free + noise, {"noise_free": noise_free, "device": device, **contributions, "noise": noise}


def truth_frame(parts: Mapping[str, Array], index: pd.Index, attrs: Mapping[str, Any]) -> pd.DataFrame:
    """Parts of a simulated reading, with the truth in `attrs`."""
    frame = pd.DataFrame(dict(parts), index=index)
    for key, value in attrs.items():
        frame.attrs[key] = value
    return frame


def check_float(function: str, name: str, value: Any, interval: str) -> float:
    """A finite float inside `interval`, or ValueError."""
    low, high = (float(end) for end in interval[1:-1].split(","))
    if (
        isinstance(value, int | float | np.integer | np.floating)
        and not isinstance(value, bool)
        and np.isfinite(float(value))
    ):
        number = float(value)
        above = number >= low if interval[0] == "[" else number > low
        below = number <= high if interval[-1] == "]" else number < high
        if above and below:
            return number
    raise ValueError(
        f"The '{name}' parameter of {function} must be a float in the range {interval}. Got {value!r} instead."
    )


def check_choice(function: str, name: str, value: Any, choices: Collection[str | None]) -> None:
    """Raise ValueError unless `value` is one of `choices`."""
    if value not in choices:
        options = ", ".join(repr(choice) for choice in choices)
        raise ValueError(f"The '{name}' parameter of {function} must be one of {options}. Got {value!r} instead.")

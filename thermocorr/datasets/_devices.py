"""Simulated devices: layers and their sensitivities, U = F(field)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from ._heat import Array, HeatStack, Layer


@dataclass(frozen=True)
class Device:
    """A device whose reading depends on the temperature of its layers.

    Parameters
    ----------
    stack : HeatStack
        Layers, from the outside inwards.
    linear : mapping of str to float
        Share of each layer in the linear sensitivity; the shares usually sum to 1.
    quadratic : mapping of str to float, default={}
        Curvature of the sensitivity to each layer [1/K].
    sensitivity : float, default=1.0
        Slope of the static law [unit/K].
    reference_temperature : float, default=22.5
        Temperature at which the bias is zero [degC].
    """

    stack: HeatStack
    linear: Mapping[str, float]
    quadratic: Mapping[str, float] = field(default_factory=dict)
    sensitivity: float = 1.0
    reference_temperature: float = 22.5

    def _weights(self, shares: Mapping[str, float]) -> Array:
        total = np.zeros(self.stack.rates.size)
        for name, share in shares.items():
            total += self.sensitivity * share * self.stack.layer_mean(name)
        return total

    def respond(self, time: Array, temperature: Array, initial_offset: float = 0.0) -> Array:
        """Bias U - U0 in air of `temperature` [degC], eq. (16)."""
        return self.stack.respond(
            time,
            temperature,
            self._weights(self.linear),
            self._weights(self.quadratic),
            reference_temperature=self.reference_temperature,
            initial_offset=initial_offset,
        )

    def lag_coefficients(self) -> tuple[Array, Array]:
        """Time constants [s] and coefficients [unit/K] of eq. (22)."""
        coefficients = self._weights(self.linear) @ self.stack.modes
        seen = np.abs(coefficients) > 1e-6 * np.abs(coefficients).sum()
        return self.stack.time_constants[seen], coefficients[seen]

    def parameters(self) -> dict[str, Any]:
        """Everything that defines the device, as plain numbers, lists and dictionaries."""
        time_constants, coefficients = self.lag_coefficients()
        return {
            "layers": [asdict(layer) for layer in self.stack.layers],
            "outer_convection": self.stack.outer_convection,
            "inner_convection": self.stack.inner_convection,
            "linear": dict(self.linear),
            "quadratic": dict(self.quadratic),
            "sensitivity": self.sensitivity,
            "reference_temperature": self.reference_temperature,
            "time_constants": time_constants.tolist(),
            "lag_coefficients": coefficients.tolist(),
        }


def _slab() -> tuple[HeatStack, dict[str, float]]:
    """Block of resin, 10 mm, on an insulator (half an hour)."""
    return HeatStack([Layer("resin", 0.010, 0.3, 2.0e6, 40)], 15.0), {"resin": 1.0}


def _plate() -> tuple[HeatStack, dict[str, float]]:
    """Ceramic plate, 5 mm, between streams of air (minutes)."""
    layers = [Layer("surface", 0.001, 2.0, 2.6e6, 6), Layer("core", 0.004, 2.0, 2.6e6, 24)]
    return HeatStack(layers, 25.0, 15.0), {"surface": 0.5, "core": 0.5}


def _layered() -> tuple[HeatStack, dict[str, float]]:
    """Package on a board with a metal base (minute and hour)."""
    return package_stack(25.0), {"package": 0.80, "board": 0.10, "base": 0.10}


def _box() -> tuple[HeatStack, dict[str, float]]:
    """Instrument in a lagged die-cast box (minutes and hours)."""
    layers = [
        Layer("case", 0.003, 120.0, 2.4e6, 3),
        Layer("foam", 0.020, 0.04, 4.0e4, 20),
        Layer("instrument", 0.010, 20.0, 2.4e6, 8, contact_resistance=0.01),
    ]
    return HeatStack(layers, 10.0), {"case": 0.3, "instrument": 0.7}


def package_stack(outer_convection: float) -> HeatStack:
    """Stack of package, board, filling and base under a fan."""
    layers = [
        Layer("package", 0.0015, 18.0, 2.8e6, 4),
        Layer("board", 0.0016, 0.3, 2.0e6, 6, contact_resistance=2e-3),
        Layer("filling", 0.012, 0.04, 5.0e4, 12),
        Layer("base", 0.006, 150.0, 2.4e6, 4),
    ]
    return HeatStack(layers, outer_convection)


_STACKS = {"slab": _slab, "plate": _plate, "layered": _layered, "box": _box}

DEVICE_NAMES = tuple(_STACKS)


def make_device(name: str, *, sensitivity: float, nonlinearity: float, reference_temperature: float) -> Device:
    """Make a device of some nonlinearity [1/K]."""
    stack, linear = _STACKS[name]()
    quadratic = {stack.layers[-1].name: nonlinearity} if nonlinearity else {}
    return Device(stack, linear, quadratic, sensitivity, reference_temperature)

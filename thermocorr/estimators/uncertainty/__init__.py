"""What the numbers of a fitted model are worth: its noise, joint errors, signed readings."""

from .joint import Sensor
from .signed import Budget, Uncertainty

__all__ = ["Budget", "Sensor", "Uncertainty"]

"""What the numbers of a fitted model are worth: its noise, joint errors, signed readings."""

from .budget import Budget
from .declared import Sensor
from .signed import Uncertainty

__all__ = ["Budget", "Sensor", "Uncertainty"]

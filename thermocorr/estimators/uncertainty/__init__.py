"""Uncertainty of a fitted model: its noise, joint errors, signed readings."""

from .joint import Sensor
from .signed import Budget, Uncertainty

__all__ = ["Budget", "Sensor", "Uncertainty"]

"""Checks of a model on unseen data, and of its thermometers."""

from .model import held_out_residuals, thermometer_errors

__all__ = ["held_out_residuals", "thermometer_errors"]

"""Checks of a model on data that it has not seen, and of what errors of the thermometers make in it."""

from .model import held_out_residuals, thermometer_errors

__all__ = ["held_out_residuals", "thermometer_errors"]

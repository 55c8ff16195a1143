"""Equations, on numpy and scipy alone; start with `lags`."""

from .allan import AllanDeviation, allan_deviation, regular_cells
from .lags import LagState, decay_and_gain, decays, equilibrium, lag_differences
from .leastsquares import RidgeSolution, TriangularFactor, solve_ridge
from .statistics import MovingAverage, moving_average, reduction_db

__all__ = [
    "AllanDeviation",
    "LagState",
    "MovingAverage",
    "RidgeSolution",
    "TriangularFactor",
    "allan_deviation",
    "decay_and_gain",
    "decays",
    "equilibrium",
    "lag_differences",
    "moving_average",
    "reduction_db",
    "regular_cells",
    "solve_ridge",
]

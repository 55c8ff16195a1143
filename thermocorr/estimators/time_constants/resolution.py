"""Which time constants a record can resolve: diffusive spectrum, excitation, intervals, and warnings."""

from __future__ import annotations

import numpy as np
import pandas as pd

from ...equations import RidgeSolution
from ...records import Record
from ...records.numbers import span_texts
from .search import Factored
from .spectrum import GridRidge

UNDETERMINED = 10.0
"""Upper over lower end of an interval, above which the record does not determine the time constant."""
CONFIDENCE_95 = 1.96
OPPOSED = 0.1
"""Share of two coefficients that is left in their sum, below which they cancel."""


def spectrum_table(factored: Factored, reference: GridRidge) -> pd.DataFrame:
    """Diffusive spectrum mu(tau) over the grid, and what the record could see of each time constant.

    Returns DataFrame with columns: time_constant [s], of the lags of the (first) thermometer; coefficient: mu(tau) of
    the reference model (ridge over the whole grid), reading per K; excitation [K]: rms of the lag difference, the
    static law and further effects taken out; smallest_coefficient: coefficient of twice its standard error, were this
    the only lag and the residuals white; alike_next: correlation with the next longer time constant, after the same
    projection: near 1 where the record cannot tell the two apart.
    """
    layout, whole = factored.layout, factored.whole
    grid = layout.grid[layout.owner == 0]
    lags = whole.r[layout.n_free :, layout.n_free : layout.n_free + len(grid)]
    norms = np.linalg.norm(lags, axis=0)
    noise = np.sqrt(reference.residual_sum_of_squares / whole.n_rows)
    unit = lags / np.where(norms > 0, norms, 1.0)
    with np.errstate(divide="ignore"):
        smallest = 2 * noise / norms
    return pd.DataFrame(
        {
            "time_constant": grid,
            "coefficient": reference.coefficients[layout.n_free : layout.n_free + len(grid)],
            "excitation": norms / np.sqrt(whole.n_rows),
            "smallest_coefficient": smallest,
            "alike_next": np.append(np.einsum("ij,ij->j", unit[:, :-1], unit[:, 1:]), np.nan),
        }
    )


def interval_table(time_constants: np.ndarray, log_errors: np.ndarray) -> pd.DataFrame:
    """Time constants with 95 % intervals [s], from standard errors of ln tau."""
    with np.errstate(over="ignore"):
        factor = np.exp(CONFIDENCE_95 * log_errors)
    return pd.DataFrame(
        {
            "time_constant": time_constants,
            "low": time_constants / factor,
            "high": time_constants * factor,
            "relative_error": log_errors,
        }
    )


def unresolved(
    time_constants: np.ndarray, record: Record, solution: RidgeSolution, n_static: int, noise: float
) -> list[str]:
    """Sentences on time constants that the record cannot determine; empty where all is well.

    `time_constants` (array of shape (J,)): Of a fitted model [s], increasing. `record` (Record). `solution`
    (RidgeSolution): Columns are `n_static` static ones, then the lags. `noise` (float): Standard deviation of the
    residuals.
    """
    step, span = record.usual_step(), record.longest_read()
    said = []
    for tau in time_constants[time_constants > span]:
        late, whole, needed = span_texts((tau, span, 3 * tau))
        said.append(
            f"A time constant of {late} is longer than the record ({whole}): over the record its lag looks like a "
            f"drift, and its coefficient is a guess. Record for at least {needed}, or leave it out."
        )
    for tau in time_constants[time_constants < step / 2]:
        late, sampled = span_texts((tau, step))
        said.append(
            f"A time constant of {late} is shorter than half the sampling step ({sampled}): the record cannot tell it "
            "from no lag. Sample faster, or leave it out."
        )
    mu = solution.coef[n_static : n_static + len(time_constants)]
    triangle = solution.inverse_triangle[n_static : n_static + len(time_constants)]
    for j in range(len(time_constants) - 1):
        both = float(np.abs(mu[j]) + np.abs(mu[j + 1]))
        error, error_of_sum = (
            CONFIDENCE_95 * noise * float(np.linalg.norm(triangle[j] + sign * triangle[j + 1])) for sign in (-1, 1)
        )
        if abs(mu[j] + mu[j + 1]) < error_of_sum:
            continue  # nothing here that could be parted
        pair = f"Time constants of {' and '.join(span_texts(time_constants[j : j + 2]))}"
        if error > both or not (triangle[j].any() and triangle[j + 1].any()):
            said.append(
                f"{pair} cannot be told apart in this record: the difference of their coefficients is known to "
                f"+-{error:.3g} only, more than both together. What both say together is known, the two coefficients "
                "are not: leave one out, or record faster temperature changes."
            )
        elif abs(mu[j] + mu[j + 1]) < OPPOSED * both:
            said.append(
                f"{pair} work against each other: their coefficients, {mu[j]:.4g} and {mu[j + 1]:.4g}, nearly cancel. "
                "What both say together is known, but these are no bodies of the device: leave one out."
            )
    return said

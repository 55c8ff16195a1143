"""`StepResponseDisplay`: how the reading follows a step of temperature."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from ..effects.expressions import follows_temperature
from ..effects.protocol import Effect
from ..estimators.time_constants.resolution import CONFIDENCE_95
from ..records import Layout, read_record
from ..records.units import difference_unit
from .axes import BLUE, GREY, axes_grid, label_values, legend_above, log_time_axis, plain
from .walk import regressor_of, without_times

POINTS = 200
INSTANT = 1e-6
"""Length of the step, as a share of the first time drawn."""


class StepResponseDisplay:
    """Bias after a step of temperature from the reference temperature, device at rest, over time.

    The band joins all coefficients' errors with their correlations: neighbouring lags err in opposite directions, and
    their sum is known far better than each of them.

    Attributes
    ----------
    ax_, axes_, figure_ : of matplotlib
        After `plot`.
    """

    def __init__(
        self,
        response: pd.DataFrame,
        time_constants: np.ndarray,
        step: float,
        temperature_unit: str,
        unit: str,
        samples: bool = False,
    ):
        self.response = response
        self.time_constants = time_constants
        self.step = step
        self.temperature_unit = temperature_unit
        self.unit = unit
        self.samples = samples

    @classmethod
    def from_estimator(cls, model: Any, *, step: float = 1.0) -> StepResponseDisplay:
        """Create it from a fitted model.

        Parameters
        ----------
        model : DynamicBiasRegressor
            Fitted; or a search with a ``best_estimator_``. Of its effects those count that follow the temperature:
            static law, lags and their products, delay, hinge, hysteresis, a smoothed rate. The effects of other
            columns, of time alone and of the plain rate of change are left out.
        step : float, default 1.0
            Height, in the unit of the temperature (K for degC). It is a step of the air where the model was told that
            its thermometer is late itself (`Thermometer`), else one of what the thermometer shows.
        """
        fitted = regressor_of(model)
        effects = fitted.features_.effect_list()
        times = _times(fitted)
        columns = _columns(fitted, effects, times, step)
        value = columns @ fitted.coef_
        if fitted.knows_noise:
            joint = fitted.joint_errors()
            error = joint.combined(_columns(fitted, joint.effects, times, step), value)
        else:
            error = fitted.standard_errors(columns)
        response = pd.DataFrame({"time": times, "response": value, "standard_error": error})
        reading = fitted.reading_
        return cls(
            response=response,
            time_constants=fitted.time_constants_,
            step=step,
            temperature_unit=difference_unit(reading.temperature_unit),
            unit=reading.unit,
            samples=without_times(fitted),
        )

    def frame(self) -> pd.DataFrame:
        """Time after the step [s], response of the bias, and its standard error, in the unit of the reading."""
        return self.response.copy()

    def plot(self, ax: Any = None) -> StepResponseDisplay:
        """Draw in `ax`, or in a new figure."""
        axes = axes_grid(ax, size=(7.0, 4.2))[0]
        only = axes[0]
        time, value = self.response["time"], self.response["response"]
        error = CONFIDENCE_95 * self.response["standard_error"]
        only.fill_between(time, value - error, value + error, color=BLUE, alpha=0.25, lw=0, label="95 % confidence")
        only.plot(time, value, color=BLUE, lw=1.8, label="response")
        only.axhline(float(value.iloc[-1]), color=GREY, ls="--", lw=1.0, label="at rest again")
        only.axhline(0.0, color="0.4", lw=0.8, zorder=1)
        if len(self.time_constants):
            ends = np.zeros(len(self.time_constants))
            place = only.get_xaxis_transform()
            only.plot(self.time_constants, ends + 0.02, "|k", ms=9, mew=1.6, transform=place, label="time constants")
        only.set_xlim(time.iloc[0], time.iloc[-1])
        plain(only)
        log_time_axis(only, "time after the step", self.samples)
        label_values(only.yaxis, f"bias after a step of {self.step:g} {self.temperature_unit}", self.unit)
        legend_above(only)
        self.axes_, self.ax_, self.figure_ = axes, only, only.figure
        return self


def _times(fitted: Any) -> np.ndarray:
    """Times to look at [s]: from well before the first time constant to well after the last."""
    memories = np.array([e.memory() for e in fitted.features_.effect_list() if follows_temperature(e)])
    taus = np.concatenate((fitted.time_constants_, memories[memories > 0]))
    if not len(taus):
        step = fitted.features_.history_.usual_step
        return np.asarray(np.geomspace(step, 1000 * step, POINTS))
    return np.asarray(np.geomspace(taus.min() / 10, 8 * taus.max(), POINTS))


def _columns(fitted: Any, effects: list[Effect], times: np.ndarray, step: float) -> np.ndarray:
    """Columns of the model after the step less those before it, shape (n, p); zeros for effects that do not follow.

    The effects' own columns, on a record of the step: eqs. (3) (19) (25) stand where they stand.
    """
    instant = INSTANT * times[0]
    T0 = fitted.reference_temperature_
    seconds = np.concatenate(([0.0, instant], instant + times))
    name = fitted.features_.history_.record.temperature_name
    late = fitted.features_.thermometers().of_column(name).late
    shown = -np.expm1(-seconds / late) if late else np.arange(len(seconds)) > 0
    frame = pd.DataFrame({"seconds": seconds, name: T0 + step * shown})
    record = read_record(frame, Layout(name, "seconds"), quiet=True)
    result = np.zeros((len(times), sum(effect.n_columns() for effect in effects)))
    at = 0
    for effect in effects:
        width = effect.n_columns()
        if follows_temperature(effect):
            block = next(record.blocks(len(seconds)))
            columns = np.asarray(effect.columns(block, None)[0]).reshape(len(seconds), width)
            result[:, at : at + width] = columns[2:] - columns[0]
        at += width
    return result

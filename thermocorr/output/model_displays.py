"""Displays of contributions, step response and spectrum."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import pandas as pd

from ..effects.expressions import follows_temperature
from ..effects.protocol import Effect
from ..model.search import CONFIDENCE_95, UNDETERMINED
from ..records import Layout, read_record
from ..records.numbers import quantity_text, unit_text
from ..records.units import difference_unit
from .axes import Display, label_values, legend_above, log_time_axis
from .curves import Curves, cells_of, draw_panel, regressor_of, without_times
from .style import BLUE, COLOURS, GROUND, ORANGE, SOFT, TEXT
from .timeline import TimeLine, dress_time, name_runs


@dataclass(eq=False)
class ContributionsDisplay(Display):
    """What each effect adds, and its step response.

    Attributes
    ----------
    rms : Series
        Root mean square of each effect's contribution about its mean, the largest first, in the unit of the reading.
    responses : DataFrame
        Time after a step of 1 K [s], and what each effect that follows the temperature adds since.
    """

    alt: ClassVar[str] = "what each effect adds over time, and its answer to a step of temperature"
    cells: pd.DataFrame
    timeline: TimeLine
    rms: pd.Series
    unit: str
    responses: pd.DataFrame
    degree: str
    samples: bool = False

    @classmethod
    def from_estimator(cls, model: Any, X: Any) -> ContributionsDisplay:
        """Create it from a fitted model and a record.

        Parameters
        ----------
        model : DynamicBiasRegressor
            Fitted; or a search with a ``best_estimator_``.
        X : as for `DynamicBiasRegressor.contributions`
        """
        return cls.of(Curves(model, X))

    @classmethod
    def of(cls, curves: Curves) -> ContributionsDisplay:
        """Create it from curves."""
        labels, model = curves.labels(), curves.model
        count = np.zeros(1)
        moments = np.zeros((2, len(labels)))

        def parts() -> Any:
            for part in curves.parts():
                known = part.contributions[np.isfinite(part.contributions).all(axis=1)]
                count[:] += len(known)
                moments[:] += known.sum(axis=0), np.einsum("ij,ij->j", known, known)
                yield part.segment, part.seconds, part.contributions

        cells = cells_of(curves.timeline, labels, curves.n_rows, parts())
        mean, square = moments / np.maximum(count, 1)
        rms = pd.Series(np.sqrt(np.maximum(square - mean**2, 0.0)), index=labels, name="rms")
        effects = model.features_.effect_list()
        times, ends = _times(model), np.cumsum([0, *(effect.n_columns() for effect in effects)])
        columns = _columns(model, effects, times, 1.0) * model.coef_
        follow = [k for k, effect in enumerate(effects) if follows_temperature(effect)]
        each = {labels[k]: columns[:, ends[k] : ends[k + 1]].sum(axis=1) for k in follow}
        return cls(
            cells=cells,
            timeline=curves.timeline,
            rms=rms.sort_values(ascending=False, kind="stable"),
            unit=model.reading_.unit,
            responses=pd.DataFrame({"time": times, **each}),
            degree=difference_unit(model.reading_.temperature_unit),
            samples=without_times(model),
        )

    def frame(self) -> pd.DataFrame:
        """The numbers drawn, a row per cell of time.

        One row per cell of time; every row of the record up to 2000 rows.
        """
        return self.cells.copy()

    def grid(self) -> dict[str, Any]:
        """Rows, columns and size of the picture."""
        shown = {"rows": min(len(self.rms), 8), "size": (9.0, 0.9 + 1.35 * min(len(self.rms), 8)), "sharex": "col"}
        return {**shown, "columns": 2, "width_ratios": (2.6, 1)} if self.responses.shape[1] > 1 else shown

    def draw(self, axes: np.ndarray) -> None:
        """Draw in axes of shape (effects, 1 or 2)."""
        for row, label, colour in zip(axes, self.rms.index, COLOURS * 2, strict=False):
            left, last = row[0], row[0] is axes[-1, 0]
            draw_panel(left, self.cells, self.timeline, label, colour)
            left.margins(x=0.01)
            dress_time(left, self.timeline, labels=last)
            label_values(left.yaxis, "adds", self.unit)
            left.set_title(f"{label}: rms {quantity_text(self.rms[label], self.unit)}")
            left.tick_params(labelbottom=last)
            if len(row) > 1:
                self._answer(row[1], label, colour, last)
        name_runs(axes[0, 0], self.timeline)
        axes[0, 0].figure.align_ylabels(axes[:, 0])

    def _answer(self, ax: Any, label: str, colour: str, last: bool) -> None:
        """Step response of an effect, if it has one."""
        time = self.responses["time"]
        ax.set_xlim(time.iloc[0], time.iloc[-1])
        if label in self.responses:
            ax.plot(time, self.responses[label], color=colour, lw=1.6)
            ax.set_title(f"after a step of 1 {unit_text(self.degree)}")
        log_time_axis(ax, "time after the step" if last else "", self.samples)
        if label in self.responses:
            label_values(ax.yaxis, "adds", self.unit)
        else:
            ax.set_axis_off()
        ax.tick_params(labelbottom=last)


POINTS = 200


@dataclass(eq=False)
class StepResponseDisplay(Display):
    """Bias after a step of temperature, device at rest.

    The band joins all coefficients' errors with their correlations: neighbouring lags err in opposite directions, and
    their sum is known far better than each of them.
    """

    alt: ClassVar[str] = "bias after a step of temperature"
    response: pd.DataFrame
    time_constants: np.ndarray
    step: float
    temperature_unit: str
    unit: str
    samples: bool = False

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
            Height, in the unit of the temperature (K for degC). It is a step of the air where the model knows that
            its thermometer is late itself (`Thermometer`), else one of what the thermometer shows.
        """
        fitted = regressor_of(model)
        effects = fitted.features_.effect_list()
        times = _times(fitted)
        columns = _columns(fitted, effects, times, step)
        value = columns @ fitted.coef_
        if fitted._knows_noise:
            joint = fitted._joint_errors()
            error = joint.combined(_columns(fitted, joint.effects, times, step), value)
        else:
            error = fitted._standard_errors(columns)
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
        """Time [s], response and standard error [unit of y]."""
        return self.response.copy()

    def grid(self) -> dict[str, Any]:
        """Size of the picture."""
        return {"size": (7.0, 4.0)}

    def draw(self, axes: np.ndarray) -> None:
        """Draw in axes of shape (1, 1)."""
        only = axes[0, 0]
        time, value = self.response["time"], self.response["response"]
        error = CONFIDENCE_95 * self.response["standard_error"]
        only.fill_between(time, value - error, value + error, color=BLUE, alpha=0.25, lw=0, label="95 % confidence")
        only.plot(time, value, color=BLUE, lw=1.8, label="response")
        only.axhline(float(value.iloc[-1]), color=SOFT, ls="--", lw=1.0, label="at rest again")
        only.axhline(0.0, color=SOFT, lw=0.8, zorder=1)
        if len(self.time_constants):
            ends = np.full(len(self.time_constants), 0.02)
            how = {"color": TEXT, "ms": 9, "mew": 1.6, "transform": only.get_xaxis_transform()}
            only.plot(self.time_constants, ends, "|", **how, label="time constants")
        only.set_xlim(time.iloc[0], time.iloc[-1])
        log_time_axis(only, "time after the step", self.samples)
        label_values(only.yaxis, f"bias after a step of {self.step:g} {unit_text(self.temperature_unit)}", self.unit)
        legend_above(only)


def _times(fitted: Any) -> np.ndarray:
    """Times after the step, around all time constants [s]."""
    memories = np.array([e.memory() for e in fitted.features_.effect_list() if follows_temperature(e)])
    taus = np.concatenate((fitted.time_constants_, memories[memories > 0]))
    if not len(taus):
        step = fitted.features_.history_.usual_step
        return np.asarray(np.geomspace(step, 1000 * step, POINTS))
    return np.asarray(np.geomspace(taus.min() / 10, 8 * taus.max(), POINTS))


def _columns(fitted: Any, effects: list[Effect], times: np.ndarray, step: float) -> np.ndarray:
    """Columns after the step less those before, (n, p).

    The effects' own columns, on a record of the step: eqs. (3) (19) (25) stand where they stand.
    """
    # The step itself lasts for a millionth of the first time drawn.
    instant = 1e-6 * times[0]
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


@dataclass(eq=False)
class SpectrumDisplay(Display):
    """Coefficient of each lag, and the spectrum mu(tau).

    The spectrum is that of the search for time constants, over its whole pool. Grey is what the record could not have
    seen: coefficients below twice their standard error, were each the only lag and the residuals white.
    """

    alt: ClassVar[str] = "coefficient of each lag over its time constant"
    lags: pd.DataFrame
    spectrum: pd.DataFrame | None
    unit: str
    samples: bool = False

    @classmethod
    def from_estimator(cls, model: Any) -> SpectrumDisplay:
        """Create it from a fitted model, or from a fitted `TimeConstantSearch`.

        A search knows intervals of its time constants, and the spectrum; a model that chose its own time constants
        keeps the spectrum; given time constants have neither.

        Raises
        ------
        ValueError
            For a model without lags.
        """
        fitted = regressor_of(model)
        if not len(fitted.time_constants_):
            raise ValueError("The model has no time constants: a static model has no spectrum.")
        intervals, spectrum = _known(model, fitted)
        table = fitted.coef_table()
        lag = table[table["effect"] == "thermal lag"].iloc[: len(fitted.time_constants_)]
        taus = fitted.time_constants_
        lags = pd.DataFrame(
            {
                "time_constant": taus,
                "low": np.nan,
                "high": np.nan,
                "coefficient": lag["coefficient"].to_numpy(),
                "standard_error": lag["standard_error"].to_numpy(),
            }
        )
        if intervals is not None and np.allclose(intervals["time_constant"], taus, rtol=1e-9):
            lags[["low", "high"]] = intervals[["low", "high"]].to_numpy()
        return cls(lags, spectrum, str(lag["unit"].iloc[0]), without_times(fitted))

    def frame(self) -> pd.DataFrame:
        """The lags, with intervals and standard errors.

        The spectrum is the attribute `spectrum`: time_constant, coefficient, excitation, smallest_coefficient,
        alike_next, see `thermocorr.model.search.spectrum_table`; None for given time constants.
        """
        return self.lags.copy()

    def grid(self) -> dict[str, Any]:
        """Rows and size of the picture."""
        rows = 1 if self.spectrum is None else 2
        return {"rows": rows, "size": (7.0, 2.7 * rows), "sharex": True}

    def draw(self, axes: np.ndarray) -> None:
        """Draw in axes of shape (1 or 2, 1)."""
        top = axes[0, 0]
        taus = self.lags["time_constant"].to_numpy()
        errors = CONFIDENCE_95 * self.lags["standard_error"].to_numpy()
        top.vlines(taus, 0.0, self.lags["coefficient"], color=BLUE, lw=1.0, alpha=0.6)
        values, spans, vague = self.lags["coefficient"].to_numpy(), self._spans(), self._vague()
        for chosen, fill, label in (
            (~vague, BLUE, "lags of the model, 95 % intervals"),
            (vague, GROUND, "time constant not determined by the record"),
        ):
            if chosen.any():
                top.errorbar(
                    taus[chosen], values[chosen], yerr=errors[chosen], xerr=spans[:, chosen], fmt="o", color=BLUE,
                    mfc=fill, ms=6, lw=1.6, capsize=3, label=label,
                )  # fmt: skip
        limits = np.array([taus.min() / 4, taus.max() * 4])
        if self.spectrum is not None:
            self._draw_spectrum(axes[1, 0])
            ends = self.spectrum["time_constant"].iloc[[0, -1]].to_numpy() * (0.8, 1.25)
            limits = np.array([min(limits[0], ends[0]), max(limits[1], ends[1])])
        for ax in axes[:, 0]:
            ax.set_xlim(*limits)
            ax.axhline(0.0, color=SOFT, lw=0.8, zorder=1)
            log_time_axis(ax, "time constant" if ax is axes[-1, 0] else "", self.samples)
            ax.tick_params(labelbottom=ax is axes[-1, 0])
            legend_above(ax)
        label_values(top.yaxis, "coefficient", self.unit)
        if self.spectrum is not None:
            label_values(axes[1, 0].yaxis, "spectrum μ(τ)", self.unit)

    def _vague(self) -> np.ndarray:
        """Time constants that the record leaves open."""
        return np.asarray(self.lags["high"] > UNDETERMINED * self.lags["low"])

    def _spans(self) -> np.ndarray:
        """Distances to the intervals' ends, (2, J)."""
        lags = self.lags
        spans = np.vstack((lags["time_constant"] - lags["low"], lags["high"] - lags["time_constant"]))
        spans[:, self._vague()] = np.nan
        return spans

    def _draw_spectrum(self, ax: Any) -> None:
        assert self.spectrum is not None
        tau, mu = self.spectrum["time_constant"], self.spectrum["coefficient"]
        ax.plot(tau, mu, "o-", color=ORANGE, ms=4, lw=1.4, label="search's spectrum")
        ax.fill_between(tau, 0.0, mu, color=ORANGE, alpha=0.2, lw=0)
        low, high = ax.get_ylim()
        least = self.spectrum["smallest_coefficient"]
        label = "too small to be seen" if least.max() > 0.01 * (high - low) else None
        ax.fill_between(tau, -least, least, color=SOFT, alpha=0.25, lw=0, zorder=1, label=label)
        ax.set_ylim(low, high)


def _known(model: Any, fitted: Any) -> tuple[pd.DataFrame | None, pd.DataFrame | None]:
    """Known intervals, and the spectrum."""
    if hasattr(model, "spectrum_"):
        return model.time_constants_, model.spectrum_
    if fitted.search_ is None or fitted.search_.spectrum is None:
        return None, None
    return None, pd.DataFrame(fitted.search_.spectrum)

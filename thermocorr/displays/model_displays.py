"""Displays of contributions, inner temperatures, step response, spectrum and budget."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Self

import numpy as np
import pandas as pd

from ..effects.expressions import follows_temperature
from ..effects.protocol import Effect
from ..estimators.time_constants.search import CONFIDENCE_95, UNDETERMINED
from ..records import Layout, read_record
from ..records.numbers import quantity_text
from ..records.units import difference_unit
from .axes import (
    BLUE,
    COLOURS,
    GREY,
    ORANGE,
    Display,
    TimeLine,
    Walk,
    axes_grid,
    cells_of,
    draw_cells,
    dress_time,
    label_values,
    legend_above,
    log_time_axis,
    name_runs,
    plain,
    regressor_of,
    without_times,
)


@dataclass(eq=False)
class ContributionsDisplay(Display):
    """Contribution of each effect over time, the largest first, one panel each.

    Attributes
    ----------
    rms : Series
        Root mean square of each effect's contribution about its mean, the largest first, in the unit of the reading.
    """

    cells: pd.DataFrame
    timeline: TimeLine
    rms: pd.Series
    unit: str

    @classmethod
    def from_estimator(cls, model: Any, X: Any) -> ContributionsDisplay:
        """Create it from a fitted model and a record of any length, in one pass and bounded memory.

        Parameters
        ----------
        model : DynamicBiasRegressor
            Fitted; or a search with a ``best_estimator_``.
        X : as for `DynamicBiasRegressor.contributions`
        """
        walk = Walk(model, X)
        labels = walk.labels()
        count = np.zeros(1)
        moments = np.zeros((2, len(labels)))

        def parts() -> Any:
            for part in walk.parts():
                known = part.contributions[np.isfinite(part.contributions).all(axis=1)]
                count[:] += len(known)
                moments[:] += known.sum(axis=0), np.einsum("ij,ij->j", known, known)
                yield part.segment, part.seconds, part.contributions

        cells = cells_of(walk.timeline, labels, walk.n_rows, parts())
        mean, square = moments / np.maximum(count, 1)
        rms = pd.Series(np.sqrt(np.maximum(square - mean**2, 0.0)), index=labels, name="rms")
        return cls(cells, walk.timeline, rms.sort_values(ascending=False, kind="stable"), walk.model.reading_.unit)

    def frame(self) -> pd.DataFrame:
        """The numbers drawn: time, segment, seconds, n, and of each effect its mean, ``_low`` and ``_high``.

        One row per cell of time; every row of the record up to 4000 rows.
        """
        return self.cells.copy()

    def plot(self, ax: Any = None) -> Self:
        """Draw one panel per effect; `ax` may be one Axes, whose place is divided, or one for each effect."""
        # Effects that get a panel; the smallest of more are added together
        labels = self.rms.index[:8]
        axes = axes_grid(ax, len(labels), size=(9.0, 1.0 + 1.5 * len(labels)), sharex=True)[:, 0]
        for axes_, label, colour in zip(axes, labels, (COLOURS * 2)[: len(labels)], strict=True):
            draw_cells(axes_, self.cells, self.timeline, label, colour)
            plain(axes_)
            axes_.margins(x=0.01)
            dress_time(axes_, self.timeline, labels=axes_ is axes[-1])
            label_values(axes_.yaxis, "adds", self.unit)
            axes_.set_title(f"{label}: rms {quantity_text(self.rms[label], self.unit)}", loc="left", fontsize=10)
            axes_.tick_params(labelbottom=axes_ is axes[-1])
        name_runs(axes[0], self.timeline)
        axes[0].figure.align_ylabels(axes)
        return self._drawn(axes, axes[0])


POINTS = 200


@dataclass(eq=False)
class StepResponseDisplay(Display):
    """Bias after a step of temperature from the reference temperature, device at rest, over time.

    The band joins all coefficients' errors with their correlations: neighbouring lags err in opposite directions, and
    their sum is known far better than each of them.
    """

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
            Height, in the unit of the temperature (K for degC). It is a step of the air where the model was told that
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
        """Time after the step [s], response of the bias, and its standard error, in the unit of the reading."""
        return self.response.copy()

    def plot(self, ax: Any = None) -> Self:
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
        return self._drawn(axes, only)


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
    # Length of the step, as a share of the first time drawn
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
    """Coefficient of each lag over its time constant, 95 % intervals of both, and the whole spectrum mu(tau) below.

    The spectrum is that of the search for time constants, over its whole pool. Grey is what the record could not have
    seen: coefficients below twice their standard error, were each the only lag and the residuals white.
    """

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
        """The lags: time_constant [s], its 95 % interval low to high, coefficient and standard_error.

        The spectrum is the attribute `spectrum`: time_constant, coefficient, excitation, smallest_coefficient,
        alike_next, see `thermocorr.estimators.time_constants.search.spectrum_table`; None for given time constants.
        """
        return self.lags.copy()

    def plot(self, ax: Any = None) -> Self:
        """Draw; `ax` may be one Axes, whose place is divided where there is a spectrum, or two."""
        rows = 1 if self.spectrum is None else 2
        axes = axes_grid(ax, rows, size=(7.0, 2.9 * rows), sharex=True)[:, 0]
        top = axes[0]
        taus = self.lags["time_constant"].to_numpy()
        errors = CONFIDENCE_95 * self.lags["standard_error"].to_numpy()
        top.vlines(taus, 0.0, self.lags["coefficient"], color=BLUE, lw=1.0, alpha=0.6)
        values, spans, vague = self.lags["coefficient"].to_numpy(), self._spans(), self._vague()
        for chosen, fill, label in (
            (~vague, BLUE, "lags of the model, 95 % intervals"),
            (vague, "white", "time constant not determined by the record"),
        ):
            if chosen.any():
                top.errorbar(
                    taus[chosen], values[chosen], yerr=errors[chosen], xerr=spans[:, chosen], fmt="o", color=BLUE,
                    mfc=fill, ms=6, lw=1.6, capsize=3, label=label,
                )  # fmt: skip
        limits = np.array([taus.min() / 4, taus.max() * 4])
        if self.spectrum is not None:
            self._draw_spectrum(axes[1])
            ends = self.spectrum["time_constant"].iloc[[0, -1]].to_numpy() * (0.8, 1.25)
            limits = np.array([min(limits[0], ends[0]), max(limits[1], ends[1])])
        for axes_ in axes:
            axes_.set_xlim(*limits)
            axes_.axhline(0.0, color="0.4", lw=0.8, zorder=1)
            plain(axes_)
            log_time_axis(axes_, "time constant", self.samples)
            legend_above(axes_)
        for axes_ in axes[:-1]:
            axes_.set_xlabel("")
            axes_.tick_params(labelbottom=False)
        label_values(top.yaxis, "coefficient", self.unit)
        if self.spectrum is not None:
            label_values(axes[1].yaxis, r"spectrum $\mu(\tau)$", self.unit)
        return self._drawn(axes, top)

    def _vague(self) -> np.ndarray:
        """Time constants that the record does not determine; none where this was not asked."""
        return np.asarray(self.lags["high"] > UNDETERMINED * self.lags["low"])

    def _spans(self) -> np.ndarray:
        """Distances to both ends of the intervals of the time constants, shape (2, J); NaN where none is drawn."""
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
        ax.fill_between(tau, -least, least, color=GREY, alpha=0.25, lw=0, zorder=1, label=label)
        ax.set_ylim(low, high)


def _known(model: Any, fitted: Any) -> tuple[pd.DataFrame | None, pd.DataFrame | None]:
    """Intervals of the time constants and the spectrum, as far as somebody has searched for them."""
    if hasattr(model, "spectrum_"):
        return model.time_constants_, model.spectrum_
    if fitted.search_ is None or fitted.search_.spectrum is None:
        return None, None
    return None, pd.DataFrame(fitted.search_.spectrum)

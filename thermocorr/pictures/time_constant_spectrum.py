"""`SpectrumDisplay`: time constants of a model, and the spectrum that they stand for."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from ..estimators.time_constants.resolution import CONFIDENCE_95, UNDETERMINED
from .axes import BLUE, GREY, ORANGE, axes_grid, label_values, legend_above, log_time_axis, plain
from .walk import regressor_of, without_times


class SpectrumDisplay:
    """Coefficient of each lag over its time constant, 95 % intervals of both, and the whole spectrum mu(tau) below.

    The spectrum is that of the search for time constants, over its whole pool. Grey is what the record could not have
    seen: coefficients below twice their standard error, were each the only lag and the residuals white.

    Attributes
    ----------
    ax_, axes_, figure_ : of matplotlib
        After `plot`.
    """

    def __init__(self, lags: pd.DataFrame, spectrum: pd.DataFrame | None, unit: str, samples: bool = False):
        self.lags = lags
        self.spectrum = spectrum
        self.unit = unit
        self.samples = samples

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
        alike_next, see `thermocorr.estimators.time_constants.resolution.spectrum_table`; None for given time constants.
        """
        return self.lags.copy()

    def plot(self, ax: Any = None) -> SpectrumDisplay:
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
        self.axes_, self.ax_, self.figure_ = axes, top, top.figure
        return self

    def _vague(self) -> np.ndarray:
        """Which time constants the record does not determine; none where nobody has asked."""
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

"""`RefinementDisplay`: the error falls, step by step."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from .axes import BLUE, GREEN, GREY, VERMILION, axes_grid, label_log_values, label_values, legend_above, plain
from .protocols import RefinementLike
from .words import each_row, wrapped

WIDE = 5.0
"""Largest over smallest error, above which the axis is logarithmic."""


class RefinementDisplay:
    """Error of the model after each step of `refine`, in sample, held out and on later blocks, down to the noise floor.

    Attributes
    ----------
    ax_, axes_, figure_ : of matplotlib
        After `plot`.
    """

    def __init__(self, steps: pd.DataFrame, noise_floor: float, unit: str, verdict: str):
        self.steps = steps
        self.noise_floor = noise_floor
        self.unit = unit
        self.verdict = verdict

    @classmethod
    def from_refinement(cls, refinement: RefinementLike) -> RefinementDisplay:
        """Create it from what `refine` did."""
        last = refinement.diagnoses[-1]
        return cls(refinement.steps, last.noise_floor, last.unit, last.verdict)

    def frame(self) -> pd.DataFrame:
        """Step, effect, change, rms (in sample), held_out_rms, later_rms, db, verdict, noise_floor."""
        return self.steps.assign(noise_floor=self.noise_floor)

    def plot(self, ax: Any = None) -> RefinementDisplay:
        """Draw in `ax`, or in a new figure."""
        n = len(self.steps)
        axes = axes_grid(ax, size=(max(5.0, 2.2 + 1.6 * n), 4.2))[0]
        only = axes[0]
        x = np.arange(n)
        only.plot(x, self.steps["held_out_rms"], "o-", color=VERMILION, label="held out", zorder=3)
        later = self.steps["later_rms"]
        if later.notna().any():
            only.plot(x, later, "^:", color=GREEN, ms=5, label="later blocks", zorder=3)
        only.plot(x, self.steps["rms"], "s-", color=BLUE, ms=5, label="in sample", zorder=3)
        only.axhline(self.noise_floor, color=GREY, ls="--", lw=1.2, label="noise floor")
        values = np.array([*self.steps["held_out_rms"], *later, *self.steps["rms"], self.noise_floor])
        values = values[np.isfinite(values) & (values > 0)]
        if len(values) and values.max() > WIDE * values.min():
            only.set_yscale("log")
            label_log_values(only.yaxis, "rms error", self.unit)
        else:
            only.set_ylim(0.0, 1.15 * float(values.max(initial=0.0)) or 1.0)
            label_values(only.yaxis, "rms error", self.unit)
        only.set_xticks(x, [wrapped(_name(step), 16) for step in each_row(self.steps)], fontsize=9)
        only.set_xlim(-0.4, n - 0.6)
        for i, step in enumerate(each_row(self.steps)):
            if i:
                above = _free_above(step, only.get_yscale() == "log")
                only.annotate(
                    f"{step.db:+.1f} dB", (i, step.held_out_rms), xytext=(0, 9 if above else -9),
                    textcoords="offset points", ha="center", va="bottom" if above else "top", fontsize=8,
                    color=VERMILION, bbox={"facecolor": "white", "edgecolor": "none", "pad": 1.0}, zorder=5,
                )  # fmt: skip
        plain(only)
        only.grid(False, axis="x")
        legend_above(only)
        self.axes_, self.ax_, self.figure_ = axes, only, only.figure
        return self


def _free_above(step: Any, logarithmic: bool) -> bool:
    """Whether there is more room for a label above the error on held-out blocks than below it."""
    errors = np.array([step.held_out_rms, step.rms, step.later_rms])
    with np.errstate(divide="ignore"):
        places = np.log(errors) if logarithmic else errors
    apart = places[1:] - places[0]
    return bool(apart[apart > 0].min(initial=np.inf) >= -apart[apart <= 0].max(initial=-np.inf))


def _name(step: Any) -> str:
    """A step below its place on the axis."""
    return f"+ {step.effect}" if step.change == "added" else step.effect or "given model"

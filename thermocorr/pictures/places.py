"""`WhereDisplay`: the conditions under which a model fails."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from ..records.units import unit_of
from .axes import axes_grid, labelled
from .protocols import DiagnosisLike
from .words import aspect_text, each_row, ends_text, wrapped

STRIPS = 9
"""Conditions that are drawn."""
HIGHEST = 4.0
"""Lift at which the colours end."""
WIDEST = 24
"""Letters of a condition's name on one line."""
LABELLED = 12
"""In a strip of at most so many tiles, each tile says its share."""


class WhereDisplay:
    """Where a model fails: one strip per condition, its intervals from low to high, the worst condition on top.

    Numbers are shares of the error beyond the noise [%]; colours compare them with the share of the samples: dark is
    where the model fails more than elsewhere.

    Attributes
    ----------
    ax_, axes_, figure_ : of matplotlib
        After `plot`.
    """

    def __init__(self, where: pd.DataFrame, units: dict[str, str] | None = None):
        self.where = where
        self.units = units or {}

    @classmethod
    def from_diagnosis(cls, diagnosis: DiagnosisLike, X: Any = None) -> WhereDisplay:
        """Create it from what `diagnose` found; `X`, the record, tells the units of its columns."""
        units = {} if X is None else {str(name): unit_of(name, X) for name in getattr(X, "columns", ())}
        return cls(diagnosis.where, units)

    def frame(self) -> pd.DataFrame:
        """`Diagnosis.where` with the aspect in words, as `condition`; the worst place first."""
        return self.where.assign(condition=[aspect_text(row) for row in each_row(self.where)])

    def plot(self, ax: Any = None) -> WhereDisplay:
        """Draw in `ax`, or in a new figure."""
        frame = self.frame()
        bands = frame[frame["aspect"] == "frequency"]  # another view of the same error, not a place where it is
        strips = [strip for _, strip in frame.drop(bands.index).groupby(["aspect", "condition"], sort=False)][:STRIPS]
        strips += [bands] if len(bands) else []
        axes = axes_grid(ax, size=(9.0, 1.3 + 0.52 * max(len(strips), 1)))[0]
        only = axes[0]
        self.axes_, self.ax_, self.figure_ = axes, only, only.figure
        if not strips:
            only.text(0.5, 0.5, "No error beyond the noise.", ha="center", va="center", transform=only.transAxes)
            only.set_axis_off()
            return self
        only.set_ylim(len(strips) - 0.5, -0.5)
        only.set_xlim(0, 1)
        for row, strip in enumerate(strips):
            self._strip(only, row, strip.sort_values("low"))
        names = [wrapped(self._name(strip.iloc[0]), WIDEST) for strip in strips]
        only.set_yticks(range(len(strips)), names, fontsize=8 if any("\n" in name for name in names) else None)
        only.tick_params(left=False, bottom=False, labelbottom=False)
        only.spines[:].set_visible(False)
        only.set_title(
            "Where the model fails: share of the error beyond the noise [%], intervals low to high",
            loc="left",
            fontsize=10,
        )
        self._colour_bar(only)
        return self

    def _strip(self, ax: Any, row: int, strip: pd.DataFrame) -> None:
        from matplotlib import colormaps

        width = 1.0 / len(strip)
        worst = int(np.argmax(strip["share"] - strip["n"] / strip["n"].sum()))
        if strip["aspect"].iloc[0] == "frequency":
            worst = int(np.argmax(strip["share"]))
        for i, tile in enumerate(each_row(strip)):
            strength = float(np.clip(tile.lift / HIGHEST, 0.0, 1.0))
            colour = colormaps["YlOrBr"](0.05 + 0.85 * strength)
            ax.add_patch(_tile(i * width, row - 0.28, width, 0.42, colour))
            if len(strip) <= LABELLED or i == worst:
                ax.text(
                    (i + 0.5) * width,
                    row - 0.07,
                    f"{100 * tile.share:.0f}",
                    ha="center",
                    va="center",
                    fontsize=8,
                    fontweight="bold" if i == worst else "normal",
                    color="white" if strength > 0.6 else "0.15",
                )
        span = float(strip["high"].max() - strip["low"].min())
        words = [ends_text(row, span) for row in each_row(strip)]
        for side, x, text in (("left", 0.0, words[0][0]), ("right", 1.0, words[-1][1])):
            ax.text(x, row + 0.17, text, ha=side, va="top", fontsize=7, color="0.35")
        place = float(np.clip((worst + 0.5) * width, 0.3, 0.7))
        low, high = words[worst]
        text = f"worst: {low}" if low == high else f"worst: {low} to {high}"
        ax.text(place, row + 0.17, text, ha="center", va="top", fontsize=7, color="0.15")

    def _name(self, place: Any) -> str:
        """An aspect with its unit."""
        if place.aspect == "frequency":
            return "period"
        if place.aspect in ("column", "temperature"):
            return labelled(place.condition, self.units.get(place.condition, ""))
        return str(place.condition)

    def _colour_bar(self, ax: Any) -> None:
        from matplotlib import colormaps
        from matplotlib.cm import ScalarMappable
        from matplotlib.colors import ListedColormap, Normalize

        colours = ListedColormap(colormaps["YlOrBr"](np.linspace(0.05, 0.9, 256)))
        bar = ax.figure.colorbar(
            ScalarMappable(Normalize(0, HIGHEST), colours), ax=ax, pad=0.02, aspect=25, extend="max"
        )
        bar.set_label("error share / sample share", fontsize=8)
        bar.set_ticks([0, 1, 2, 3, 4])


def _tile(x: float, y: float, width: float, height: float, colour: Any) -> Any:
    from matplotlib.patches import Rectangle

    return Rectangle((x, y), width, height, facecolor=colour, edgecolor="white", lw=1.0)

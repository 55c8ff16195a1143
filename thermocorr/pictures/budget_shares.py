"""`BudgetDisplay`: what an uncertainty consists of."""

from __future__ import annotations

from typing import Any

import pandas as pd

from ..estimators import Budget
from ..records.numbers import scale_of
from .axes import BLUE, axes_grid, label_values, plain
from .words import each_row

PALE = "#B8C4CE"
SMALLEST = 0.0005
"""Share below which a quantity gets no bar: it would print as 0.0 %."""


class BudgetDisplay:
    """Horizontal bars: each quantity's share of the variance, declared ones (type B) paler.

    Attributes
    ----------
    ax_, axes_, figure_ : of matplotlib
        After `plot`.
    """

    def __init__(self, budget: Budget):
        self.budget = budget

    @classmethod
    def from_budget(cls, budget: Budget) -> BudgetDisplay:
        """Create it from what `Uncertainty.budget` or `Uncertainty.mean` gives."""
        return cls(budget)

    def frame(self) -> pd.DataFrame:
        """The budget's table, the largest share first."""
        return self.budget.frame().sort_values("share", ascending=False, ignore_index=True)

    def plot(self, ax: Any = None) -> BudgetDisplay:
        """Draw in `ax`, or in a new figure."""
        frame = self.frame()
        shown = frame[frame["share"] >= SMALLEST]
        axes = axes_grid(ax, size=(8.0, 1.5 + 0.42 * max(len(shown), 1)))[0]
        only = axes[0]
        self.axes_, self.ax_, self.figure_ = axes, only, only.figure
        only.set_title(self.budget.result(), loc="left", fontsize=10)
        percent = 100 * shown["share"]
        colors = [BLUE if kind == "A" else PALE for kind in shown["type"]]
        only.barh(range(len(shown)), percent, color=colors, height=0.62)
        scale = scale_of(shown["contribution"], self.budget.unit)
        for row, line in enumerate(each_row(shown)):
            text = f"{100 * line.share:.1f} %, {scale.text(line.contribution, 2)}"
            only.text(100 * line.share + 1.0, row, text, va="center", fontsize=8)
        only.set_yticks(range(len(shown)), [f"{line.quantity} ({line.type})" for line in each_row(shown)])
        only.invert_yaxis()
        only.set_xlim(0, 125)
        only.set_xticks(range(0, 101, 20))
        plain(only)
        only.grid(False, axis="y")
        label_values(only.xaxis, "share of the variance; blue: from the data (A), pale: declared (B)", "%")
        return self

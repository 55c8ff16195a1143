"""`SuspectsDisplay`: the effects under suspicion, ranked."""

from __future__ import annotations

import textwrap
from typing import Any

import pandas as pd

from .axes import BLUE, axes_grid, plain
from .protocols import DiagnosisLike
from .words import each_row, probability_text, wrapped

SHOWN = 8
LONGEST_TEXT = 58
"""Letters beside a bar; `frame` has everything."""
LEAST_REACH = 0.5
"""Shortest length of the axis of gains [dB], so that small gains look small."""
WIDEST = 38
"""Letters of a suspect's name on one line."""
PALE = "#B8C4CE"
COLUMNS = ["label", "kind", "column", "standing", "gain_db", "later_db", "p_value", "share", "confusable_with"]


class SuspectsDisplay:
    """Suspects ranked: gain on data not learned from, how sure that is, and what each cannot be told apart from.

    Attributes
    ----------
    ax_, axes_, figure_ : of matplotlib
        After `plot`.
    """

    def __init__(self, ranking: pd.DataFrame, verdict: str, named: bool = False, level: float = 0.001):
        self.ranking = ranking
        self.verdict = verdict
        self.named = named
        self.level = level

    @classmethod
    def from_diagnosis(cls, diagnosis: DiagnosisLike) -> SuspectsDisplay:
        """Create it from what `diagnose` found."""
        return cls(diagnosis.ranking, diagnosis.verdict, diagnosis.best is not None, diagnosis.level)

    def frame(self) -> pd.DataFrame:
        """Label, kind, column, standing, gain_db, later_db, p_value, share and confusable_with, the best first."""
        return self.ranking.reindex(columns=COLUMNS)

    def plot(self, ax: Any = None) -> SuspectsDisplay:
        """Draw in `ax`, or in a new figure."""
        frame = self.frame().head(SHOWN)
        axes = axes_grid(ax, size=(9.0, 1.3 + 0.42 * max(len(frame), 1)))[0]
        only = axes[0]
        self.axes_, self.ax_, self.figure_ = axes, only, only.figure
        title = f"Verdict: {self.verdict}" + (f" - {frame['label'].iloc[0]}" if self.named and len(frame) else "")
        only.set_title(wrapped(title, 80), loc="left", fontsize=10)
        if not len(frame):
            only.text(0.5, 0.5, "No suspects.", ha="center", va="center", transform=only.transAxes)
            only.set_axis_off()
            return self
        certain = frame["standing"].fillna("") != ""
        gains = frame["gain_db"].clip(lower=0.0)
        only.barh(range(len(frame)), gains, color=[BLUE if sure else PALE for sure in certain], height=0.62)
        reach = max(float(gains.max()), LEAST_REACH)
        for row, suspect in enumerate(each_row(frame)):
            text = f"error probability {probability_text(suspect.p_value)}"
            if suspect.standing == "helps":
                text = "helps on later data, cause not proven"
            text += f", explains {suspect.share:.0%}"
            if suspect.gain_db <= 0:
                text += ", no gain"
            if len(suspect.confusable_with):
                others = ", ".join(suspect.confusable_with)
                text += "\n" + textwrap.shorten(f"not to be told from {others}", LONGEST_TEXT, placeholder=" ...")
            only.text(
                float(gains.iloc[row]) + 0.015 * reach, row, text, va="center", fontsize=8, linespacing=1.1,
                color="0.1" if certain.iloc[row] else "0.4",
            )  # fmt: skip
        labels = [wrapped(label, WIDEST) for label in frame["label"]]
        only.set_yticks(range(len(frame)), labels, fontsize=8 if any("\n" in label for label in labels) else None)
        if self.named:
            only.get_yticklabels()[0].set_fontweight("bold")
        only.invert_yaxis()
        only.set_xlim(0, 1.9 * reach)
        plain(only)
        only.grid(False, axis="y")
        only.set_xlabel(
            f"gain on blocks of time not learned from [dB]\nblue: named (proven at p <= {self.level:g}, or helpful)"
        )
        return self

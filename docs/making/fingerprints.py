"""Picture of what an effect does to a reading, over time and over the temperature."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from thermocorr import DynamicBiasRegressor

WINDOW = 10
"""Samples in an average: noise hides less, nothing that an effect does is that fast but a rate."""


def draw(
    record: pd.DataFrame, contribution: pd.Series, model: DynamicBiasRegressor, better: DynamicBiasRegressor, path: Path
) -> None:
    """Draw contribution and residuals over time, and the contribution over the temperature, into `path`."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    X, y = record.drop(columns="reading"), record["reading"]
    days = _thin((record.index - record.index[0]).total_seconds().to_numpy() / 86_400)
    added = contribution.to_numpy() - contribution.mean()
    figure = plt.figure(figsize=(9, 5), layout="constrained")
    grid = figure.add_gridspec(3, 2, width_ratios=(2.2, 1), height_ratios=(0.8, 1, 1))
    room, top, rest = (figure.add_subplot(grid[i, 0]) for i in range(3))
    over = figure.add_subplot(grid[:, 1])
    room.plot(days, _thin(X["temperature"].to_numpy()), color="tab:red", lw=0.9)
    room.set_ylabel("room [degC]")
    top.plot(days, _thin(added), color="black", lw=1.1)
    top.set_ylabel("it adds [ppm]")
    for fitted, label, colour in ((model, "without it", "tab:orange"), (better, "with it", "tab:blue")):
        rest.plot(days, _thin(fitted.residuals(X, y).to_numpy()), lw=0.8, color=colour, label=label)
    rest.set_ylabel("residual [ppm]")
    rest.set_xlabel("time [days]")
    rest.legend(loc="upper left", ncols=2, frameon=False, fontsize="small")
    low, high = rest.get_ylim()
    rest.set_ylim(low, high + 0.3 * (high - low))
    for axes in (room, top):
        axes.sharex(rest)
        axes.tick_params(labelbottom=False)
    over.scatter(_thin(X["temperature"].to_numpy()), _thin(added), c=days, s=5, cmap="viridis")
    over.set_xlabel("room [degC]")
    over.set_ylabel("it adds [ppm]")
    for axes in (room, top, rest, over):
        axes.spines[["top", "right"]].set_visible(False)
    figure.savefig(path, dpi=90)
    plt.close(figure)


def _thin(values: np.ndarray) -> np.ndarray:
    """Means of consecutive stretches."""
    whole = len(values) // WINDOW * WINDOW
    return np.asarray(values[:whole]).reshape(-1, WINDOW).mean(axis=1)

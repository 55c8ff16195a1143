"""Make the README's picture: the error of the built-in voltage reference before and after its corrections.

pip install . matplotlib && python docs/making/readme_picture.py docs/voltage_reference.png
"""

import sys

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt

from thermocorr import DynamicBiasRegressor
from thermocorr.datasets import load_voltage_reference
from thermocorr.equations import moving_average
from thermocorr.output.axes import legend_above
from thermocorr.output.style import BLUE, ORANGE, PURPLE, STYLE, VERMILION


def main(path: str) -> None:
    """Draw three days of the record into `path`."""
    record = load_voltage_reference()
    X, y = record.drop(columns="voltage"), record["voltage"]
    static = DynamicBiasRegressor(time_constants=(), degree=2).fit(X, y)
    dynamic = DynamicBiasRegressor(time_constants=6, degree=2).fit(X, y)
    days = (record.index - record.index[0]).total_seconds().to_numpy() / 86400
    shown = (days >= 7) & (days < 10)
    left = {
        "before correction": ((y - y.mean()).to_numpy(), PURPLE),
        "after the static correction": (static.residuals(X, y).to_numpy(), ORANGE),
        "after the dynamic correction": (dynamic.residuals(X, y).to_numpy(), BLUE),
    }
    plt.rcParams.update(STYLE)
    figure, axes = plt.subplots(3, 1, sharex=True, figsize=(8, 5.2), layout="constrained", height_ratios=(1, 1.6, 1.6))
    axes[0].plot(days[shown], X["temperature"][shown], color=VERMILION, lw=0.9)
    axes[0].set_ylabel("room [°C]")
    for label, (error, colour) in left.items():
        smooth = 1e6 * moving_average(error, 25)[shown]
        axes[1].plot(days[shown], smooth, lw=1.0, color=colour, label=label)
        if label != "before correction":
            axes[2].plot(days[shown], smooth, lw=0.9, color=colour)
    axes[1].set_ylabel("error [nV]")
    axes[2].set_ylabel("the same, closer [nV]")
    axes[2].set_xlabel("time [days]")
    legend_above(axes[1])
    figure.align_ylabels(axes)
    figure.savefig(path, dpi=110)


if __name__ == "__main__":
    main(sys.argv[1])

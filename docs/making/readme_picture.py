"""Make the README's picture: what static and dynamic corrections leave of the built-in voltage reference.

pip install . matplotlib && python docs/making/readme_picture.py docs/voltage_reference.png
"""

import sys

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt

from thermocorr import DynamicBiasRegressor
from thermocorr.datasets import load_voltage_reference
from thermocorr.equations import moving_average


def main(path: str) -> None:
    """Draw three days of the record into `path`."""
    record = load_voltage_reference()
    X, y = record.drop(columns="voltage"), record["voltage"]
    static = DynamicBiasRegressor(time_constants=(), degree=2).fit(X, y)
    dynamic = DynamicBiasRegressor(time_constants=6, degree=2).fit(X, y)
    days = (record.index - record.index[0]).total_seconds().to_numpy() / 86400
    shown = (days >= 7) & (days < 10)
    figure, (top, bottom) = plt.subplots(2, 1, sharex=True, figsize=(8, 4.6), layout="constrained")
    top.plot(days[shown], X["temperature"][shown], color="tab:red", lw=0.8)
    top.set_ylabel("room [degC]")
    corrections = ((static, "static correction", "tab:orange"), (dynamic, "dynamic correction", "tab:blue"))
    for model, label, colour in corrections:
        rest = 1e6 * moving_average(model.residuals(X, y).to_numpy(), 25)
        bottom.plot(days[shown], rest[shown], lw=0.8, color=colour, label=label)
    bottom.set_ylabel("error left [nV]")
    bottom.set_xlabel("time [days]")
    bottom.legend(loc="upper right", ncols=2, frameon=False)
    low, high = bottom.get_ylim()
    bottom.set_ylim(low, high + 0.25 * (high - low))
    figure.savefig(path, dpi=110)


if __name__ == "__main__":
    main(sys.argv[1])

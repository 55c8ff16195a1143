"""Axes of pictures: layout, labels with units, ticks."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from threading import RLock
from typing import Any, ClassVar, Self

import numpy as np

from ..records.errors import printable
from ..records.numbers import SUPERSCRIPTS, scale_of, span_text, unit_text
from ..records.units import without_unit
from .style import STYLE, svg_of

TIMES = (1e-3, 1e-2, 0.1, 1, 10, 60, 600, 3600, 21_600, 86_400, 864_000, 8_640_000, 31_557_600, 315_576_000)
FINE_TIMES = (
    1e-3, 2e-3, 5e-3, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 30, 60, 120, 300, 600, 1800, 3600, 7200, 21_600,
    43_200, 86_400, 172_800, 432_000, 864_000, 2_592_000, 8_640_000, 31_557_600,
)  # fmt: skip


DRAWING = RLock()
"""The style of matplotlib is one for all threads."""


class Display:
    """Base of displays; `plot` sets ``ax_``, ``axes_``, ``figure_``."""

    alt: ClassVar[str] = "picture"
    """What a picture shows, for those who do not see it."""
    stacked: ClassVar[bool] = False
    """True if the panels stand one above the other, so that a page needs no engine to lay them out: half the time."""

    def grid(self) -> dict[str, Any]:
        """Rows, columns and size [inch], for `axes_grid`."""
        raise NotImplementedError

    def draw(self, axes: np.ndarray) -> None:
        """Draw in axes of shape (rows, columns)."""
        raise NotImplementedError

    def plot(self, ax: Any = None) -> Self:
        """Draw in a new figure, in one Axes, or in several."""
        with pyplot().rc_context(STYLE):
            axes = axes_grid(ax, **self.grid())
            self.draw(axes)
        self.axes_, self.ax_ = axes, axes[0, 0]
        self.figure_ = self.ax_.figure
        return self

    def to_svg(self, width: float | None = None, height: float | None = None) -> str:
        """The picture as ``<svg>``; `width` and `height` in pixels."""
        pyplot()
        from matplotlib import rc_context
        from matplotlib.figure import Figure

        wide, high = self.grid()["size"]
        size = (wide if width is None else width / 96, high if height is None else height / 96)
        with DRAWING, rc_context(STYLE):
            figure = Figure(figsize=size, layout=None if self.stacked else "constrained")
            self.plot(figure.subplots())
            if self.stacked:
                stack(list(self.axes_[:, 0]), self.grid()["height_ratios"])
            return svg_of(figure, escape(self.alt, quote=True))


def pyplot() -> Any:
    """``matplotlib.pyplot``; an ImportError that names the extra where it is absent."""
    try:
        from matplotlib import pyplot as plt
    except ImportError:
        raise ImportError("Drawing needs matplotlib: pip install matplotlib.") from None
    return plt


def axes_grid(
    ax: Any, rows: int = 1, columns: int = 1, *, size: tuple[float, float], sharex: Any = False, **grid: Any
) -> np.ndarray:
    """Axes to draw in, shape (rows, columns).

    Without `ax` a new figure of `size` [inch]; one Axes lends its place, which is divided; several are taken as given.
    """
    if ax is None:
        _, axes = pyplot().subplots(
            rows, columns, figsize=size, layout="constrained", squeeze=False, sharex=sharex, gridspec_kw=grid or None
        )
        return np.asarray(axes)
    given = np.asarray(ax, dtype=object)
    if given.size == rows * columns:
        return given.reshape(rows, columns)
    if given.size != 1:
        raise ValueError(f"The 'ax' parameter must be one Axes or {rows * columns} of them. Got {given.size}.")
    only = given.item()
    figure, place = only.figure, only.get_subplotspec()
    if place is None:
        raise ValueError("The 'ax' parameter must be an Axes of a grid, such as plt.subplots() makes: it is divided.")
    only.remove()
    parts = place.subgridspec(rows, columns, **grid)
    axes = np.empty((rows, columns), dtype=object)
    for i in range(rows):
        for j in range(columns):
            shared = axes[0, j] if i and sharex in (True, "col") else None
            axes[i, j] = figure.add_subplot(parts[i, j], sharex=shared)
    return axes


def stack(axes: Sequence[Any], shares: Sequence[float]) -> None:
    """Put panels one above the other, legends included."""
    wide, high = axes[0].figure.get_size_inches()
    longest = max(len(label.get_text()) for ax in axes for label in ax.yaxis.get_ticklabels())
    left, right, bottom = 0.4 + 0.07 * longest, 0.12, 0.5  # inch
    above = [0.1 + 0.19 * _legend_rows(ax) for ax in axes]
    room, top = max(high - bottom - sum(above), 0.2), high
    for ax, share, gap in zip(axes, shares, above, strict=True):
        height = room * share / sum(shares)
        top -= gap + height
        ax.set_position((left / wide, top / high, 1 - (left + right) / wide, height / high))


def _legend_rows(ax: Any) -> int:
    legend = ax.get_legend()
    return 0 if legend is None else -(-len(legend.get_texts()) // legend._ncols)


def labelled(name: str, unit: str) -> str:
    """``voltage [mV]``; without a unit the name alone."""
    name = without_unit(name, unit)
    return printable(f"{name} [{unit_text(unit)}]" if unit else name)


def label_values(axis: Any, name: str, unit: str) -> None:
    """Label an axis with a suitable unit, after drawing.

    ``residual [µV]`` for thousandths of a mV; a unit without prefixes gets a power of ten: ``residual [10⁻⁵ ppm]``.
    """
    from matplotlib.ticker import FuncFormatter, LogFormatter, ScalarFormatter

    low, high = axis.get_view_interval()
    largest = max(abs(low), abs(high))
    scale = scale_of([largest], unit)
    if axis.get_scale() == "log":
        decades = LogFormatter(labelOnlyBase=high > 10 * low)
        decades.set_axis(axis)

        def written(value: float, place: int | None = None) -> str:
            return _decade(value * scale.factor) if decades(value, place) else ""

        axis.set_major_formatter(FuncFormatter(written))
        axis.set_minor_formatter(FuncFormatter(written))
        axis.set_label_text(labelled(name, scale.unit))
        return
    power = int(np.floor(np.log10(largest))) if largest > 0 and scale.unit == unit else -round(np.log10(scale.factor))
    if scale.unit == unit and -3 < power < 5:
        power = 0
    formatter = ScalarFormatter(useOffset=bool(high - low < 1e-8 * largest), useMathText=False)
    formatter.set_powerlimits((power, power) if power else (-9, 9))
    axis.set_major_formatter(formatter)
    if power:
        axis.get_offset_text().set_visible(False)
    ten = f"10{str(power).translate(SUPERSCRIPTS)} " if power and scale.unit == unit else ""
    axis.set_label_text(labelled(without_unit(name, unit), f"{ten}{scale.unit}".strip()))


def _decade(value: float) -> str:
    """A decade in print: 0.01 to 1000, or a power of ten."""
    if 0.00999 < value < 9999:
        return f"{value:.3g}"
    power = int(np.floor(np.log10(value) + 1e-9))
    digit = round(value / 10.0**power)
    return f"{'' if digit == 1 else f'{digit}·'}10{str(power).translate(SUPERSCRIPTS)}"


def legend_above(ax: Any, **options: Any) -> None:
    """A legend above the axes, where there is room."""
    if ax.figure.get_figheight() < 2.9:  # inches: too small for a legend inside
        return
    handles, labels = ax.get_legend_handles_labels()
    if labels:
        room = 0.8 * ax.figure.get_figwidth() * ax.get_subplotspec().get_position(ax.figure).width / 0.775
        wide = [0.065 * len(label) + 0.4 for label in labels]  # inch, about
        columns = len(labels) if sum(wide) < room else max(int(room / max(wide)), 1)
        usual = {"ncols": columns, "columnspacing": 1.2, "handlelength": 1.6, "borderaxespad": 0.1}
        ax.legend(handles, labels, loc="lower right", bbox_to_anchor=(1.0, 1.0), **usual | options)


def log_time_axis(ax: Any, label: str, samples: bool = False) -> None:
    """A logarithmic axis of times, after drawing.

    `samples` counts rows, where their times are not known.
    """
    ax.set_xscale("log")
    if samples:
        ax.set_xlabel(f"{label} [samples]")
        return
    from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator

    low, high = ax.get_xlim()
    inside = [t for t in FINE_TIMES if low <= t <= high]
    if len(inside) > 7:
        inside = [t for t in TIMES if low <= t <= high]
    ax.xaxis.set_major_locator(FixedLocator(inside))
    ax.xaxis.set_major_formatter(FuncFormatter(lambda value, position: span_text(value)))
    ax.xaxis.set_minor_locator(NullLocator())
    ax.set_xlabel(label)

"""Charts as data: what the page's script draws with uPlot, and still lines for places without scripts."""

from __future__ import annotations

import base64
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from markupsafe import Markup

from ..pictures.axes import FINE_TIMES, TIMES
from ..records.quantities import SPANS
from ..records.units import without_unit
from .html import rendered, unit_text, units_of_axis

TIME_SPANS = {"units": list(SPANS.items()), "fine": FINE_TIMES, "coarse": TIMES}
"""Units of time spans, and where an axis of them has its ticks [s]."""


@dataclass(frozen=True)
class ChartLine:
    """One line of a panel."""

    label: str
    values: np.ndarray | tuple[str, int, int]
    """Shape (n,), beside the chart's x, NaN where there is none; or chart, panel and line that has the same values."""
    role: str
    """What it shows, which gives it its colour: reading, model, corrected, residual, average, temperature, other."""
    dash: bool = False
    dots: bool = False
    joined: bool = True
    """Whether points are joined by a line."""
    edge: bool = False
    """Edge of the band around the line before it: two follow one another, the lower first."""
    stretches: np.ndarray | None = None
    """Where `values` belong to stretches of x: their first and last points, shape (m, 2)."""


@dataclass(frozen=True)
class Panel:
    """Lines over one axis."""

    label: str
    unit: str
    lines: tuple[ChartLine, ...]
    log: bool = False
    rules: tuple[float, ...] = ()
    """Values of horizontal lines."""
    height: int = 200
    scale_of: int | None = None
    """Panel of the same chart whose vertical scale this one has too."""


@dataclass(frozen=True)
class Chart:
    """Panels over one common x, zoomed together."""

    name: str
    """Identifier in the page: letters only."""
    x_label: str
    x: np.ndarray | str
    """Shape (n,), or the chart that has the same x; never decreasing; seconds since 1970 where `dates`."""
    panels: tuple[Panel, ...]
    caption: str
    """One or two sentences: what is to be seen."""
    x_unit: str = ""
    joints: tuple[tuple[float, float], ...] = ()
    """Where x is no true time: x and true time at which segments begin."""
    dates: bool = False
    x_log: bool = False
    shades: tuple[tuple[float, float], ...] = ()
    """Stretches of x that stand out: from, to."""

    def payload(self) -> dict[str, Any]:
        """What the script reads."""
        return {
            "name": self.name,
            "x": {
                "label": without_unit(self.x_label, self.x_unit),
                "unit": unit_text(self.x_unit),
                "spans": TIME_SPANS if self.x_log and self.x_unit == "s" else None,
                "joints": [list(joint) for joint in self.joints],
                "dates": self.dates,
                "log": self.x_log,
                "data": packed_times(self.x),
            },
            "panels": [
                {
                    "label": without_unit(panel.label, panel.unit),
                    "unit": unit_text(panel.unit),
                    "units": units_of_axis(panel.unit),
                    "log": panel.log,
                    "height": panel.height,
                    "like": panel.scale_of,
                    "rules": [float(value) for value in panel.rules],
                    "lines": [
                        {
                            "label": line.label,
                            "role": line.role,
                            "dash": line.dash,
                            "dots": line.dots,
                            "joined": line.joined,
                            "edge": line.edge,
                            "data": packed(line.values),
                            "stretches": None if line.stretches is None else line.stretches.ravel().tolist(),
                        }
                        for line in panel.lines
                    ],
                }
                for panel in self.panels
            ],
            "shades": [[float(low), float(high)] for low, high in self.shades],
        }

    def html(self) -> Markup:
        """Place and caption of the chart."""
        names = dict.fromkeys(line.label for panel in self.panels for line in panel.lines if not line.edge)
        return rendered("chart", chart=self, names=", ".join(names))


def places(charts: Iterable[Chart]) -> Markup:
    """Places and captions of some charts."""
    return Markup("").join(chart.html() for chart in charts)


def packed(values: np.ndarray | tuple[str, int, int]) -> dict[str, Any]:
    """Single-precision distances from the middle, in base64: exact to 6e-8 of the span."""
    if isinstance(values, tuple):
        return {"same": list(values)}
    numbers = np.asarray(values, float)
    known = numbers[np.isfinite(numbers)]
    middle = float((known.min() + known.max()) / 2) if len(known) else 0.0
    return {"add": middle, "f4": base64.b64encode((numbers - middle).astype("<f4").tobytes()).decode()}


def packed_times(x: np.ndarray | str) -> dict[str, Any]:
    """Even steps as three numbers, others in base64 at full precision."""
    if isinstance(x, str):
        return {"same": x}
    x = np.asarray(x, float)
    if len(x) > 2 and np.ptp(np.diff(x)) <= 1e-9 * max(abs(x[-1] - x[0]), 1e-300):
        return {"start": float(x[0]), "step": float((x[-1] - x[0]) / (len(x) - 1)), "n": len(x)}
    return {"f8": base64.b64encode(x.astype("<f8").tobytes()).decode()}


def still(values: np.ndarray, floor: float) -> Markup:
    """A line without a script: extremes of a few hundred groups of rows, as SVG in the colour of the text.

    Parameters
    ----------
    values : array of shape (n,)
    floor : float
        Dashed lines at plus and minus this.
    """
    width, height = 640, 90
    parts = np.array_split(np.asarray(values, float), min(width // 2, len(values)))
    cells = [part[np.isfinite(part)] for part in parts]
    extremes = [(part.min(), part.max()) if len(part) else (np.nan, np.nan) for part in cells]
    low, high = np.array(extremes).T
    bottom, top = np.nanmin([np.nanmin(low), -floor]), np.nanmax([np.nanmax(high), floor])
    scale = (height - 4) / max(top - bottom, 1e-300)

    def y(value: float) -> float:
        return round(float(2 + (top - value) * scale), 1)

    step = width / len(cells)
    strokes = [
        f"M{(i + 0.5) * step:.1f} {y(a) + 0.5:.1f}V{y(b) - 0.5:.1f}"
        for i, (a, b) in enumerate(zip(low, high, strict=True))
        if np.isfinite(a)
    ]
    drawn = []
    drawn.append(f'<path d="{"".join(strokes)}" stroke="#4d86d8" stroke-width="{max(step * 0.8, 1):.2f}" fill="none"/>')
    middles = [f"{(i + 0.5) * step:.1f} {y(part.mean())}" for i, part in enumerate(cells) if len(part) > 3]
    drawn.append(
        f'<path d="M{"L".join(middles)}" stroke="currentColor" stroke-width="1.5" fill="none"/>' if middles else ""
    )
    edges = "".join(f"M0 {y(edge)}H{width}" for edge in (floor, -floor))
    drawn.append(f'<path d="{edges}" stroke="currentColor" stroke-dasharray="6 4" opacity="0.7" fill="none"/>')
    return Markup(
        f'<svg viewBox="0 0 {width} {height}" width="{width}" height="{height}" role="img" aria-label="residual" '
        f'style="max-width:100%;height:auto;display:block">{"".join(drawn)}</svg>'
    )

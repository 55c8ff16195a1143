"""`compare_variants`: the paper's table for any record."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from html import escape
from typing import Any

import numpy as np
import pandas as pd
from sklearn.base import clone

from ..equations import moving_average, reduction_db
from ..records import Record, read_record
from ..records.errors import check_int, printable, said_once
from ..records.numbers import Scale, as_data, number_text, scale_of
from ..records.screen import error_of
from .advice import Advice, advise
from .averages import rms
from .heteroscedasticity import accepted_readings
from .out_of_sample import residuals_of_blocks, time_blocks
from .progress import Progress, reporting
from .regressor import DynamicBiasRegressor

_TITLES = {
    "std": "std",
    "std_smoothed": "std, smoothed",
    "reduction_db": "reduction [dB]",
    "dynamic_vs_static_db": "dynamic vs static [dB]",
    "held_out_rms": "held-out rms",
    "held_out_std_smoothed": "held-out std, smoothed",
    "held_out_reduction_db": "held-out reduction [dB]",
    "held_out_dynamic_vs_static_db": "held-out dynamic vs static [dB]",
}
_STATIC = {
    "dynamic linear": "static linear",
    "dynamic nonlinear": "static nonlinear",
    "dynamic nonlinear with products": "static nonlinear",
}
"""Dynamic variant -> the static one that it is compared with."""


@dataclass(frozen=True, repr=False, kw_only=True)
class VariantComparison:
    """Figures, models and residuals; prints as the paper's table."""

    table: pd.DataFrame
    models: dict[str, DynamicBiasRegressor]
    """Fitted on the whole record."""
    residuals: pd.DataFrame
    """Residuals of the fitted record, one column per variant."""
    held_out_residuals: pd.DataFrame
    unit: str
    window: int
    """Samples of the moving average."""
    n_blocks: int
    advice: Advice
    """Which of them to use, if any, by their errors on data that they were not learned from."""
    record: Record | None = field(default=None, repr=False)
    """Times, temperatures and readings compared: views of the user's data."""

    @property
    def best_(self) -> DynamicBiasRegressor | None:
        """The advised variant, fitted; None for none."""
        return self.models.get(self.advice.variant)

    @property
    def begun(self) -> str:
        """Name of the variant to look for missing effects in."""
        return self.starts[0]

    @property
    def starts(self) -> tuple[str, ...]:
        """Names of the variants to refine: advised, and richest."""
        return tuple(dict.fromkeys(name for name in (self.advice.variant, list(self.models)[-1]) if name))

    def frame(self) -> pd.DataFrame:
        """The figures: one row per variant."""
        return self.table.copy()

    def scale(self) -> Scale:
        """The unit of the printed figures."""
        return scale_of(self.table[[name for name in _TITLES if not name.endswith("_db")]], self.unit)

    def caption(self, unit: str = "") -> str:
        """Meaning of the columns, in one line."""
        unit = printable(unit or self.scale().unit)
        figures = f" Figures in {unit}." if unit else ""
        return (
            f"Smoothed: moving average of {self.window} samples. Reduction: smoothed std against the reading before "
            f"correction; negative is good. Held out: {self.n_blocks} blocks of time, each predicted by a model fitted "
            f"without it; rms includes each block's offset, std does not.{figures}{self._not_smoothed()}"
        )

    def _not_smoothed(self) -> str:
        """Sentence on smoothed figures that are missing, or ""."""
        whole, held_out = (self.table[name].isna().all() for name in ("std_smoothed", "held_out_std_smoothed"))
        if not held_out:
            return ""
        of = "" if whole else " of the held-out blocks"
        stretch = f"no stretch of {'the record' if whole else 'them'} is longer than half the moving average"
        return f" No smoothed figures{of}: {stretch}."

    def formatted(self) -> pd.DataFrame:
        """The figures as text, four digits or tenths of dB."""
        text, factor = pd.DataFrame(index=self.table.index), self.scale().factor
        for name, title in _TITLES.items():
            said = "{:.1f}".format if name.endswith("_db") else lambda value: number_text(factor * value, 4)
            text[title] = ["" if np.isnan(v) else said(v) for v in self.table[name]]
        return text

    def __str__(self) -> str:
        text = self.formatted()
        two = [text.iloc[:, :4], text.iloc[:, 4:]]
        return "\n\n".join([*(part.to_string() for part in two), self.caption()])

    def __repr__(self) -> str:
        return str(self)

    def to_html(self) -> str:
        """The table as HTML, caption included."""
        table = self.formatted().to_html(border=0, classes="thermocorr-variants")
        return f"{table}\n<p>{escape(self.caption())}</p>"

    def _repr_html_(self) -> str:
        return self.to_html()


@said_once()
def compare_variants(
    X: Any,
    y: Any,
    *,
    model: DynamicBiasRegressor | None = None,
    temperature: Any = None,
    time_constants: Any = "auto",
    degree: int | None = None,
    products: bool | int | None = None,
    window: int = 25,
    n_blocks: int = 5,
    progress: Progress = None,
    **options: Any,
) -> VariantComparison:
    """Compare static and dynamic, linear and nonlinear corrections.

    Parameters
    ----------
    X, y : as for `DynamicBiasRegressor.fit`
    model : DynamicBiasRegressor, optional
        Fitted or not: where the options of all variants come from; or give them here by name:
    temperature, time_constants, **options : see `DynamicBiasRegressor`
        By default the number of time constants is chosen too; the paper has six.
    degree : int, optional
        Degree of the nonlinear static law; 1 leaves it linear. None is that of the model, 2 where it is linear.
    products : {False, True, 2, 3}, optional
        Add a fifth variant with the products of eq. (21), see `DynamicBiasRegressor`. None is what the model says.
    window : int, default 25
        Samples of the moving average, eqs. (9) (26).
    n_blocks : int, default 5
        Blocks of time, 2 or more, for the held-out figures. Each is predicted by a model whose coefficients and time
        constants were found without it. Where they are no longer than half the window, smoothed figures of them say
        nothing and are NaN.
    progress : callable or True, optional
        Called with a line of text before each fit; True draws a bar (extra "progress").

    Returns
    -------
    VariantComparison
        ``print`` it, or take ``best_``, ``advice``, ``frame()``, ``to_html()``, ``models``, ``residuals``.

    Raises
    ------
    TypeError
        For options of a model besides `model`.
    ValueError
        For a degree or a window below 1, or fewer than 2 blocks.

    Examples
    --------
    >>> from thermocorr import compare_variants
    >>> from thermocorr.datasets import make_record
    >>> record = make_record(4000, seed=1)
    >>> comparison = compare_variants(record[["temperature"]], record["reading"], time_constants=["5 min", "90 min"])
    >>> figures = comparison.frame()["held_out_reduction_db"]
    >>> bool(figures["dynamic linear"] < figures["static linear"] - 10)
    True
    """
    own = {"temperature": temperature} if temperature is not None else {}
    own |= {} if isinstance(time_constants, str) and time_constants == "auto" else {"time_constants": time_constants}
    own |= options
    if model is not None and own:
        raise TypeError(f"compare_variants() takes options of a model or a model=, not both. Got {', '.join(own)} too.")
    dynamic = DynamicBiasRegressor(**own) if model is None else clone(model)
    degree = check_int("compare_variants", "degree", max(dynamic.degree, 2) if degree is None else degree, 1)
    products = dynamic.products if products is None else products
    window = check_int("compare_variants", "window", window, 1)
    n_blocks = check_int("compare_variants", "n_blocks", n_blocks, 2)
    variants = variants_of(dynamic, degree)
    if products:
        variants["dynamic nonlinear with products"] = clone(dynamic).set_params(degree=degree, products=products)
    reading = accepted_readings(dynamic, X, y)
    blocks = time_blocks(reading, n_blocks)
    inside: dict[str, np.ndarray] = {}
    outside: dict[str, np.ndarray] = {}
    fitted: dict[str, DynamicBiasRegressor] = {}
    with reporting(progress, len(variants) * (1 + len(blocks)) + 1) as tell:
        for name, variant in variants.items():
            tell(f"{name}: fitting")
            fitted[name] = clone(variant).fit(X, y)
            inside[name] = np.asarray(fitted[name].residuals(X, y))
            outside[name] = residuals_of_blocks(variant, X, reading, n_blocks, partial(_tell, tell, name))
        tell("which of them to use")
        advice = advise(fitted, X, y)
    record = read_record(X, fitted["static linear"].features_.layout(), y=y, quiet=True)
    smooth = _Smoothing(record, blocks, window)
    raw = np.asarray(error_of(reading, as_data(X), dynamic.reference), float)
    raw = raw - np.nanmean(raw)
    before = float(np.nanstd(raw))
    rows = {"before correction": {"std": before, "std_smoothed": _std(smooth.whole(raw))}}
    for name in variants:
        rows[name] = _figures(name, inside, outside, before, smooth)
    index = X.index if isinstance(X, pd.DataFrame) else None
    return VariantComparison(
        table=pd.DataFrame.from_dict(rows, orient="index", columns=list(_TITLES)).rename_axis("variant"),
        models=fitted,
        residuals=pd.DataFrame(inside, index=index),
        held_out_residuals=pd.DataFrame(outside, index=index),
        unit=fitted["static linear"].reading_.unit,
        window=window,
        n_blocks=len(blocks),
        advice=advice,
        record=record,
    )


def variants_of(model: DynamicBiasRegressor, degree: int) -> dict[str, DynamicBiasRegressor]:
    """Unfitted static and dynamic variants of a model."""
    return {
        "static linear": clone(model).set_params(time_constants=(), degree=1, products=False),
        "static nonlinear": clone(model).set_params(time_constants=(), degree=degree, products=False),
        "dynamic linear": clone(model).set_params(degree=1, products=False),
        "dynamic nonlinear": clone(model).set_params(degree=degree, products=False),
    }


def _tell(say: Callable[[str], None], name: str, text: str) -> None:
    """Report progress on a variant."""
    say(f"{name}: {text}")


class _Smoothing:
    """Moving averages, eqs. (9) (26), within runs and blocks.

    NaN where no piece is longer than half the window: their averages are all the same.
    """

    def __init__(self, record: Record, blocks: list[slice], window: int):
        self.window = window
        self.segments = [
            np.arange(record.n_rows)[record.rows(segment.start, segment.stop)] for segment in record.segments
        ]
        number = np.full(record.n_rows, -1)
        for i, rows in enumerate(self.segments):
            number[rows] = i
        self.blocks = [
            [block.start + np.flatnonzero(number[block] == i) for i in np.unique(number[block])] for block in blocks
        ]

    def whole(self, values: np.ndarray) -> np.ndarray:
        """Smoothed inside each segment, in time order."""
        return self._smoothed(values, self.segments)

    def by_block(self, values: np.ndarray) -> list[np.ndarray]:
        """Smoothed inside each held-out block."""
        return [self._smoothed(values, pieces) for pieces in self.blocks]

    def _smoothed(self, values: np.ndarray, pieces: list[np.ndarray]) -> np.ndarray:
        if all(len(rows) <= (self.window + 1) // 2 for rows in pieces):  # every average is that of its whole piece
            return np.full(sum(map(len, pieces)), np.nan)
        return np.concatenate([moving_average(values[rows], self.window) for rows in pieces])


def _figures(
    name: str, inside: dict[str, np.ndarray], outside: dict[str, np.ndarray], before: float, smooth: _Smoothing
) -> dict[str, float]:
    std, held = _std(smooth.whole(inside[name])), _within(smooth.by_block(outside[name]))
    figures = {
        "std": _std(inside[name]),
        "std_smoothed": std,
        "reduction_db": reduction_db(std, before),
        "held_out_rms": rms(outside[name]),
        "held_out_std_smoothed": held,
        "held_out_reduction_db": reduction_db(held, before),
    }
    static = _STATIC.get(name)
    if static is not None:
        figures["dynamic_vs_static_db"] = reduction_db(std, _std(smooth.whole(inside[static])))
        figures["held_out_dynamic_vs_static_db"] = reduction_db(held, _within(smooth.by_block(outside[static])))
    return figures


def _within(blocks: list[np.ndarray]) -> float:
    """Standard deviation about each block's own mean."""
    centred = [block - np.nanmean(block) for block in blocks if np.isfinite(block).any()]
    return rms(np.concatenate(centred)) if centred else np.nan


def _std(values: np.ndarray) -> float:
    return float(np.nanstd(values)) if np.isfinite(values).any() else np.nan

"""Pieces of curves as the page asks for them: checked, and packed as its charts read them."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from ...pages.charts import packed, packed_times
from ..tiles import MOST_PIECES, PIECES, Tiles

MOST_CURVES = 64
MEAN = "mean "
"""Beginning of the name of an averaged curve."""


class NoSuchCurve(LookupError):
    """A curve of an arrangement that is not known any more."""


def piece_of(tiles: Tiles, curves: dict[str, str], asked: Mapping[str, str]) -> dict[str, Any]:
    """Some curves between two places on the axis.

    `tiles` (Tiles). `curves` (dict of str to str): Their names in the store. `asked` (mapping of str to str): curves
    (JSON: a list of names; "mean residual" is the residual averaged over stretches), low and high (on the axis, whose
    ``zero`` and ``scale`` are given too), n (pixels). Raises NoSuchCurve for a curve that is not there. Raises
    ValueError for limits that are no numbers.
    """
    scale, zero = _number(asked, "scale", 1.0) or 1.0, _number(asked, "zero", 0.0)
    low, high = _number(asked, "low", -math.inf), _number(asked, "high", math.inf)
    names = _names(asked.get("curves", "[]"))
    averaged = [name for name in names if name.startswith(MEAN)]
    names = [name for name in names if name not in averaged]
    piece = tiles.piece(
        curves["place"],
        curves["begins"],
        [_curve(curves, name) for name in names],
        low * scale - zero,
        high * scale - zero,
        int(min(max(_number(asked, "n", PIECES), 1), MOST_PIECES)),
        [_curve(curves, name.removeprefix(MEAN)) for name in averaged],
    )
    means = list(piece.means.values()) or [np.full(len(piece.place), np.nan)] * len(averaged)
    return {
        "x": packed_times((piece.place + zero) / scale),
        "curves": {
            name: packed(values) for name, values in zip([*names, *averaged], [*piece.curves, *means], strict=True)
        },
        "averaged": piece.mean_rows if piece.means else 0,
        "rows": piece.rows,
        "per_point": piece.rows_per_point,
    }


def cloud_of(tiles: Tiles, curves: dict[str, str], asked: Mapping[str, str]) -> dict[str, Any]:
    """One curve over another: ``across``, ``up``."""
    found = tiles.cloud(_curve(curves, asked.get("across", "")), _curve(curves, asked.get("up", "residual")))
    return {name: packed(values) for name, values in found.items()}


def _curve(curves: dict[str, str], name: str) -> str:
    # What stands with the curves and is no curve
    if name not in curves or name in ("begins", "row"):
        raise NoSuchCurve(name)
    return curves[name]


def _names(text: str) -> list[str]:
    try:
        names = json.loads(text)
    except (ValueError, RecursionError):
        names = None
    if not isinstance(names, list) or len(names) > MOST_CURVES or not all(isinstance(name, str) for name in names):
        raise ValueError(f"curves is no list of at most {MOST_CURVES} names.")
    return list(dict.fromkeys(names))


def _number(asked: Mapping[str, str], name: str, usual: float) -> float:
    try:
        value = float(asked.get(name, usual))
    except ValueError:
        value = math.nan
    if math.isnan(value):
        raise ValueError(f"{name} is no number.")
    return value


def known_json(node: Any) -> Any:
    """JSON without NaN and infinities, which it does not have."""
    if isinstance(node, float):
        return node if math.isfinite(node) else None
    if isinstance(node, dict):
        return {key: known_json(value) for key, value in node.items()}
    return [known_json(value) for value in node] if isinstance(node, list | tuple) else node

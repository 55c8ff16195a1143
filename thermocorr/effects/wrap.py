"""Any scikit-learn transformer as an effect."""

from __future__ import annotations

from typing import Any, Self

import numpy as np
import pandas as pd
from sklearn.base import clone
from sklearn.utils.metaestimators import _BaseComposition

from ..records import Block, Record
from .protocol import Effect, ParametersOnce


class TransformerEffect(Effect):
    """A row-by-row scikit-learn transformer as an effect.

    Parameters
    ----------
    transformer : transformer
        Cloned, fitted on about `fit_rows` rows spread evenly over the record, applied block by block.
    column_names : list of columns
        What it reads; None stands for the temperature.
    fit_rows : int
        Rows given to its `fit`, about.

    Examples
    --------
    >>> from sklearn.preprocessing import SplineTransformer
    >>> from thermocorr import DynamicBiasRegressor
    >>> from thermocorr.datasets import make_record
    >>> from thermocorr.effects import TransformerEffect
    >>> record = make_record(2000, seed=1)
    >>> effect = TransformerEffect(SplineTransformer(n_knots=4), ["humidity"])
    >>> model = DynamicBiasRegressor("temperature", ["90 min"], effects=[effect])
    >>> model.fit(record.drop(columns="reading"), record["reading"]).coef_table().index[-1]
    'splinetransformer[humidity_sp_5]'
    """

    kind = "transformer"

    def __init__(self, transformer: Any = None, column_names: Any = None, fit_rows: int = 100_000):
        self.transformer = transformer
        self.column_names = column_names
        self.fit_rows = fit_rows

    def inputs(self) -> list[Any]:
        """The columns that the transformer reads."""
        return list(self.column_names or [])

    def learn(self, record: Record) -> None:
        """Fit the transformer."""
        self.inputs_ = self.inputs() or [record.temperature_name]
        self.fitted_ = clone(self.transformer)
        stride = max(1, record.n_used // self.fit_rows)
        parts = [self._frame(block).iloc[::stride] for block in record.blocks()]
        columns = self.fitted_.fit_transform(pd.concat(parts))
        self.n_columns_ = np.shape(columns)[1]

    def _frame(self, block: Block) -> pd.DataFrame:
        return pd.DataFrame({str(name): block[name] for name in self.inputs_})

    def names(self) -> list[str]:
        """The transformer's own names where it has them."""
        prefix = type(self.transformer).__name__.lower()
        if hasattr(self.fitted_, "get_feature_names_out"):
            return [f"{prefix}[{name}]" for name in self.fitted_.get_feature_names_out()]
        return [f"{prefix}[{i}]" for i in range(self.n_columns_)]

    def columns(self, block: Block, state: Any) -> tuple[np.ndarray, Any]:
        """Output of the transformer for the block's rows."""
        result = self.fitted_.transform(self._frame(block))
        if hasattr(result, "toarray"):
            result = result.toarray()
        return np.asarray(result, float), state

    def label(self) -> str:
        """The transformer's class, and what it reads."""
        return type(self.transformer).__name__ + "".join(f": {name}" for name in self.inputs())


def as_effects(given: Any, parameter: str = "effects") -> list[tuple[str, Effect]]:
    """Named effects from effects, transformers or pairs.

    Raises ValueError for anything else, and for a name that stands twice.
    """
    if isinstance(given, Effect) or hasattr(given, "transform"):
        given = [given]
    named: list[tuple[str, Effect]] = []
    for item in given:
        name, effect = item if isinstance(item, tuple) and len(item) == 2 else (None, item)
        if not isinstance(effect, Effect):
            if not (hasattr(effect, "fit") and hasattr(effect, "transform")) or isinstance(effect, type):
                raise ValueError(
                    f"The {parameter!r} parameter must hold effects, scikit-learn transformers, or (name, effect) "
                    f"pairs; a recorded column is one as Covariate(column). Got {effect!r} instead."
                )
            effect = TransformerEffect(effect)
        if name is None:
            name = effect.kind if not effect.inputs() else f"{effect.kind}_{'_'.join(map(str, effect.inputs()))}"
            taken = [other for other, _ in named]
            name = name if name not in taken else f"{name}_{len(taken)}"
        named.append((str(name), effect))
    names = [name for name, _ in named]
    for name in names:
        if names.count(name) > 1:
            raise ValueError(f"The {parameter!r} parameter has two effects called {name!r}. Give them different names.")
    return named


class EffectsParameters(_BaseComposition, ParametersOnce):
    """`get_params` / `set_params` that reach into named effects: ``effects__humidity__time_constants``-style search.

    Parts are addressed by name: ``model.set_params(humidity__time_constants=[3600])``.
    """

    effects: Any

    def get_params(self, deep: bool = True) -> dict[str, Any]:
        """Parameters, with those of (name, effect) pairs as ``name__parameter``."""
        if not (deep and self._named()):
            return dict(super(_BaseComposition, self).get_params(deep=deep))
        return dict(self._get_params("effects", deep=deep))

    def set_params(self, **params: Any) -> EffectsParameters:
        """Set parameters, those of (name, effect) pairs as ``name__parameter``."""
        if self._named():
            self._set_params("effects", **params)
        else:
            super(_BaseComposition, self).set_params(**params)
        return self

    def with_effect(self, effect: Effect) -> Self:
        """An unfitted copy of this model with one more effect."""
        model: Self = clone(self)
        given = model.effects if isinstance(model.effects, list | tuple) else [model.effects]
        model.set_params(effects=[*given, effect])
        return model

    def without_effect(self, name: str) -> Self:
        """An unfitted copy of this model without one effect."""
        model: Self = clone(self)
        given = as_effects(model.effects)
        if name not in [own for own, _ in given]:
            raise ValueError(f"The model has no effect called {name!r}. There are {[own for own, _ in given]}.")
        model.set_params(effects=[pair for pair in given if pair[0] != name])
        return model

    def _named(self) -> bool:
        given = self.effects
        return isinstance(given, list) and bool(given) and all(isinstance(i, tuple) and len(i) == 2 for i in given)

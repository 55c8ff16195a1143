"""`workbench(model, X, y)`: the same screen in a notebook, on data in memory."""

from __future__ import annotations

import tempfile
import weakref
from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd
from sklearn.base import clone

from ...effects.protocol import Effect
from ...effects.wrap import as_effects
from ...estimators import DynamicBiasRegressor
from ...estimators.thermometers import Thermometers
from ...judgement import diagnose
from ...records.numbers import as_pandas
from ..acts import Add, AddedEffect, Columns, ModelSettings, Past, Roles
from ..bench import Bench
from ..source import ReadLog
from ..tiles import Store
from . import page_assets
from .desk import Desk


def workbench(model: DynamicBiasRegressor, X: Any, y: Any, *, suspects: Sequence[type[Effect]] = ()) -> Any:
    """Compare a model with its record, see what is missing, add it and watch the error fall, in a notebook.

    Parameters
    ----------
    model : DynamicBiasRegressor
        Fitted or not; it stays as it is. `BenchWidget.model` is the model as it stands on the screen.
    X : DataFrame
    y : array-like of shape (n_rows,)
    suspects : sequence of classes of effects
        Suspects of your own.

    Returns
    -------
    BenchWidget
        Shown by the notebook. Without the package anywidget (extra "jupyter"): the `Diagnosis`, whose short form the
        notebook shows instead; its `save_html` writes the page.

    Raises
    ------
    RecordError
        For a record that cannot be used.
    """
    bench = bench_of(model, X, y, suspects)
    try:
        import anywidget  # noqa: F401
    except ImportError:
        data = bench.fit().data
        return diagnose(bench.fit().model, data.X, data.learned, suspects=bench.own)
    bench.fit()
    return _widget_class()(bench)


def bench_of(model: DynamicBiasRegressor, X: Any, y: Any, suspects: Sequence[type[Effect]] = ()) -> Bench:
    """A bench for data in memory, with the model's effects on it."""
    frame = as_pandas(X)
    if not isinstance(frame, pd.DataFrame):
        raise TypeError(f"The workbench needs a DataFrame, whose columns have names. Got {type(X).__name__}.")
    attrs, index = dict(frame.attrs), frame.index
    name = str(getattr(y, "name", None) or "reading")
    frame = frame.rename(columns=str)
    name = name if name not in frame.columns else f"{name} (reading)"
    frame = frame.assign(**{name: pd.Series(getattr(y, "to_numpy", lambda: y)(), index=index)})
    frame.attrs = {**attrs, "units": {**attrs.get("units", {}), **getattr(y, "attrs", {}).get("units", {})}}
    ambient, further, _ = Thermometers.of(model.temperature)
    temperature = str(frame.columns[0] if ambient is None else ambient)
    time, run = (None if column is None else str(column) for column in (model.time, model.run))
    base, given, taus = clone(model), as_effects(model.effects), model.time_constants
    if further:  # the bench has one, and the others as effects
        features = clone(model).fit(X, y).features_
        given, taus = features.further_effects(), features.thermometers().split(features.time_constants)[0]
        for _, effect in given:
            if hasattr(effect, "time_constants") and isinstance(effect.time_constants, np.ndarray):
                effect.set_params(time_constants=effect.time_constants.tolist())
        base.set_params(time_constants=list(taus))
    settings = ModelSettings(
        time_constants=tuple(taus) if isinstance(taus, list | tuple) else taus,
        degree=model.degree,
        products=model.products,
        screen=model.screen,
        sampling_period=model.sampling_period,
        max_gap=model.max_gap,
    )
    base.set_params(temperature=ambient)
    source = ReadLog(frame=frame, name="data in memory")
    folder = tempfile.TemporaryDirectory(prefix="thermocorr-")
    bench = Bench(source, Store(folder.name), settings=settings, own=suspects, base=base)
    weakref.finalize(bench, folder.cleanup)
    acts: list[Any] = [Columns(Roles(temperature=temperature, reading=name, time=time, run=run))]
    for _, effect in given:
        acts.append(Add(AddedEffect.of(bench.codec.pack(clone(effect), "effect"), effect.label())))
    bench.past = Past((tuple(acts),), 0)
    return bench


def _widget_class() -> Any:
    """The class of the widget; made when it is first needed, as anywidget is an extra."""
    import anywidget
    import traitlets

    class BenchWidget(anywidget.AnyWidget):
        """The workbench in a notebook."""

        _esm = page_assets.module()
        _css = page_assets.style()
        body = traitlets.Unicode(page_assets.body()).tag(sync=True)

        def __init__(self, bench: Bench):
            super().__init__()
            self.desk = Desk(bench, self.send)
            self.on_msg(lambda widget, content, buffers: self.desk.hear(content))

        @property
        def model(self) -> DynamicBiasRegressor:
            """The model as it stands on the screen, fitted."""
            bench = self.desk.bench
            assert bench is not None  # it was made with one
            return bench.fit().model

    return BenchWidget

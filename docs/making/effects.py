"""One page for each kind of the catalogue: physics, picture, executed example, columns, bench check, reference."""

from __future__ import annotations

import contextlib
import inspect
import io
import json
from pathlib import Path
from typing import Any

import pandas as pd
from sklearn.base import clone

from thermocorr import DynamicBiasRegressor
from thermocorr.datasets import make_record
from thermocorr.datasets._planted import PLANTS
from thermocorr.effects import CATALOGUE, Covariate, Effect
from thermocorr.effects.protocol import SINCE_START
from thermocorr.records import Layout, read_record

ROWS, SEED, STRENGTH = 7_200, 1, 2.0
TIME_CONSTANTS = ["270 s", "5100 s"]
"""Those of the simulated device: the model lacks nothing but the effect that the page is about."""

_INDEX = """\
# Effects, one by one

Everything that can move a reading is an *effect*: a class that turns the record into columns. A diagnosis tries all of
these but events, which you know of yourself; `make_record(effects={"hysteresis": 2.0})` plants nearly any of them in a
simulated record, so that you can see beforehand how it looks and whether your record would show it.

| kind | physics |
|---|---|
%(rows)s

```{toctree}
:hidden:

%(kinds)s
```
"""

_PAGE = """\
# %(title)s

%(physics)s

`%(formula)s`

## How it looks

A simulated device to which this effect was added; what no static law explains of it is %(strength)g times the noise of
one sample. Left: what the effect adds to the reading, and what is left of the reading by a model without and with it
(averages of %(window)d samples). Right: the same contribution over the temperature, from the record's start (dark) to
its end (bright).

![Fingerprint of %(name)s](%(kind)s.png)

## In a model

```python
%(code)s
```

```text
%(printed)s
```

%(again)s

## Columns

%(columns)s

## Parameters

%(parameters)s

## On the bench

%(bench)s

## Reference

```{eval-rst}
.. autoclass:: thermocorr.effects.%(cls)s
   :members: learn, names, units, signals, candidates
```
"""


def title(kind: str) -> str:
    """``thermal_lag`` -> ``Thermal lag``."""
    return kind.replace("_", " ").capitalize()


def planted(kind: str) -> tuple[pd.DataFrame, pd.DataFrame, Effect]:
    """Record and truth with the effect in it, and the effect with the planted parameters."""
    given = CATALOGUE[kind].info.example
    effects = [(kind, STRENGTH, given) if kind in PLANTS else (CATALOGUE[kind](**given), STRENGTH)]
    record, truth = make_record(ROWS, effects=effects, seed=SEED, return_truth=True)
    parameters = dict(truth.attrs["effects"][kind]["parameters"])
    parameters = {name: value for name, value in parameters.items() if value != []}
    if kind == "static_polynomial":
        parameters["lowest_power"] = parameters["degree"]  # the model has the lower powers
    return record, truth, CATALOGUE[kind](**parameters)


def example(kind: str, effect: Effect) -> str:
    """Code that plants the effect, fits without it and with it."""
    parameters = effect.info.example
    given = f'[("{kind}", {STRENGTH}, {json.dumps(parameters)})]' if parameters else f'{{"{kind}": {STRENGTH}}}'
    if kind not in PLANTS:
        given = f"[({shown(effect)}, {STRENGTH})]"
    return f"""\
from thermocorr import DynamicBiasRegressor
from thermocorr.datasets import make_record
from thermocorr.effects import {type(effect).__name__}

record = make_record({ROWS}, effects={given}, seed={SEED})
X, y = record.drop(columns="reading"), record["reading"]
model = DynamicBiasRegressor("temperature", time_constants={json.dumps(TIME_CONSTANTS)}).fit(X, y)
better = model.with_effect({shown(effect)}).fit(X, y)
for name, fitted in (("without", model), ("with", better)):
    print(f"residual {{name:7}} {{fitted.residual_std_:.2f}} ppm")
print(f"noise            {{record.attrs['noise']:.2f}} ppm")"""


def shown(effect: Effect) -> str:
    """Code that makes the effect, numbers to four digits."""
    twin = clone(effect)
    for name, value in effect.get_params().items():
        if isinstance(value, float):
            twin.set_params(**{name: float(f"{value:.4g}")})
        elif isinstance(value, list):
            twin.set_params(**{name: [float(f"{item:.4g}") for item in value]})
    return " ".join(repr(twin).split()).replace("'", '"')


def executed(code: str) -> tuple[str, dict[str, Any]]:
    """What the code prints, and the names that it leaves."""
    names: dict[str, Any] = {}
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        exec(code, names)
    return printed.getvalue().rstrip(), names


def write_pages(folder: Path) -> None:
    """Write ``index.md``, and one page and one picture for each kind, into `folder`."""
    folder.mkdir(parents=True, exist_ok=True)
    rows = [f"| [`{kind}`]({kind}.md) | {effect.info.physics} |" for kind, effect in CATALOGUE.items()]
    index = _INDEX % {"rows": "\n".join(rows), "kinds": "\n".join(CATALOGUE)}
    _write(folder / "index.md", index)
    for kind in CATALOGUE:
        write_page(kind, folder)


def write_page(kind: str, folder: Path) -> None:
    """Write the page and the picture of one kind."""
    from .fingerprints import WINDOW, draw

    record, truth, effect = planted(kind)
    code = example(kind, effect)
    printed, names = executed(code)
    draw(record, truth[kind], names["model"], names["better"], folder / f"{kind}.png")
    info = effect.info
    _write(
        folder / f"{kind}.md",
        _PAGE
        % {
            "title": title(kind),
            "kind": kind,
            "name": title(kind).lower(),
            "physics": info.physics,
            "formula": info.formula,
            "strength": STRENGTH,
            "window": WINDOW,
            "code": code,
            "printed": printed,
            "again": _found(kind, names["model"], record),
            "columns": _columns(effect, names["better"]),
            "parameters": _parameters(effect, record),
            "bench": info.bench_check,
            "cls": type(effect).__name__,
        },
    )


def _found(kind: str, model: DynamicBiasRegressor, record: pd.DataFrame) -> str:
    """What a diagnosis of the model without the effect says."""
    from thermocorr import diagnose

    found = diagnose(model, record.drop(columns="reading"), record["reading"])
    said = f"`diagnose(model, X, y)` says **{found.verdict}**"
    if found.best is None:
        return f"{said}: on this record it names nobody."
    if found.best.kind == kind:
        return f"{said}, and its first suspect is this effect: `{shown(found.best)}`."
    return f"{said}, but its first suspect is another effect that looks alike on this record: `{shown(found.best)}`."


def _columns(effect: Effect, model: DynamicBiasRegressor) -> str:
    fitted = model.features_.effect_list()[-1]
    rows = [f"| `{name}` | {unit or '1'} |" for name, unit in zip(fitted.names(), fitted.units(), strict=True)]
    if isinstance(effect, Covariate):
        rows = [row.replace("| 1 |", f"| unit of `{effect.inputs()[0]}` |") for row in rows]
    return "\n".join(["| column of the example | unit |", "|---|---|", *rows])


def _parameters(effect: Effect, record: pd.DataFrame) -> str:
    units, given = effect.info.parameters, effect.get_params()
    around = effect.nearby(read_record(record, Layout("temperature"), needed=effect.inputs(), quiet=True))
    moved = {name for other in around for name, value in other.get_params().items() if value != given[name]}
    rows = [
        f"| `{name}` | {'-' if value.default is inspect.Parameter.empty else f'`{value.default!r}`'} "
        f"| {units.get(name, '')} | {'yes' if name in {*effect.info.tuned, *moved} else ''} |"
        for name, value in inspect.signature(type(effect)).parameters.items()
    ]
    if not rows:
        return "None."
    head = ["| parameter | default | unit | tuned by the diagnosis |", "|---|---|---|---|"]
    notes = {
        "s": 'Times (unit "s") may also be written as spans, such as `"15 min"`.',
        SINCE_START: 'Moments may also be written as spans, such as `"3 days"`, or as dates.',
    }
    return "\n".join([*head, *rows, *(f"\n{note}" for unit, note in notes.items() if unit in units.values())])


def _write(path: Path, text: str) -> None:
    """Write only what has changed: Sphinx reads unchanged pages from its cache."""
    if not path.exists() or path.read_text(encoding="utf-8") != text:
        path.write_text(text, encoding="utf-8")

"""What one takes from a `Story`: script, model, log, report."""

from __future__ import annotations

import inspect
import io
from collections.abc import Callable
from typing import Any, NamedTuple

from ..effects.wrap import as_effects
from ..output.answer import Answer
from ..output.model_file import content_of
from ..output.report import report_text
from ..output.results import write_csv
from ..records.errors import printable
from .log import quiet

_END = """# What is missing, and how large the error is: in sample, on blocks held out, and on later data.
diagnosis = diagnose(model, X, learned)
print(diagnosis)
errors = model.residual_std_, diagnosis.held_out_rms, diagnosis.later_rms
print("in sample {:.6g}, held out {:.6g}, later {:.6g}".format(*errors))

# The corrected readings.
corrected = model.evaluate(X, y)
print(corrected["corrected"].describe())
"""


class Kind(NamedTuple):
    """Something to take away."""

    name: str
    """Of the file."""
    media: str
    title: str
    make: Callable[[Any, Any], str | bytes]


def exported(story: Any, kind: str) -> bytes:
    """One of `KINDS`; ValueError for others, or without a model."""
    if kind not in KINDS:
        raise ValueError(f"{kind!r} is no file to take. There are: {', '.join(KINDS)}.")
    found = story.now
    if found is None:
        raise ValueError("There is no model yet: say first which column is the temperature and which the reading.")
    with quiet():
        made = KINDS[kind].make(story, found)
    return made.encode() if isinstance(made, str) else made


def script(story: Any) -> str:
    """Python code that comes to the same model."""
    found = story.fit()
    effects = [effect for _, effect in as_effects(found.model.effects)]
    roles = story.roles
    assert roles is not None
    done = [
        f"# {n}. {printable(act['text'])}" for n, act in enumerate(story.acts, 1) if act["do"] in ("add", "leave_out")
    ]
    own = [] if roles["reading"] == roles["temperature"] else [roles["reading"]]
    return "\n".join(
        [
            "# Written by thermocorr",
            f"# The thermal bias of {printable(story.log.name)}, as it was learned on the workbench.",
            "",
            *_imports(story, effects),
            "",
            "# The log.",
            f"log = {story.log.code(roles['time'])}",
            f"X, y = log.drop(columns={[*own, *roles['ignored']]!r}), log[{roles['reading']!r}]",
            "",
            "# The model, and what was done:" if done else "# The model.",
            *done,
            *_model(found, effects),
            "",
            _END,
        ]
    )


def _imports(story: Any, effects: list[Any]) -> list[str]:
    names: dict[str, set[str]] = {}
    own = {type(effect).__name__ for effect in effects if not type(effect).__module__.startswith("thermocorr.")}
    for effect in effects:
        if type(effect).__name__ not in own:
            names.setdefault("thermocorr.effects", set()).add(type(effect).__name__)
    needed = story.log.code(None).split("(")[0]
    lines = [*(["import runpy"] if own else []), "import warnings", "", "import numpy as np", ""]
    used = {"DynamicBiasRegressor", "RecordWarning", "diagnose", *({"read_log"} & {needed})}
    used |= {name for name in ("Sensor", "Thermometer") if f"{name}(" in repr(story.now.model.temperature)}
    lines.append(f"from thermocorr import {', '.join(sorted(used))}")
    if needed.startswith("load_"):
        lines.append(f"from thermocorr.datasets import {needed}")
    lines += [f"from {module} import {', '.join(sorted(found))}" for module, found in sorted(names.items())]
    if own:
        lines += [
            "",
            f"own = runpy.run_path({story.effects_file!r})",
            *(f"{name} = own[{name!r}]" for name in sorted(own)),
        ]
    return [*lines, "", 'warnings.simplefilter("ignore", RecordWarning)  # what the workbench has said']


def _model(found: Any, effects: list[Any]) -> list[str]:
    lines = ["learned = y.astype(float)"]
    lines += [f"learned.iloc[{start}:{stop}] = np.nan  # left out" for start, stop in found.left_out]
    given, usual = found.model.get_params(deep=False), _usual(type(found.model))
    lines += ["model = DynamicBiasRegressor(", f"    {given['temperature']!r},", f"    {given['time_constants']!r},"]
    lines += [f"    degree={given['degree']!r},"]
    apart = ("temperature", "time_constants", "degree", "effects")
    lines += [f"    {name}={value!r}," for name, value in given.items() if name not in apart and value != usual[name]]
    if effects:
        lines += ["    effects=[", *(f"        {code(effect)}," for effect in effects), "    ],"]
    return [*lines, ")", "model.fit(X, learned)", "print(model.equation())"]


def code(effect: Any) -> str:
    """An effect as code, all digits included."""
    usual, given = _usual(type(effect)), effect.get_params(deep=False)
    said = ", ".join(f"{name}={value!r}" for name, value in given.items() if repr(value) != repr(usual.get(name)))
    return f"{type(effect).__name__}({said})"


def _usual(cls: type) -> dict[str, Any]:
    """Defaults of a class's parameters."""
    return {name: parameter.default for name, parameter in inspect.signature(cls).parameters.items()}


def _corrected(story: Any, found: Any) -> bytes:
    evaluated = found.model.evaluate(found.X, found.y, return_std=True)
    written, _ = story.log.timed(None if story.roles is None else story.roles["time"])
    file = io.BytesIO()
    write_csv(file, written, evaluated)
    return file.getvalue()


def _report(story: Any, found: Any) -> str:
    unjudged = found.lacking or ("" if found.diagnosis is not None else "Not judged yet.")
    answer = Answer(
        diagnosis=found.diagnosis,
        unjudged=unjudged,
        advice=story.advice.get(story.key(story.acts[:1])) if len(story.acts) == 1 else None,
        steps=story.errors(),
        source=story.log.name,
        command="thermocorr workbench",
    )
    return report_text(found.model, found.X, found.y, answer)


KINDS = {
    "script": Kind("session.py", "text/x-python", "Python script", lambda story, found: script(story)),
    "model": Kind("model.json", "application/json", "model.json", lambda story, found: content_of(found.model)),
    "corrected": Kind("corrected.csv", "text/csv", "corrected.csv", _corrected),
    "report": Kind("report.html", "text/html", "Report page", _report),
}

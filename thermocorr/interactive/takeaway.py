"""What is taken away: the script that repeats the session, the model, corrected readings, the report."""

from __future__ import annotations

import inspect
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

from ..effects.protocol import Effect
from ..effects.wrap import as_effects
from ..files import Outputs, write_file
from ..files.codec import ModelFileError, fields, integer, items
from ..files.effect_nodes import ImportNotAllowedError
from ..files.model_file import content_of
from ..files.result_files import write_corrected
from ..pages import Answer
from ..pages.report import report_text
from ..records.errors import printable
from .acts import Act, Add, Arrangement, LeaveOut, Past, act_of
from .bench import Bench
from .learning import Fitted, quietly
from .source import SAMPLES, ReadLog

OWN = "Give the file of your own effects, as you did before: --effects my_effects.py"


def past_node(past: Past) -> dict[str, Any]:
    """All that was done, each act once: ``acts``, ``versions`` (numbers of acts) and which of them stands, ``at``."""
    numbers: dict[Act, int] = {}
    versions = [[numbers.setdefault(act, len(numbers)) for act in acts] for acts in past.versions]
    return {"acts": [act.node() for act in numbers], "versions": versions, "at": past.at}


def with_past(bench: Bench, node: Any) -> Bench:
    """A bench on which all that was done stands again."""
    node = fields(node, "$.past", ("acts", "versions", "at"))

    def label(effect: Any, where: str) -> str:
        try:
            return bench.codec.unpack(effect, where).label()
        except ImportNotAllowedError:
            raise ModelFileError(OWN) from None

    acts = [act_of(act, f"$.past.acts[{i}]", label) for i, act in enumerate(items(node["acts"], "$.past.acts"))]
    versions = tuple(
        tuple(acts[integer(k, f"$.past.versions[{i}]", 0, len(acts) - 1)] for k in items(version, "$.past.versions"))
        for i, version in enumerate(items(node["versions"], "$.past.versions"))
    )
    if not versions:
        raise ModelFileError("$.past.versions holds nothing")
    bench.past = Past(versions, integer(node["at"], "$.past.at", 0, len(versions) - 1))
    return bench


class Chapter(NamedTuple):
    """A few lines of code, and what they are for."""

    text: str
    code: str


def script(bench: Bench, found: Fitted) -> str:
    """The session as a Python script."""
    parts = [f"# {_title(bench.source)}"]
    for chapter in chapters(bench, found):
        parts += ["", *(f"# {line}" for line in chapter.text.splitlines()), chapter.code]
    return "\n".join(["# Written by thermocorr", *parts]) + "\n"


def _title(source: ReadLog) -> str:
    return f"The thermal bias of {printable(source.name)}, as it was learned on the workbench."


def chapters(bench: Bench, found: Fitted) -> list[Chapter]:
    """Chapters of the script."""
    source, arrangement = bench.source, found.arrangement
    effects = [effect for _, effect in as_effects(found.model.effects)]
    steps = [
        f"{number}. {printable(act.sentence())}"
        for number, act in enumerate(bench.acts, 1)
        if isinstance(act, Add | LeaveOut)
    ]
    done = "\n".join(["The model, and what was done:", *steps]) if steps else "The model."
    return [
        Chapter("What it needs.", _imports(source, effects, bench.own_file)),
        Chapter("The log.", _log(source, arrangement)),
        Chapter(done, _model_text(found, effects)),
        Chapter("What is missing.", "diagnosis = diagnose(model, X, learned)\nprint(diagnosis)"),
        Chapter("How large the error is: in sample, on blocks held out, and on later data.", _ERRORS),
        Chapter(
            "The corrected readings.", 'corrected = model.evaluate(X, y)\nprint(corrected["corrected"].describe())'
        ),
    ]


_ERRORS = """errors = model.residual_std_, diagnosis.held_out_rms, diagnosis.later_rms
print("in sample {:.6g}, held out {:.6g}, later {:.6g}".format(*errors))"""


def _imports(source: ReadLog, effects: list[Effect], own_file: str) -> str:
    names: dict[str, set[str]] = {}
    own = set()
    for effect in effects:
        cls = type(effect)
        if cls.__module__.startswith("thermocorr."):
            names.setdefault(cls.__module__, set()).add(cls.__name__)
        else:
            own.add(cls.__name__)
    if source.files:
        names["thermocorr"] = {"read_log"}
    elif source.name in SAMPLES:
        names["thermocorr.datasets"] = {SAMPLES[source.name].loader}
    lines = [*(["import runpy"] if own else []), "import warnings", "", "import numpy as np", ""]
    lines.append("from thermocorr import DynamicBiasRegressor, RecordWarning, diagnose")
    lines += [f"from {module} import {', '.join(sorted(found))}" for module, found in sorted(names.items())]
    if own:
        lines += ["", f"own = runpy.run_path({own_file!r})", *(f"{name} = own[{name!r}]" for name in sorted(own))]
    lines += ["", 'warnings.simplefilter("ignore", RecordWarning)  # what the workbench has said']
    return "\n".join(lines)


def _log(source: ReadLog, arrangement: Arrangement) -> str:
    roles = arrangement.roles
    assert roles is not None
    if source.files:
        time = "" if roles.time is None or source.how.time else f", time={roles.time!r}"
        files = repr(source.files[0] if len(source.files) == 1 else list(source.files))
        lines = [f"log = read_log({files}{source.keywords()}{time})"]
    elif source.name in SAMPLES:
        lines = [f"log = {SAMPLES[source.name].code()}"]
    else:
        lines = [
            f"log = X.rename(columns=str).assign(**{{{roles.reading!r}: y}})  # X, y: as the workbench was given them"
        ]
    own = [] if roles.reading == roles.temperature else [roles.reading]
    lines.append(f"X, y = log.drop(columns={[*own, *roles.ignored]!r}), log[{roles.reading!r}]")
    return "\n".join(lines)


def _model_text(found: Fitted, effects: list[Effect]) -> str:
    given, usual = found.model.get_params(deep=False), _usual(type(found.model))
    apart = ("temperature", "time_constants", "degree", "effects")
    lines = ["learned = y.astype(float)"]
    lines += [f"learned.iloc[{start}:{stop}] = np.nan  # left out" for start, stop in found.arrangement.left_out]
    lines += ["model = DynamicBiasRegressor("]
    lines += [f"    {given[name]!r}," for name in apart[:3]]
    lines += [f"    {name}={value!r}," for name, value in given.items() if name not in apart and value != usual[name]]
    if effects:
        lines += ["    effects=[", *(f"        {code(effect)}," for effect in effects), "    ],"]
    lines += [")", "model.fit(X, learned)", "print(model.equation())"]
    return "\n".join(lines)


def code(effect: Effect) -> str:
    """An effect as code, with every digit of the parameters that are not as usual."""
    usual, given = _usual(type(effect)), effect.get_params(deep=False)
    said = ", ".join(f"{name}={value!r}" for name, value in given.items() if repr(value) != repr(usual.get(name)))
    return f"{type(effect).__name__}({said})"


def _usual(cls: type) -> dict[str, Any]:
    """Defaults of a class's parameters."""
    return {name: parameter.default for name, parameter in inspect.signature(cls).parameters.items()}


class Kind(NamedTuple):
    """Something to take away."""

    file: str
    media: str
    what: str
    make: Callable[[Bench, Fitted, Path], str | bytes | None]
    """Gives the content of the file; None where it has written the file itself."""


def taken(bench: Bench, kind: str, folder: Path) -> Path:
    """Write one of `KINDS` to a new folder inside of a folder; whoever took it away removes that.

    Raises ValueError for a kind that there is not, and where there is no model yet. Raises OutputError where it
    cannot be written.
    """
    if kind not in KINDS:
        raise ValueError(f"{kind!r} cannot be taken away. There are: {', '.join(KINDS)}.")
    found = bench.current
    if found is None:
        raise ValueError("There is no model yet: say first which column is the temperature and which the reading.")
    path = Path(tempfile.mkdtemp(prefix="take-", dir=folder)) / KINDS[kind].file
    made = quietly(lambda: KINDS[kind].make(bench, found, path))
    return path if made is None else write_file(path, made)


def _corrected(bench: Bench, found: Fitted, path: Path) -> None:
    evaluated = found.model.evaluate(found.data.X, found.data.y, return_std=True)
    roles = found.arrangement.roles
    written, _ = bench.source.timed(None if roles is None else roles.time)
    with Outputs(bench.source.files) as outputs:
        write_corrected(outputs, path.parent, written, evaluated)


def _report(bench: Bench, found: Fitted, path: Path) -> str:
    answer = Answer(
        diagnosis=found.diagnosis,
        unjudged=found.said.get("diagnosis", "Not judged yet." if found.diagnosis is None else ""),
        source=bench.source.name,
        command="thermocorr workbench",
    )
    return report_text(found.model, found.data.X, found.data.y, answer)


KINDS = {
    "script": Kind("session.py", "text/x-python", "Python script", lambda bench, found, _: script(bench, found)),
    "model": Kind("model.json", "application/json", "model.json", lambda _, found, __: content_of(found.model)),
    "corrected": Kind("corrected.csv", "text/csv", "corrected.csv", _corrected),
    "report": Kind("report.html", "text/html", "Report page", _report),
}

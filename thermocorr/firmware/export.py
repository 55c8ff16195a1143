"""`export_c`: a fitted model as C99, with a self-test."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from ..effects import StaticPolynomial
from ..effects.protocol import refuse_foresight
from ..effects.stream import walk
from ..output.writer import Outputs
from ..records import Record, Segment
from ..records.errors import printable
from .printer import DEFAULT, Program, comment, identifier, number, prefix, program_of

SAMPLES = 200
"""Rows of the fitted record that the self-test runs."""
TOLERANCE = 1e-12
"""Largest error of the self-test, as a share of what the effects add up to."""
ABSURD = 1e12
"""An input beyond it is taken as missing."""


@dataclass(frozen=True)
class FirmwareExport:
    """Files of an export, and what the code takes."""

    name: str
    """Prefix of the names that the code shows."""
    paths: tuple[Path, ...]
    """Header, source, self-test."""
    columns: tuple[object, ...]
    """Recorded columns in the order in which `update` takes them."""
    kept: tuple[str, ...]
    """Effects of the model that `correct` does not remove, and the code neither."""

    def __str__(self) -> str:
        lines = [f"{self.name}: C99, doubles", *(f"  {path}" for path in self.paths)]
        if self.columns:
            lines.append(f"  columns: {', '.join(map(printable, self.columns))}")
        if self.kept:
            lines.append(f"  kept in the corrected reading: {', '.join(map(printable, self.kept))}")
        return "\n".join(lines)


def export_c(
    model: Any, path: str | Path, *, name: str | None = None, force: bool = False, inputs: Iterable[str | Path] = ()
) -> FirmwareExport:
    """Write a fitted model as C99, with a self-test.

    The code takes no heap and keeps all it remembers in one struct. ``init`` starts a device anew; ``update`` takes the
    time since the sample before [s], a temperature, a reading (and recorded columns), and gives bias, corrected reading
    and flags. Inputs that jump or stand still are held back and doubted as in Python (`thermocorr.records.gate`). A
    missing or infinite input raises a flag, and its last good value stands in; Python passes over the row instead. A
    step longer than the model's `max_gap` starts anew. Start-up decays, eq. (18), belong to the fitted record: a device
    that starts anew has none, is taken to be at rest, and is flagged until the washout is over.

    Parameters
    ----------
    model : DynamicBiasRegressor
        Fitted, or loaded from its file.
    path : str or Path
        Folder (made where there is none), or a path that ends in .c or .h, whose stem becomes the name.
    name : str, optional
        Prefix of all names in C, and name of the files; by default "thermal_bias", or the stem of `path`.
    force : bool, default False
        Overwrite files that are there already.
    inputs : paths
        Files that must not be overwritten in any case.

    Returns
    -------
    FirmwareExport

    Raises
    ------
    ValueError
        For an effect that cannot be written in C, before anything is written.
    OutputError
        An OSError and a RecordError: the files cannot be written, or must not be; none of them is.
    """
    path = Path(path)
    folder, stem = (path.parent, path.stem) if path.suffix in (".c", ".h") else (path, DEFAULT)
    name = prefix(name or stem)
    effects, history = model.features_.effect_list(), model.features_.history_
    removed = [i for i, effect in enumerate(effects) if effect.removed_by_correct]
    edges = np.cumsum([0, *(effect.n_columns() for effect in effects)])
    parts = [model.coef_[low:high].tolist() for low, high in pairwise(edges)]
    refuse_foresight([effects[i] for i in removed], "a device")
    began = history.between(history.zero, 0)
    program = program_of([effects[i] for i in removed], [parts[i] for i in removed], began, history.usual_step)
    about = _about(model, name, program)
    texts = {f".{kind}": _environment().get_template(f"bias.{kind}.j2").render(about) for kind in ("h", "c")}
    texts["_test.c"] = _environment().get_template("test.c.j2").render(about, **_trial(model, removed, program))
    paths = tuple(folder / f"{name}{ending}" for ending in texts)
    with Outputs(inputs, force) as outputs:
        for each, text in zip(paths, texts.values(), strict=True):
            outputs.write(each, text)
    kept = tuple(effect.label() for effect in effects if not effect.removed_by_correct)
    return FirmwareExport(name, paths, tuple(program.columns), kept)


@cache
def _environment() -> Any:
    from jinja2 import Environment, PackageLoader, StrictUndefined

    made = Environment(
        loader=PackageLoader("thermocorr.firmware"), undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True,
        keep_trailing_newline=True,
    )  # fmt: skip
    made.filters |= {"num": number, "said": comment, "bound": _bound}
    return made


def _bound(value: float) -> str:
    """A number that may be infinite."""
    return number(value) if np.isfinite(value) else "HUGE_VAL" if value > 0 else "-HUGE_VAL"


def _about(model: Any, name: str, program: Program) -> dict[str, Any]:
    """All that header and source say."""
    from .._version import __version__

    features, reading = model.features_, model.reading_
    history, effects = features.history_, features.effect_list()
    temperature = next(e for e in effects if isinstance(e, StaticPolynomial)).temperature_name_
    motions = {} if history.screen is None else {n: known.motion for n, known in history.screen.inputs.items()}
    unit = f"{reading.temperature_unit}{'' if reading.unit_named else ', as its values have it: the record named none'}"
    taken: set[str] = set()
    first, last = (history.record.times.label(row) for row in (0, history.record.segments[-1].stop - 1))
    low, high = reading.temperature_range
    lines = [
        f"Reading: {reading.name} [{reading.unit or 'its own unit'}], mean {reading.mean:.10g}",
        f"Fitted rows: {history.n_fitted}, from {first} to {last}, usually {history.usual_step:.10g} s apart",
        f"Temperature: {temperature}, fitted from {low:.6g} to {high:.6g} {unit}",
        f"Reading at {model.reference_temperature_:.10g}, at rest (U0): {model.intercept_:.17g}",
        f"Time constants: {', '.join(f'{tau:.6g}' for tau in model.time_constants_) or 'none'} s",
        f"Standard deviation of the fitted residuals: {model.residual_std_:.6g}",
        f"Effects removed: {'; '.join(e.label() for e in effects if e.removed_by_correct) or 'none'}",
        f"Effects kept: {'; '.join(e.label() for e in effects if not e.removed_by_correct) or 'none'}",
    ]
    removed = [effect.removed_by_correct for effect in effects]
    return {
        "name": name,
        "NAME": name.upper(),
        "version": __version__,
        "lines": lines,
        "program": program,
        "names": [(identifier(column, taken, "x").upper(), column) for column in program.columns],
        "motions": [motions.get(column) for column in (temperature, *program.columns)],
        "low": low,
        "high": high,
        "gaps": reading.temperature_gaps,
        "ranges": model._learned_ranges()[removed].tolist(),
        "level": model._removed_level,
        "deviation": float(model.residual_std_),
        "washout": float(model.washout_),
        "max_gap": np.inf if history.max_gap is None else history.max_gap,
        "absurd": ABSURD,
    }


def _trial(model: Any, removed: list[int], program: Program) -> dict[str, Any]:
    """The self-test: inputs within their fitted ranges and rates.
    them.
    """
    history, kept = model.features_.history_, model.features_.history_.record
    k, columns = np.arange(SAMPLES), dict[Any, np.ndarray]()
    for place, (column, (low, high)) in enumerate(history.ranges.items()):
        motion = None if history.screen is None else history.screen.inputs[column].motion
        half, angle = (high - low) / 2, 0.1 + 0.01 * place
        if motion is not None and half > 0:
            angle = min(angle, motion.farthest / (2 * half))
        columns[column] = (low + high) / 2 + half * np.sin(angle * k)
    step = {"rows": 1, "seconds": history.usual_step}.get(history.kind, history.usual_step * kept.times.per_second)
    first = np.asarray(kept.times.ticks)[0]
    ticks = first + (k * step if history.kind == "seconds" else np.rint(k * step).astype(np.int64))
    times = replace(kept.times, n=SAMPLES, ticks=ticks)
    part = Record(times, kept.temperature_name, columns, (Segment(0, SAMPLES, kept.segments[0].run),))
    rows, bias, size = list[tuple[float, ...]](), list[float](), 0.0
    for block, parts in model._weighed(walk(model.features_.effect_list(), part, zero=history.zero)):
        inputs = [block.temperature, *(np.asarray(block[name], float) for name in program.columns)]
        rows += zip(block.steps.tolist(), *(each.tolist() for each in inputs), strict=True)
        bias += (parts[:, removed].sum(axis=1) + model._removed_level).tolist()
        size = max(size, float(np.abs(parts[:, removed]).sum(axis=1).max()))
    seconds = part.times.between(part.stamp(0), history.zero)
    return {"rows": rows, "bias": bias, "tolerance": TOLERANCE * size + 1e-300, "seconds": seconds}

"""A fitted model as source for a microcontroller: `export_c`, and `export_to` for any language."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from ..effects import StaticPolynomial
from ..estimators.identifiability import Cancellation
from ..files import Outputs
from ..records import seconds_of
from ..records.errors import warn
from ..records.numbers import quantity_text
from ..records.units import difference_unit
from .c99 import C99
from .composer import Composer, refuse
from .finished import Firmware, FirmwareExport, provenance
from .guard import Guard
from .language import Language
from .program import Program, TimeCounter, settling
from .selftest import TOLERANCE, Trial, courses, expected_flags, reference_bias, tolerance
from .selftest import inputs as test_inputs
from .target import DEFAULT_PREFIX, Dtype, Target, prefix


def export_c(
    model: Any,
    path: str | Path,
    dtype: Dtype = "float",
    *,
    sampling_period: Any = "fitted",
    name: str | None = None,
    force: bool = False,
    inputs: Iterable[str | Path] = (),
) -> FirmwareExport:
    """Write a fitted model as C99: `<name>.h`, `<name>.c` and the self-test `<name>_test.c`.

    The code takes no heap and keeps all it remembers in one struct. ``init`` starts a device anew, ``update`` takes a
    temperature and a reading (and recorded columns) and gives bias, corrected reading and flags. Inputs that jump or
    stand still are held back and doubted as in Python (`thermocorr.records.gate`). A missing or infinite input raises a
    flag, and its last good value stands in; Python passes over the row instead, as if it had not come, and starts a new
    segment after a step longer than `max_gap`, for which the device calls ``init`` again. Start-up decays, eq. (18),
    belong to the fitted record: a device that starts anew has none, is taken to be at rest, and is flagged until the
    washout is over.

    Parameters
    ----------
    model : DynamicBiasRegressor
        Fitted, or loaded from its file.
    path : str or Path
        Folder (made where there is none), or a path that ends in .c or .h, whose stem becomes the name.
    dtype : {"float", "double"}, default "float"
        Numbers on the device. A float holds a reading to seven digits; where these are not enough, take the code's
        `bias` and subtract it in another form.
    sampling_period : float, time span, "fitted" or "variable", default "fitted"
        Time between samples [s]; "fitted" is the fitted record's usual step. "variable" gives each update its step in
        microseconds, at the price of a division or two for each lag, and of `expm1` (`exp` in double precision) for
        steps above tau/10; a step longer than the model's `max_gap` starts anew, as in Python.
    name : str, optional
        Prefix of all names in C, and name of the files; by default "thermal_bias", or the stem of `path`. One that C
        or its library has taken ("int", "math") comes behind ``thermal_bias_``.
    force : bool, default False
        Overwrite files that thermocorr did not write.
    inputs : paths
        Files that must not be overwritten in any case.

    Returns
    -------
    FirmwareExport
        Files and costs; `print` it.

    Raises
    ------
    ValueError
        For an effect that cannot be written in C, before anything is written; for numbers that `dtype` cannot hold.
    OutputError
        An OSError and a RecordError: the files cannot be written, or must not be; none of them is.
    """
    return export_to(
        C99(), model, path, dtype, sampling_period=sampling_period, name=name, outputs=Outputs(inputs, force)
    )


def export_to(
    language: Language,
    model: Any,
    path: str | Path,
    dtype: Dtype,
    *,
    sampling_period: Any = "fitted",
    name: str | None = None,
    outputs: Outputs | None = None,
) -> FirmwareExport:
    """Write a fitted model in a language; parameters, result and errors are those of `export_c`."""
    if dtype not in ("float", "double"):
        raise ValueError(f"The 'dtype' parameter must be 'float' or 'double'. Got {dtype!r} instead.")
    effects = model.features_.effect_list()
    removed = [i for i, effect in enumerate(effects) if effect.removed_by_correct]
    refuse([effects[i] for i in removed], language.title)
    folder, stem = _place(path, language)
    static = next(effect for effect in effects if isinstance(effect, StaticPolynomial))
    history = model.features_.history_
    T0 = float(static.reference_temperature_)
    target = Target(
        name=prefix(name or stem, language.keywords, language.unfit),
        dtype=dtype,
        period=_period(sampling_period, history),
        reference_temperature=float(np.float32(T0)) if dtype == "float" else T0,
        temperature_name=static.temperature_name_,
        degree=difference_unit(model.reading_.temperature_unit),
        history=history,
    )
    edges = np.cumsum([0, *(effect.n_columns() for effect in effects)])
    weights = [np.asarray(model.coef_[low:high], float) for low, high in pairwise(edges)]
    parts = [(effects[i], weights[i]) for i in removed]
    program, clock = _compose(model, Program(target, language.keywords), parts)
    screen = history.screen
    motions = (
        [] if screen is None else [screen.inputs[name].motion for name in (target.temperature_name, *program.columns)]
    )
    known = [motion for motion in motions if motion is not None]
    guard = Guard(program, known, float(model.residual_std_), float(model.washout_))
    firmware = Firmware(program, clock, model.reading_.temperature_range, guard, model.reading_.temperature_gaps)
    trial = _trial(model, firmware, parts)
    texts = language.files(firmware, provenance(model, target, effects), trial)
    paths = _write(folder, target.name, texts, outputs or Outputs())
    return FirmwareExport(
        name=target.name,
        dtype=dtype,
        sampling_period=target.period,
        paths=paths,
        columns=tuple(program.columns),
        state_bytes=firmware.state_bytes,
        constant_bytes=firmware.constant_bytes,
        operations=firmware.operations,
        kept=tuple(effect.label() for effect in effects if not effect.removed_by_correct),
    )


def _trial(model: Any, firmware: Firmware, parts: Sequence[tuple[Any, np.ndarray]]) -> Trial:
    """The self-test, by the effects themselves."""
    target, history = firmware.target, firmware.target.history
    step = target.period or history.usual_step
    recorded = {name: np.asarray(history.record.columns[name], float) for name in firmware.program.columns}
    given = test_inputs(firmware, recorded, step)
    seconds = _seconds(target, given.steps)
    judged = courses(firmware, given)
    bias, size = reference_bias(target, parts, *judged.now, seconds, given.steps)
    other, _ = reference_bias(target, parts, *judged.twin, seconds, given.steps)
    changed, bias = bias - other, bias + model._removed_level
    spread = max(float(np.ptp(bias)), model.reading_.std)
    if target.single:
        _warn_of_lost_digits(Cancellation(size, spread))
        _warn_of_coarse_readings(model)
    flags = expected_flags(firmware, given, judged, changed)
    return Trial(given, bias, flags, tolerance(firmware, bias, size))


def _warn_of_lost_digits(found: Cancellation) -> None:
    """Warn where large contributions cancel, so that the digits of single precision are lost with them."""
    # Roundings of each contribution that may add up: of its coefficient, its column, their product and the sum
    rounding = 4.0 * float(np.finfo(np.float32).eps) / 2
    if found.beyond(TOLERANCE["float"] / rounding):
        warn(
            f"{found} Single precision may be wrong by {rounding * found.reach:.1g}. Export with dtype='double', or "
            "fit fewer time constants (or with a ridge penalty, alpha)."
        )


def _warn_of_coarse_readings(model: Any) -> None:
    """Warn where the readings themselves have steps in single precision that are not small against their noise."""
    reading, noise = model.reading_, model.residual_std_
    if not noise > 0:
        return
    largest = abs(reading.mean) + reading.std
    step = float(np.spacing(np.float32(largest)))
    # Step of the readings in single precision, over their noise, from which it is told: it adds 1 % to the noise
    if step > 0.5 * noise:
        said, fine, noisy = (quantity_text(value, reading.unit) for value in (largest, step, noise))
        warn(
            f"A reading of {said} has steps of {fine} in single precision, and the noise is {noisy}: corrected "
            "readings lose what the correction gains. Export with dtype='double' (--double), or take the bias that the "
            "code tells off in double precision."
        )


def _compose(model: Any, program: Program, parts: Sequence[tuple[Any, np.ndarray]]) -> tuple[Program, TimeCounter]:
    """Let every effect write its part."""
    composer = Composer(program, model.reading_.unit)
    program.bias_constant += model._removed_level
    composer.write(*zip(*parts, strict=True))
    settling(program, float(model.washout_))
    return program, composer.clock


def _place(path: str | Path, language: Language) -> tuple[Path, str]:
    """Folder and name: a path with an ending of the language names the files, any other is a folder."""
    path = Path(path)
    return (path.parent, path.stem) if path.suffix in language.suffixes else (path, DEFAULT_PREFIX)


def _period(given: Any, history: Any) -> float | None:
    if isinstance(given, str) and given == "variable":
        return None
    if isinstance(given, str) and given == "fitted":
        return float(history.usual_step)
    return seconds_of(given, "sampling_period")


def _seconds(target: Target, steps: np.ndarray) -> np.ndarray:
    """Times of samples since the first fitted row [s]."""
    if target.period is not None:
        return target.period * np.arange(len(steps))
    return np.asarray(np.cumsum(np.round(steps * 1e6)) / 1e6)


def _write(folder: Path, name: str, texts: dict[str, str], outputs: Outputs) -> tuple[Path, ...]:
    paths = tuple(folder / f"{name}{ending}" for ending in texts)
    with outputs:
        for path, text in zip(paths, texts.values(), strict=True):
            outputs.write(path, text.encode("ascii"))
    return paths

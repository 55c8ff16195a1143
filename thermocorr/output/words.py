"""Words that terminal, pictures and pages share."""

from __future__ import annotations

import re
import shutil
import textwrap
from collections.abc import Iterator
from typing import Any

import numpy as np
import pandas as pd

from ..effects import Disturbance
from ..effects.protocol import SINCE_START, TEMPERATURE, TEMPERATURE_DIFFERENCE
from ..effects.wrap import as_effects
from ..model.tables import VERDICTS
from ..records.errors import printable
from ..records.numbers import SUPERSCRIPTS, UNKNOWN, Scale, quantity_text, scale_of, span_text, span_texts, unit_text
from ..records.units import difference_unit

MINUS = "\u2212"
HELPS = "One effect lowers the error on unseen data; that it is the cause is not proven."
MANY_MOMENTS = 6
"""Moments of a cause that are listed at most."""


def page_width() -> int:
    """Letters of a printed line, from 60 to 120."""
    return min(max(shutil.get_terminal_size((100, 24)).columns, 60), 120)


def each_row(table: pd.DataFrame) -> Iterator[Any]:
    """Rows of a result's table, each with its columns as attributes.

    pandas' types know a cell as any scalar there is; which one it is stands in the docstring of the table.
    """
    return table.itertuples()


def aspect_text(row: Any) -> str:
    """Name of a condition, or of a column."""
    if row.aspect == "column" or (row.aspect == "temperature" and isinstance(row.column, str)):
        return printable(row.column)
    if row.aspect == "lag difference":
        return f"lag difference, {span_text(row.time_constant)} [{unit_text(row.unit)}]"
    if row.aspect == "rate":
        return f"rate [{unit_text(row.unit)}]"
    if row.aspect == "hour":
        return f"hour of day{row.unit.removeprefix('h')}"
    return str(row.aspect)


def ends_text(row: Any, span: float = 0.0) -> tuple[str, str]:
    """Low and high end of a place, for a picture."""
    if row.unit == "date":
        low, high = (pd.Timestamp(value, unit="s").round("s") for value in (row.low, row.high))
        if span:
            # Dates of records longer than 200 days are written with their year.
            form = "%d %b %Y" if span > (200 * 86_400.0) else "%d %b %H:%M"
            return low.strftime(form), high.strftime(form)
        return str(low), str(high).removeprefix(f"{low:%Y-%m-%d} ")
    if row.unit == "s":
        first, last = span_texts((row.low, row.high))
        return first, last
    # An end smaller than 1e-9 of the other is the rounding of 0.
    size = 1e-9 * max(abs(row.low), abs(row.high))
    least, most = (f"{0.0 if abs(end) < size else end:.4g}".replace("-", MINUS) for end in (row.low, row.high))
    return least, most


def interval_text(row: Any) -> str:
    """``20.1 to 22.4``, two dates, or ``1`` for a state."""
    low, high = ends_text(row)
    if row.aspect == "column" and row.low == row.high:
        return low
    return f"{low} to {high}" + (" h" if row.aspect == "hour" else "")


def place_text(row: Any) -> str:
    """A place where a model fails, as part of a sentence."""
    return f"from {interval_text(row)}" if row.aspect == "time" else f"where {aspect_text(row)} is {interval_text(row)}"


def decide_sentence(found: Any) -> str:
    """Which measurement decides between rivals; "" for none."""
    return "" if found.proposal is None else str(printable(found.proposal.sentence()))


def said_of_rest(found: Any, scale: Scale) -> list[str]:
    """What decides between rivals, what is left, and what is small."""
    return [decide_sentence(found), *left_sentences(found.left, scale, found.verdict), small_sentence(found)]


def effect_text(effect: Any) -> str:
    """Kind and column of an effect: ``lagged covariate: humidity``."""
    return str(effect.kind).replace("_", " ") + "".join(f": {printable(name)}" for name in effect.inputs()[:1])


def plain(value: float, digits: int = 4) -> str:
    """A number in print: 0.1040, a power of ten, a real minus."""
    if not np.isfinite(value):
        return "\u2013" if np.isnan(value) else ("∞" if value > 0 else f"{MINUS}∞")
    if value != 0 and not 1e-3 <= abs(value) < 10 ** max(digits + 2, 6):
        mantissa, exponent = f"{value:.{digits - 1}e}".split("e")
        return f"{mantissa} \u00d7 10{str(int(exponent)).translate(SUPERSCRIPTS)}".replace("-", MINUS, 1)
    shown = f"{value:#.{digits}g}".removesuffix(".") if abs(value) < 10**digits else f"{value:.0f}"
    return shown.replace("-", MINUS) if value else "0"


def parameters_text(effect: Any, start: float | None, degrees: str) -> str:
    """Parameters with a unit, in words.

    `degrees` (str): Unit of the temperature.
    """
    parts = []
    units = {TEMPERATURE: degrees, TEMPERATURE_DIFFERENCE: difference_unit(degrees)}
    for name, unit in (effect.info.parameters if effect.info is not None else {}).items():
        value = getattr(effect, name)
        several = value if isinstance(value, list | tuple | np.ndarray) else [value]
        try:
            numbers = [float(item) for item in several]
        except (TypeError, ValueError):
            continue
        if not numbers:
            continue
        if unit == SINCE_START and start is not None:
            shown = [str(pd.Timestamp(start + number, unit="s").round("s")) for number in numbers]
        elif unit in ("s", SINCE_START):
            shown = [span_text(number) for number in numbers]
        else:
            shown = [f"{plain(v, 3)} {unit_text(units.get(unit, unit))}" for v in numbers]
        parts.append(f"{name.replace('_', ' ').removesuffix('s' if len(several) == 1 else '')} {', '.join(shown)}")
    return "; ".join(parts)


def probability_text(p: float) -> str:
    """A p-value; below 1e-12 it is no more than that."""
    return f"{p:.2g}" if p > 1e-12 else "< 1e-12"


def better_text(suspect: Any) -> str:
    """Stretches that a suspect improves: "5 of 6"; "-" for none."""
    falls = suspect.each
    return f"{sum(fall > 0 for fall in falls)} of {len(falls)}" if falls else UNKNOWN


def wrapped(name: str, width: int, lines: int = 3) -> str:
    """A name in a few lines of limited width.

    Examples
    --------
    >>> print(wrapped("plc.station_04/barometer_raw", 16))
    plc.station_04/
    barometer_raw
    """
    found = [""]
    for piece in re.findall(r"\s*[^\s_./:-]*[_./:-]*", str(name)):
        if found[-1] and len(found[-1] + piece) > width:
            found.append("")
        found[-1] += piece if found[-1] else piece.lstrip()
    short = [part for long in found for part in textwrap.wrap(long, width)]
    return "\n".join(short if len(short) <= lines else [*short[: lines - 1], f"{short[lines - 1][: width - 4]} ..."])


STANDINGS = {
    "confirmed": "confirmed",
    "helps": "helps on unseen data; not proven to be the cause",
    "proven": "proven, not confirmed",
    "": "not named",
}


def suspect_sentence(suspect: Any) -> str:
    """Two sentences on a suspect: the evidence, and its physics."""
    tie = ""
    size = f", {matters_text(suspect.matters_from)}" if suspect.matters_from else ""
    lag = f"A lag, if any, is below {span_text(suspect.lag_below)}. " if suspect.lag_below else ""
    if suspect.confusable_with:
        tie = f"; cannot be distinguished from {', '.join(effect_text(effect) for effect in suspect.confusable_with)}"
    if suspect.in_model:
        tie += "; this record cannot tell it apart from slow lags that the model has, a slow body"
    physics = suspect.effect.info.physics if suspect.effect.info is not None else ""
    return (
        (
            f"{suspect.title or suspect.effect.title()}: {STANDINGS[suspect.standing]}{size}; {worth_text(suspect)}, "
            f"p-value {probability_text(suspect.p_value)}{tie}. {lag}{when_text(suspect)} {physics}"
        )
        .replace(".  ", ". ")
        .strip()
    )


def worth_text(suspect: Any) -> str:
    """How far a suspect lowers the error of averages."""
    blocks = f"{suspect.gain_db:.2f} dB on held-out blocks"
    if not np.isfinite(suspect.later_db):
        return f"too late in the record to be judged on later data, lowers the error of averages by {blocks}"
    return f"lowers the error of averages on later data by {suspect.later_db:.2f} dB, by {blocks}"


def matters_text(readings: int) -> str:
    """The averaging at which an effect exceeds the noise."""
    return "more than one reading's noise" if readings < 2 else f"matters if you average {readings:,} readings or more"


def size_text(suspect: Any, scale: Scale) -> str:
    """Size of a suspect, and the averaging that shows it."""
    size = f"{scale.text(suspect.size, 2)} rms, " if np.isfinite(suspect.size) else ""
    return f"{size}{matters_text(suspect.matters_from)}"


def small_sentence(found: Any) -> str:
    """Sentence on proven, unconfirmed effects, or ""."""
    if not found.small:
        return ""
    largest = sorted(found.small, key=lambda suspect: -suspect.size)
    scale = scale_of([suspect.size for suspect in largest], printable(found.unit))
    said = [f"{suspect.label} ({size_text(suspect, scale)})" for suspect in largest[:2]]
    more = f" and {len(largest) - 2} more" if len(largest) > 2 else ""
    return f"Proven, but not confirmed on unseen data: {', '.join(said)}{more}."


def moment_texts(low: Any, high: Any) -> list[str]:
    """Two dates, or two times since the start."""
    if isinstance(low, pd.Timestamp):
        return [str(moment.round("s")) for moment in (low, high)]
    return span_texts((low, high))


def when_text(suspect: Any) -> str:
    """When a suspect happened: a sentence, or ""."""
    spans = [f"between {' and '.join(moment_texts(low, high))}" for low, high in suspect.when]
    if not spans:
        return ""
    if isinstance(suspect.effect, Disturbance):
        return f"It began {spans[0]} and ended {spans[1]} (95 %)."
    more = f" and {len(spans) - MANY_MOMENTS} more" if len(spans) > MANY_MOMENTS else ""
    return f"It happened {', '.join(spans[:MANY_MOMENTS])}{more} (95 %{', each' if len(spans) > 1 else ''})."


_TO_LOG = (
    (600.0, "draughts, the supply voltage, the load"),
    (2 * 3600.0, "the air conditioning's switch, a fan, the mains load"),
    (12 * 3600.0, "a second thermometer (room, wall, meter), humidity, sunlight"),
    (36 * 3600.0, "daily cycles: sunlight, the mains load, people in the room, humidity"),
    (5 * 86_400.0, "weather: pressure and humidity; a second thermometer deep in the instrument"),
    (np.inf, "humidity (moisture is taken up for weeks), weekly activity, a second standard that ages differently"),
)


def left_sentences(left: Any, scale: Scale, verdict: str) -> list[str]:
    """Sentences on the residual and the record's limits.

    `scale` has the unit of every size, in the letters or in the signs of print.
    """
    said = []
    named = not (VERDICTS[verdict].calm or VERDICTS[verdict].unknown)
    what = "Given these causes, what" if named else "What"
    if left.structured:
        said.append(
            f"{what} is left wanders by {scale.text(left.wandering)}, with a correlation time of about "
            f"{span_text(left.correlation_time)}: {matters_text(left.matters_from)}."
        )
        if VERDICTS[verdict].in_doubt and not left.of_thermometers:
            to_log = next(text for limit, text in _TO_LOG if left.correlation_time <= limit)
            said.append(f"To learn its cause, log what changes as slowly: {to_log}.")
    elif left.rounding:
        said.append(
            "What is left is no more than the rounding of the reading, in steps of "
            f"{scale.text(left.rounding)}. Rounding follows the reading, so p-values mean nothing. Log more digits."
        )
    elif left.filtered and not left.absurd:
        said.append(
            f"What is left has a correlation time of {span_text(left.filtered)}, a few samples, and looks like white "
            "noise beyond. The instrument filters or averages, or something unrecorded changes as fast."
        )
    elif not left.absurd:
        said.append(f"{what} is left looks like white noise.")
    said += thermometer_sentences(left, scale)
    if left.copied and not VERDICTS[verdict].calm:
        said.append(
            f"What is left follows {', '.join(left.copied[:3])}, but copies of it shifted in time nearly as well: "
            "a few slow swings prove nothing. Record longer."
        )
    if left.absurd:
        said.append(
            f"A few readings dominate the residual: its rms is {left.tails:.2g} times its usual size. If they are "
            "invalid, they spoil the fit: find them in the residual, and leave them out (NaN, or mask=...)."
        )
    if left.spikes:
        said.append(
            f"{'At least ' if len(left.spikes) == 10 else ''}"
            f"{'one reading jumps' if len(left.spikes) == 1 else f'{len(left.spikes)} readings jump'} far out of the "
            f"noise, the farthest {span_text(left.spikes[0])} after the record began: the diagnosis leaves them out."
        )
    if left.loud:
        loud, more = left.loud[0], len(left.loud) - 1
        said.append(
            f"The noise is up to {loud.size:.2g} times as large as usual from {span_text(loud.start)} to "
            f"{span_text(loud.end)} after the record began{f', and in {more} more stretches' if more else ''}: these "
            "readings count less. If something happened then, leave them out of the fit (mask=...)."
        )
    sizes = {"a drift": left.smallest_drift, "a step": left.smallest_step}
    known = {what: size for what, size in sizes.items() if np.isfinite(size)}
    seen = [f"{what} of {scale.text(size, 2)}" for what, size in known.items()]
    if seen:
        said.append(f"This record could have shown {' or '.join(seen)}; smaller ones go unseen.")
    if left.drift_hides and not named:
        which = "a smaller drift than that" if np.isfinite(left.smallest_drift) else "a drift"
        said.append(
            f"The model can mimic a drift on this record: {which} would go unseen, and a forecast be wrong by as much. "
            "Record longer, through the same temperatures again."
        )
    if left.start_or:
        said.append(
            f"The model's start-up decay may as well be {' or '.join(left.start_or)}, which continues where a "
            "start-up ends, so a forecast may be wrong. A longer record distinguishes them."
        )
    return said


def thermometer_sentences(left: Any, scale: Scale) -> list[str]:
    """Sentences on thermometer errors and the gain."""
    said = []
    for row in each_row(left.thermometers):
        sizes = {"noise": (row.noise, row.noise_from), "steps": (row.resolution, row.resolution_from)}
        of_what = " and ".join(
            f"{what} of {quantity_text(v, row.unit)} ({how})" for what, (v, how) in sizes.items() if v
        )
        whose = f"the {of_what} of the thermometer {str(printable(row.thermometer))!r}"
        if left.of_thermometers and row.wandering:
            said.append(
                f"About as much, {scale.text(row.wandering)}, comes from {whose}. A finer "
                "thermometer, or the mean of several of its readings, would lower it."
            )
        # An error of the static gain of 0.2 % is worth a word.
        if abs(row.gain_error) >= 0.002:
            about = f"about {100 * float(f'{abs(row.gain_error):.1g}'):g}%"
            gain = f"is {about} too {'small' if row.gain_error < 0 else 'large'}"
            if row.resolution:
                far = about if row.gain_error < 1 else "as much as itself"
                gain = f"may be off by {far} (an estimate, not a limit)"
            said.append(
                f"Due to {whose}, the static gain {gain}. "
                "Readings are corrected as well as this thermometer allows; do not quote the gain itself."
            )
    return said


def share_of_samples(row: Any) -> float:
    """Share of the samples in a row of `Diagnosis.where`."""
    return float(row.share / row.lift) if row.lift else np.nan


def further_text(refinement: Any) -> str:
    """The effects that a refinement added, or ""."""
    if len(refinement.steps) < 2:
        return ""
    return ", ".join(effect_text(effect) for _, effect in as_effects(refinement.model_.effects)) or "further lags"


def worst_sentence(row: Any) -> str:
    """The first place of `Diagnosis.where`, for a printed page."""
    return (
        f"The model fails most {place_text(row)}: {row.share:.0%} of the error beyond the noise in "
        f"{share_of_samples(row):.0%} of the samples."
    )

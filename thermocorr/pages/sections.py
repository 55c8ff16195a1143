"""A diagnosis as sections of a page, in the order of the user's questions; sentences first, then figures."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd

from ..pictures.protocols import DiagnosisLike
from ..pictures.timeline import time_text
from ..pictures.words import aspect_text, each_row, effect_text, interval_text, left_sentences, place_text
from .data import PageData
from .figures import placed
from .html import (
    DASH,
    Safe,
    Section,
    bar,
    decibels,
    join,
    number,
    percent,
    plain,
    probability,
    table,
    tag,
    unit_text,
    with_unit,
)

SHOWN_PLACES = 8
"""Places of failure in the first table; the rest is folded."""

VERDICTS = {
    "nothing missing": "Nothing is missing: what is left looks like noise.",
    "missing": "Something is missing, and this record can tell what.",
    "ambiguous": "Something is missing, and this record cannot tell two explanations apart.",
    "unexplained": "Structure is left in the residual that no known effect explains by itself.",
}


def section(identity: str, title: str, *parts: Any) -> Section:
    """A section under a heading."""
    made = Section(tag("section", tag("h2", title), *parts, id=identity))
    made.identity, made.heading = identity, title
    return made


def parameters_text(effect: Any, data: PageData) -> str:
    """Parameters that have a unit, in words; moments of a record with dates as dates."""
    parts = []
    for name, unit in (effect.info.parameters if effect.info is not None else {}).items():
        value = getattr(effect, name)
        several = value if isinstance(value, list | tuple | np.ndarray) else [value]
        try:
            numbers = [float(item) for item in several]
        except (TypeError, ValueError):
            continue
        if not numbers:
            continue
        if name == "time" and data.start is not None:
            shown = [str(pd.Timestamp(data.start + number, unit="s").round("s")) for number in numbers]
        elif unit == "s":
            shown = [time_text(number) for number in numbers]
        else:
            if name in ("knee", "reference_temperature"):
                unit = data.temperature_unit
            shown = [f"{plain(v, 3)} {unit_text(unit)}" for v in numbers]
        parts.append(f"{name.replace('_', ' ').removesuffix('s' if len(several) == 1 else '')} {', '.join(shown)}")
    return "; ".join(parts)


def by_kind(effects: Sequence[Any]) -> list[Any]:
    """The first effect of each kind that says what it is."""
    return list({effect.kind: effect for effect in reversed(effects) if effect.info is not None}.values())[::-1]


def verdict_box(found: DiagnosisLike) -> Safe:
    """The verdict in a word and in a sentence."""
    named = "" if found.best is None else effect_text(found.best)
    said = VERDICTS.get(found.verdict, "")
    if named and found.suspects[0].standing == "helps":
        said = "One effect lowers the error on data that it was not learned from; that it is the cause is not proven."
    return tag(
        "p",
        tag("strong", found.verdict, class_="verdict", data_verdict=found.verdict),
        " ",
        said,
        join((" Most likely: ", tag("strong", named), ".")) if named else "",
        class_="verdict-line",
    )


def anything(found: DiagnosisLike, *figures: Any) -> Section:
    """1: residual against noise floor."""
    largest = max(found.residual_rms, found.noise_floor)
    rows = [
        (label, number(value, found.unit), bar(value / largest if largest else 0.0))
        for label, value in (("residual of the model", found.residual_rms), ("noise floor", found.noise_floor))
    ]
    return section(
        "anything",
        "1 Is anything missing?",
        verdict_box(found),
        tag(
            "p",
            "The residual has an rms of ",
            number(found.residual_rms, found.unit),
            "; the noise floor, which no effect can explain, is ",
            number(found.noise_floor, found.unit),
            " for one sample. ",
            percent(found.explainable),
            " of the residual's variance could still be explained.",
        ),
        tag("p", " ".join(left_sentences(found.left, found.unit, found.verdict))),
        table(("", "rms", ""), rows, "lrl"),
        *figures,
    )


def places(found: DiagnosisLike, data: PageData, *figures: Any) -> Section:
    """2: where the model fails."""
    where = found.where
    if not len(where):
        return section(
            "where",
            "2 Where does it fail?",
            tag("p", "Nowhere more than elsewhere: the error is evenly spread."),
            *figures,
        )
    sentence = _worst_sentence(found)
    shown = 0 if found.verdict == "nothing missing" else SHOWN_PLACES
    bands = where[where["aspect"] == "frequency"]
    longest = float(max(where["share"].drop(bands.index).max(), 1e-300))
    rows = [_place(row, longest, data) for row in each_row(where)]
    head = ("condition", "range", "share of the error", "", "times its share of samples", with_unit("rms", found.unit))
    folded = tag(
        "details",
        tag("summary", f"{len(rows) - shown} more places" if shown else f"{len(rows)} places"),
        table(head, rows[shown:], "llrlrr", "places"),
        class_="long",
    )
    return section(
        "where",
        "2 Where does it fail?",
        sentence,
        *figures,
        table(head, rows[:shown], "llrlrr", "places") if shown else "",
        folded if len(rows) > shown else "",
    )


def _worst_sentence(found: DiagnosisLike) -> Safe:
    """The worst place, and slow or fast."""
    where = found.where
    bars = "A bar is a place's share of the error beyond the noise; its mark is the place's share of the samples."
    if found.verdict == "nothing missing":
        return tag(
            "p",
            "Nowhere in particular: nothing is missing, and the little beyond the noise is where chance put it. ",
            bars,
        )
    worst = next(each_row(where))
    sentence = tag(
        "p",
        "It fails most ",
        tag("strong", place_text(worst)),
        ": ",
        percent(worst.share),
        " of the error beyond the noise lies in ",
        percent(worst.share / worst.lift),
        f" of the samples. {bars}",
    )
    bands = where[where["aspect"] == "frequency"]
    if not len(bands):
        return sentence
    band = bands.nlargest(1, "share").iloc[0]
    return join((sentence, tag("p", "Slow or fast: ", percent(band.share), f" of it has {interval_text(band)}.")))


def _place(row: Any, longest: float, data: PageData) -> tuple[Any, ...]:
    interval: Any = interval_text(row)
    scale = 1.0 if row.aspect == "frequency" else longest
    if row.aspect == "time":
        stretch = placed(data, row.low, row.high)
        if stretch is not None:
            interval = tag("button", interval, class_="show", type="button", data_from=stretch[0], data_to=stretch[1])
    return (
        aspect_text(row),
        interval,
        percent(row.share),
        bar(row.share / scale, row.share / row.lift / scale if row.lift else None),
        number(row.lift, digits=3),
        number(row.rms, digits=3),
    )


def suspects(found: DiagnosisLike, data: PageData) -> Section:
    """3: the ranking of suspects."""
    if not found.suspects:
        return section("what", "3 What is missing?", tag("p", "No suspect could be tried on this record."))
    lead = {
        "nothing missing": "Nothing that was tried: no suspect is worth adding.",
        "unexplained": "No suspect explains it. The first of those tried:",
    }.get(found.verdict, "The causes, what helps most on later data first; then what else was tried.")
    rows = [
        (
            join(
                (
                    tag("strong", effect_text(row.effect)),
                    tag("small", parameters_text(row.effect, data)),
                )
            ),
            percent(row.share),
            bar(row.share),
            row.standing or DASH,
            decibels(row.gain_db),
            decibels(row.later_db),
            probability(row.p_value),
            ", ".join(effect_text(effect) for effect in row.confusable_with) or DASH,
        )
        for row in found.suspects
    ]
    head = (
        "suspect",
        "explains of the structure",
        "",
        "standing",
        "gain, blocks",
        "gain, later",
        "error probability",
        "not told apart from",
    )
    physics = [
        tag("li", tag("strong", effect.kind.replace("_", " ")), ": ", effect.info.physics)
        for effect in by_kind([suspect.effect for suspect in found.suspects[:3]])
    ]
    listed = table(head, rows, "lrllrrrl", "suspects")
    if found.verdict == "nothing missing":
        listed = tag("details", tag("summary", f"The first {len(rows)} of those tried"), listed)
        physics = []
    return section(
        "what",
        "3 What is missing?",
        tag("p", lead),
        tag("ul", *physics) if physics else "",
        listed,
        tag(
            "p",
            "Error probabilities are those of the whole family of suspects, from likelihoods in which the noise may "
            f"wander; below {found.level:g} a cause is proven. A cause helps if the squared error falls by a decibel "
            "and more on later stretches learned from earlier ones and on held-out blocks, more than noise would do.",
            class_="fine",
        ),
    )


def cure(found: DiagnosisLike) -> Section:
    """4: the effect ready to be added, and the measurement that would confirm it or part rivals."""
    title = "4 What to do?"
    if found.best is None:
        advice = {
            "nothing missing": "Nothing. To go lower, lower the noise: average longer, or measure better.",
        }.get(
            found.verdict,
            "Record more of what may act on the instrument (supply, load, humidity, pressure, a second temperature), "
            "or longer, and diagnose again.",
        )
        return section("cure", title, tag("p", advice))
    steps = [tag("p", "Add the effect, and see whether the error falls on data that the fit did not see:")]
    steps.append(
        tag(
            "pre",
            tag(
                "code",
                f"effect = {found.best!r}\nbetter = model.with_effect(effect).fit(X, y)\n# or: refine(model, X, y)",
            ),
        )
    )
    rivals = [found.best, *(found.suspects[0].confusable_with if found.suspects else ())]
    checks = [
        tag("li", tag("strong", effect.kind.replace("_", " ")), ": ", effect.info.bench_check)
        for effect in by_kind(rivals)
    ]
    lead = (
        "Confirm it on the bench:"
        if len(checks) == 1
        else "Part them on the bench; each of these tells one from the rest:"
    )
    return section("cure", title, *steps, tag("p", lead), tag("ul", *checks))


def judged(found: DiagnosisLike, data: PageData, noise: Sequence[Any], time: Sequence[Any]) -> list[Section]:
    """The four questions; `noise` and `time` are figures for the first two."""
    return [anything(found, *noise), places(found, data, *time), suspects(found, data), cure(found)]

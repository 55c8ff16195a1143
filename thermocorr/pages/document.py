"""The page: one self-contained HTML file that needs no network."""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.resources import files
from typing import Any

from ..estimators.variants import VariantComparison
from ..pictures.intervals import stretches
from ..pictures.protocols import DiagnosisLike, RefinementLike
from . import chapters, figures
from .charts import Chart
from .data import PageData
from .html import DASH, Safe, Section, join, script_data, tag, text
from .sections import judged, section


@dataclass(frozen=True, kw_only=True)
class Findings:
    """What a page tells of a record beside the model that is kept, and how the page came about."""

    diagnosis: DiagnosisLike | None = None
    """Diagnosis of the first model; by default the refinement's first."""
    refinement: RefinementLike | None = None
    comparison: VariantComparison | None = None
    advice: str = ""
    """Whether the correction is shown to help on later data."""
    unjudged: str = ""
    """Why there is no diagnosis."""
    source: str = ""
    """File that the data came from."""
    command: str = ""
    """The command that made the page."""

    @property
    def first(self) -> DiagnosisLike | None:
        """Diagnosis of the first model."""
        if self.diagnosis is None and self.refinement is not None:
            return self.refinement.diagnoses[0]
        return self.diagnosis

    @property
    def last(self) -> DiagnosisLike | None:
        """Diagnosis of the model that is kept."""
        return self.diagnosis if self.refinement is None else self.refinement.diagnoses[-1]


def page(data: PageData, findings: Findings) -> str:
    """The whole page as HTML; `data` are those of the model that is kept, on the record."""
    diagnosis, refinement = findings.first, findings.refinement
    charts: list[Chart] = []
    body: list[Section] = []
    if diagnosis is not None:
        first = diagnosis.data or data
        series = figures.series(first, diagnosis.noise_floor, stretches(diagnosis, first.timeline))
        noise = [chart for chart in (figures.stability(first), figures.spectrum(diagnosis)) if chart is not None]
        time = [chart for chart in (series, figures.loop(first)) if chart is not None]
        charts += [*noise, *time]
        body += judged(diagnosis, first, [chart.html() for chart in noise], [chart.html() for chart in time])
    else:
        series = figures.series(data)
        charts.append(series)
        reason = tag("p", findings.unjudged) if findings.unjudged else ""
        body.append(section("record", "The record", reason, series.html()))
    numbers = iter(range(5 if diagnosis is not None else 1, 99))
    if refinement is not None:
        before = refinement.diagnoses[0].data
        drawn: list[Chart] = []
        if len(refinement.diagnoses) > 1 and before is not None and diagnosis is refinement.diagnoses[0]:
            drawn.append(figures.refined(before, data, refinement.diagnoses[-1].noise_floor))
        charts += drawn
        title = f"{next(numbers)} The error, step by step"
        body.append(chapters.steps(refinement, title, *(chart.html() for chart in drawn)))
    if findings.comparison is not None:
        body.append(chapters.variants(findings.comparison, f"{next(numbers)} Static and dynamic, linear and nonlinear"))
    after = figures.following(data)
    charts += [] if after is None else [after]
    body += [
        chapters.formula(data, f"{next(numbers)} The model", *([] if after is None else [after.html()])),
        chapters.quality(data, f"{next(numbers)} The data"),
        chapters.provenance(data, f"{next(numbers)} Versions", findings.command, findings.source),
    ]
    leads: list[Any] = [*([findings.advice] if findings.advice else []), data.record_sentence()]
    if refinement is not None and len(refinement.steps) > 1:
        leads.append(chapters.in_short(refinement))
    return document(f"Thermal bias of {data.reading}", leads, body, charts)


def document(title: str, leads: Sequence[Any], body: Sequence[Section], charts: Sequence[Chart]) -> str:
    """Head, body and scripts. A policy in the head lets nothing run or load but what is written here."""
    styles = asset("uplot.min.css") + asset("page.css")
    scripts = [asset("uplot.min.js"), asset("page.js")]
    hashes = " ".join(f"'sha256-{digest(script)}'" for script in scripts)
    policy = f"default-src 'none'; style-src 'unsafe-inline'; img-src data:; script-src {hashes}"
    head = tag(
        "head",
        Safe('<meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">'),
        Safe(f'<meta http-equiv="Content-Security-Policy" content="{text(policy)}">'),
        Safe('<meta name="color-scheme" content="light dark"><meta name="generator" content="thermocorr">'),
        tag("title", f"{title} {DASH} thermocorr"),
        Safe(f"<style>{styles}</style>"),
    )
    links = [tag("li", tag("a", part.heading, href=f"#{part.identity}")) for part in body]
    inner = tag(
        "body",
        tag(
            "header",
            tag("h1", title),
            *(tag("p", lead, class_="lead") for lead in leads),
            tag("nav", tag("ol", *links)),
        ),
        tag("main", *body),
        tag("noscript", tag("p", "The charts need JavaScript; the tables do not.")),
        script_data("charts", [chart.payload() for chart in charts]),
        join([Safe(f"<script>{script}</script>") for script in scripts]),
    )
    return f'<!DOCTYPE html>\n<html lang="en">{head}{inner}</html>\n'


def asset(name: str) -> str:
    """A file of ``assets``."""
    return files(__package__).joinpath("assets", name).read_text(encoding="utf-8")


def digest(script: str) -> str:
    """SHA-256 of a script, as a content security policy writes it."""
    return base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()

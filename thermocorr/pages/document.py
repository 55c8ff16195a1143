"""The page: one self-contained HTML file that needs no network."""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from os import PathLike
from typing import Any

from markupsafe import Markup

from ..estimators.variants import VariantComparison
from ..files import write_file
from ..pictures.axes import stretches
from ..pictures.words import DiagnosisLike, RefinementLike, kept_sentence
from . import chapters as chapters
from . import figures
from .chapters import brief_diagnosis, brief_refinement, judged
from .charts import Chart, places
from .data import PageData
from .html import Section, asset, rendered, script_data, section, with_signs


@dataclass(frozen=True, kw_only=True)
class Findings:
    """What a page tells of a record beside the model that is kept, and how the page came about."""

    diagnosis: DiagnosisLike | None = None
    """Diagnosis of the first model; by default the refinement's first."""
    refinement: RefinementLike | None = None
    comparison: VariantComparison | None = None
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
        body += judged(diagnosis, first, places(noise), places(time), refinement)
    else:
        series = figures.series(data)
        charts.append(series)
        body.append(section("record", "The record", unjudged=findings.unjudged, figures=series.html()))
    numbers = iter(range(5 if diagnosis is not None else 1, 99))
    if refinement is not None:
        before = refinement.diagnoses[0].data
        drawn: list[Chart] = []
        if len(refinement.diagnoses) > 1 and before is not None and diagnosis is refinement.diagnoses[0]:
            drawn.append(figures.refined(before, data, refinement.diagnoses[-1].noise_floor))
        charts += drawn
        body.append(chapters.steps(refinement, f"{next(numbers)} The error, step by step", places(drawn)))
    if findings.comparison is not None:
        body.append(chapters.variants(findings.comparison, f"{next(numbers)} Static and dynamic, linear and nonlinear"))
    after = [chart for chart in [figures.following(data)] if chart is not None]
    charts += after
    body += [
        chapters.formula(data, f"{next(numbers)} The model", places(after)),
        chapters.quality(data, f"{next(numbers)} The data"),
        chapters.provenance(data, f"{next(numbers)} Versions", findings.command, findings.source),
    ]
    return document(f"Thermal bias of {data.reading}", leads(data, findings), body, charts)


def leads(data: PageData, findings: Findings) -> list[Any]:
    """What stands above everything: what the model to use is worth on later data, and what the record is."""
    refinement = findings.refinement
    advice = None if findings.comparison is None else findings.comparison.advice
    used = "" if refinement is None else kept_sentence(refinement, advice)
    advised = "" if advice is None else advice.sentence()
    if used and advised:
        advised = f"(Before that: {advised})"
    said: list[Any] = [*map(with_signs, filter(None, (used, advised))), *data.warnings, data.record_sentence()]
    if refinement is not None and len(refinement.steps) > 1:
        said.append(chapters.in_short(refinement))
    return said


def document(title: str, leads: Sequence[Any], body: Sequence[Section], charts: Sequence[Chart]) -> str:
    """Head, body and scripts. A policy in the head lets nothing run or load but what is written here."""
    scripts = [asset("uplot.min.js"), asset("charts.js") + asset("page.js")]
    hashes = " ".join(f"'sha256-{digest(script)}'" for script in scripts)
    return rendered(
        "page",
        title=title,
        policy=f"default-src 'none'; style-src 'unsafe-inline'; img-src data:; script-src {hashes}",
        styles=Markup(asset("uplot.min.css") + asset("colours.css") + asset("page.css")),
        leads=leads,
        body=body,
        charts=script_data([chart.payload() for chart in charts]),
        scripts=[Markup(script) for script in scripts],
    )


def digest(script: str) -> str:
    """SHA-256 of a script, as a content security policy writes it."""
    return base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()


class Page:
    """Base of what can be shown as a page."""

    def to_html(self, *, source: str = "", command: str = "") -> str:
        """One self-contained HTML page that needs no network; `source` and `command` are named at its end."""
        raise NotImplementedError

    def save_html(self, path: str | PathLike[str], *, source: str = "", command: str = "", force: bool = False) -> None:
        """Write `to_html` to a file; OutputError for one that thermocorr did not write, unless forced."""
        write_file(path, self.to_html(source=source, command=command), force=force)


class DiagnosisPage(Page):
    """Page of a `Diagnosis`."""

    def to_html(self: DiagnosisLike, *, source: str = "", command: str = "") -> str:
        """One self-contained HTML page that needs no network; `source` and `command` are named at its end."""
        if self.data is None:
            raise ValueError("This diagnosis holds no data to draw. Make it with diagnose(model, X, y).")
        return page(self.data, Findings(diagnosis=self, source=source, command=command))

    def _repr_html_(self: DiagnosisLike) -> str:
        return brief_diagnosis(self)


class RefinementPage(Page):
    """Page of a `Refinement`: its last model's, with the diagnosis of the first."""

    def to_html(self: RefinementLike, *, source: str = "", command: str = "") -> str:
        """One self-contained HTML page that needs no network; `source` and `command` are named at its end."""
        data = self.diagnoses[-1].data
        if data is None:
            raise ValueError("This refinement holds no data to draw. Make it with refine(model, X, y).")
        return page(data, Findings(refinement=self, source=source, command=command))

    def _repr_html_(self: RefinementLike) -> str:
        return brief_refinement(self)

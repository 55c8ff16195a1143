"""The page: one self-contained HTML file that needs no network."""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Sequence
from os import PathLike
from typing import Any

from markupsafe import Markup

from ..displays.axes import stretches
from ..files import write_file
from . import chapters, figures
from .answer import Answer
from .chapters import brief_diagnosis, brief_refinement
from .charts import Chart, places
from .data import PageData
from .html import Section, asset, rendered, script_data, section, with_signs


def page(data: PageData, answer: Answer) -> str:
    """The whole page as HTML; `data` are those of the model that is kept, on the record."""
    found, refinement = answer.last, answer.refinement
    numbers = iter(range(1, 99))
    charts: list[Chart] = []
    body: list[Section] = []

    def titled(title: str) -> str:
        return f"{next(numbers)} {title}"

    if answer.advised is not None or answer.refined:
        body.append(chapters.which(answer, titled("Which correction?")))
    if found is not None:
        own = found.data or data
        series = figures.series(own, found.noise_floor, stretches(found, own.timeline))
        noise = [chart for chart in (figures.stability(own), figures.spectrum(found)) if chart is not None]
        charts += [*noise, series]
        body += [
            chapters.anything(found, titled("Is anything missing?"), places(noise)),
            chapters.where(found, titled("Where does it fail?"), own, places([series])),
            chapters.what(found, titled("What is missing?"), own),
            chapters.cure(found, titled("What to do?")),
        ]
    else:
        series = figures.series(data)
        charts.append(series)
        body.append(section("record", "The record", unjudged=answer.unjudged, figures=series.html()))
    after = [chart for chart in [figures.following(data)] if chart is not None]
    body += [chapters.formula(data, titled("The model"), places(after)), chapters.quality(data, titled("The data"))]
    charts += after
    if refinement is not None:
        before = refinement.diagnoses[0].data
        drawn: list[Chart] = []
        if answer.refined and before is not None:
            drawn.append(figures.refined(before, data, refinement.diagnoses[-1].noise_floor))
        charts += drawn
        body.append(chapters.steps(refinement, titled("How the model came about"), places(drawn)))
    if answer.comparison is not None:
        body.append(chapters.variants(answer.comparison, titled("Static and dynamic, linear and nonlinear")))
    body.append(chapters.provenance(data, titled("Versions"), answer.command, answer.source))
    return document(f"Thermal bias of {data.reading}", leads(data, answer), body, charts)


def leads(data: PageData, answer: Answer) -> list[Any]:
    """Head of the page: which correction to use, its error, and the record."""
    return [*filter(None, [with_signs(answer.sentence())]), *data.warnings, data.record_sentence()]


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
        """Write `to_html` to a file; OutputError for one that is there already, unless forced."""
        write_file(path, self.to_html(source=source, command=command), force=force)


class DiagnosisPage(Page):
    """Page of a `Diagnosis`."""

    def to_html(self: Any, *, source: str = "", command: str = "") -> str:
        """One self-contained HTML page that needs no network; `source` and `command` are named at its end."""
        if self.data is None:
            raise ValueError("This diagnosis holds no data to draw. Make it with diagnose(model, X, y).")
        return page(self.data, Answer(diagnosis=self, source=source, command=command))

    def _repr_html_(self: Any) -> str:
        return brief_diagnosis(self)


class RefinementPage(Page):
    """Page of a `Refinement`: its last model's, with the diagnosis of the first."""

    def to_html(self: Any, *, source: str = "", command: str = "") -> str:
        """One self-contained HTML page that needs no network; `source` and `command` are named at its end."""
        data = self.diagnoses[-1].data
        if data is None:
            raise ValueError("This refinement holds no data to draw. Make it with refine(model, X, y).")
        return page(data, Answer(refinement=self, source=source, command=command))

    def _repr_html_(self: Any) -> str:
        return brief_refinement(self)

"""What a diagnosis and a refinement can do with a page: `to_html`, `save_html`, and the short form of notebooks."""

from __future__ import annotations

from os import PathLike

from ..files import write_file
from ..pictures.words import DiagnosisLike, RefinementLike
from .chapters import brief_diagnosis, brief_refinement
from .document import Findings, page


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

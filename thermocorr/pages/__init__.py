"""A diagnosis, a refinement or a fitted model as one self-contained HTML page, and in short for notebooks."""

from .data import PageData
from .document import DiagnosisPage, Findings, RefinementPage, page

__all__ = ["DiagnosisPage", "Findings", "PageData", "RefinementPage", "page"]

"""A diagnosis, a refinement or a fitted model as one self-contained HTML page, and in short for notebooks."""

from .data import PageData
from .document import Findings, page
from .shown import DiagnosisPage, RefinementPage

__all__ = ["DiagnosisPage", "Findings", "PageData", "RefinementPage", "page"]

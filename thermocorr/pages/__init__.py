"""A diagnosis, a refinement or a fitted model as one self-contained HTML page, and in short for notebooks."""

from .answer import Answer
from .data import PageData
from .document import DiagnosisPage, RefinementPage, page

__all__ = ["Answer", "DiagnosisPage", "PageData", "RefinementPage", "page"]

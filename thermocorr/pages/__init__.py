"""A diagnosis, a refinement or a fitted model as one self-contained HTML page, and in short for notebooks."""

from .data import PageData
from .document import page
from .shown import DiagnosisPage, RefinementPage

__all__ = ["DiagnosisPage", "PageData", "RefinementPage", "page"]

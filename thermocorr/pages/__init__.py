"""A diagnosis, a refinement or a fitted model as one self-contained HTML page, and in short for notebooks."""

from .answer import Answer
from .report import DiagnosisPage, RefinementPage, report_text, write_report

__all__ = ["Answer", "DiagnosisPage", "RefinementPage", "report_text", "write_report"]

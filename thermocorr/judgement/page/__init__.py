"""A diagnosis, a refinement or a fitted model as one self-contained HTML page, and in short for notebooks."""

from .brief import brief_diagnosis, brief_refinement
from .data import PageData
from .document import page

__all__ = ["PageData", "brief_diagnosis", "brief_refinement", "page"]

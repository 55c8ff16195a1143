"""Judgement: what is missing, where, and its refinement."""

from .diagnose import diagnose
from .refine import Refinement, refine
from .report import Diagnosis, FoundSuspect, Left

__all__ = ["Diagnosis", "FoundSuspect", "Left", "Refinement", "diagnose", "refine"]

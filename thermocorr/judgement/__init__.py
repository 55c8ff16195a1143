"""Floor 6: judgement: what is missing in a model, where it fails, its refinement."""

from .diagnose import diagnose
from .refine import Refinement, refine
from .report import Diagnosis, FoundSuspect, Left

__all__ = ["Diagnosis", "FoundSuspect", "Left", "Refinement", "diagnose", "refine"]

"""Floor 6: judgement: what is missing in a model, where it fails, its refinement."""

from .diagnosis import diagnose
from .found import Diagnosis, FoundSuspect
from .left import Left
from .refine import Refinement, refine

__all__ = ["Diagnosis", "FoundSuspect", "Left", "Refinement", "diagnose", "refine"]

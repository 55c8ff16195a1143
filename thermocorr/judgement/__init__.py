"""Floor 6: judgement: what is missing in a model, where it fails, its refinement."""

from .diagnosis import Diagnosis, diagnose
from .refinement import Refinement, refine

__all__ = ["Diagnosis", "Refinement", "diagnose", "refine"]

"""Judgement: what is missing, where, and its refinement."""

from .diagnose import diagnose
from .propose import Proposal, calibration_profile, propose
from .refine import Refinement, refine
from .report import Diagnosis, FoundSuspect, Left

__all__ = [
    "Diagnosis",
    "FoundSuspect",
    "Left",
    "Proposal",
    "Refinement",
    "calibration_profile",
    "diagnose",
    "propose",
    "refine",
]

"""Floor 5: a fitted model on a running stream."""

from .corrector import OnlineCorrector
from .given import Corrected

__all__ = ["Corrected", "OnlineCorrector"]

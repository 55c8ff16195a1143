"""A fitted model on a running stream."""

from .corrector import OnlineCorrector
from .samples import Corrected

__all__ = ["Corrected", "OnlineCorrector"]

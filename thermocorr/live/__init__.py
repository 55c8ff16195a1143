"""Floor 5: a fitted model on a running stream."""

from .corrector import Corrected, OnlineCorrector

__all__ = ["Corrected", "OnlineCorrector"]

"""Floor 1: logs as other programs write them, understood: their separators, decimal commas, dates and headers."""

from .how import ForeignTable, HowToRead
from .roles import RUN, Roles, guess, time_of
from .several import as_runs, joined, read_log, read_logs
from .timed import with_times

__all__ = [
    "RUN",
    "ForeignTable",
    "HowToRead",
    "Roles",
    "as_runs",
    "guess",
    "joined",
    "read_log",
    "read_logs",
    "time_of",
    "with_times",
]

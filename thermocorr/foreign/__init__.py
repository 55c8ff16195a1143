"""Floor 1: logs as other programs write them, understood: their separators, decimal commas, dates and headers."""

from .how import ForeignTable, HowToRead
from .several import RUN, as_runs, joined, read_log, read_logs
from .timed import with_times

__all__ = ["RUN", "ForeignTable", "HowToRead", "as_runs", "joined", "read_log", "read_logs", "with_times"]

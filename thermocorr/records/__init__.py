"""From frames and arrays to times, segments and columns."""

from .errors import RecordError, RecordWarning
from .history import History
from .read import Layout, read_record
from .record import BLOCK_ROWS, Block, Record, Segment, SegmentStart
from .times import seconds_of

__all__ = [
    "BLOCK_ROWS",
    "Block",
    "History",
    "Layout",
    "Record",
    "RecordError",
    "RecordWarning",
    "Segment",
    "SegmentStart",
    "read_record",
    "seconds_of",
]

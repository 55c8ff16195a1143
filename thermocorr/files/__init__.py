"""Files: the one writer of everything that thermocorr writes, and the marks by which it knows its own files."""

from .writer import AppendedFile, OutputError, Outputs, write_file

__all__ = ["AppendedFile", "OutputError", "Outputs", "write_file"]

"""Files: the one writer of everything that thermocorr writes, the model file, results."""

from .writer import OutputError, Outputs, write_file

__all__ = ["OutputError", "Outputs", "write_file"]

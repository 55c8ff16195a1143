"""What an export costs on the device, and where its files are."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from ..records.text import printable
from .operations import Operations


@dataclass(frozen=True)
class FirmwareExport:
    """Files of an export and what the code needs: memory in bytes, operations for one sample."""

    name: str
    """Prefix of the names that the code shows."""
    dtype: str
    sampling_period: float | None
    """[s]; None where each update is told its step."""
    paths: tuple[Path, ...]
    """Header, source, self-test."""
    columns: tuple[object, ...]
    """Recorded columns in the order in which `update` takes them."""
    state_bytes: int
    """Size of the state on a 32-bit Arm."""
    constant_bytes: int
    """Numbers in flash; the code itself comes on top, see `arm-none-eabi-size`."""
    operations: Operations
    """Counted in the statements of the update, the larger number of each kind where there are two branches."""
    kept: tuple[str, ...]
    """Effects of the model that `correct` does not remove, and the code neither."""

    def frame(self) -> pd.DataFrame:
        """The costs as a table: one row for each, `value` and `unit`."""
        o = self.operations
        rows = {
            "RAM: state": (self.state_bytes, "bytes"),
            "flash: constants": (self.constant_bytes, "bytes"),
            "multiply-adds": (o.multiply_adds, "per sample"),
            "further additions": (o.adds, "per sample"),
            "divisions": (o.divisions, "per sample"),
            "calls of libm": (o.calls, "per sample"),
        }
        return pd.DataFrame.from_dict(rows, orient="index", columns=["value", "unit"]).rename_axis("cost")

    def __str__(self) -> str:
        step = "steps given to update" if self.sampling_period is None else f"every {self.sampling_period:.10g} s"
        lines = [f"{self.name}: {self.dtype}, {step}", *(f"  {path}" for path in self.paths)]
        lines += [f"  {name:<20}{value:>8} {unit}" for name, value, unit in self.frame().itertuples()]
        if self.columns:
            lines.append(f"  columns: {', '.join(map(printable, self.columns))}")
        if self.kept:
            lines.append(f"  kept in the corrected reading: {', '.join(map(printable, self.kept))}")
        return "\n".join(lines)

"""A finished program: its flags, costs and provenance."""

from __future__ import annotations

import platform
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from ..records.errors import printable
from .guard import Guard
from .program import Member, Program, TimeCounter
from .statements import Operations
from .target import Target


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
    """Counted in the statements of the update, the larger number of each kind where there are two branches; twice as
    many while inputs are doubted."""
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


def provenance(model: Any, target: Target, effects: list[Any]) -> list[str]:
    """Lines of the header's first comment."""
    from .._version import __version__

    lines = [f"{target.name}: dynamic thermal bias, corrected sample by sample. Made by thermocorr {__version__}"]
    lines[0] += f" (Python {platform.python_version()}, numpy {np.__version__}); do not edit."
    lines.append("")
    reading, history = model.reading_, target.history
    lines.append(f"Reading: {reading.name} [{reading.unit or 'its own unit'}], mean {reading.mean:.10g}")
    lines.append(f"Fitted readings: {reading.n_readings}")
    low, high = reading.temperature_range
    unit = reading.temperature_unit + (
        "" if reading.unit_named else ", as its values have it: the record named no unit"
    )
    lines.append(f"Temperature: {target.temperature_name}, fitted from {low:.6g} to {high:.6g} {unit}")
    of = "U0, reading" if model.features_.reference is None else "U0, part of the bias, of an error"
    lines.append(f"{of} at the reference temperature {model.reference_temperature_:.10g}: {model.intercept_:.17g}")
    first, last = (history.record.times.label(row) for row in (0, history.record.segments[-1].stop - 1))
    lines.append(f"Fitted rows: {history.n_fitted}, from {first} to {last}")
    lines.append(f"Their usual step: {history.usual_step:.10g} s")
    taus = ", ".join(f"{tau:.6g}" for tau in model.time_constants_)
    lines.append(f"Time constants: {taus or 'none'} s")
    lines.append(f"Standard deviation of the fitted residuals: {model.residual_std_:.6g}")
    lines.append(f"Effects removed: {'; '.join(e.label() for e in effects if e.removed_by_correct) or 'none'}")
    kept = "; ".join(e.label() for e in effects if not e.removed_by_correct)
    lines.append(f"Effects kept in the corrected reading: {kept or 'none'}")
    step = "given to each update" if target.period is None else f"{target.period:.17g} s, fixed"
    lines.append(f"Time between samples: {step}")
    lines.append("State after init: unknown, taken to be at rest")
    lines.append(f"Flagged after it, while the lags forget: {float(model.washout_):.6g} s")
    return lines


FLAGS = (
    ("NO_TEMPERATURE", "temperature missing or absurd: the last good one was taken"),
    ("NO_COLUMN", "a recorded column missing or absurd: its last good value was taken"),
    ("NO_READING", "reading missing or not finite: no corrected reading"),
    ("WASHOUT", "the lags have not yet forgotten an unknown start"),
    ("OUTSIDE_RANGE", "temperature outside the fitted range: the bias is extrapolated"),
    ("NOT_STARTED", "no sample with all inputs yet: nothing is corrected"),
    ("BAD_STEP", "step of zero or longer than three years: the sample was left out"),
    ("JUMP", "an input moves faster than it ever did: the value before stands in its place"),
    ("DOUBTFUL", "inputs that jump or stand still, now or before, may move the bias by more than the noise"),
)


class Firmware:
    """A program that is ready to become text."""

    def __init__(
        self,
        program: Program,
        clock: TimeCounter,
        limits: tuple[float, float],
        guard: Guard,
        gaps: tuple[tuple[float, float], ...],
    ):
        self.program, self.clock, self.target, self.guard = program, clock, program.target, guard
        self.limits = limits
        """Lowest and highest fitted temperature."""
        self.gaps = gaps
        """Stretches between these in which the static law is not known."""
        self.bias_constant = program.constant("bias_at_reference", program.bias_constant, "sum of all constant terms")

    def members(self) -> list[Member]:
        """Members of the state of one course, those of eight bytes first: no padding between them."""
        program = self.program
        members = [Member("number", "temperature", None, "at the last sample"), *program.members]
        if program.columns:
            members.insert(1, Member("number", "column", len(program.columns), "recorded columns at the last sample"))
        members.append(Member("uint32", "started", None, "0 until the first usable sample"))
        return sorted(members, key=lambda member: -self.target.bytes_of(member.kind))

    @property
    def state_bytes(self) -> int:
        """Size of the state: two courses and what the gates remember."""
        courses, widest = self._padded(self.members())
        gates, _ = self._padded(self.guard.members())
        return -(-(2 * courses + gates) // widest) * widest

    def _padded(self, members: list[Member]) -> tuple[int, int]:
        """Size of some members, padded at their end, and of the widest."""
        sizes = [(self.target.bytes_of(member.kind), member.length or 1) for member in members]
        widest = max(size for size, _ in sizes)
        return -(-sum(size * length for size, length in sizes) // widest) * widest, widest

    @property
    def constant_bytes(self) -> int:
        """Constants and tables; small helpers and code come on top."""
        return self.target.bytes_of("number") * sum(len(constant.values) for constant in self.program.constants)

    @property
    def operations(self) -> Operations:
        """Operations of one update, the larger number of each kind where there are two branches.

        While inputs are doubted there are two courses, and twice as many.
        """
        staged = [block for stage in self.program.stages for block in (stage.locals, stage.advance)]
        blocks = [*staged, self.program.output, self.program.store]
        return sum((block.cost for block in blocks), Operations(adds=1) + self.guard.cost)  # reading - bias

    def flags(self) -> list[tuple[str, int, str]]:
        """Flags that this program can raise: name, bit, meaning."""
        absent = set() if self.program.columns else {"NO_COLUMN"}
        if not self.program.flags_washout:
            absent.add("WASHOUT")
        if self.target.fixed:
            absent.add("BAD_STEP")
        if not self.guard.motions:
            absent |= {"JUMP", "DOUBTFUL"}
        return [(name, 1 << i, text) for i, (name, text) in enumerate(FLAGS) if name not in absent]

    @property
    def asks_start(self) -> bool:
        """True if `init` must be told when the first sample is: samples or microseconds from the first fitted row."""
        return self.clock.used

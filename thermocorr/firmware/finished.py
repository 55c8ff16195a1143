"""A program that all effects have written to: its state, flags and costs, which every language prints."""

from __future__ import annotations

from .counter import TimeCounter
from .operations import Operations
from .program import Member, Program

FLAGS = (
    ("NO_TEMPERATURE", "temperature missing or absurd: the last good one was taken"),
    ("NO_COLUMN", "a recorded column missing or absurd: its last good value was taken"),
    ("NO_READING", "reading missing or not finite: no corrected reading"),
    ("WASHOUT", "the lags have not yet forgotten an unknown start"),
    ("OUTSIDE_RANGE", "temperature outside the fitted range: the bias is extrapolated"),
    ("NOT_STARTED", "no sample with all inputs yet: nothing is corrected"),
    ("BAD_STEP", "step of zero or longer than three years: the sample was left out"),
)


class Firmware:
    """A program that is ready to become text."""

    def __init__(self, program: Program, clock: TimeCounter, limits: tuple[float, float]):
        self.program, self.clock, self.target = program, clock, program.target
        self.limits = limits
        """Lowest and highest fitted temperature."""
        self.bias_constant = program.constant("bias_at_reference", program.bias_constant, "sum of all constant terms")

    def members(self) -> list[Member]:
        """Members of the state, those of eight bytes first, so that nothing is lost between them."""
        program = self.program
        members = [Member("number", "temperature", None, "at the last sample"), *program.members]
        if program.columns:
            members.insert(1, Member("number", "column", len(program.columns), "recorded columns at the last sample"))
        members.append(Member("uint32", "started", None, "0 until the first usable sample"))
        return sorted(members, key=lambda member: -self.target.bytes_of(member.kind))

    @property
    def state_bytes(self) -> int:
        """Size of the state, padded at its end."""
        sizes = [(self.target.bytes_of(member.kind), member.length or 1) for member in self.members()]
        widest = max(size for size, _ in sizes)
        return -(-sum(size * length for size, length in sizes) // widest) * widest

    @property
    def constant_bytes(self) -> int:
        """Constants and tables; small helpers and code come on top."""
        return self.target.bytes_of("number") * sum(len(constant.values) for constant in self.program.constants)

    @property
    def operations(self) -> Operations:
        """Operations of one update, the larger number of each kind where there are two branches."""
        staged = [block for stage in self.program.stages for block in (stage.locals, stage.advance)]
        blocks = [*staged, self.program.output, self.program.store]
        return sum((block.cost for block in blocks), Operations(adds=1))  # reading - bias

    def flags(self) -> list[tuple[str, int, str]]:
        """Flags that this program can raise: name, bit, meaning."""
        absent = set() if self.program.columns else {"NO_COLUMN"}
        if not self.program.flags_washout:
            absent.add("WASHOUT")
        if self.target.fixed:
            absent.add("BAD_STEP")
        return [(name, 1 << i, text) for i, (name, text) in enumerate(FLAGS) if name not in absent]

    @property
    def asks_start(self) -> bool:
        """Whether `init` must be told when the first sample is: samples or microseconds from the first fitted row."""
        return self.clock.used and not self.target.continues

"""What the texts of a finished program share: state, flags, signatures, costs."""

from __future__ import annotations

from .counter import TimeCounter
from .language import Operations
from .program import BYTES, Member, Program

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
    """A program that all effects have written to, ready to become text."""

    def __init__(self, program: Program, clock: TimeCounter, limits: tuple[float, float]):
        self.program, self.clock, self.target = program, clock, program.target
        self.limits = limits
        """Lowest and highest fitted temperature."""
        self.bias_constant = program.constant("bias_at_reference", program.bias_constant, "sum of all constant terms")
        program.close.add("result.corrected = reading - bias;", cost=Operations(adds=1))

    def members(self) -> list[Member]:
        """Members of the state, those of eight bytes first, so that nothing is lost between them."""
        program, T = self.program, self.target.dtype
        members = [Member(T, "temperature", None, "at the last sample"), *program.members]
        if program.columns:
            members.insert(1, Member(T, "column", len(program.columns), "recorded columns at the last sample"))
        members.append(Member("uint32_t", "started", None, "0 until the first usable sample"))
        return sorted(members, key=lambda member: -BYTES[member.ctype])

    @property
    def state_bytes(self) -> int:
        """Size of the state, padded at its end."""
        members = self.members()
        widest = max(BYTES[member.ctype] for member in members)
        return -(-sum(member.size for member in members) // widest) * widest

    @property
    def constant_bytes(self) -> int:
        """Constants and tables; small helpers and code come on top."""
        return BYTES[self.target.dtype] * sum(len(constant.values) for constant in self.program.constants)

    def flags(self) -> list[tuple[str, int, str]]:
        """Flags that this program can raise: name, bit, meaning."""
        absent = set() if self.program.columns else {"NO_COLUMN"}
        if not self.program.flags_washout:
            absent.add("WASHOUT")
        if self.target.fixed:
            absent.add("BAD_STEP")
        return [(name, 1 << i, text) for i, (name, text) in enumerate(FLAGS) if name not in absent]

    def init_signature(self) -> str:
        """Signature of the function that starts a device."""
        start = f", {self.clock.counter_type} start" if self.clock.used and not self.target.continues else ""
        return f"void {self.target.name}_init({self.target.name}_state *s{start})"

    def update_signature(self) -> str:
        """Signature of the function that takes a sample."""
        name, T = self.target.name, self.target.dtype
        step = "" if self.target.fixed else "uint64_t step_us, "
        columns = f", const {T} *columns" if self.program.columns else ""
        return f"{name}_result {name}_update({name}_state *s, {step}{T} temperature, {T} reading{columns})"

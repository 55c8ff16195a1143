"""The gate of the inputs, sample by sample, around a program's course: `thermocorr.records.gate` on a device."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..records.gate import AGREED, BELIEVED, BELIEVED_AGAIN, DOUBTED, Motion
from .program import Member, Program
from .statements import (
    TURN,
    Assign,
    Bias,
    Bracketed,
    Call,
    Choice,
    Converted,
    Declare,
    Finish,
    Follow,
    Fork,
    Formula,
    If,
    Kept,
    Largest,
    Local,
    Loop,
    Number,
    Operations,
    Raise,
    Statement,
    Unary,
    Variable,
    Whole,
    behind,
    binary,
)
from .target import LONGEST_STEP_US, MICROSECONDS

_KEPT = {
    "last": "the last value of each input that was believed",
    "known": "1 where there is one",
    "passed": "usual steps since then",
    "rest": "usual steps for which it has stood still",
    "odd": "how far a value that is held back lies away",
    "doubt": "1 where it is doubted",
    "level": "the last value before a doubt",
    "age": "usual steps since then",
    "away_for": "the same with pauses left out",
    "stands": "0 where the courses agree, 1 where it is doubted, 2 where it was believed again",
}
_STEP, _HELD, _JUMPED, _DOUBTED = map(Variable, ("steps", "held", "jumped", "doubted"))
_GIVEN, _OTHER = Variable("given"), Variable("other")
_APART, _QUIET = map(Kept, ("apart", "quiet"))
COST = Operations.of(products=1, sums=3)
"""Cost of judging one input that moves as usual."""


class Guard:
    """The gates of a program's inputs: the temperature, and its columns.

    `motions` (sequence of Motion): How each moved in the fit; empty where nothing is refused. `deviation`
    (float): Standard deviation of the residuals. `memory` (float): How long the effects remember [s].
    """

    def __init__(self, program: Program, motions: Sequence[Motion], deviation: float, memory: float):
        self.program, self.motions, self.deviation, self.memory = program, motions, deviation, memory
        held = program.target.held
        columns = [(m.low, m.high, m.move, m.farthest, max(m.high - m.low, m.move), m.longest_rest / m.step, m.spread)
                   for m in motions]  # fmt: skip
        tables = np.where(np.abs(columns) < 1e-37, 0.0, columns).T.tolist() if motions else []
        names = ("low", "high", "move", "farthest", "width", "longest_rest", "spread")
        said = (
            "lowest fitted value of each input", "highest fitted value", "farthest that it may move in a usual step",
            "farthest that it moved", "how far a first value may lie outside", "usual steps that it may stand still",
            "standard deviation of its values",
        )  # fmt: skip
        self.tables = {
            name: program.constant(f"gate_{name}", [held(value) for value in table], comment)
            for name, table, comment in zip(names, tables, said, strict=False)
        }

    def members(self) -> list[Member]:
        """Members of the state that the gates need."""
        kept = [Member("number", name, len(self.motions), said) for name, said in _KEPT.items() if self.motions]
        flags = [
            Member("uint32", "apart", None, "1 while doubtful inputs make a difference"),
            Member("number", "quiet", None, "usual steps for which they have agreed"),
        ]
        return [*kept, *flags]

    @property
    def cost(self) -> Operations:
        """Operations of one update, where no input is doubted."""
        return COST * len(self.motions)

    def starting(self) -> list[Statement]:
        """Statements of `init` that the gates need."""
        n = len(self.motions)
        zero: list[Statement] = [Loop(n, [Assign(Kept(name)[TURN], Number(0.0)) for name in _KEPT])] if n else []
        return [*zero, Assign(_APART, Whole(0)), Assign(_QUIET, Number(0.0))]

    def updating(self) -> list[list[Statement]]:
        """Statements of `update`, in sections: inputs, gates, courses."""
        program, n = self.program, 1 + len(self.program.columns)
        take: list[Statement] = [Declare("given", n), Assign(_GIVEN[Whole(0)], Variable("temperature"))]
        if program.columns:
            place = behind(TURN, 1)
            take.append(Loop(len(program.columns), [Assign(_GIVEN[place], Variable("columns")[TURN])]))
        if not self.motions:
            return [take, [Follow("result", "now", "given"), Finish()]]
        take.append(Declare("other", n))
        for variable in (_JUMPED, _DOUBTED):
            take += [Declare(variable.name), Assign(variable, Number(0.0))]
        gate: Statement = Loop(n, self._gate())
        if not program.target.fixed:
            step = Variable("step_us")
            bad = binary(binary(step, "==", Whole(0)), "or", binary(step, ">", Whole(LONGEST_STEP_US, "uint64")))
            usual = Number(self.motions[0].step * MICROSECONDS)
            take.append(Local("steps", Converted("number", step) / usual))
            gate = If(bad, [Loop(n, [Assign(_OTHER[TURN], _GIVEN[TURN])])], [gate])
        return [take, [gate], self._courses()]

    def _gate(self) -> list[Statement]:
        """Statements for one input; where it is missing, the twin moves away."""
        doubted = [Assign(_DOUBTED, Number(1.0)), Assign(Kept("stands")[TURN], Number(DOUBTED))]
        k = {name: Kept(name)[TURN] for name in _KEPT}
        c = {name: table[TURN] for name, table in self.tables.items()}
        value, other, target = _GIVEN[TURN], _OTHER[TURN], self.program.target
        step = self._step()
        last, reach, away = map(Variable, ("last", "reach", "away"))
        none, one = Number(0.0), Number(1.0)
        first: Formula = binary(k["known"], "==", none)
        if target.longest_step is not None:
            limit = Number(target.longest_step / self.motions[0].step)
            first = binary(first, "or", binary(k["passed"], ">", limit))
        near = Choice(value < c["low"], c["low"], Bracketed(Choice(value > c["high"], c["high"], value)))
        moved = Choice(k["passed"] > one, c["move"] * k["passed"], c["move"])
        outward = Choice(value + value > c["low"] + c["high"], c["spread"], -c["spread"])
        stands: list[Statement] = [
            If(
                k["rest"] > c["longest_rest"],
                [If(binary(value, "!=", c["low"]), [If(binary(value, "!=", c["high"]), [
                    Assign(other, value + outward), *doubted])])],
            )
        ]  # fmt: skip
        near_it = Choice(
            Variable("jumps"), Bracketed(Choice(k["age"] > one, c["move"] * k["age"], c["move"])), c["move"]
        )
        back = Call("is_within", (value - k["level"], near_it))
        counted = Choice(k["passed"] > one, one, k["passed"])
        ended: list[Statement] = [Assign(k["doubt"], none), Assign(k["stands"], Number(BELIEVED_AGAIN))]
        inside = Call("is_within", (value + value - c["low"] - c["high"], c["high"] - c["low"]))
        believed = If(Unary("not", Variable("jumps")), [If(k["away_for"] > Number(BELIEVED), [If(inside, ended)])])
        believe: list[Statement] = [
            If(
                binary(k["doubt"], "!=", none),
                [Assign(k["away_for"], Choice(Variable("first_value"), none, Bracketed(counted)), "+"),
                 If(back, [Assign(k["doubt"], none)], believed)],
            ),
            If(binary(value, "!=", k["last"]), [Assign(k["rest"], none)]),
            Assign(k["last"], value), Assign(k["known"], one), Assign(k["passed"], none), Assign(k["odd"], none),
            If(binary(k["doubt"], "!=", none), [Assign(other, k["level"]), *doubted], stands),
        ]  # fmt: skip
        hold: list[Statement] = [
            Assign(k["odd"], away), Assign(value, last),
            Assign(_HELD, one), Assign(_JUMPED, one), *doubted,
            Assign(other, Choice(away > none, Choice(Variable("first_value"), c["low"], last + c["farthest"]),
                                 Choice(Variable("first_value"), c["high"], last - c["farthest"]))),
        ]  # fmt: skip
        doubt: list[Statement] = [
            Assign(k["doubt"], one), Assign(k["level"], last), Assign(k["away_for"], none),
            Assign(k["age"], Choice(Variable("first_value"), none, k["passed"])),
        ]  # fmt: skip
        far = Variable("far")
        lost: list[Statement] = [
            Local("wandered", c["farthest"] * k["passed"]),
            Local("far", Choice(Variable("wandered") < c["spread"], Variable("wandered"), c["spread"])),
            Local("kept", Choice(binary(k["doubt"], "!=", none), k["level"], k["last"])),
            Assign(
                other, Variable("kept") + Choice(Variable("kept") + Variable("kept") > c["low"] + c["high"], far, -far)
            ),
            *doubted,
        ]
        judged: list[Statement] = [
            Local("first_value", first, "truth"),
            Local("last", Choice(Variable("first_value"), Bracketed(near), k["last"])),
            Local("reach", Choice(Variable("first_value"), c["width"], moved)),
            Local("away", value - last),
            Local("jumps", Unary("not", Call("is_within", (away, reach))), "truth"),
            If(Variable("first_value"), [Assign(k["doubt"], none), Assign(k["rest"], none)]),
            Declare("held"), Assign(_HELD, none),
            If(Variable("jumps"), [If(binary(k["doubt"], "==", none), [If(away * k["odd"] > none, doubt, hold)])]),
            If(binary(_HELD, "==", none), believe),
        ]  # fmt: skip
        return [
            Assign(k["passed"], step, "+"), Assign(k["rest"], step, "+"),
            If(binary(k["doubt"], "!=", none), [Assign(k["age"], step, "+")]),
            Assign(other, value),
            If(Call("is_within", (value, Largest("number"))), judged, [If(binary(k["known"], "!=", none), lost)]),
        ]  # fmt: skip

    def _step(self) -> Formula:
        """The step of an update, in usual ones."""
        period = self.program.target.period
        return _STEP if period is None else Number(period / self.motions[0].step)

    def _courses(self) -> list[Statement]:
        """Follow the course of the inputs, and the other one while they are apart: `records.gate.Doubt`."""
        difference = Bias("result") - Bias("other_result")
        # Two courses agree that differ by less than this share of the noise
        small = Call("is_within", (difference, Number(1e-3 * self.deviation)))
        large = Unary("not", Call("is_within", (difference, Number(self.deviation))))
        none, one, n = Number(0.0), Number(1.0), len(self.motions)
        doubted = binary(_DOUBTED, "!=", none)
        is_open, is_believed, stands = Variable("is_open"), Variable("is_believed"), Kept("stands")[TURN]
        asked = Loop(
            n,
            [
                If(binary(stands, "==", Number(DOUBTED)), [Assign(is_open, one)]),
                If(binary(stands, "==", Number(BELIEVED_AGAIN)), [Assign(is_believed, one)]),
            ],
        )
        counts = binary(binary(is_open, "!=", none), "or", binary(is_believed, "==", none))
        ended = [Assign(_APART, Whole(0)), Loop(n, [Assign(stands, Number(AGREED))])]
        return [
            If(doubted, [If(binary(_APART, "==", Whole(0)), [Fork(), Assign(_APART, Whole(1))])]),
            Follow("result", "now", "given"),
            If(binary(_APART, "!=", Whole(0)), [
                Follow("other_result", "twin", "other"),
                Declare("is_open"), Assign(is_open, none), Declare("is_believed"), Assign(is_believed, none),
                asked, If(counts, [If(large, [Raise("DOUBTFUL")])]),
                Assign(_QUIET, self._step(), "+"),
                If(binary(doubted, "or", Unary("not", small)), [Assign(_QUIET, none)]),
                If(binary(_QUIET, ">", Number(self.memory / self.motions[0].step)), ended),
            ]),
            If(binary(_JUMPED, "!=", none), [Raise("JUMP")]),
            Finish(),
        ]  # fmt: skip

"""Small random changes of the code."""

from __future__ import annotations

import ast
import random
from dataclasses import dataclass
from pathlib import Path

SWAPS: dict[type, tuple[type, ...]] = {
    ast.Lt: (ast.LtE, ast.GtE), ast.LtE: (ast.Lt, ast.Gt), ast.Gt: (ast.GtE, ast.LtE), ast.GtE: (ast.Gt, ast.Lt),
    ast.Eq: (ast.NotEq,), ast.NotEq: (ast.Eq,), ast.Is: (ast.IsNot,), ast.IsNot: (ast.Is,), ast.In: (ast.NotIn,),
    ast.NotIn: (ast.In,), ast.Add: (ast.Sub,), ast.Sub: (ast.Add,), ast.Mult: (ast.Div,), ast.Div: (ast.Mult,),
    ast.FloorDiv: (ast.Mult,), ast.And: (ast.Or,), ast.Or: (ast.And,), ast.BitOr: (ast.BitAnd,),
    ast.BitAnd: (ast.BitOr,),
}  # fmt: skip


@dataclass(frozen=True)
class Mutant:
    """One change."""

    path: str
    line: int
    lines: range | None
    """Lines whose tests meet it first; None outside of functions."""
    what: str
    source: str


def places(tree: ast.Module, source: str) -> list[ast.AST]:
    """Nodes that can be changed, where a test could notice."""
    elsewhere = {k for k, row in enumerate(source.splitlines(), 1) if "pragma: no cover" in row}  # on other systems
    skipped: set[int] = set()
    for node in ast.walk(tree):
        parts = [node] if getattr(node, "lineno", 0) in elsewhere else hidden(node)
        skipped.update(id(inner) for part in parts if part is not None for inner in ast.walk(part))
    kinds = (
        ast.Compare, ast.BinOp, ast.BoolOp, ast.UnaryOp, ast.Constant, ast.If, ast.Raise, ast.Return, ast.Expr,
        ast.Assign, ast.AugAssign,
    )  # fmt: skip
    return [node for node in ast.walk(tree) if isinstance(node, kinds) and id(node) not in skipped and changeable(node)]


def hidden(node: ast.AST) -> list[ast.AST | None]:
    """Parts that tests need not see: types and assertions about them, decorators, imports, words of messages."""
    if isinstance(node, ast.FunctionDef):
        arguments = [part.annotation for part in ast.walk(node.args) if isinstance(part, ast.arg)]
        return [node.returns, *node.decorator_list, *arguments]
    if isinstance(node, ast.ClassDef):
        return [*node.decorator_list]
    if isinstance(node, ast.AnnAssign):
        return [node.annotation]
    if isinstance(node, ast.Raise):
        return [*ast.iter_child_nodes(node)]
    for_checkers = isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test)
    return [node] if for_checkers or isinstance(node, ast.Assert | ast.JoinedStr | ast.Import | ast.ImportFrom) else []


def changeable(node: ast.AST) -> bool:
    """Whether there is a change that could matter."""
    if isinstance(node, ast.Constant):
        return isinstance(node.value, bool | int | float) or node.value is None
    if isinstance(node, ast.Expr):
        return isinstance(node.value, ast.Call)
    if isinstance(node, ast.UnaryOp):
        return isinstance(node.op, ast.Not | ast.USub)
    if isinstance(node, ast.BinOp | ast.BoolOp):
        return type(node.op) in SWAPS
    return not isinstance(node, ast.Return) or not (node.value is None or ast.unparse(node.value) == "None")


def changed(node: ast.AST, rng: random.Random) -> ast.AST:
    """Another node in its place."""
    if isinstance(node, ast.Compare):
        ops = list(node.ops)
        k = rng.randrange(len(ops))
        ops[k] = rng.choice(SWAPS[type(ops[k])])()
        return ast.Compare(node.left, ops, node.comparators)
    if isinstance(node, ast.BinOp):
        return ast.BinOp(node.left, rng.choice(SWAPS[type(node.op)])(), node.right)
    if isinstance(node, ast.BoolOp):
        return ast.BoolOp(rng.choice(SWAPS[type(node.op)])(), node.values)
    if isinstance(node, ast.UnaryOp):
        return node.operand
    if isinstance(node, ast.Constant):
        return ast.Constant(other_value(node.value, rng))
    if isinstance(node, ast.If):
        return ast.If(ast.Constant(rng.choice([True, False])), node.body, node.orelse)
    if isinstance(node, ast.Return):
        return ast.Return(ast.Constant(None))
    return ast.Pass()


def other_value(value: object, rng: random.Random) -> object:
    """Another constant of the same kind."""
    if value is None:
        return False  # Python warns of a number after `is`
    if isinstance(value, bool):
        return not value
    if value == 0.0 and isinstance(value, float):
        return 1.0
    return value + rng.choice([-1, 1]) if isinstance(value, int) else value * rng.choice([0.5, 2.0])  # type: ignore[operator]


def spliced(source: str, old: ast.AST, new: ast.AST) -> str:
    """The source with one node replaced; every other line stays as it is."""
    if isinstance(old, ast.If) and isinstance(new, ast.If):
        old, new = old.test, new.test
    code = ast.unparse(ast.fix_missing_locations(new))
    rows = source.encode().splitlines(keepends=True)
    begin = sum(map(len, rows[: old.lineno - 1])) + old.col_offset
    end = sum(map(len, rows[: old.end_lineno - 1])) + old.end_col_offset
    text = f"({code})" if isinstance(new, ast.expr) else code
    return (source.encode()[:begin] + text.encode() + source.encode()[end:]).decode()


def touching(tree: ast.Module, line: int) -> range | None:
    """From the begin of the statement that holds the line to the line; all of a function for its arguments' defaults.

    None outside of functions.
    """
    functions = [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)]
    around = [node for node in functions if node.lineno <= line <= (node.end_lineno or 0)]
    if not around:
        return None
    inner = max(around, key=lambda node: node.lineno)
    if line < inner.body[0].lineno:
        return range(inner.body[0].lineno, (inner.end_lineno or 0) + 1)
    statements = (node for node in ast.walk(inner) if isinstance(node, ast.stmt))
    return range(max(node.lineno for node in statements if node.lineno <= line), line + 1)


def draw(count: int, rng: random.Random, root: Path, rooms: list[str]) -> list[Mutant]:
    """Random mutants of the rooms under a root, each place with the same chance."""
    files = sorted(
        p for room in rooms for p in ([root / room] if room.endswith(".py") else (root / room).rglob("*.py"))
    )
    texts = {path: path.read_text() for path in files}
    everywhere = [(path, k) for path, text in texts.items() for k in range(len(places(ast.parse(text), text)))]
    mutants = []
    for path, k in rng.sample(everywhere, min(count, len(everywhere))):
        text = texts[path]
        tree = ast.parse(text)
        old = places(tree, text)[k]
        new = changed(old, rng)
        before, after = (ast.unparse(ast.fix_missing_locations(node)).splitlines()[0][:70] for node in (old, new))
        source, lines = spliced(text, old, new), touching(tree, old.lineno)
        mutants.append(Mutant(str(path.relative_to(root)), old.lineno, lines, f"{before}  ->  {after}", source))
    return mutants

"""Table from the founding paper's equation numbers to the functions that compute them, read from the code."""

from __future__ import annotations

import ast
import importlib
import importlib.util
import re
from collections.abc import Iterator
from pathlib import Path

WORDS: dict[int, tuple[str, str]] = {
    3: (r"U = U_0 + \sum_i a_i (T - T_0)^i", "static law"),
    9: (r"\bar U_k = \frac{1}{N} \sum_n U_{k+n}", "moving average of the corrected reading"),
    11: (r"U = Q a", "the model as a linear system"),
    12: (r"\min_a \lVert U - Q a \rVert^2 + \varepsilon \lVert a \rVert^2", "least squares with a small penalty"),
    13: (r"a^\star = (Q^\top Q + \varepsilon I)^{-1} Q^\top U", "its solution"),
    14: (r"c \, \partial_t \theta = \nabla \cdot (\lambda \nabla \theta)", "heat conduction inside the device"),
    15: (r"-\lambda \, \partial_n \theta = h (\theta - T)", "exchange with the surroundings"),
    16: (r"U = F(\theta)", "the reading depends on the whole temperature field"),
    17: (r"\tau \, \dot\psi = T - \psi", "lag of time constant τ (unit gain)"),
    18: (r"\psi_0(t) = e^{-t/\tau} \psi_0", "unknown start: decay column"),
    19: (r"\Psi_j = \psi_j + \psi_{0j} - T", "lag difference"),
    20: (r"U = U_0 + \sum a_i T^i + \sum \mu_j \Psi_j + \dots", "nonlinear dynamic model, series"),
    21: (r"\dots + \sum \mu_{jk} \Psi_j \Psi_k + \dots", "its products"),
    22: (r"U = U_0 + \sum a_i T^i + \sum \mu_j (\psi_j - T) + \sum \nu_j e^{-t/\tau_j}", "working model"),
    23: (r"\nu_j = \mu_j \, \psi_0(\tau_j)", "coefficients of the decays"),
    24: (r"U_{0k} = U_k - \sum a_i T_k^i - \sum \mu_j (\psi_{jk} - T_k)", "correction"),
    25: (r"\psi_{k+1} = e^{-\Delta t/\tau} \psi_k + (1 - e^{-\Delta t/\tau}) T_k", "exact step of a lag (unit gain)"),
    26: (r"\bar U_k = \frac{1}{N} \sum_n U_{0,k+n}", "moving average, dynamic correction"),
    30: (r"U = Q \, (a, \mu, \nu)", "the dynamic model as a linear system"),
    31: (r"\min \lVert U - Q (a, \mu, \nu) \rVert^2 + \varepsilon \lVert \cdot \rVert^2", "least squares"),
    32: (r"(a, \mu, \nu)^\star = (Q^\top Q + \varepsilon I)^{-1} Q^\top U", "its solution"),
}
"""Number -> formula and words; unit-gain form throughout."""

PUBLIC = (
    "thermocorr",
    "thermocorr.effects",
    "thermocorr.datasets",
    "thermocorr.equations",
    "thermocorr.records",
    "thermocorr.model",
    "thermocorr.judgement",
)
"""Modules whose names the reference describes, in the order in which it looks for them."""

_CITED = re.compile(r"\beqs?\.((?:[\s,]|and|-|\(\d+\))+)")
_NUMBERS = re.compile(r"\((\d+)\)(?:\s*-\s*\((\d+)\))?")


def cited(line: str) -> set[int]:
    """Equation numbers that a line cites: ``eqs. (11)-(13) and (32)`` gives 11, 12, 13, 32."""
    numbers: set[int] = set()
    for found in _CITED.finditer(line):
        for first, last in _NUMBERS.findall(found[1]):
            numbers |= set(range(int(first), int(last or first) + 1))
    return numbers


def citations(package: Path) -> dict[int, list[str]]:
    """Equation number -> full names of the functions, classes and modules that cite it, in reading order."""
    places: dict[int, dict[str, None]] = {}
    for path in sorted(package.rglob("*.py")):
        text = path.read_text(encoding="utf-8")
        module = ".".join(path.relative_to(package.parent).with_suffix("").parts)
        spans = list(_definitions(ast.parse(text), module))
        for number, line in enumerate(text.splitlines(), 1):
            for equation in cited(line):
                inside = [name for name, first, last in spans if first <= number <= last]
                places.setdefault(equation, {})[inside[-1] if inside else module] = None
    return {equation: list(names) for equation, names in sorted(places.items())}


def _definitions(tree: ast.AST, prefix: str) -> Iterator[tuple[str, int, int]]:
    """(full name, first line, last line) of every function and class, outer ones first."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            name = f"{prefix}.{node.name}"
            yield name, node.lineno, node.end_lineno or node.lineno
            yield from _definitions(node, name)


def table(package: Path) -> str:
    """The table as Markdown; a module stands for its functions only where none of them cites the equation itself."""
    found = citations(package)
    lines = ["| eq. | what | code |", "|---|---|---|"]
    for number, (formula, words) in WORDS.items():
        names = found.get(number, [])
        inner = [name for name in names if not any(other.startswith(f"{name}.") for other in names)]
        code = "<br>".join(_shown(name) for name in inner)
        lines.append(f"| ({number}) | {words}<br>${formula}$ | {code} |")
    return "\n".join(lines) + "\n"


def write_table(package: Path, path: Path) -> None:
    """Write the table into a file, if it has changed."""
    path.parent.mkdir(exist_ok=True)
    text = table(package)
    if not path.exists() or path.read_text(encoding="utf-8") != text:
        path.write_text(text, encoding="utf-8")


def public_names() -> dict[int, str]:
    """Identity of every public function and class -> the name under which the reference describes it."""
    names: dict[int, str] = {}
    for module in PUBLIC:
        room = importlib.import_module(module)
        for name in getattr(room, "__all__", ()):
            names.setdefault(id(getattr(room, name)), f"{module}.{name}")
    return names


def _shown(name: str) -> str:
    """A link where the reference describes it, else its place in the package."""
    known = public_names()
    module = name
    while module.rsplit(".", 1)[-1][0].isupper() or not _is_module(module):
        module = module.rpartition(".")[0]
    head, *rest = [*name.removeprefix(module).lstrip(".").split(".")]
    public = known.get(id(getattr(importlib.import_module(module), head, None))) if head else None
    if public:
        return f"{{py:obj}}`{'.'.join([head, *rest])} <{'.'.join([public, *rest])}>`"
    return f"`{name.removeprefix('thermocorr.')}`"


def _is_module(name: str) -> bool:
    try:
        return importlib.util.find_spec(name) is not None
    except ModuleNotFoundError:
        return False

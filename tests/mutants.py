"""Small faults in the code, one at a time, drawn from a seed over all modules; `mutate` asks who notices.

A comparison turned, a sign changed, a constant doubled, a condition negated, a statement left out.
"""

from __future__ import annotations

import ast
import copy
import random
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
ROOMS = ("upplied/planning", "upplied/catalog")

TURNED: dict[type[ast.AST], type[ast.AST]] = {
    ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq,
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.BitAnd: ast.BitOr,
    ast.BitOr: ast.BitAnd, ast.And: ast.Or, ast.Or: ast.And, ast.Is: ast.IsNot, ast.IsNot: ast.Is,
    ast.In: ast.NotIn, ast.NotIn: ast.In,
}  # fmt: skip
SWAPPED = {
    "min": "max", "max": "min", "minimum": "maximum", "maximum": "minimum", "any": "all", "all": "any",
    "argmin": "argmax", "argmax": "argmin", "floor": "ceil", "ceil": "floor", "sin": "cos", "cos": "sin",
}  # fmt: skip


@dataclass(frozen=True)
class Mutant:
    """One fault at one place."""

    path: Path  # from the root
    line: int
    what: str
    source: str  # of the whole module, with the fault
    lines: range  # of the statement that it is in
    traced: bool  # whether a tracer sees those lines: not when a module is loaded, not in compiled functions

    def __str__(self) -> str:
        return f"{self.path}:{self.line} {self.what}"


def faults(tree: ast.Module) -> Iterator[tuple[ast.AST, str]]:
    """Every node that can be made wrong, and in which way."""
    skipped = {id(inner) for node in ast.walk(tree) for outer in _silent(node) for inner in ast.walk(outer)}
    for node in ast.walk(tree):
        if id(node) in skipped:
            continue
        if isinstance(node, ast.Compare | ast.BinOp | ast.BoolOp | ast.AugAssign):
            operator = node.ops[0] if isinstance(node, ast.Compare) else node.op
            if type(operator) in TURNED:
                yield node, f"{type(operator).__name__} became {TURNED[type(operator)].__name__}"
        elif isinstance(node, ast.Constant) and type(node.value) in (int, float, bool):
            yield node, f"{node.value} became {_other(node.value)}"
        elif isinstance(node, ast.Attribute | ast.Name) and _name(node) in SWAPPED:
            yield node, f"{_name(node)} became {SWAPPED[_name(node)]}"
        elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not | ast.Invert | ast.USub):
            yield node, f"{type(node.op).__name__} left out"
        if isinstance(node, ast.If | ast.IfExp | ast.While):
            yield node.test, "condition negated"
        if isinstance(node, ast.Expr | ast.AugAssign | ast.Raise | ast.Continue | ast.Break):
            yield node, "statement left out"


def _silent(node: ast.AST) -> list[ast.AST]:
    """What of a node says nothing to the machine: annotations, documentation, decorators, messages."""
    nodes: list[ast.AST] = []
    if isinstance(node, ast.FunctionDef | ast.ClassDef | ast.Module):
        nodes += [line for line in node.body[:1] if isinstance(line, ast.Expr) and _is_text(line.value)]
    if isinstance(node, ast.FunctionDef):
        arguments = [*node.args.args, *node.args.kwonlyargs, *node.args.posonlyargs]
        nodes += [*node.decorator_list, *([node.returns] if node.returns else [])]
        nodes += [argument.annotation for argument in arguments if argument.annotation]
        if node.name in ("__repr__", "__str__"):
            nodes.append(node)
    if isinstance(node, ast.ClassDef):
        nodes += node.decorator_list
    if isinstance(node, ast.AnnAssign):
        nodes.append(node.annotation)
    if isinstance(node, ast.JoinedStr | ast.Import | ast.ImportFrom):
        nodes.append(node)
    if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.dump(node.test):
        nodes.append(node)
    return nodes


def _is_text(node: ast.AST) -> bool:
    return isinstance(node, ast.Constant) and isinstance(node.value, str)


def _name(node: ast.Attribute | ast.Name) -> str:
    return node.attr if isinstance(node, ast.Attribute) else node.id


def _other(value: float | bool) -> float | bool:
    if isinstance(value, bool):
        return not value
    return value + 1 if isinstance(value, int) else (2 * value if value else 1.0)


def made_wrong(tree: ast.Module, number: int) -> str:
    """The source of a module with its fault of that number."""
    tree = copy.deepcopy(tree)
    node, what = list(faults(tree))[number]
    if what == "condition negated":
        new: ast.AST = ast.UnaryOp(ast.Not(), copy.deepcopy(node))
    elif what == "statement left out":
        new = ast.Pass()
    elif what.endswith("left out"):
        new = node.operand  # type: ignore[attr-defined]
    else:
        new = copy.copy(node)
        if isinstance(new, ast.Constant):
            new.value = _other(new.value)  # type: ignore[arg-type]
        elif isinstance(new, ast.Compare):
            new.ops = [TURNED[type(new.ops[0])](), *new.ops[1:]]  # type: ignore[list-item]
        elif isinstance(new, ast.Attribute):
            new.attr = SWAPPED[new.attr]
        elif isinstance(new, ast.Name):
            new.id = SWAPPED[new.id]
        else:
            new.op = TURNED[type(new.op)]()  # type: ignore[attr-defined]

    class Exchange(ast.NodeTransformer):
        def visit(self, here: ast.AST) -> ast.AST:
            return new if here is node else self.generic_visit(here)

    return ast.unparse(ast.fix_missing_locations(Exchange().visit(tree)))


def sample(number: int, seed: int, rooms: tuple[str, ...] = ROOMS) -> list[Mutant]:
    """Mutants drawn evenly from all places of the rooms, the same for the same seed and code."""
    places = []
    for room in rooms:
        paths = [ROOT / room] if room.endswith(".py") else sorted((ROOT / room).rglob("*.py"))
        for path in paths:
            tree = ast.parse(path.read_text(encoding="utf-8"))
            places += [(path, tree, at, node, what) for at, (node, what) in enumerate(faults(tree))]
    drawn = random.Random(seed).sample(places, min(number, len(places)))
    return [
        Mutant(path.relative_to(ROOT), node.lineno, what, made_wrong(tree, at), *_around(tree, node))  # type: ignore[attr-defined]
        for path, tree, at, node, what in drawn
    ]


def _around(tree: ast.Module, node: ast.AST) -> tuple[range, bool]:
    """The lines of the statement that a node is in, and whether a tracer sees them."""
    within: list[ast.stmt] = []
    for outer in ast.walk(tree):
        if isinstance(outer, ast.stmt) and any(inner is node for inner in ast.walk(outer)):
            within.append(outer)
    innermost = max(within, key=lambda outer: (outer.lineno, -(outer.end_lineno or 0)))
    functions = [outer for outer in within if isinstance(outer, ast.FunctionDef)]
    # The defaults of a function are read where it is defined, which for most is when its module is loaded.
    inside = any(outer is not innermost for outer in functions) and not any(
        "njit" in ast.dump(item) for of in functions for item in of.decorator_list
    )
    last = innermost.end_lineno or innermost.lineno
    body = getattr(innermost, "body", None)
    if body:
        last = max(innermost.lineno, body[0].lineno - 1)
    return range(innermost.lineno, last + 1), inside

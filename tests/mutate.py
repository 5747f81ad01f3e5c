"""How many small faults in the planning and the catalog do their tests notice?

A mutant is the code with one fault: a comparison turned, a sign changed, a constant doubled, a condition
negated, a statement left out. Mutants are drawn from a seed over all modules; each meets the tests of
its room, those that import the module first. Printed are the share that the tests killed, and each survivor.

    python tests/mutate.py --number 200 --seed 0 [--only upplied/planning/airspace]
"""

from __future__ import annotations

import argparse
import ast
import copy
import os
import random
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
ROOMS = ("upplied/planning", "upplied/catalog")
WHOLE = {"plan.py", "trajectory", "carry", "measures"}  # judged by whole plans as well
SLACK_S = 60  # beyond three times what the tests take on sound code: then a mutant hangs, which is noticed

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
    found: list[ast.AST] = []
    if isinstance(node, ast.FunctionDef | ast.ClassDef | ast.Module):
        found += [line for line in node.body[:1] if isinstance(line, ast.Expr) and _is_text(line.value)]
    if isinstance(node, ast.FunctionDef):
        arguments = [*node.args.args, *node.args.kwonlyargs, *node.args.posonlyargs]
        found += [*node.decorator_list, *([node.returns] if node.returns else [])]
        found += [argument.annotation for argument in arguments if argument.annotation]
        if node.name in ("__repr__", "__str__"):
            found.append(node)
    if isinstance(node, ast.ClassDef):
        found += node.decorator_list
    if isinstance(node, ast.AnnAssign):
        found.append(node.annotation)
    if isinstance(node, ast.JoinedStr | ast.Import | ast.ImportFrom):
        found.append(node)
    if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.dump(node.test):
        found.append(node)
    return found


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
        Mutant(path.relative_to(ROOT), node.lineno, what, made_wrong(tree, at))  # type: ignore[attr-defined]
        for path, tree, at, node, what in drawn
    ]


def tests_of(module: Path) -> list[list[str]]:
    """Test files for a module: those of its room that import it, the others of the room, and whole plans."""
    room = ROOT / "tests" / Path(*module.parts[1:-1])
    while not room.is_dir() or not list(room.glob("test_*.py")):
        room = room.parent
    named = ".".join(module.with_suffix("").parts)
    files = sorted(room.glob("test_*.py"))
    own = [str(file.relative_to(ROOT)) for file in files if named in file.read_text(encoding="utf-8")]
    rest = [str(file.relative_to(ROOT)) for file in files if str(file.relative_to(ROOT)) not in own]
    whole = ["tests/planning/test_plan.py"] if set(module.parts) & WHOLE else []
    return [group for group in (own, rest, whole) if group]


def passes(tests: list[str], root: Path, timeout_s: float) -> bool:
    """Whether the tests pass on a copy of the project; hanging is failing."""
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-m", "not slow", "-p", "no:cacheprovider", *tests]
    home = {"PYTHONPATH": f"{root}:{root / 'tests'}", "PYTHONDONTWRITEBYTECODE": "1"}
    data = {"UPPLIED_REAL_DATA": os.environ.get("UPPLIED_REAL_DATA", str(ROOT.parent / "shared" / "data"))}
    try:
        done = subprocess.run(
            command,
            cwd=root,
            env=os.environ | data | home,
            capture_output=True,
            timeout=timeout_s,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return False
    return done.returncode == 0


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--number", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", nargs="*", default=ROOMS, help="rooms or modules, from the project's root")
    given = parser.parse_args()
    mutants = sample(given.number, given.seed, tuple(given.only))
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder) / "project"
        ignored = shutil.ignore_patterns(".venv", ".git", "__pycache__", ".*_cache", "site", "catalog-data")
        shutil.copytree(ROOT, root, ignore=ignored, symlinks=True)
        usual: dict[str, float] = {}
        killed, survivors = 0, []
        for number, mutant in enumerate(mutants, 1):
            noticed = False
            for group in tests_of(mutant.path):
                key = " ".join(group)
                if key not in usual:
                    begin = time.monotonic()
                    if not passes(group, root, 3600):
                        print(f"the tests fail on sound code: {key}")
                        return 1
                    usual[key] = time.monotonic() - begin
                sound = (root / mutant.path).read_text(encoding="utf-8")
                (root / mutant.path).write_text(mutant.source, encoding="utf-8")
                noticed = not passes(group, root, 3 * usual[key] + SLACK_S)
                (root / mutant.path).write_text(sound, encoding="utf-8")
                if noticed:
                    break
            killed += noticed
            if not noticed:
                survivors.append(mutant)
            said = "killed" if noticed else "SURVIVED"
            print(f"{number:4d} {said:8s} {mutant.path}:{mutant.line} {mutant.what}", flush=True)
    share = 100 * killed / max(len(mutants), 1)
    print(f"\n{killed} of {len(mutants)} mutants killed: {share:.0f} % (seed {given.seed})")
    for mutant in survivors:
        print(f"survived: {mutant.path}:{mutant.line} {mutant.what}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())

"""Every number that the planner holds, as a page: what sort it is, its unit, its reason and the evidence.

Read from the code itself: the reason is the comment beside the number. `constants.csv` beside this file says
what sort each one is and what is known of its worth, `literals.csv` the same of numbers within functions. A
test fails where a number has no row in them, or more are tuned than should be.
"""

from __future__ import annotations

import ast
import csv
import importlib
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, fields
from functools import cache
from pathlib import Path
from typing import Any

from comments import comments

from upplied.config import FIDELITIES, PRESETS, Fidelity, settings_for

ROOT = Path(__file__).parents[2]
PLANNING = ROOT / "upplied" / "planning"
TABLE, LITERALS = (Path(__file__).with_name(f"{name}.csv") for name in ("constants", "literals"))
SORTS = {
    "tuned": "chosen value that follows from nothing else; another value gives another plan",
    "fitted": "calibrated on data by a bench, all of them together",
    "resolution": "resolution of a computation: twice as fine changes no plan beyond its tolerance",
    "numerical": "guard of a division, tolerance of a solver, cap of its iterations, rounding",
    "bound": "limit of memory or time",
    "definition": "definition of a term or a measure, or a number of mathematics",
    "requested": "requirement of a user, a vehicle or a rule",
}
#: Of a literal within a function, that need no row: counting, halving, and guards as small as these.
PLAIN, GUARD = {0, 1, 2, 3, 4, 0.5, 100, 90, 180, 360}, 1e-5


@dataclass(frozen=True)
class Constant:
    """A number of a module."""

    module: str
    name: str
    index: int | None  # in a tuple
    value: Any
    reason: str

    @property
    def row(self) -> str:
        """E.g. ``surface.parts._TOUCHING``: the row of the table."""
        return f"{self.module.removeprefix('upplied.planning.')}.{self.name}"

    @property
    def label(self) -> str:
        """The same with the place in a tuple."""
        return self.row if self.index is None else f"{self.row}[{self.index}]"


@cache
def constants() -> tuple[Constant, ...]:
    """The numbers of the planner's modules, in the order of their files; what is made of others apart."""
    return tuple(_constants())


def _constants() -> Iterator[Constant]:
    for path in sorted(PLANNING.rglob("*.py")):
        module = ".".join(path.relative_to(ROOT).with_suffix("").parts)
        text = path.read_text(encoding="utf-8")
        for node in ast.parse(text).body:
            if not isinstance(node, ast.Assign) or not _numbers(node.value):
                continue
            reason = _comment(text.splitlines(), node)
            for name in _names(node):
                value = getattr(importlib.import_module(module), name)
                if isinstance(value, tuple) and all(isinstance(each, int | float) for each in value):
                    for index, each in enumerate(value):
                        yield Constant(module, name, index, each, reason)
                elif isinstance(value, int | float) and not isinstance(value, bool):
                    yield Constant(module, name, None, value, reason)


def settings() -> Iterator[Constant]:
    """The numbers of the settings, as presets and fidelities hold them, equal ones once."""
    presets = [settings_for(name) for name in PRESETS]
    for stage in fields(presets[0]):
        if stage.name != "preset":
            meanings = comments(type(getattr(presets[0], stage.name)))
            for item in fields(getattr(presets[0], stage.name)):
                values = {getattr(getattr(preset, stage.name), item.name): None for preset in presets}
                some = [each for each in values if type(each) in (int, float)]
                for index, value in enumerate(some):
                    name, place = f"{stage.name}.{item.name}", index if len(some) > 1 else None
                    yield Constant("settings", name, place, value, meanings.get(item.name, ""))
    meanings = comments(Fidelity)
    for item in fields(Fidelity):
        for index, value in enumerate({getattr(fidelity, item.name): 0 for fidelity in FIDELITIES.values()}):
            yield Constant("settings", f"fidelity.{item.name}", index, value, meanings[item.name])


def literals() -> dict[str, str]:
    """Numbers within functions that decide something, by function: ``surface.skin._near`` to ``0.05``."""
    numbers_of: dict[str, list[float]] = {}
    for path in sorted(PLANNING.rglob("*.py")):
        module = ".".join(path.relative_to(PLANNING).with_suffix("").parts)
        for function in _functions(ast.parse(path.read_text(encoding="utf-8"))):
            indices = {
                id(inner)
                for node in ast.walk(function)
                if isinstance(node, ast.Subscript | ast.FormattedValue)
                for inner in ast.walk(node.slice if isinstance(node, ast.Subscript) else node)
            }
            some = [
                node.value
                for node in ast.walk(function)
                if isinstance(node, ast.Constant) and type(node.value) in (int, float)
                if id(node) not in indices and abs(node.value) not in PLAIN and abs(node.value) > GUARD
            ]
            if some:
                numbers_of.setdefault(f"{module}.{function.name}", []).extend(some)
    return {name: " ".join(f"{each:g}" for each in sorted(set(some))) for name, some in numbers_of.items()}


def _functions(tree: ast.Module) -> Iterator[ast.FunctionDef]:
    for node in tree.body:
        for inner in node.body if isinstance(node, ast.ClassDef) else [node]:
            if isinstance(inner, ast.FunctionDef):
                yield inner


def _numbers(node: ast.expr) -> bool:
    return any(isinstance(each, ast.Constant) and type(each.value) in (int, float) for each in ast.walk(node))


def _names(node: ast.Assign) -> Iterator[str]:
    for target in node.targets:
        for name in target.elts if isinstance(target, ast.Tuple) else [target]:
            assert isinstance(name, ast.Name)
            yield name.id


def _comment(lines: list[str], node: ast.Assign) -> str:
    """The comment in the lines of a statement, or else the lines of comment above it."""
    for number in range(node.lineno - 1, node.end_lineno or node.lineno):
        if "#" in lines[number]:
            return lines[number].split("#", 1)[1].strip()
    above: list[str] = []
    number = node.lineno - 2
    while number >= 0 and lines[number].startswith("#"):
        above.insert(0, lines[number].lstrip("#: ").strip())
        number -= 1
    return " ".join(above)


def table(path: Path = TABLE) -> dict[str, dict[str, str]]:
    """The rows of a table by their first column."""
    with path.open(encoding="utf-8", newline="") as stream:
        return {row["number"]: row for row in csv.DictReader(stream)}


def tuned() -> list[Constant]:
    """The numbers of modules that were chosen, each of a tuple on its own."""
    known = table()
    return [each for each in constants() if known[each.row]["sort"] == "tuned"]


def counts() -> Counter[str]:
    """How many numbers there are of each sort: in settings, in modules and within functions."""
    known, inner = table(), table(LITERALS)
    counts = Counter(known[each.row]["sort"] for each in (*settings(), *constants()))
    for name, numbers in literals().items():
        counts[inner[name]["sort"]] += len(numbers.split())
    return counts


def constants_page() -> str:
    """Markdown: the sorts and how many there are of each, then every number."""
    return "\n".join(_page())


def _page() -> Iterator[str]:
    known, inner, within, count = table(), table(LITERALS), literals(), counts()
    yield "# The planner's numbers\n"
    yield "Plans depend on their inputs, on [settings](settings.md), that users may change, on numbers of the"
    yield "planner's modules, and on numbers within functions. `bench/sensitivity.py` halves and doubles each"
    yield "tuned number of a module and prints the changes of the results.\n"
    yield "| sort | numbers | meaning |\n|---|---|---|"
    for sort, about in SORTS.items():
        yield f"| {sort} | {count[sort]} | {about} |"
    rows: dict[str, list[Constant]] = {}
    for each in (*settings(), *constants()):
        rows.setdefault(each.row, []).append(each)
    for sort in SORTS:
        yield f"\n## {sort.capitalize()}\n"
        yield "| number | value | unit and reason | evidence |\n|---|---|---|---|"
        for name, some in rows.items():
            if known[name]["sort"] == sort:
                value = ", ".join(f"{each.value:.4g}" for each in some)
                about = (known[name]["reason"] or some[0].reason).replace("|", "\\|")
                yield f"| `{name}` | {value} | {about} | {known[name]['evidence']} |"
        for name, numbers in within.items():
            if inner[name]["sort"] == sort:
                yield f"| in `{name}` | {numbers.replace(' ', ', ')} | {inner[name]['reason']} | |"

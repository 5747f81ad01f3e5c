"""The library as pages: every module with its first line, which room uses which, and the public names.

Read from the code itself, so that it stays true.
"""

from __future__ import annotations

import ast
import inspect
from collections.abc import Iterator
from pathlib import Path

import upplied

ROOT = Path(__file__).parents[2]
#: Rooms in the order in which data walks through them.
LIBRARY = (
    "inputs", "planning", "catalog", "recommend", "fleet", "proof", "outputs", "samples", "web", "cli",
)  # fmt: skip
PLANNING = (
    "geometry", "surface", "visibility", "correspondence", "airspace", "demonstration", "carry", "trajectory",
    "measures",
)  # fmt: skip

#: The functions of `planning/plan.py` that the way is written in.
_METHOD = ("_begun", "_on_pair", "decided", "_planned")


def house_page() -> str:
    """Markdown: rooms, arrows between them, modules."""
    return "\n".join(_page())


def _page() -> Iterator[str]:
    yield "# The tree\n"
    yield "What each part of the library is, in the order in which data walks through it. A room of"
    yield "planning uses those before it; a test reads the imports. A demonstration becomes a plan from the"
    yield "first room to the last, and `planning/plan.py` is the whole way on one page.\n"
    yield "## Planning: the rooms of the method\n"
    yield "| room | what it holds | uses |\n|---|---|---|"
    used = _arrows(ROOT / "upplied" / "planning", "upplied.planning", PLANNING)
    for room in PLANNING:
        about = _first_line(ROOT / "upplied" / "planning" / room / "__init__.py")
        yield f"| `{room}/` | {about} | {', '.join(used[room]) or 'records alone'} |"
    yield "\n## One demonstration, from room to room\n"
    yield "What `planning/plan.py` asks, and whom, in its order; each room hands records to the next.\n"
    yield "| asked | room | by |\n|---|---|---|"
    yield from _stages()
    yield "\n## Modules\n"
    foundation = sorted((ROOT / "upplied").glob("*.py"))
    yield from _modules("upplied/", [path for path in foundation if path.name != "__init__.py"])
    for part in LIBRARY:
        for folder in [ROOT / "upplied" / part, *_folders(ROOT / "upplied" / part)]:
            modules = [path for path in sorted(folder.glob("*.py")) if path.name != "__init__.py"]
            if modules:
                yield from _modules(f"{folder.relative_to(ROOT)}/", modules)


def public_page() -> str:
    """Markdown: the names that are importable from `upplied`, and what each is."""
    rows = []
    for name, module in upplied._PUBLIC.items():
        about = (inspect.getdoc(getattr(upplied, name)) or "").split("\n\n")[0]
        rows.append(f"| `{name}` | {' '.join(about.split())} | `{module}` |")
    head = (
        "# Public names\n\nWhat a study or a script of one's own needs is importable from `upplied` and "
        "stays under these names; a module is loaded when its name is first asked for. The rest may move.\n"
    )
    return "\n".join([head, "| name | what it is | from |\n|---|---|---|", *rows])


def _stages() -> Iterator[str]:
    """A row for each question of the method, the comment in its code, with the calls that stand below it."""
    text = (ROOT / "upplied" / "planning" / "plan.py").read_text(encoding="utf-8")
    tree, lines = ast.parse(text), text.splitlines()
    room_of = {
        alias.name: str(node.module).split(".")[2:]
        for node in tree.body
        if isinstance(node, ast.ImportFrom) and str(node.module).startswith("upplied.planning.")
        for alias in node.names
    }
    calls = sorted(
        (call.lineno, call.func.id)
        for function in tree.body
        if isinstance(function, ast.FunctionDef) and function.name in _METHOD
        for call in ast.walk(function)
        if isinstance(call, ast.Call) and isinstance(call.func, ast.Name) and call.func.id in room_of
    )
    by_question: dict[str, list[str]] = {}
    for number, name in calls:
        above = [line.strip() for line in lines[:number] if line.strip().startswith("# ")]
        by_question.setdefault(above[-1][2:], []).append(name)
    for question, names in by_question.items():
        by = ", ".join(f"`{'.'.join([*room_of[name][1:], name])}`" for name in names)
        yield f"| {question} | `{room_of[names[0]][0]}/` | {by} |"


def _folders(folder: Path) -> list[Path]:
    inner = [path.parent for path in folder.rglob("__init__.py") if path.parent != folder]
    order = {name: at for at, name in enumerate(PLANNING)}
    return sorted(inner, key=lambda path: (order.get(path.name, 99), str(path)))


def _modules(title: str, modules: list[Path]) -> Iterator[str]:
    yield f"### `{title}`\n\n| module | what it is |\n|---|---|"
    for path in modules:
        yield f"| `{path.name}` | {_first_line(path)} |"
    yield ""


def _first_line(path: Path) -> str:
    """What a module says of itself in its first paragraph."""
    text = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or ""
    return " ".join(text.split("\n\n")[0].split()).replace("|", "\\|")


def _arrows(folder: Path, package: str, rooms: tuple[str, ...]) -> dict[str, list[str]]:
    """Room to the other rooms that its modules import."""
    before: dict[str, list[str]] = {}
    for room in rooms:
        names = set()
        for path in (folder / room).rglob("*.py"):
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if isinstance(node, ast.ImportFrom) and (node.module or "").startswith(f"{package}."):
                    names.add(str(node.module).split(".")[2])
        before[room] = [name for name in rooms if name in names - {room}]
    return before

"""What a process keeps between calls, and what records keep, is listed in CONVENTIONS.md, and no more."""

from __future__ import annotations

import ast
import re
from copy import copy
from dataclasses import replace
from pathlib import Path

import numpy as np

from upplied.records import Cloud

ROOT = Path(__file__).parents[1]
TABLES = frozenset({"lru_cache", "WeakKeyDictionary", "WeakValueDictionary"})
KEEPERS = TABLES | {"cache"}  # as a decorator: much else bears that name


def keepers(path: Path) -> set[str]:
    """The names of a module's functions that remember, and of its tables that outlive a call."""
    tree, names = ast.parse(path.read_text(encoding="utf-8")), set()
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef):
            if any(_asks(decorator) for decorator in node.decorator_list):
                names.add(node.name)
            for inner in ast.walk(node):
                if isinstance(inner, ast.Global):
                    names.update(inner.names)
        elif (
            isinstance(node, ast.Assign | ast.AnnAssign)
            and node.value is not None
            and _asks(node.value, TABLES)
        ):
            target = node.targets[0] if isinstance(node, ast.Assign) else node.target
            names.add(ast.unparse(target).removeprefix("self."))
    return names


def _asks(node: ast.expr, keepers: frozenset[str] = KEEPERS) -> bool:
    """Whether it is one of the keepers, or a call of one: ``cache``, ``lru_cache(4)(self.read)``."""
    while isinstance(node, ast.Call):
        node = node.func
    return (node.id if isinstance(node, ast.Name) else getattr(node, "attr", "")) in keepers


def test_whatever_is_kept_between_calls_is_listed() -> None:
    text = (ROOT / "CONVENTIONS.md").read_text(encoding="utf-8")
    section = text.split("## Kept between calls")[1].split("\n## ")[0]
    listed = {
        (module, name)
        for module, names in re.findall(r"^\| `([\w.]+)` \| ([^|]+)\|", section, re.MULTILINE)
        for name in re.findall(r"`(\w+)`", names)
    }
    actual = set()
    for folder in ("upplied", "flows"):
        for path in sorted((ROOT / folder).rglob("*.py")):
            module = ".".join(path.relative_to(ROOT / folder).with_suffix("").parts)
            actual |= {(module if folder == "upplied" else f"flows.{module}", name) for name in keepers(path)}
    assert actual == listed, f"not listed: {actual - listed}; no longer kept: {listed - actual}"


def test_whatever_is_kept_with_a_record_is_listed() -> None:
    text = (ROOT / "CONVENTIONS.md").read_text(encoding="utf-8")
    section = text.split("## Kept with a record")[1].split("\n## ")[0]
    actual = set()
    for path in (ROOT / "upplied").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and getattr(node.func, "attr", "") == "derived":
                module = ".".join(path.relative_to(ROOT / "upplied").with_suffix("").parts)
                actual.add((module, re.sub(r"^f?'| ?({.*)?'$", "", ast.unparse(node.args[0]))))
    assert actual == set(re.findall(r"^\| `([\w.]+)` \| `([\w ]+)`", section, re.MULTILINE))


def test_a_record_keeps_what_follows_from_it_and_neither_a_changed_copy_nor_another_process_has_it() -> None:
    cloud, records = Cloud(np.zeros((2, 3))), []

    def count(of: Cloud) -> int:
        return of.derived("count", lambda: records.append(of) or len(of.points))  # type: ignore[func-returns-value]

    changed = replace(cloud, points=np.zeros((5, 3)))
    assert [count(cloud), count(cloud), count(changed), count(cloud)] == [2, 2, 5, 2]
    assert [id(of) for of in records] == [id(cloud), id(changed)]
    assert cloud.derived("another", lambda: "value") == "value" and count(cloud) == 2
    assert "_derived" in vars(cloud) and "_derived" not in vars(copy(cloud))


def test_a_table_of_its_own_is_noticed(tmp_path: Path) -> None:
    path = tmp_path / "module.py"
    path.write_text(
        "from functools import cache, lru_cache\n_A: dict = WeakKeyDictionary()\n_made = None\n"
        "@cache\ndef one(): ...\n@lru_cache(maxsize=2)\ndef two(): ...\n"
        "class C:\n    def __init__(self): self.three = lru_cache(4)(self.read)\n"
        "def sets():\n    global _made\n    _made = 1\n"
    )
    assert keepers(path) == {"_A", "_made", "one", "two", "three"}

"""List every string that people read in commands, pages and messages, and how many are new since a revision.

``python docs/making/words.py [REVISION] [--list]``: texts of two words and more in ``upplied/cli``,
``upplied/outputs`` (but missions), ``upplied/web`` and ``flows``: messages, help, labels and scripts.
"""

from __future__ import annotations

import ast
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]
ROOMS = ("upplied/cli", "upplied/outputs", "upplied/web", "upplied/studio", "flows")
DOCSTRINGS = ("upplied/cli",)  # the help of a command is its docstring


def main(arguments: list[str]) -> None:
    """Print how many strings there are, and how many a revision does not have."""
    revisions = [each for each in arguments if not each.startswith("--")]
    now = {text for name, content in files_now() for text in texts(name, content)}
    before = (
        {text for name, content in files_of(revisions[0]) for text in texts(name, content)}
        if revisions
        else now
    )
    new = now - before
    if "--list" in arguments:
        sys.stdout.write("\n".join(sorted(now)) + "\n")
    share = 100 * len(new) / len(now)
    sys.stdout.write(f"{len(now)} strings; {len(new)} ({share:.0f} %) are new since {revisions or 'now'}\n")


def files_now() -> Iterator[tuple[str, str]]:
    """Name and content of each file as it is."""
    for room in ROOMS:
        for path in sorted((ROOT / room).rglob("*")):
            if path.suffix in (".py", ".js", ".toml") and "missions" not in path.parts:
                yield str(path.relative_to(ROOT)), path.read_text(encoding="utf-8")


def files_of(revision: str) -> Iterator[tuple[str, str]]:
    """The same of a revision."""
    listed = git("ls-tree", "-r", "--name-only", revision, *ROOMS).splitlines()
    for name in listed:
        if name.endswith((".py", ".js", ".toml")) and "/missions/" not in name:
            yield name, git("show", f"{revision}:{name}")


def git(*words: str) -> str:
    """What git prints."""
    return subprocess.run(["git", *words], cwd=ROOT, capture_output=True, text=True, check=True).stdout


def texts(name: str, content: str) -> Iterator[str]:
    """The strings of two words and more that a file shows to people."""
    if name.endswith(".js"):
        strings = re.findall(
            r'"([^"\n]*[A-Za-z]+ [a-z][^"\n]*)"', re.sub(r"^\s*//.*$", "", content, flags=re.M)
        )
        yield from (text for text in strings if not re.search(r"[{}=;]|^M\d", text))
        return
    if name.endswith(".toml"):
        for label in _texts_of(tomllib.loads(content)):
            if re.search(r"[A-Za-z]{2,} [a-z]{2,}", label):
                yield label
        return
    tree = ast.parse(content)
    quiet = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            public = name.startswith(DOCSTRINGS) and not isinstance(node, ast.Module)
            if node.body and isinstance(node.body[0], ast.Expr) and not public:
                quiet.add(id(node.body[0].value))
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in quiet:
            text = " ".join(node.value.split())
            if re.search(r"[A-Za-z]{2,} [a-z]{2,}", text) and not text.startswith(("<", "http")):
                yield text


def _texts_of(values: Any) -> Iterator[str]:
    """The texts within tables and lists."""
    if isinstance(values, dict | list):
        for each in values.values() if isinstance(values, dict) else values:
            yield from _texts_of(each)
    elif isinstance(values, str):
        yield values


if __name__ == "__main__":
    main(sys.argv[1:])

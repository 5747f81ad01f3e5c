"""The public names of a package, loaded when first asked for: so `import upplied` and the help stay fast."""

from __future__ import annotations

import ast
import importlib
from collections.abc import Callable
from pathlib import Path
from typing import Any


def public_names(package: str, folder: str) -> tuple[dict[str, str], Callable[[str], Any]]:
    """Names that the stub of a package imports, each with its module, and what loads one (PEP 562).

    The stub, ``__init__.pyi`` in the package's folder, says the same to type checkers.
    """
    stub = ast.parse(Path(folder, "__init__.pyi").read_text(encoding="utf-8"))
    imports = [node for node in stub.body if isinstance(node, ast.ImportFrom)]
    modules = {alias.name: str(node.module) for node in imports for alias in node.names}

    def load(name: str) -> Any:
        if name in modules:
            return getattr(importlib.import_module(modules[name]), name)
        raise AttributeError(f"module {package!r} has no attribute {name!r}")

    return modules, load

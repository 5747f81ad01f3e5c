"""What is loaded when it is first asked for: the public names of a package, and what its extras bring.

So `import upplied` and the help stay fast, and what is missing is told in words.
"""

import ast
import importlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from upplied.errors import InputError


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


@contextmanager
def extra(name: str) -> Iterator[None]:
    """Import within what an extra brings; an `InputError` says how it is installed where it is not."""
    try:
        yield
    except ModuleNotFoundError as error:
        rule = f"what the extra {name!r} brings"
        remedy = f'install it: pip install "upplied[{name}]"'
        raise InputError(f"the package {error.name}", "is not installed", rule, remedy) from None


def required(package: str, name: str) -> None:
    """Ask for the package of an extra before work begins that would fail without it in other processes."""
    with extra(name):
        if find_spec(package) is None:
            raise ModuleNotFoundError(name=package)

"""What an extra of the package brings, asked for where it is needed, in words where it is missing."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec

from upplied.errors import InputError


@contextmanager
def extra(name: str) -> Iterator[None]:
    """Import within what an extra brings.

    Raises
    ------
    InputError
        Where it is not installed, with the command that installs it.
    """
    try:
        yield
    except ModuleNotFoundError as error:
        rule = f"what the extra {name!r} brings"
        remedy = f'install it: pip install "upplied[{name}]"'
        raise InputError(f"the package {error.name}", "is not installed", rule, remedy) from None


def required(package: str, name: str) -> None:
    """Ask for a package before work begins that would fail without it in other processes.

    Parameters
    ----------
    package : str
        As it is imported.
    name : str
        The extra that brings it.
    """
    with extra(name):
        if find_spec(package) is None:
            raise ModuleNotFoundError(name=package)

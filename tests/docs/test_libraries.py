"""Every dependency earns its place: what is declared is imported, and the other way round."""

from __future__ import annotations

import ast
import re
import sys
import tomllib
from collections.abc import Mapping
from functools import cache
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest
from packaging.requirements import Requirement

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
EXTRAS = PROJECT["optional-dependencies"]
# Declared, and not imported by name: why.
NOT_IMPORTED = {
    "open3d": "the same package for other platforms",
    "fastapi": "kept below what breaks Prefect",
    "sqlalchemy": "kept below what breaks Prefect's schedules",
    "setuptools": "builds the package",
    "ruff": "a command",
    "mypy": "a command",
    "moto": "a server of its own",
    "pytest-xdist": "a plugin of pytest",
    "playwright": "a browser in a process of its own",
    "pymavlink": "a process of its own",
    "pycollada": "trimesh writes COLLADA by it",
    "lxml": "trimesh writes 3MF by it",
    "networkx": "trimesh writes 3MF by it",
    "mkdocs-material": "a theme",
    "mkdocstrings-python": "a plugin",
}
CORE, DEV = ("upplied",), ("upplied", "flows", "tests", "bench", "docs", "examples")
# What only an extra brings may be imported in these files, and nowhere else in the package.
EXTRA_FILES = {
    "formats": {"upplied/inputs/formats/clouds.py"},
    "ardupilot": {"upplied/inputs/sources/autopilots.py"},
    "geoid": {"upplied/inputs/schemas/geodetic.py"},
    "export": {
        "upplied/outputs/pages.py",
        "upplied/outputs/draw/sheet.py",
        "upplied/outputs/logs.py",
        "upplied/outputs/mission_drawing.py",
        "upplied/outputs/pictures.py",
        "upplied/web/guard.py",
        "upplied/web/serving.py",
    },
    "plan": {"upplied/geometry/scene.py"},
    "signing": {"upplied/catalog/verbs/roster.py"},
    "fleet": set(),
    "dask": set(),
    "ray": set(),
}


def plain(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


def declared(texts: list[str]) -> set[str]:
    return {plain(Requirement(text).name) for text in texts} - {"upplied"}


def imported(*folders: str) -> dict[str, set[str]]:
    """The files that import each top-level package from elsewhere."""
    files: dict[str, set[str]] = {}
    for path in (path for folder in folders for path in (ROOT / folder).rglob("*.py")):
        for top in packages(path) - sys.stdlib_module_names:
            files.setdefault(top, set()).add(path.relative_to(ROOT).as_posix())
    return files


@cache
def packages(path: Path) -> set[str]:
    """Top-level packages that a file imports."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            names.add(str(node.module).split(".")[0])
    return names


def distributions(module: str) -> set[str]:
    """What brings a module; where none is installed, a distribution of its name."""
    return {plain(name) for name in installed().get(module, [module])}


@cache
def installed() -> Mapping[str, list[str]]:
    return packages_distributions()


@pytest.mark.ci
def test_what_is_declared_is_imported() -> None:
    used = {name for module in imported(*DEV) for name in distributions(module)}
    every = declared(PROJECT["dependencies"] + [text for texts in EXTRAS.values() for text in texts])
    idle = every - used
    assert idle <= set(NOT_IMPORTED), f"declared, never imported: {sorted(idle - set(NOT_IMPORTED))}"
    assert set(NOT_IMPORTED) <= every, f"no longer declared: {sorted(set(NOT_IMPORTED) - every)}"
    core = {name for module in imported(*CORE) for name in distributions(module)}
    idle = declared(PROJECT["dependencies"]) - core
    assert not idle, f"a dependency of everybody, and the package never imports it: {sorted(idle)}"


def test_what_the_package_imports_is_declared_where_it_is_needed() -> None:
    core = declared(PROJECT["dependencies"])
    for module, files in imported(*CORE).items():
        if module == "upplied" or distributions(module) & core:
            continue
        extras = {name for name in EXTRA_FILES if distributions(module) & declared(EXTRAS[name])}
        assert extras, f"{module} is not declared, {sorted(files)} import it"
        allowed = set().union(*(EXTRA_FILES[name] for name in extras))
        assert files <= allowed, f"{module} comes with {extras}, {sorted(files - allowed)} import it"


def test_flows_import_what_the_extra_fleet_brings() -> None:
    ours = declared(PROJECT["dependencies"] + EXTRAS["fleet"] + EXTRAS["dask"] + EXTRAS["ray"])
    for module, files in imported("flows").items():
        assert module in ("upplied", "flows") or distributions(module) & ours, (module, files)


def test_what_developers_install_brings_every_extra_that_runs_here() -> None:
    own = [Requirement(text) for text in EXTRAS["dev"] if Requirement(text).name == "upplied"]
    names = {name for one in own for name in one.extras}
    assert {"plan", "fleet", "formats", "export", "dask"} <= names


@pytest.mark.parametrize(
    "name", sorted(declared(PROJECT["dependencies"]).union(*map(declared, EXTRAS.values())))
)
def test_each_dependency_has_a_row(name: str) -> None:
    text = (ROOT / "docs" / "making" / "libraries.md").read_text(encoding="utf-8")
    assert f"`{name.removesuffix('-cpu')}`" in text, "docs/making/libraries.md does not say what it is for"


def test_an_extra_that_is_missing_is_named_with_the_command_that_installs_it() -> None:
    from upplied.errors import InputError
    from upplied.extras import extra

    with pytest.raises(InputError, match=r'pip install "upplied\[formats\]"'), extra("formats"):
        raise ModuleNotFoundError("no", name="pye57")

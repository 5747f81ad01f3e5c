"""Titles of columns and measures: the tables of `labels.toml`."""

import tomllib
from importlib import resources
from typing import Any


def table(name: str) -> dict[str, Any]:
    """A TOML file of this package."""
    return tomllib.loads(resources.files("upplied.outputs").joinpath(name).read_text("utf-8"))


#: Title of each column or measure, by table; for figures in sentences with their format.
LABELS: dict[str, dict[str, Any]] = table("labels.toml")

"""Titles of columns, measures and rules as people read them: the tables of `labels.toml`."""

from __future__ import annotations

import tomllib
from importlib import resources
from typing import Any


def table(name: str) -> dict[str, Any]:
    """A TOML file of this package: what is data and no code."""
    return tomllib.loads(resources.files("upplied.outputs").joinpath(name).read_text("utf-8"))


#: Title of each column or measure, by table; where figures stand in sentences with their form.
LABELS: dict[str, dict[str, Any]] = table("labels.toml")

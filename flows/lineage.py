"""What is made of what, as assets of Prefect: structures, demonstrations, plans and publications."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import ParamSpec, TypeVar
from urllib.parse import quote

from prefect.assets import Asset, AssetProperties
from prefect.tasks import MaterializingTask

P = ParamSpec("P")
R = TypeVar("R")

SOMEWHERE = "file:///catalog"  # of a task that has not been told yet what it makes (`making`)
MEANING = {
    "structures": "The structures of a fleet, with their meshes.",
    "demonstrations": "The flights of experts.",
    "flights": "Flights of the plans, and what they showed.",
    "transfers": "The plans: every demonstration to every structure of its kind.",
    "reports": "Plain Parquet, pages and pictures for people.",
}


def asset(location: str, name: str) -> Asset:
    """A table of the catalog at a location, or the publication there, by its name in `MEANING`."""
    place = source(location)
    key = place if name == "reports" else f"{place.rstrip('/')}/{name}"
    return Asset(key=key, properties=AssetProperties(name=name, description=MEANING[name]))


def source(location: str) -> str:
    """The key of a file or folder that is read."""
    return location if "://" in location else f"file://{quote(str(Path(location).absolute()))}"


def making(task: MaterializingTask[P, R], asset: Asset, of: Sequence[Asset | str]) -> MaterializingTask[P, R]:
    """A task that says what it makes, and of what."""
    return task.with_options(assets=[asset], asset_deps=list(of))

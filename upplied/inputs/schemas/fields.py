"""The paths that are read of the messages of each schema, as `schemas.toml` lists them."""

from __future__ import annotations

from collections.abc import Iterator

from upplied.inputs.files import table
from upplied.inputs.flight.tracks import PoseShape

_FAMILIES = table("schemas/schemas.toml")


def shapes_of(family: str) -> dict[str, PoseShape]:
    """Where the poses of each schema of a family stand in its messages."""
    return {schema: PoseShape(*paths) for schema, paths in _FAMILIES[family].get("poses", {}).items()}


def fields_of(family: str) -> dict[str, tuple[str, ...]]:
    """All paths that are read of each schema of a family; ``{x,y}`` stands for several."""
    paths = {schema: shape.paths for schema, shape in shapes_of(family).items()}
    for schema, text in _FAMILIES[family].get("fields", {}).items():
        paths[schema] = (*paths.get(schema, ()), *_paths(text))
    return paths


def _paths(text: str) -> Iterator[str]:
    for word in text.split():
        start, _, ends = word.rstrip("}").partition("{")
        yield from (start + end for end in ends.split(","))


FIELDS = {schema: paths for family in _FAMILIES for schema, paths in fields_of(family).items()}

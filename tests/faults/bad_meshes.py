"""Structures that are wrong in one way each: units, axes, kinds, counts; made from sample structures."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import trimesh

from upplied.inputs.manifests import StructureEntry
from upplied.records import Floats, Ints, Structure, Surroundings

# What the numbers of a file are off by where its unit is mistaken, or a model is no real size.
SIZES = {
    "millimetres as metres": 1000.0,
    "centimetres as metres": 100.0,
    "inches as metres": 1 / 0.0254,
    "feet as metres": 1 / 0.3048,
    "metres as millimetres": 0.001,
    "metres as centimetres": 0.01,
    "metres as inches": 0.0254,
    "metres as feet": 0.3048,
    "a model of 3 to 10": 0.3,
    "a model of 1 to 10": 0.1,
    "ten times": 10.0,
    "yards as inches": 36.0,
}
SURELY = ("millimetres as metres", "centimetres as metres", "inches as metres", "metres as millimetres",
          "metres as centimetres", "metres as inches", "yards as inches")  # fmt: skip
# How a file's axes are taken for others: rows are the declared x, y, z in true axes.
SIDES: dict[str, Floats] = {
    "Y up read as Z up": np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]),
    "Z up read as Y up": np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]),
    "X up read as Z up": np.array([[0.0, 0, -1], [0, 1, 0], [1, 0, 0]]),
    "upside down": np.diag([1.0, -1.0, -1.0]),
    "all axes exchanged": np.array([[0.0, 1, 0], [0, 0, 1], [1, 0, 0]]),
}


def scaled(structure: Structure, factor: float) -> Structure:
    """The structure in a mistaken unit."""
    return replace(structure, vertices=structure.vertices * factor, sha256="")


def on_its_side(structure: Structure, turn: Floats) -> Structure:
    """The structure with its axes mistaken."""
    return replace(structure, vertices=structure.vertices @ turn.T, sha256="")


@dataclass(frozen=True)
class Odd:
    """A file and what is said of it, by which one rule is broken."""

    rule: str
    vertices: Floats
    triangles: Ints
    entry: dict
    suffix: str = "obj"
    edit: Callable[[str], str] = str


def box(size: tuple[float, float, float], at: tuple[float, float, float] = (0, 0, 0)) -> trimesh.Trimesh:
    """A box about a place."""
    mesh = trimesh.creation.box(size)
    mesh.apply_translation(at)
    return mesh


def odd_alone() -> Iterator[Odd]:
    """A file for each rule that needs no other structure."""
    house = box((10, 6, 4))
    ground = Surroundings(ground_z_m=0.0)
    inside = trimesh.util.concatenate([house, box((1, 1, 1))])
    wake = trimesh.Trimesh([[-9, -1, -2], [-90, -9, -2], [-90, 9, -2]], [[0, 1, 2]])
    trail = trimesh.util.concatenate([house, wake])

    def odd(rule: str, mesh: trimesh.Trimesh, **entry: object) -> Odd:
        suffix, edit = str(entry.pop("suffix", "obj")), entry.pop("edit", str)
        return Odd(rule, np.asarray(mesh.vertices), np.asarray(mesh.faces), entry, suffix, edit)  # type: ignore[arg-type]

    yield odd("nominal", house, nominal_m=(20.0, None, None))
    yield odd("extent", house, unit_m=1000.0)
    yield odd("odd-extent", house, unit_m=300.0)
    yield odd("declared-unit", house, suffix="glb", unit_m=0.5, up="y", forward="z")
    yield odd("declared-up", house, suffix="glb", up="z", forward="x")
    yield odd("far", box((10, 6, 4), (50_000, 0, 0)))
    yield odd("below-ground", house, surroundings=ground)
    yield odd("effects", house, edit=lambda text: text.replace("\nf ", "\no ship_wake\nf ", 1))
    yield odd("landmark", house, landmarks={"nose": (50.0, 0.0, 0.0)})
    yield odd("hidden", inside)
    yield odd("outlier", trail)


def entry_of(odd: Odd, folder: Path, data: bytes) -> StructureEntry:
    """The entry of an odd file that is written into a folder."""
    path = folder / f"odd.{odd.suffix}"
    path.write_bytes(odd.edit(data.decode()).encode() if odd.suffix == "obj" else data)
    return StructureEntry("odd", "thing", path, **({"unit_m": 1.0} | odd.entry))

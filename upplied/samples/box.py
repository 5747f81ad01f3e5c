"""Boxes of the size of buildings; every face is a part of its own."""

from __future__ import annotations

from upplied.samples.surfaces import Member, assemble, box_faces


def box(size_m: tuple[float, float, float], structure_id: str) -> Member:
    """The mesh of a box (length along X, width, height) whose base has its middle on the origin."""
    length, width, height = size_m
    faces = box_faces((-length / 2, -width / 2, 0.0), (length / 2, width / 2, height), cells=12)
    return assemble(structure_id, "box", faces, "box")

"""Triangles of meshes: their areas, and points spread evenly over them."""

from __future__ import annotations

import numpy as np

from upplied.records import Floats, Ints, Structure
from upplied.vectors import area_vectors


def triangle_areas(structure: Structure) -> Floats:
    """Area (T,) of each triangle of a mesh, m^2; kept with its record."""

    def areas() -> Floats:
        corners = structure.vertices[structure.triangles]
        return np.asarray(np.linalg.norm(area_vectors(corners), axis=1) / 2)

    return structure.derived("triangle areas", areas)


def points_on_triangles(
    structure: Structure, number: int, rng: np.random.Generator, some: Ints | None = None
) -> tuple[Floats, Ints]:
    """Points spread evenly by area over a mesh: stratified along the cumulated area.

    Parameters
    ----------
    structure : Structure
    number : int
    rng : numpy.random.Generator
    some : array of int, shape (S,), optional
        The triangles to spread them over; all where not given.

    Returns
    -------
    points : array, shape (number, 3), m
    triangle : array of int, shape (number,)
        On which each lies.
    """
    area = triangle_areas(structure)
    cumulated = np.cumsum(area if some is None else area[some])
    along = (np.arange(number) + rng.random(number)) / number * cumulated[-1]
    triangle = np.minimum(np.searchsorted(cumulated, along, side="right"), len(cumulated) - 1)
    triangle = triangle if some is None else some[triangle]
    chosen = structure.vertices[structure.triangles[triangle]]
    root, second = np.sqrt(rng.random(number))[:, None], rng.random(number)[:, None]
    points = chosen[:, 0] * (1 - root) + root * (chosen[:, 1] * (1 - second) + chosen[:, 2] * second)
    return points, triangle

"""The true counterparts on the sample fleet: same part, same triangle, same place in it."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from upplied.errors import InputError
from upplied.geometry.scene import scene_of
from upplied.records import Floats, Ints
from upplied.samples.fleet import member
from upplied.samples.surfaces import Member

# With `counterparts=OUTER_ENGINES` a twin's engines correspond to the outer ones of a four-engined airliner.
OUTER_ENGINES = {
    f"{part}_{side}": f"{part}_{side}_outer" for part in ("engine", "pylon") for side in ("left", "right")
}


def parts(structure: str | Member) -> tuple[tuple[str, ...], Ints]:
    """Names of the parts of a sample structure, and the part of each of its triangles."""
    sample = _member(structure)
    return sample.part_names, sample.part_of_triangle


def true_counterparts(
    source: str | Member,
    target: str | Member,
    points: Floats,
    counterparts: Mapping[str, str] | None = None,
) -> Floats:
    """Where points of one member of a kind lie on another.

    Parameters
    ----------
    source, target : str or Member
        Sample structures of one kind, by id or as made.
    points : array, shape (N, 3), m, frame of the source
        Each stands for its closest point on the source's surface.
    counterparts : mapping, optional
        Part of the source to part of the target, where the names differ, e.g. `OUTER_ENGINES`.

    Returns
    -------
    array, shape (N, 3), m, frame of the target
        NaN where the target lacks the part.

    Raises
    ------
    InputError
        If the two are not of one kind, or one is no sample structure.
    """
    one, other = _member(source), _member(target)
    if one.structure.kind != other.structure.kind:
        raise InputError(
            f"{one.structure.structure_id} and {other.structure.structure_id}",
            f"are of the kinds {one.structure.kind} and {other.structure.kind}",
            "true counterparts are known within one kind",
        )
    closest, triangle = scene_of(one.structure).closest(points)  # single precision: mm on long triangles
    answering = _answering_triangles(one, other, counterparts or {})[triangle]
    weights = _barycentric(closest, one.structure.vertices[one.structure.triangles[triangle]])
    corners = other.structure.vertices[other.structure.triangles[answering]]
    carried = np.einsum("nk,nkj->nj", weights, corners)
    carried[answering < 0] = np.nan
    return carried


def _member(structure: str | Member) -> Member:
    return member(structure) if isinstance(structure, str) else structure


def _answering_triangles(one: Member, other: Member, renamed: Mapping[str, str]) -> Ints:
    """For each triangle of the one its partner on the other, -1 where there is none."""
    answer = np.full(len(one.part_of_triangle), -1)
    for name in one.part_names:
        own_name = renamed.get(name, name)
        name_there = own_name if own_name in other.part_names else name
        there = other.triangles_of(name_there)
        if len(there):
            answer[one.triangles_of(name)] = there
    return answer


def _barycentric(points: Floats, corners: Floats) -> Floats:
    """Weights (N, 3) of the corners (N, 3, 3) for points in the planes of their triangles."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    to_b, to_c, to_p = b - a, c - a, points - a
    bb, bc, cc = (np.einsum("ij,ij->i", x, y) for x, y in ((to_b, to_b), (to_b, to_c), (to_c, to_c)))
    pb, pc = np.einsum("ij,ij->i", to_p, to_b), np.einsum("ij,ij->i", to_p, to_c)
    area = np.maximum(bb * cc - bc * bc, 1e-300)
    v, w = (cc * pb - bc * pc) / area, (bb * pc - bc * pb) / area
    weights = np.clip(np.stack([1 - v - w, v, w], axis=1), 0, 1)
    return np.asarray(weights / weights.sum(axis=1, keepdims=True))

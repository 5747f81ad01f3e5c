"""What the user says a flight, or a zone, is about: names of parts, boxes, and what is painted in balls."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.spatial import cKDTree

from upplied.errors import SettingsError
from upplied.geometry.scene import scene_of
from upplied.planning.surface.parts import labels_of
from upplied.records import Bools, Cloud, Floats, Ints, Structure

_NEIGHBOURS = 25  # samples nearest to a landmark, that say which part of the skin it lies in
_RULE = (
    "landmarks, part_0, part_1, ..., 'box X Y Z X Y Z' (two corners, m), 'ball X Y Z R' (m) or labels of "
    "faces, separated by commas"
)


#: Which faces (T,) of a structure have a label, by the hash of the labels and the label.
Faces = Callable[[Structure, str, str], Bools]


def zone_of(
    about: str, structure: Structure, cloud: Cloud, skin: Ints, faces: Faces | None = None
) -> Bools | None:
    """Which surface samples (N,) a text names; None where it names none.

    Parameters
    ----------
    about : str
        Landmarks of the structure (the part of the skin there), ``part_3`` of a summary, or
        ``box 10 2 1 14 6 4``: two corners in the structure's declared frame, m, or ``ball 10 2 1 0.5``:
        the surface that near to a place, on the side that is nearest to it. Separated by commas.
    structure, cloud
        In whatever frame it is planned in, and its N surface samples.
    skin : array of int, shape (N,)
        The part of the skin that each lies on.
    faces : callable, optional
        What ``labels HASH LABEL`` asks for the faces of a label.

    Raises
    ------
    SettingsError
        If a name is unknown, a box or ball has not its numbers, or nothing of the surface is named.
    """
    wanted = [word.strip() for word in about.split(",") if word.strip()]
    if not wanted:
        return None
    zone = np.zeros(len(cloud), bool)
    for word in wanted:
        zone |= _zone(word, structure, cloud, skin, faces)
    if not zone.any():
        raise SettingsError(f"about {about[:80]!r}", "names no surface of the structure", _RULE)
    return zone


def _zone(word: str, structure: Structure, cloud: Cloud, skin: Ints, faces: Faces | None) -> Bools:
    if word.lower().startswith("box "):
        corners = _numbers(word, 6, "a box").reshape(2, 3)
        low, high = corners.min(axis=0), corners.max(axis=0)
        points = structure.frame.to_declared(cloud.points)
        return np.asarray(((points >= low) & (points <= high)).all(axis=1), bool)
    if word.lower().startswith("ball "):
        *place, radius = _numbers(word, 4, "a ball")
        points = structure.frame.to_declared(cloud.points)
        off = np.linalg.norm(points - place, axis=1)
        same_side = np.ones(len(cloud), bool)
        if cloud.normals is not None:  # of a thin plate one side is meant
            same_side = cloud.normals @ cloud.normals[int(off.argmin())] > 0
        return np.asarray((off <= radius) & same_side, bool)
    if word.startswith("labels ") and faces is not None and len(structure.triangles):
        named = word.split()
        if len(named) != 3:
            raise SettingsError(f"about {word[:60]!r}", "cannot be read as labels", _RULE)
        nearest = scene_of(structure).closest(cloud.points)[1]
        return np.asarray(faces(structure, *named[1:])[nearest], bool)
    if word in structure.landmarks:
        count = min(_NEIGHBOURS, len(cloud))
        near = cKDTree(cloud.points).query(np.array(structure.landmarks[word]), k=count)[1]
        return np.asarray(skin == np.bincount(skin[np.atleast_1d(near)]).argmax(), bool)
    label = labels_of(cloud)
    number = word.removeprefix("part_")
    if word.startswith("part_") and number.isdecimal() and int(number) <= int(label.max()):
        return np.asarray(label == int(number), bool)
    known = ", ".join(sorted(structure.landmarks)) or "none"
    reason = f"is unknown; landmarks of {structure.structure_id}: {known}"
    raise SettingsError(f"about {word[:60]!r}", reason, _RULE)


def _numbers(word: str, count: int, what: str) -> Floats:
    try:
        numbers = np.array([float(part) for part in word.split()[1:]])
    except ValueError:
        numbers = np.empty(0)
    if len(numbers) != count or not np.isfinite(numbers).all():
        raise SettingsError(f"about {word[:60]!r}", f"cannot be read as {what}", _RULE)
    return numbers

"""Parts of a surface of one piece, from a structure of the same kind whose pieces tell its parts.

A scan, a photogrammetric model or a cloud is one piece. Its skin continues over a nacelle and ends where
that meets the wing (`surface.skin`), and another structure of the kind says what lies about there. So
stretches of skin are named after the part that a smooth displacement brings onto them, stretches of one
name that touch are one part, and what has the shape of a part found already is another one of its kind,
whatever lies near it: the outer engine of an airliner beside the inner one that the other has alone.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from upplied.planning.constants import (
    COMPACT,
    FACING,
    FRAGMENT,
    MAJORITY,
    SAME_FACE,
    SAME_SIZE,
    TOLERANCE,
    TOUCH,
)
from upplied.planning.correspondence.coherent_point_drift import Patch, drift, spread_over
from upplied.planning.geometry.boxes import diagonal_of, spacing
from upplied.planning.surface.parts import labels_of, part_labels
from upplied.records import Bools, Cloud, Floats, Ints
from upplied.vectors import with_normals

_LEAST_SAMPLES = 15  # of a part that is compared with others
_CONTROLS, _ANCHORS = 200, 450  # points that move, and points that pull (`correspondence.by_parts`)


def has_parts(cloud: Cloud) -> bool:
    """Whether the samples of a surface are known to lie on more than one part."""
    return bool(labels_of(cloud).max(initial=0) > 0)


def parts_like(whole: Cloud, skin: Ints, known: Cloud) -> Ints:
    """The part (N,) of each sample of a surface of one piece, 0 the largest.

    Parameters
    ----------
    whole : Cloud
        N samples with normals and areas.
    skin : array of int, shape (N,)
        The stretch of skin that each lies on.
    known : Cloud
        Samples of a structure with parts, in the frame and at the scale of `whole`.
    """
    solid = ~_floating(whole)
    label = np.empty(len(whole), np.int64)
    label[solid] = _parts_of_solid(whole.at(solid), skin[solid], known)
    # What floats is one part, which corresponds to none and widens none.
    label[~solid] = label[solid].max() + 1
    return label


def _floating(whole: Cloud) -> Bools:
    """Which samples lie on fragments that touch nothing: birds, cables, reflections in a scan."""
    pairs = cKDTree(whole.points).query_pairs(TOUCH * spacing(whole), output_type="ndarray")
    piece = _connected(pairs, np.zeros(len(whole), np.int64))
    count = np.bincount(piece)[piece]
    return np.asarray(count < np.minimum(max(_LEAST_SAMPLES, FRAGMENT * len(whole)), count.max()), bool)


def _parts_of_solid(whole: Cloud, skin: Ints, known: Cloud) -> Ints:
    name = carried(whole, known)
    step, reach = spacing(whole), TOUCH * spacing(whole)
    stretch = _named_stretches(whole, skin, name)
    pairs = cKDTree(whole.points).query_pairs(reach, output_type="ndarray")
    label = _connected(pairs, stretch)
    label = _others_alike(whole, skin, label, max(step, 1e-9))
    return part_labels(whole.points, whole.areas, label)


def carried(whole: Cloud, known: Cloud) -> Ints:
    """The part (N,) of `known` that lies nearest to each sample, faces alike, after a smooth displacement."""
    diagonal = diagonal_of(whole.points)
    none = np.full(len(known), -1), np.full(len(whole), -1)
    moving = Patch(known.points, known.outward, none[0])
    fixed = Patch(whole.points, whole.outward, none[1])
    found = drift(
        moving.rows(spread_over(known, _CONTROLS)), fixed.rows(spread_over(whole, _ANCHORS)), diagonal
    )
    moved = moving.points + found.at(moving.points, moving.label)
    weight = FACING * diagonal
    tree = cKDTree(with_normals(moved, known.outward, weight))
    return labels_of(known)[tree.query(with_normals(whole.points, whole.outward, weight))[1]]


def _named_stretches(whole: Cloud, skin: Ints, name: Ints) -> Ints:
    """A name for each sample: its stretch's, or where that has none its own."""
    area = np.zeros((int(skin.max()) + 1, int(name.max()) + 1))
    np.add.at(area, (skin, name), whole.areas)
    pure = area.max(axis=1) >= MAJORITY * area.sum(axis=1)
    return np.where(pure[skin], area.argmax(axis=1)[skin], name)


def _connected(pairs: Ints, name: Ints) -> Ints:
    """Samples of one name that touch, as parts (N,)."""
    same = pairs[name[pairs[:, 0]] == name[pairs[:, 1]]]
    number = len(name)
    graph = coo_matrix((np.ones(len(same), bool), (same[:, 0], same[:, 1])), (number, number))
    return np.asarray(connected_components(graph, directed=False)[1], np.int64)


def _others_alike(whole: Cloud, skin: Ints, label: Ints, step_m: float) -> Ints:
    """The parts, and beside them stretches of skin that look like one of the compact parts found already."""
    diagonal = diagonal_of(whole.points)
    label = label.copy()
    templates = _compact(whole, label, diagonal)
    for stretch in np.flatnonzero(np.bincount(skin) >= max(_LEAST_SAMPLES, FRAGMENT * len(skin))):
        mine = skin == stretch
        if np.ptp(whole.points[mine], axis=0).max() > COMPACT * diagonal:
            continue
        if (np.bincount(label[mine]).max() > MAJORITY * mine.sum()) and _is_alone(label, mine):
            continue  # a part of its own already
        if any(_alike(whole, template, mine, step_m) for template in templates):
            label[mine] = label.max() + 1
    return label


def _compact(whole: Cloud, label: Ints, diagonal: float) -> list[Bools]:
    """Which samples lie on each part that is small enough for others of its kind to stand elsewhere."""
    count = np.bincount(label)
    found = [label == part for part in np.flatnonzero(count >= max(_LEAST_SAMPLES, FRAGMENT * len(label)))]
    return [mine for mine in found if np.ptp(whole.points[mine], axis=0).max() < COMPACT * diagonal]


def _is_alone(label: Ints, mine: Bools) -> bool:
    """Whether most of the part that a stretch lies in is that stretch."""
    part = np.bincount(label[mine]).argmax()
    return bool(mine[label == part].mean() > MAJORITY)


def _alike(whole: Cloud, template: Bools, mine: Bools, step_m: float) -> bool:
    """Whether a stretch of skin has the shape of a part, shifted, or mirrored left for right."""
    ratio = whole.areas[mine].sum() / whole.areas[template].sum()
    if not 1 / SAME_SIZE < ratio < SAME_SIZE or (template & mine).any():
        return False
    here, facing = whole.points[template], whole.outward[template]
    there, faces = whole.points[mine], whole.outward[mine]
    return any(_fits(here * flip, facing * flip, there, faces, step_m) for flip in _FLIPS)


_FLIPS = np.array([[1.0, 1, 1], [1, -1, 1], [-1, 1, 1]])


def _fits(here: Floats, facing: Floats, there: Floats, faces: Floats, step_m: float) -> bool:
    """Whether most samples of either surface lie near the other, once their middles are made equal."""
    size = float(np.linalg.norm(np.ptp(there, axis=0)))
    moved = here + (there.min(axis=0) + there.max(axis=0) - here.min(axis=0) - here.max(axis=0)) / 2
    shares = []
    for one, normals, other, others in ((moved, facing, there, faces), (there, faces, moved, facing)):
        apart, index = cKDTree(other).query(one)
        near = apart < max(TOLERANCE * size, step_m)
        shares.append(float((near & ((normals * others[index]).sum(axis=1) > SAME_FACE)).mean()))
    return min(shares) > MAJORITY

"""Parts of a surface of one piece, from a structure of the same kind whose pieces tell its parts.

A scan, a photogrammetric model or a cloud is one piece. Its skin continues over a nacelle and ends where
that meets the wing (`surface.skin`), and another structure of the kind says what lies about there. So
samples of a stretch of skin are named after the part that a smooth displacement brings onto them, samples of
one name that touch are one part, and where the displacement brings nothing, what has the shape of a part
found already is another one of its kind: the outer engine of an airliner beside the inner one.
"""

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from upplied.geometry.vectors import with_normals
from upplied.planning.constants import (
    COMPACT,
    FACING,
    FRAGMENT,
    MAJORITY,
    MOST_RATIO,
    SAME_FACE,
    SAME_SIZE,
    TOLERANCE,
    TOUCH,
)
from upplied.planning.correspondence.coherent_point_drift import brought_onto
from upplied.planning.geometry.clouds import diagonal_of, nearest_facing, spacing
from upplied.planning.surface.parts import by_size, joined_small, labels_of
from upplied.records import Bools, Cloud, Floats, Ints

_LEAST_SAMPLES = 15  # of a part that is compared with others
_LIKE = 0.6  # share of either surface that lies near the other, from which parts are alike
_ROUNDS = 6  # in which a part is shifted to where it lies best


def has_parts(cloud: Cloud) -> bool:
    """Whether the samples of a surface are known to lie on more than one part."""
    return bool(labels_of(cloud).max(initial=0) > 0)


def parts_like(whole: Cloud, skin: Ints, known: Cloud) -> Ints:
    """The part (N,) of each sample of a surface of one piece, 0 the largest.

    `skin` (N,) is the stretch of skin that each lies on; `known` are samples of a structure with parts, in
    the frame and at the scale of `whole`.
    """
    solid = ~_floating(whole)
    label, body, skin = np.empty(len(whole), np.int64), whole.at(solid), skin[solid]
    moved = brought_onto(body, known)
    name, far = _nearest(body, moved)
    part = _with_others(body, skin, _pieces(body, _named(body, skin, name, moved)), far)
    label[solid] = by_size(body.areas, joined_small(body.points, body.areas, part))
    # What floats is one part, which corresponds to none and widens none.
    label[~solid] = label[solid].max() + 1
    return label


def _floating(whole: Cloud) -> Bools:
    """Which samples lie on fragments that touch nothing: birds, cables, reflections in a scan."""
    piece = _pieces(whole, np.zeros(len(whole), np.int64))
    count = np.bincount(piece)[piece]
    return np.asarray(count < np.minimum(max(_LEAST_SAMPLES, FRAGMENT * len(whole)), count.max()), bool)


def fragments(cloud: Cloud) -> int:
    """How many fragments of a scan touch nothing."""
    return len(np.unique(_pieces(cloud, np.zeros(len(cloud), np.int64))[_floating(cloud)]))


def _pieces(cloud: Cloud, name: Ints) -> Ints:
    """Samples of one name that touch, as parts (N,)."""
    return connected(cKDTree(cloud.points).query_pairs(TOUCH * spacing(cloud), output_type="ndarray"), name)


def carried(whole: Cloud, known: Cloud) -> Ints:
    """The part (N,) of `known` that a smooth displacement brings onto each sample, -1 where none is near."""
    name, far = _nearest(whole, brought_onto(whole, known))
    return np.where(far, -1, name)


def _nearest(whole: Cloud, moved: Cloud) -> tuple[Ints, Bools]:
    """The part (N,) of `moved` that lies nearest to each sample, and whether it is far."""
    # Farther than what turning a normal by a right angle counts.
    weight = FACING * diagonal_of(whole.points)
    distance, index = nearest_facing(whole, moved, weight)
    return labels_of(moved)[index], distance > weight


def _named(whole: Cloud, skin: Ints, name: Ints, moved: Cloud) -> Ints:
    """A name for each sample: what most of its stretch have, unless its own lies clearly nearer."""
    # What is no farther than neighbours are is not clearer: decks lie close, and so does what a displacement
    # brings a step too far. Nor do few samples of a stretch make a part.
    number, weight, slack = int(name.max()) + 1, FACING * diagonal_of(whole.points), TOUCH * spacing(whole)
    of_stretch, own_name = _counted(skin, name, number).argmax(axis=1)[skin], name.copy()
    for part in np.unique(of_stretch[name != of_stretch]):
        doubt = np.flatnonzero((of_stretch == part) & (name != part))
        both = moved, moved.at(labels_of(moved) == part)
        own, other = (nearest_facing(whole.at(doubt), one, weight)[0] for one in both)
        own_name[doubt[other - own < slack]] = part
    few = np.maximum(_LEAST_SAMPLES, TOLERANCE * np.bincount(skin))[skin]
    return np.where(_counted(skin, own_name, number)[skin, own_name] < few, of_stretch, own_name)


def _counted(skin: Ints, name: Ints, number: int) -> Ints:
    """How many samples of each stretch (row) have each name (column)."""
    count = np.bincount(skin * number + name, minlength=(int(skin.max()) + 1) * number)
    return np.asarray(count.reshape(-1, number), np.int64)


def connected(pairs: Ints, name: Ints) -> Ints:
    """Samples of one name that touch, as parts (N,)."""
    same = pairs[name[pairs[:, 0]] == name[pairs[:, 1]]]
    number = len(name)
    graph = coo_matrix((np.ones(len(same), bool), (same[:, 0], same[:, 1])), (number, number))
    return np.asarray(connected_components(graph, directed=False)[1], np.int64)


def _with_others(whole: Cloud, skin: Ints, label: Ints, far: Bools) -> Ints:
    """The parts, and beside them others of the kind of a compact one, of samples that mostly lie far."""
    # Each is looked for about a compact stretch of skin, the largest first.
    templates = [mine for mine in _compact(whole, label) if far[mine].mean() <= MAJORITY]
    label, count = label.copy(), np.bincount(skin)
    taken = np.any(templates, axis=0) if templates else np.zeros(len(whole), bool)
    for stretch in np.argsort(-count, kind="stable")[: int((count >= _LEAST_SAMPLES).sum())]:
        mine = (skin == stretch) & ~taken
        if 2 * mine.sum() < count[stretch] or far[mine].mean() <= MAJORITY or not _is_compact(whole, mine):
            continue
        for template in templates:
            if not 1 / MOST_RATIO < mine.sum() / template.sum() < SAME_SIZE:
                continue
            another = _covered(whole, skin, template, mine, taken)
            if far[another].mean() > MAJORITY and _alike(whole, template, another):
                label[another] = label.max() + 1
                taken = taken | another
                break
    return label


def unnamed_like(whole: Cloud, named: Ints, template: Bools) -> bool:
    """Whether something on a larger part, that nothing explains, is of the size of one: another, perhaps.

    Samples without a name (N,), -1, that touch; what is much of its part was asked as a part.
    """
    label, lone = labels_of(whole), np.minimum(named, 0)
    piece, area, most = _pieces(whole, lone), whole.areas, SAME_SIZE**2
    size = np.ptp(whole.points[template], axis=0)
    for each in np.unique(piece[lone < 0]):
        mine = piece == each
        theirs = label == np.bincount(label[mine]).argmax()
        if area[mine & theirs].sum() > MAJORITY * area[theirs].sum():
            continue
        ratio = np.append(np.ptp(whole.points[mine], axis=0) / size, area[mine].sum() / area[template].sum())
        if ratio.min() > 1 / most and ratio.max() < most:
            return True
    return False


def _covered(whole: Cloud, skin: Ints, template: Bools, mine: Bools, taken: Bools) -> Bools:
    """What a part covers, shifted or mirrored to where it lies best about a stretch of skin."""
    # Stretches that it mostly covers count whole, and must be most of it: on a scan another engine may be two
    # of them, and its pylon a piece of the wing's, but what covers a piece of a wing alone is none. Then the
    # stretch is asked alone.
    size, reach = _size_and_reach(whole, template)
    weight = FACING * diagonal_of(whole.points)
    middle = whole.points[mine].mean(axis=0)
    about = np.flatnonzero((np.linalg.norm(whole.points - middle, axis=1) < size) & ~taken)
    there = with_normals(whole.points[about], whole.outward[about], weight)
    tree, most = cKDTree(there), np.zeros(len(whole), bool)
    for flip in _FLIPS:
        moved = with_normals(whole.points[template] * flip, whole.outward[template] * flip, weight)
        moved[:, :3] += middle - moved[:, :3].mean(axis=0)
        for _ in range(_ROUNDS):
            apart, index = tree.query(moved)
            near = apart < size / 2
            if near.any():
                moved[:, :3] += (there[index[near], :3] - moved[near, :3]).mean(axis=0)
        index = cKDTree(moved).query(there)[1]
        near = np.linalg.norm(there[:, :3] - moved[index, :3], axis=1) < reach
        near &= (there[:, 3:] * moved[index, 3:]).sum(axis=1) > SAME_FACE * weight**2
        if near.sum() > most.sum():
            most = np.zeros(len(whole), bool)
            most[about[near]] = True
    mostly = (np.bincount(skin, weights=most) > MAJORITY * np.bincount(skin))[skin] & ~taken
    return most | mostly if (most & mostly).sum() > MAJORITY * most.sum() else mine


def _compact(whole: Cloud, label: Ints) -> list[Bools]:
    """Which samples lie on each part that is small enough for others of its kind to stand elsewhere."""
    count = np.bincount(label)
    parts = [label == part for part in np.flatnonzero(count >= max(_LEAST_SAMPLES, FRAGMENT * len(label)))]
    return [mine for mine in parts if _is_compact(whole, mine)]


def _is_compact(whole: Cloud, mine: Bools) -> bool:
    return bool(np.ptp(whole.points[mine], axis=0).max() < COMPACT * diagonal_of(whole.points))


def _size_and_reach(whole: Cloud, mine: Bools) -> tuple[float, float]:
    """The diagonal of a part, and how near another of its kind lies to it, m."""
    size = float(np.linalg.norm(np.ptp(whole.points[mine], axis=0)))
    return size, max(TOLERANCE * size, spacing(whole), 1e-9)


def _alike(whole: Cloud, template: Bools, mine: Bools) -> bool:
    """Whether some samples have the shape of a part, shifted, or mirrored left for right."""
    ratio = whole.areas[mine].sum() / whole.areas[template].sum()
    if not 1 / SAME_SIZE < ratio < SAME_SIZE or (template & mine).any():
        return False
    here, facing = whole.points[template], whole.outward[template]
    there, faces = whole.points[mine], whole.outward[mine]
    reach = _size_and_reach(whole, mine)[1]
    return any(_fits(here * flip, facing * flip, there, faces, reach) for flip in _FLIPS)


_FLIPS = np.array([[1.0, 1, 1], [1, -1, 1], [-1, 1, 1]])


def _fits(here: Floats, facing: Floats, there: Floats, faces: Floats, reach: float) -> bool:
    """Whether most samples of either surface lie near the other, once their middles are made equal."""
    moved = here + (there.min(axis=0) + there.max(axis=0) - here.min(axis=0) - here.max(axis=0)) / 2
    shares = []
    for one, normals, other, others in ((moved, facing, there, faces), (there, faces, moved, facing)):
        apart, index = cKDTree(other).query(one)
        shares.append(float(((apart < reach) & ((normals * others[index]).sum(axis=1) > SAME_FACE)).mean()))
    return min(shares) > _LIKE

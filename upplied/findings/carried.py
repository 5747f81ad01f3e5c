"""The same place on the other structures of a kind, by the correspondence that plans are carried by."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, TypeVar

import numpy as np
from scipy.spatial import cKDTree

from upplied.catalog import Catalog
from upplied.config import Settings, digest
from upplied.errors import RefusedError
from upplied.findings.adding import on_surface
from upplied.findings.looks import Spot, plane_axes
from upplied.fleet.decisions import PlanRequest, SettingsOf
from upplied.fleet.siblings import SiblingsOf
from upplied.planning.correspondence.certainty import certainty
from upplied.planning.correspondence.memo import content_key
from upplied.planning.correspondence.pair import Grained, Pair
from upplied.planning.correspondence.siblings import study
from upplied.planning.demonstration.repetition import choices_in
from upplied.planning.geometry.clouds import spacing
from upplied.planning.surface.frames import frames_for, named_axes, structure_in
from upplied.planning.surface.parts import labels_of, parts_of_both
from upplied.records import Bools, Cloud, Floats, Ints, Rows, Structure
from upplied.scene import scene_of
from upplied.threads import one_thread
from upplied.vectors import with_normals

R = TypeVar("R")

_RING = np.arange(6) * np.pi / 3
_STEP = 1.5  # spacings of the samples, that the places about a spot are off it
_PRESET = "recommended"
# Of the target's diagonal: the error of every counterpart, and what is added for a misfit of one
# (`Registration.scanned`), for the way from where the registration alone leads and for that from where the
# box of the part does, each up to the last.
_ALWAYS, _MISFIT, _WHOLE, _PART, _MOST = 0.007, 0.055, 0.3, 1.4, 0.05
_LEAST = 0.9  # probability of the part, below which a counterpart is said to be doubtful
_FARTHEST = 0.02  # of the structure's diagonal: a place that may be farther off is doubtful


@dataclass(frozen=True, eq=False, repr=False)
class Counterparts(Rows):
    """Where N spots of one structure are on another; what has no counterpart has no place."""

    part: Ints  # (N,) of the target; -1: none, or its parts are not known
    place: Floats  # (N, 3) m, frame of the target; NaN where there is none
    normal: Floats  # (N, 3) unit, outward
    turn: Floats  # (N, 3, 3) directions about the spot to those about its counterpart; mirrored ones mirror
    probability: Floats  # (N,) that it is the right part; NaN where that cannot be told
    error_m: Floats  # (N,) how far off it may be in 95 % of cases
    doubtful: Bools  # (N,)

    def __len__(self) -> int:
        return len(self.part)

    def doubt(self, at: int) -> str:
        """Why a counterpart is not certain, in words; empty where it is."""
        if not np.isfinite(self.place[at, 0]):
            return "the place has no counterpart there"
        if not self.doubtful[at]:
            return ""
        sure = self.probability[at]
        part = "parts are not told apart" if np.isnan(sure) else f"the right part with probability {sure:.2f}"
        return f"doubtful: {part}, may be {self.error_m[at]:.2f} m off"


class Carrying:
    """Spots carried from a structure to others; what is found out is remembered by the catalog's cache."""

    def __init__(self, catalog: Catalog) -> None:
        self.catalog = catalog
        self._settings = SettingsOf(catalog, PlanRequest())
        rows = catalog.structures()
        self._siblings = SiblingsOf(rows)
        self._sha256 = dict(zip(rows["structure_id"], rows["sha256"], strict=True))
        self.kinds = dict(zip(rows["structure_id"], rows["kind"], strict=True))

    def targets(self, source_id: str, to: str = "kind") -> list[str]:
        """The other structures of a source's kind, or those of ids that are listed with commas.

        Raises
        ------
        RefusedError
            If one is of another kind.
        """
        kind = self.kinds.get(source_id, "")
        if to == "kind":
            return sorted(name for name, other in self.kinds.items() if other == kind and name != source_id)
        asked = [name.strip() for name in to.split(",") if name.strip()]
        for name in asked:
            if self.kinds.get(name) != kind:
                found = f"is of kind {self.kinds.get(name, '(unknown)')}, {source_id} is of kind {kind}"
                raise RefusedError(f"structure {name}", found, "structures of one kind correspond")
        return asked

    def to(self, spots: Sequence[Spot], target_id: str) -> Counterparts:
        """Where spots of one structure are on another."""
        source_id, places = spots[0].structure_id, np.array([[*spot.place, *spot.normal] for spot in spots])
        if source_id == target_id:
            return _themselves(places)
        settings = self._settings(_PRESET, self.kinds[target_id], target_id)
        siblings = self._siblings(source_id, target_id, settings.correspondence.siblings)
        hashes = [self._sha256[source_id], self._sha256[target_id], [list(one) for one in siblings]]
        key = [*hashes, settings.sha256, places.round(6).tolist()]

        def found() -> Counterparts:
            with one_thread():
                return carried_spots(places, *self._pair(source_id, target_id, settings), settings)

        return self.remembered("counterparts", Counterparts, key, found)

    def everywhere(self, spot: Spot, names: Sequence[str]) -> Counterparts:
        """Where a spot is on each of some structures, a row for each."""
        settings = {self._settings(_PRESET, self.kinds[name], name).sha256 for name in names}
        about = [spot.structure_id, list(names), self.named(spot.structure_id), sorted(settings)]
        place = [*spot.place.round(6).tolist(), *spot.normal.round(6).tolist()]

        def found() -> Counterparts:
            each = [self.to([spot], name) for name in names]
            return Counterparts(
                *(np.concatenate([getattr(one, f.name) for one in each]) for f in fields(each[0]))
            )

        return self.remembered("counterparts-of-all", Counterparts, [*about, place], found)

    def remembered(self, stage: str, record: type[R], key: Sequence[Any], compute: Callable[[], R]) -> R:
        """What follows from a key, kept in the cache of the catalog."""
        return self.catalog.cache(stage, record, content_key(stage, *key), compute)

    def named(self, reference_id: str) -> str:
        """A name of all structures of a kind as they are, and of the settings that pairs are studied by."""
        kind = self.kinds[reference_id]
        names = sorted(name for name, other in self.kinds.items() if other == kind)
        settings = self._settings(_PRESET, kind, reference_id).sha256
        return digest([settings, *([name, self._sha256[name]] for name in names)])

    def instances(self, spot: Spot, target_id: str) -> list[Counterparts]:
        """Where a spot is on each part of a structure like its counterpart, and on that one first."""
        source_id, settings = spot.structure_id, self._settings(_PRESET, self.kinds[target_id], target_id)
        places = np.array([[*spot.place, *spot.normal]])
        with one_thread():
            pair, source, target = self._pair(source_id, target_id, settings)
            found = [carried_spots(places, pair, source, target, settings)]
            fit, (mine,) = pair.surface, _parts_of(places, pair)
            parts = parts_of_both(fit.source, fit.registered, named_axes(pair.source.frame))
            known = fit.correspondences.target_parts(mine).tolist()
            for choice in choices_in(pair, parts[0], mine, parts[1], known).tolist():
                if choice in known and choice == found[0].part[0]:
                    continue
                names = (*settings.correspondence.counterparts, (f"part_{mine}", f"part_{choice}"))
                asked = replace(settings, correspondence=replace(settings.correspondence, counterparts=names))
                other = self._pair(source_id, target_id, asked)
                found.append(carried_spots(places, *other, asked))
        return found

    def _pair(self, source_id: str, target_id: str, settings: Settings) -> tuple[Pair, Structure, Structure]:
        source, target = self.catalog.structure(source_id), self.catalog.structure(target_id)
        names = self._siblings(source_id, target_id, settings.correspondence.siblings)
        here, there = frames_for(source, target, settings)
        both = structure_in(here, source), structure_in(there, target)
        siblings = [self.catalog.structure(name) for name, _ in names]
        return study(*both, settings, self.catalog.cache, siblings), source, target


def carried_spots(
    spots: Floats, pair: Pair, source: Structure, target: Structure, settings: Settings
) -> Counterparts:
    """Places (N, 3) with normals (N, 3), side by side, of a source carried to the target of a pair.

    The displacement that carries the samples of the surface carries each place and a ring about it; from the
    ring follows how directions turn. Source and target are in their declared frames, as are the results.
    """
    here, there = frames_for(source, target, settings)
    fit, cloud, count = pair.surface, pair.surface.source, len(spots)
    axes = np.array([plane_axes(normal) for normal in spots[:, 3:]])  # (N, 2, 3)
    circle = np.column_stack([np.cos(_RING), np.sin(_RING)])
    rings = spots[:, None, :3] + _STEP * spacing(cloud) * np.einsum("rk,nki->nri", circle, axes)
    rings = on_surface(scene_of(source), rings.reshape(-1, 3))[0].reshape(rings.shape)
    points = here.from_declared(np.concatenate([spots[:, None, :3], rings], axis=1).reshape(-1, 3))
    normals = np.repeat(spots[:, 3:] @ here.turn, 1 + len(_RING), axis=0)
    nearest = _nearest(cloud, points, normals)
    more = Cloud(
        np.concatenate([cloud.points, points]),
        np.concatenate([cloud.outward, normals]),
        np.concatenate([cloud.areas, np.full(len(points), 1e-9)]),
        None if cloud.part is None else np.concatenate([cloud.part, cloud.part[nearest]]),
    )
    even = np.concatenate([np.arange(len(cloud)), nearest])
    every = Grained(fit.target, np.arange(len(fit.target)), pair.grain)
    match = pair.with_samples(Grained(more, even, ""), every).surface.correspondences
    index = match.target_index[len(cloud) :].reshape(count, -1)
    places = there.to_declared(match.target_points[len(cloud) :]).reshape(count, -1, 3)
    known = np.isfinite(places).all(axis=2) & (index >= 0)
    there_is = known[:, 0]
    place, normal = np.full((count, 3), np.nan), np.full((count, 3), np.nan)
    if there_is.any():
        place[there_is], normal[there_is] = on_surface(scene_of(target), places[there_is, 0])
    towards = fit.target.outward[index[:, 0]] @ there.turn.T
    normal = np.where(np.einsum("ni,ni->n", normal, towards)[:, None] > 0, normal, towards)
    turn = np.repeat(np.eye(3)[None], count, axis=0)
    for at in np.flatnonzero(there_is):
        ring = known[at, 1:]
        turn[at] = _turn(spots[at], rings[at][ring], places[at, 1:][ring] - places[at, 0], normal[at])
    part_here = labels_of(cloud)[nearest].reshape(count, -1)[:, 0]
    sure = _sure(pair, part_here)
    simply = _simply(pair, points.reshape(count, -1, 3)[:, 0], part_here)
    error = _error_m(target, pair, place, [there.to_declared(each) for each in simply])
    part = np.where(there_is, labels_of(fit.target)[index[:, 0]], -1)
    doubtful = ~(sure >= _LEAST) | ~there_is | (error > _FARTHEST * target.diagonal_m)
    return Counterparts(part, place, normal, turn, sure, error, doubtful)


def _simply(pair: Pair, points: Floats, part: Ints) -> list[Floats]:
    """Where the registration alone, and the box of each part on its counterpart's, carry points (N, 3)."""
    fit, match = pair.surface, pair.surface.correspondences
    places = [fit.registration.to_target(points)]
    if match.displacement is not None and match.source_class is not None:
        known = match.source_class[part]
        turned = np.einsum("nij,nj->ni", match.displacement.matrix[known], points)
        places.append(fit.registration.to_target(turned + match.displacement.offset_m[known]))
    return places


def _error_m(target: Structure, pair: Pair, place: Floats, simply: Sequence[Floats]) -> Floats:
    """How far off (N,) counterparts may be in 95 % of cases, m.

    Where a simple map leads elsewhere, and where the structures fit each other badly, a counterpart is less
    certain: the weights are of a quantile regression on sample structures (bench/findings.py).
    """
    misfit = pair.surface.registration.scanned
    error = np.full(len(place), _ALWAYS + _MISFIT * (min(misfit, 3.0) if np.isfinite(misfit) else 3.0))
    scene = scene_of(target)
    for weight, points in zip((_WHOLE, _PART), simply, strict=False):
        dropped = scene.closest(points)[0]
        away = np.linalg.norm(dropped - place, axis=1) / target.diagonal_m
        error += weight * np.minimum(away, _MOST)
    return np.asarray(error * target.diagonal_m)


def _themselves(places: Floats) -> Counterparts:
    """Places of a structure on itself."""
    count, ones = len(places), np.ones(len(places))
    turn = np.repeat(np.eye(3)[None], count, axis=0)
    part, none = np.full(count, -1, np.int64), np.zeros(count, bool)
    return Counterparts(part, places[:, :3], places[:, 3:], turn, ones, 0 * ones, none)


def _sure(pair: Pair, part: Ints) -> Floats:
    """Probability (N,) that parts of the source have the counterparts that they were matched with."""
    fit, found = pair.surface, np.full(len(part), np.nan)
    if fit.carried is None:
        one_piece = not labels_of(fit.source).any() and not labels_of(fit.target).any()
        drawn = not (pair.source.is_scan or pair.target.is_scan)
        return np.ones(len(part)) if one_piece and drawn else found
    for one in np.unique(part):
        partners = fit.correspondences.target_parts(int(one)).tolist()
        if partners:
            found[part == one] = certainty(fit, int(one), partners)
    return found


def _parts_of(spots: Floats, pair: Pair) -> list[int]:
    frame, cloud = pair.source.frame, pair.surface.source
    nearest = _nearest(cloud, frame.from_declared(spots[:, :3]), spots[:, 3:] @ frame.turn)
    return [int(part) for part in labels_of(cloud)[nearest]]


def _nearest(cloud: Cloud, points: Floats, normals: Floats) -> Ints:
    """The sample that is nearest to each point, on its side of a thin plate."""
    apart = spacing(cloud)
    known = cKDTree(with_normals(cloud.points, cloud.outward, 2 * apart))
    return np.asarray(known.query(with_normals(points, normals, 2 * apart))[1], np.int64)


def _turn(spot: Floats, ring: Floats, carried: Floats, normal: Floats) -> Floats:
    """The orthogonal matrix (3, 3) that turns directions about a spot into those about its counterpart."""
    here = np.column_stack([*plane_axes(spot[3:]), spot[3:]])
    there = np.column_stack([*plane_axes(normal), normal])
    if len(ring) < 3:
        return there @ here.T
    flat = ((ring - spot[:3]) @ here)[:, :2]
    linear = np.linalg.lstsq(flat, (carried @ there)[:, :2], rcond=None)[0].T
    left, _, right = np.linalg.svd(linear)
    plane = np.eye(3)
    plane[:2, :2] = left @ right
    return np.asarray(there @ plane @ here.T)

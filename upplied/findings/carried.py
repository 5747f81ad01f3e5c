"""The same place on the other structures of a kind, by the correspondence that plans are carried by."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np
from scipy.spatial import cKDTree

from upplied.catalog import Catalog
from upplied.config import Settings, digest
from upplied.errors import RefusedError
from upplied.findings.adding import on_surface
from upplied.findings.looks import Spot, off_surface, plane_axes
from upplied.findings.sampled import Carried, carried_samples, neighbours
from upplied.fleet.decisions import PlanRequest, SettingsOf
from upplied.fleet.siblings import SiblingsOf
from upplied.geometry.scene import scene_of
from upplied.geometry.vectors import with_normals
from upplied.planning.correspondence.memo import content_key
from upplied.planning.correspondence.pair import Pair
from upplied.planning.correspondence.siblings import study
from upplied.planning.demonstration.repetition import choices_in
from upplied.planning.surface.frames import frames_for, named_axes, structure_in
from upplied.planning.surface.parts import parts_of_both
from upplied.records import Bools, Floats, Ints, Rows, Structure
from upplied.threads import one_thread

R = TypeVar("R")

_PRESET = "recommended"
_LEAST = 0.9  # probability of the part, below which a counterpart is said to be doubtful
# Of the target's diagonal: a place with a larger stated error is doubtful. Errors have long tails: of places
# with this one, one of some thousand is more than 2 % off (bench/findings.py, on the other half).
_FARTHEST = 0.0105


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
        names = [name.strip() for name in to.split(",") if name.strip()]
        for name in names:
            if self.kinds.get(name) != kind:
                fault = f"is of kind {self.kinds.get(name, '(unknown)')}, {source_id} is of kind {kind}"
                raise RefusedError(f"structure {name}", fault, "structures of one kind correspond")
        return names

    def to(self, spots: Sequence[Spot], target_id: str) -> Counterparts:
        """Where spots of one structure are on another."""
        source_id, places = spots[0].structure_id, np.array([[*spot.place, *spot.normal] for spot in spots])
        target, off = (
            self.catalog.structure(target_id),
            off_surface(self.catalog, spots, self._sha256[source_id]),
        )
        if source_id == target_id:
            there = _themselves(places)
        else:
            there = carried_spots(places, self.carried(source_id, target_id), target)
        error = there.error_m + off
        doubtful = there.doubtful | (error > _FARTHEST * target.diagonal_m)
        return replace(there, error_m=error, doubtful=doubtful)

    def everywhere(self, spot: Spot, names: Sequence[str]) -> Counterparts:
        """Where a spot is on each of some structures, a row for each."""
        settings = {self._settings(_PRESET, self.kinds[name], name).sha256 for name in names}
        about = [spot.structure_id, list(names), self.named(spot.structure_id), sorted(settings)]
        place = [*spot.place.round(6).tolist(), *spot.normal.round(6).tolist(), spot.structure_sha256]

        def carried() -> Counterparts:
            return Counterparts.stacked([self.to([spot], name) for name in names])

        return self.remembered("counterparts-on-kind", Counterparts, [*about, place], carried)

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
        places, target = np.array([[*spot.place, *spot.normal]]), self.catalog.structure(target_id)
        carried = self.carried(source_id, target_id)
        mine, places_there = int(carried.own_part[_nearest(carried, places)[0]]), [self.to([spot], target_id)]
        with one_thread():
            pair = self._pair(source_id, target_id, settings)[0]
        fit = pair.surface
        parts = parts_of_both(fit.source, fit.registered, named_axes(pair.source.frame))
        known = fit.correspondences.target_parts(mine).tolist()
        for choice in choices_in(pair, parts[0], mine, parts[1], known).tolist():
            if choice in known and choice == places_there[0].part[0]:
                continue
            names = (*settings.correspondence.counterparts, (f"part_{mine}", f"part_{choice}"))
            named = replace(settings, correspondence=replace(settings.correspondence, counterparts=names))
            places_there.append(carried_spots(places, self.carried(source_id, target_id, named), target))
        return places_there

    def pair_key(self, source_id: str, target_id: str, settings: Settings | None = None) -> list[Any]:
        """What the correspondence of a pair depends on."""
        settings = settings or self._settings(_PRESET, self.kinds[target_id], target_id)
        siblings = self._siblings(source_id, target_id, settings.correspondence.siblings)
        hashes = [self._sha256[source_id], self._sha256[target_id], [list(one) for one in siblings]]
        return [*hashes, settings.sha256]

    def carried(self, source_id: str, target_id: str, settings: Settings | None = None) -> Carried:
        """The samples of a structure on another one, by other settings than theirs where these are given."""
        settings = settings or self._settings(_PRESET, self.kinds[target_id], target_id)

        def carried() -> Carried:
            with one_thread():
                return carried_samples(*self._pair(source_id, target_id, settings), settings)

        return self.remembered(
            "carried-samples", Carried, self.pair_key(source_id, target_id, settings), carried
        )

    def _pair(self, source_id: str, target_id: str, settings: Settings) -> tuple[Pair, Structure, Structure]:
        source, target = self.catalog.structure(source_id), self.catalog.structure(target_id)
        names = self._siblings(source_id, target_id, settings.correspondence.siblings)
        here, there = frames_for(source, target, settings)
        both = structure_in(here, source), structure_in(there, target)
        siblings = [self.catalog.structure(name) for name, _ in names]
        return study(*both, settings, self.catalog.cache, siblings), source, target


def carried_spots(spots: Floats, carried: Carried, target: Structure) -> Counterparts:
    """Places (N, 3) with normals (N, 3), side by side, carried as the samples about them, onto the surface.

    Of the samples, those count that face alike and belong to the part of the nearest one. A place that no
    sample is near lies inside of other parts, and is uncertain: samples are where surface can be seen.
    """
    points, normals = spots[:, :3], spots[:, 3:]
    first = _nearest(carried, spots)
    others, weight = neighbours(points, normals, carried.point, carried.normal, carried.step_m)
    others, weight = np.column_stack([first, others]), np.column_stack([np.full(len(spots), 1e-9), weight])
    weight[carried.own_part[others] != carried.own_part[first][:, None]] = 0.0
    weight[np.isnan(carried.place[others, 0])] = 0.0
    weight[np.isnan(carried.place[first, 0])] = 0.0
    offset = points[:, None] - carried.point[others]
    moved = np.nan_to_num(carried.place)[others] + np.einsum("nkij,nkj->nki", carried.linear[others], offset)
    share = weight / np.maximum(weight.sum(axis=1, keepdims=True), 1e-300)
    there_is = weight.any(axis=1)
    place, normal = np.full_like(points, np.nan), np.full_like(points, np.nan)
    if there_is.any():
        mean = np.einsum("nk,nki->ni", share, moved)
        place[there_is], normal[there_is] = on_surface(scene_of(target), mean[there_is])
    towards = carried.towards[first]
    normal = np.where(np.einsum("ni,ni->n", normal, towards)[:, None] > 0, normal, towards)
    turn = np.repeat(np.eye(3)[None], len(spots), axis=0)
    for at in np.flatnonzero(there_is):
        ring = others[at, 1:][weight[at, 1:] > 0]
        turn[at] = _turn(spots[at], carried.point[ring], carried.place[ring] - place[at], normal[at])
    sure = carried.probability[first]
    stretch = np.abs(np.linalg.det(carried.linear[first])) ** (1 / 3)
    away, facing = np.linalg.norm(offset[:, 0], axis=1), np.einsum("ni,ni->n", normals, carried.normal[first])
    hidden = (away > carried.step_m) | (facing <= 0)
    error = carried.error_m[first] + 2 * stretch * np.where(hidden, np.maximum(away, carried.step_m), 0.0)
    doubtful = ~(sure >= _LEAST) | ~there_is | (error > _FARTHEST * target.diagonal_m)
    return Counterparts(carried.part[first], place, normal, turn, sure, error, doubtful)


def _themselves(places: Floats) -> Counterparts:
    """Places of a structure on itself."""
    count, ones = len(places), np.ones(len(places))
    turn = np.repeat(np.eye(3)[None], count, axis=0)
    part, none = np.full(count, -1, np.int64), np.zeros(count, bool)
    return Counterparts(part, places[:, :3], places[:, 3:], turn, ones, 0 * ones, none)


def _nearest(carried: Carried, spots: Floats) -> Ints:
    """The sample that is nearest to each spot, on its side of a thin plate."""
    weight = 2 * carried.step_m
    known = cKDTree(with_normals(carried.point, carried.normal, weight))
    return np.asarray(known.query(with_normals(spots[:, :3], spots[:, 3:], weight))[1], np.int64)


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

"""The same place on the other structures of a kind, by the correspondence that plans are carried by.

One structure of a kind is the map for all: every other one is studied with it alone, and read both ways. A
place goes from its structure to the map and on to the others, so a question about a whole fleet needs one
correspondence for each structure, most of which its plans have left behind.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np

from upplied.catalog import Catalog
from upplied.config import Settings
from upplied.errors import CatalogError, RefusedError, UppliedError
from upplied.findings.looks import Spot, off_surface, plane_axes
from upplied.findings.sampled import Carried, Near, about, carried_samples
from upplied.fleet.decisions import PlanRequest, SettingsOf, SiblingsOf
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
_BELOW = 0.3  # spacings below the samples' surface, from which on a place lies inside of other parts


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
        part = (
            "parts cannot be distinguished"
            if np.isnan(sure)
            else f"the right part with probability {sure:.2f}"
        )
        return f"doubtful: {part}, may be {self.error_m[at]:.2f} m off"

    @property
    def spots(self) -> Floats:
        """Places with normals (N, 6), to be carried on."""
        return np.hstack([self.place, self.normal])


class Carrying:
    """Spots carried from a structure to others; correspondences are remembered by the catalog's cache.

    Parameters
    ----------
    catalog : Catalog
    progress : callable, optional
        Called with the names of each two structures that are studied since nothing of them is remembered.
    """

    def __init__(self, catalog: Catalog, progress: Callable[[str], object] = lambda _: None) -> None:
        self.catalog, self._progress = catalog, progress
        self._settings = SettingsOf(catalog, PlanRequest())
        rows = catalog.structures()
        self._siblings = SiblingsOf(rows)
        self._sha256 = dict(zip(rows["structure_id"], rows["sha256"], strict=True))
        sizes = np.linalg.norm(rows[["size_x_m", "size_y_m", "size_z_m"]].to_numpy(float), axis=1)
        self._size_m = dict(zip(rows["structure_id"], sizes.tolist(), strict=True))
        self.kinds = dict(zip(rows["structure_id"], rows["kind"], strict=True))
        self._demonstrated = set(catalog.demonstrations()["structure_id"])

    def targets(self, source_id: str, to: str = "kind") -> list[str]:
        """The other structures of a source's kind, or those of ids that are listed with commas.

        Raises
        ------
        RefusedError
            If one is of another kind.
        """
        kind = self.kinds.get(source_id, "")
        if to == "kind":
            return [name for name in self.members(kind) if name != source_id]
        names = [name.strip() for name in to.split(",") if name.strip()]
        for name in names:
            if self.kinds.get(name) != kind:
                fault = f"is of kind {self.kinds.get(name, '(unknown)')}, {source_id} is of kind {kind}"
                raise RefusedError(f"structure {name}", fault, "structures of one kind correspond")
        return names

    def members(self, kind: str) -> list[str]:
        """The structures of a kind."""
        return sorted(name for name, other in self.kinds.items() if other == kind)

    def reference(self, kind: str) -> str:
        """The structure of a kind that is the map for all: the first that was demonstrated, else the first.

        Raises
        ------
        CatalogError
            If the kind has no structure.
        """
        members = self.members(kind)
        if not members:
            raise CatalogError(f"kind {kind}", "has no structure", "one at least")
        return min(self._demonstrated.intersection(members), default=members[0])

    def study(self, kind: str) -> list[str]:
        """Remember the correspondences of a kind's structures with their map: questions then only read.

        Returns
        -------
        list of str
            Why there is none, in words.
        """
        reference, problems = self.reference(kind), []
        for name in self.targets(reference):
            try:
                self.carried(reference, name)
            except UppliedError as error:
                problems.append(f"findings on {name}: {error}")
        return problems

    def to(self, spots: Sequence[Spot], target_id: str) -> Counterparts:
        """Where spots of one structure are on another."""
        return self.everywhere(spots, [target_id])[0]

    def everywhere(self, spots: Sequence[Spot], names: Sequence[str]) -> list[Counterparts]:
        """Where spots of one structure are on each of some structures."""
        source_id = spots[0].structure_id
        off = off_surface(self.catalog, spots, self._sha256[source_id])
        places = np.array([[*spot.place, *spot.normal] for spot in spots])
        here = _themselves(places, off, self._size_m[source_id])
        reference = self.reference(self.kinds[source_id])
        on_map = here
        if source_id != reference and set(names) != {source_id}:
            back = self.carried(reference, source_id).inverse()
            on_map = self._continued(here, back, source_id, reference)
        near: tuple[Carried, Near] | None = None
        results = []
        for name in names:
            if name in (source_id, reference):
                results.append(here if name == source_id else on_map)
                continue
            try:
                carried = self.carried(reference, name)
            except RefusedError:  # nothing of it corresponds
                results.append(_nowhere(len(spots)))
                continue
            if near is None or not np.array_equal(near[0].point, carried.point):
                near = carried, _about(on_map.spots, carried)
            results.append(self._continued(on_map, carried, reference, name, near[1]))
        return results

    def instances(self, spot: Spot, target_id: str) -> list[Counterparts]:
        """Where a spot is on each part of a structure like its counterpart, and on that one first."""
        reference, settings = self.reference(self.kinds[target_id]), self._settings_of(target_id)
        on_map, first = self.everywhere([spot], [reference, target_id])
        carried = self.carried(reference, target_id)
        mine = int(carried.own_part[_about(on_map.spots, carried).samples[0, 0]])
        with one_thread():
            pair = self._pair(reference, target_id, settings)[0]
        fit, results = pair.surface, [first]
        parts = parts_of_both(fit.source, fit.registered, named_axes(pair.source.frame))
        known = fit.correspondences.target_parts(mine).tolist()
        for choice in choices_in(pair, parts[0], mine, parts[1], known).tolist():
            if choice in known and choice == first.part[0]:
                continue
            names = (*settings.correspondence.counterparts, (f"part_{mine}", f"part_{choice}"))
            named = replace(settings, correspondence=replace(settings.correspondence, counterparts=names))
            other = self.carried(reference, target_id, named)
            results.append(self._continued(on_map, other, reference, target_id))
        return results

    def pair_key(self, source_id: str, target_id: str) -> list[Any]:
        """What the places of a structure on another one depend on."""
        reference = self.reference(self.kinds[target_id])
        return [self._study_key(reference, name) for name in sorted({source_id, target_id} - {reference})]

    def remembered(self, stage: str, record: type[R], key: Sequence[Any], compute: Callable[[], R]) -> R:
        """What follows from a key, kept in the cache of the catalog."""
        return self.catalog.cache(stage, record, content_key(stage, *key), compute)

    def carried(self, source_id: str, target_id: str, settings: Settings | None = None) -> Carried:
        """The samples of a structure on another one, by other settings than theirs where these are given."""
        settings = settings or self._settings_of(target_id)

        def carried() -> Carried:
            self._progress(f"{target_id} and {source_id}")
            with one_thread():
                return carried_samples(*self._pair(source_id, target_id, settings), settings)

        key = self._study_key(source_id, target_id, settings)
        return self.remembered("carried-both-ways", Carried, key, carried)

    def _continued(
        self, spots: Counterparts, carried: Carried, source_id: str, target_id: str, near: Near | None = None
    ) -> Counterparts:
        """Counterparts on one structure carried on to another: of two errors the larger one counts.

        Errors have long tails, so that both are seldom large, and what the two correspondences have in common
        cancels: 97 % of such places lie within it (bench/findings.py).
        """
        size_m, ratio = self._size_m[target_id], self._size_m[target_id] / self._size_m[source_id]
        there = carried_spots(spots.spots, carried, size_m, near)
        lost = ~np.isfinite(spots.place[:, :1])
        error = np.maximum(there.error_m, ratio * spots.error_m)
        return replace(
            there,
            place=np.where(lost, np.nan, there.place),
            turn=there.turn @ spots.turn,
            probability=there.probability * spots.probability,
            error_m=error,
            doubtful=spots.doubtful | there.doubtful | lost[:, 0] | (error > _FARTHEST * size_m),
        )

    def _settings_of(self, structure_id: str) -> Settings:
        return self._settings(_PRESET, self.kinds[structure_id], structure_id)

    def _study_key(self, source_id: str, target_id: str, settings: Settings | None = None) -> list[Any]:
        settings = settings or self._settings_of(target_id)
        siblings = self._siblings(source_id, target_id, settings.correspondence.siblings)
        hashes = [self._sha256[source_id], self._sha256[target_id], [list(one) for one in siblings]]
        return [*hashes, settings.sha256]

    def _pair(self, source_id: str, target_id: str, settings: Settings) -> tuple[Pair, Structure, Structure]:
        source, target = self.catalog.structure(source_id), self.catalog.structure(target_id)
        names = self._siblings(source_id, target_id, settings.correspondence.siblings)
        here, there = frames_for(source, target, settings)
        both = structure_in(here, source), structure_in(there, target)
        siblings = [self.catalog.structure(name) for name, _ in names]
        return study(*both, settings, self.catalog.cache, siblings), source, target


def carried_spots(spots: Floats, carried: Carried, size_m: float, near: Near | None = None) -> Counterparts:
    """Places with normals (N, 6), carried as the samples about them onto a structure of a size.

    Of the samples, those count that face alike and belong to the part of the nearest one; where another part
    is as near, the place may be where that one leads. A place that no sample is near, or that lies below
    them, is inside of other parts, and is uncertain: samples are where surface can be seen.
    """
    if not len(carried.point):
        return _nowhere(len(spots))
    near = near or _about(spots, carried)
    others, first = near.samples, near.samples[:, 0]
    there = np.isfinite(carried.place[others, 0])
    same = carried.own_part[others] == carried.own_part[first][:, None]
    weight = np.where(there & there[:, :1] & same, near.weight, 0.0)
    offset = spots[:, None, :3] - carried.point[others]
    places, towards = np.nan_to_num(carried.place)[others], carried.towards[others]
    moved = places + np.einsum("nkij,nkj->nki", carried.linear[carried.map[others]], offset)
    share = weight / np.maximum(weight.sum(axis=1, keepdims=True), 1e-300)
    place, normal = (np.einsum("nk,nki->ni", share, each) for each in (moved, towards))
    normal = np.where(there[:, :1], normal, towards[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    above = np.einsum("nki,nki->nk", towards, place[:, None] - places)  # of the samples' tangent planes
    away, up = near.away_m[:, 0], carried.normal[first]
    below = np.abs(np.einsum("ni,ni->n", offset[:, 0], up)) > _BELOW * carried.step_m
    hidden = (away > carried.step_m) | (np.einsum("ni,ni->n", spots[:, 3:], up) <= 0) | below
    onto = np.where(hidden, 0.0, (share * above).sum(axis=1))
    place = np.where(there[:, :1], place - onto[:, None] * normal, np.nan)
    apart = np.linalg.norm(moved - place[:, None], axis=2)
    seam = np.where(there & ~same & (near.away_m <= carried.step_m), np.nan_to_num(apart), 0.0).max(axis=1)
    stretch = np.abs(np.linalg.det(carried.linear)) ** (1 / 3)
    stated = (share * carried.error_m[others]).sum(
        axis=1
    )  # it jumps between neighbours: none is known better
    inside = np.where(hidden, 2 * stretch[carried.map[first]] * np.maximum(away, carried.step_m), 0.0)
    error, sure = np.maximum(stated + inside, seam), carried.probability[carried.map[first]]
    doubtful = ~(sure >= _LEAST) | ~there[:, 0] | (error > _FARTHEST * size_m)
    turn = _turn(spots, -offset, np.nan_to_num(places - place[:, None]), normal, weight[:, 1:] > 0)
    return Counterparts(carried.part[first], place, normal, turn, sure, error, doubtful)


def _about(spots: Floats, carried: Carried) -> Near:
    """The samples about spots; any about those that have no place."""
    return about(np.nan_to_num(spots), carried.point, carried.normal, carried.step_m)


def _themselves(places: Floats, error_m: Floats, size_m: float) -> Counterparts:
    """Places of a structure on itself, off by that much."""
    count = len(places)
    turn = np.repeat(np.eye(3)[None], count, axis=0)
    doubtful = error_m > _FARTHEST * size_m
    part = np.full(count, -1, np.int64)
    return Counterparts(part, places[:, :3], places[:, 3:], turn, np.ones(count), error_m, doubtful)


def _nowhere(count: int) -> Counterparts:
    """What has no counterpart."""
    lost = np.full((count, 3, 3), np.nan)
    part, doubtful = np.full(count, -1, np.int64), np.ones(count, bool)
    return Counterparts(part, lost[:, 0], lost[:, 0], lost, lost[:, 0, 0], lost[:, 0, 0], doubtful)


def _turn(spots: Floats, ring: Floats, carried: Floats, normal: Floats, known: Bools) -> Floats:
    """The orthogonal matrices (N, 3, 3) that turn directions about spots into those about their counterparts.

    In the plane they are the orthogonal factor of the linear map of the ring of samples about a spot.
    """
    here, there = (np.stack([*plane_axes(up), up], axis=-1) for up in (spots[:, 3:], normal))
    flat, moved = (np.einsum("nki,nij->nkj", each[:, 1:], axes)[..., :2] * known[..., None]
                   for each, axes in ((ring, here), (carried, there)))  # fmt: skip
    inverse = np.linalg.pinv(np.einsum("nki,nkj->nij", flat, flat), hermitian=True)
    left, size, right = np.linalg.svd(np.einsum("nki,nkj->nij", moved, flat) @ inverse)
    plane = np.repeat(np.eye(3)[None], len(spots), axis=0)
    enough = (known.sum(axis=1) >= 3) & (size[:, 1] > 0)
    plane[enough, :2, :2] = (left @ right)[enough]
    return np.asarray(there @ plane @ here.transpose(0, 2, 1))

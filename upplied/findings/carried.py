"""The same place on the other structures of a kind, by the correspondence that plans are carried by.

One structure of a kind is the map for all: every other one is studied with it alone, and read both ways. A
place goes from its structure to the map and on to the others, so a question about a whole fleet needs one
correspondence for each structure, most of which its plans have left behind.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from upplied.catalog import Catalog
from upplied.config import Settings
from upplied.errors import CatalogError, RefusedError, UppliedError
from upplied.findings import counterparts
from upplied.findings.counterparts import Carried, CarriedGroup, Counterparts, Near
from upplied.findings.looks import Spot, off_surface
from upplied.fleet.decisions import PlanRequest, SettingsOf, SiblingsOf
from upplied.planning.correspondence.memo import content_key
from upplied.records import Structure
from upplied.threads import one_thread

if TYPE_CHECKING:
    from upplied.planning.correspondence.pair import Pair

R = TypeVar("R")

_PRESET = "recommended"
_FEW, _MANY = 10, 50  # structures whose samples are read one by one, and at once


class Carrying:
    """Spots carried from a structure to others; correspondences are remembered by the catalog's cache.

    `progress` is called with the names of each two structures that are studied, where none is remembered.
    """

    def __init__(self, catalog: Catalog, progress: Callable[[str], object] = lambda _: None) -> None:
        self.catalog, self._progress = catalog, progress
        self._settings = SettingsOf(catalog, PlanRequest())
        rows = catalog.structures().sort_values("commit_version", kind="stable")
        self._siblings = SiblingsOf(rows)
        self._sha256 = dict(zip(rows["structure_id"], rows["sha256"], strict=True))
        sizes = np.linalg.norm(rows[["size_x_m", "size_y_m", "size_z_m"]].to_numpy(float), axis=1)
        self._size_m = dict(zip(rows["structure_id"], sizes.tolist(), strict=True))
        self.kinds = dict(zip(rows["structure_id"], rows["kind"], strict=True))
        self._demonstrated = set(catalog.demonstrations()["structure_id"])

    def targets(self, source_id: str, to: str = "kind") -> list[str]:
        """The other structures of a source's kind, or those of ids with commas, which must be of it."""
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
        """The structure of a kind that is the map for all: the first that was demonstrated, else of all."""
        members = self.members(kind)
        if not members:
            raise CatalogError(f"kind {kind}", "has no structure", "one at least")
        return min(self._demonstrated.intersection(members), default=members[0])

    def study(self, kind: str) -> list[str]:
        """Remember how a kind's structures correspond to their map, or say why not: questions only read."""
        reference, problems = self.reference(kind), []
        for name in self.targets(reference):
            try:
                self.carried(reference, name)
            except UppliedError as error:
                problems.append(f"findings on {name}: {error}")
        if len(self.members(kind)) > _FEW:
            deque(self._groups(reference, set(self.kinds)), maxlen=0)
        return problems

    def to(self, spots: Sequence[Spot], target_id: str) -> Counterparts:
        """Where spots of one structure are on another."""
        return self.everywhere(spots, [target_id])[0]

    def everywhere(self, spots: Sequence[Spot], names: Sequence[str]) -> list[Counterparts]:
        """Where spots of one structure are on each of some structures."""
        source_id = spots[0].structure_id
        off = off_surface(self.catalog, spots, self._sha256[source_id])
        places = np.array([[*spot.place, *spot.normal] for spot in spots])
        here = counterparts.themselves(places, off, self._size_m[source_id])
        reference = self.reference(self.kinds[source_id])
        on_map = here
        if source_id != reference and set(names) != {source_id}:
            back = self.carried(reference, source_id).inverse()
            on_map = self._continued(here, back, source_id, [reference])
        known = {reference: on_map, source_id: here}
        if len(names) > _FEW:
            known |= self._on_many(on_map, reference, set(names) - set(known))
        for name in set(names) - set(known):
            try:
                known[name] = self._continued(on_map, self.carried(reference, name), reference, [name])
            except RefusedError:  # nothing of it corresponds
                known[name] = counterparts.nowhere(len(spots))
        return [known[name] for name in names]

    def _on_many(self, on_map: Counterparts, reference: str, names: set[str]) -> dict[str, Counterparts]:
        """Counterparts on a kind's map carried on to those of many structures that share its samples."""
        results: dict[str, Counterparts] = {}
        for group in self._groups(reference, names):
            members = np.array([at for at, name in enumerate(group.members) if name in names], np.int64)
            ids, count = [group.members[at] for at in members], len(on_map)
            near = group.near(on_map.spots, members)
            whole = Counterparts.stacked([on_map] * len(members))
            there = self._continued(whole, group.carried, reference, ids, near)
            parts = (there.rows(slice(start, start + count)) for start in range(0, len(there), count))
            results |= zip(ids, parts, strict=True)
        return results

    def _groups(self, reference: str, names: set[str]) -> Iterator[CarriedGroup]:
        """Those groups of a kind's structures, in the order they were added, that hold some of these."""
        kinds = self.kinds
        others = [name for name in kinds if kinds[name] == kinds[reference] and name != reference]
        for start in range(0, len(others), _MANY):
            some = others[start : start + _MANY]

            def group(some: Sequence[str] = some) -> CarriedGroup:
                parts = {}
                for name in some:
                    with suppress(UppliedError):  # nothing of it corresponds
                        parts[name] = self.carried(reference, name)
                if not parts:
                    raise RefusedError(f"structures {', '.join(some)}"[:200], "have no counterparts")
                return CarriedGroup.of(parts)

            if names.intersection(some):
                key = [self._study_key(reference, name) for name in some]
                with suppress(RefusedError):
                    one = self.remembered("carried-groups", CarriedGroup, key, group)
                    if names.intersection(one.members):
                        yield one

    def instances(self, spot: Spot, target_id: str) -> list[Counterparts]:
        """Where a spot is on each part of a structure like its counterpart, and on that one first."""
        from upplied.planning.demonstration.repetition import choices_in
        from upplied.planning.surface.frames import named_axes
        from upplied.planning.surface.parts import parts_of_both

        reference, settings = self.reference(self.kinds[target_id]), self._settings_of(target_id)
        on_map, first = self.everywhere([spot], [reference, target_id])
        carried = self.carried(reference, target_id)
        near = counterparts.about(on_map.spots, carried.point, carried.normal, carried.step_m)
        mine = int(carried.own_part[near.samples[0, 0]])
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
            results.append(self._continued(on_map, other, reference, [target_id]))
        return results

    def pair_key(self, source_id: str, target_id: str) -> list[Any]:
        """What the places of a structure on another one depend on."""
        reference = self.reference(self.kinds[target_id])
        return [self._study_key(reference, name) for name in sorted({source_id, target_id} - {reference})]

    def remembered(self, stage: str, record: type[R], key: Sequence[Any], compute: Callable[[], R]) -> R:
        """A record that follows from a key, stored in the cache of the catalog."""
        return self.catalog.cache(stage, record, content_key(stage, *key), compute)

    def carried(self, source_id: str, target_id: str, settings: Settings | None = None) -> Carried:
        """The samples of a structure on another one, by other settings than theirs where these are given."""
        settings = settings or self._settings_of(target_id)

        def carried() -> Carried:
            from upplied.findings.sampling import carried_samples  # planning, which questions seldom load

            self._progress(f"{target_id} and {source_id}")
            with one_thread():
                return carried_samples(*self._pair(source_id, target_id, settings), settings)

        key = self._study_key(source_id, target_id, settings)
        return self.remembered("carried-both-ways", Carried, key, carried)

    def _continued(
        self, spots: Counterparts, carried: Carried, source: str, names: Sequence[str],
        near: Near | None = None,
    ) -> Counterparts:  # fmt: skip
        """Counterparts on one structure carried on to others, as many on each: the larger error counts."""
        # Errors have long tails, so that both are seldom large, and what the two correspondences have in
        # common cancels: 97 % of such places lie within it (bench/findings.py).
        size_m = np.repeat([self._size_m[name] for name in names], len(spots) // len(names))
        there = counterparts.carried_spots(spots.spots, carried, size_m, near)
        lost = ~np.isfinite(spots.place[:, :1])
        error = np.maximum(there.error_m, size_m / self._size_m[source] * spots.error_m)
        return replace(
            there,
            place=np.where(lost, np.nan, there.place),
            turn=there.turn @ spots.turn,
            probability=there.probability * spots.probability,
            error_m=error,
            doubtful=spots.doubtful | there.doubtful | lost[:, 0] | (error > counterparts.FARTHEST * size_m),
        )

    def _settings_of(self, structure_id: str) -> Settings:
        return self._settings(_PRESET, self.kinds[structure_id], structure_id)

    def _study_key(self, source_id: str, target_id: str, settings: Settings | None = None) -> list[Any]:
        settings = settings or self._settings_of(target_id)
        siblings = self._siblings(source_id, target_id, settings.correspondence.siblings)
        hashes = [self._sha256[source_id], self._sha256[target_id], [list(one) for one in siblings]]
        return [*hashes, settings.sha256]

    def _pair(self, source_id: str, target_id: str, settings: Settings) -> tuple[Pair, Structure, Structure]:
        from upplied.planning.correspondence.siblings import study
        from upplied.planning.surface.frames import frames_for, structure_in

        source, target = self.catalog.structure(source_id), self.catalog.structure(target_id)
        names = self._siblings(source_id, target_id, settings.correspondence.siblings)
        here, there = frames_for(source, target, settings)
        both = structure_in(here, source), structure_in(there, target)
        siblings = [self.catalog.structure(name) for name, _ in names]
        return study(*both, settings, self.catalog.cache, siblings), source, target

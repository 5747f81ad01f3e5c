"""The zones that are required of one structure: where they are on it, and how views of it show them."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from upplied import records
from upplied.config import CloudSettings, Settings, focal_px, settings_for
from upplied.errors import SettingsError, UppliedError
from upplied.geometry.scene import Scene, scene_of
from upplied.geometry.supposed_scene import scene_for
from upplied.geometry.vectors import with_normals
from upplied.planning.airspace.rules import Airspace
from upplied.planning.correspondence.certainty import certainty
from upplied.planning.correspondence.fit import Fit
from upplied.planning.correspondence.memo import Memo, no_memo
from upplied.planning.correspondence.pair import study_pair
from upplied.planning.demonstration.inspection import Faces, zone_of
from upplied.planning.geometry.clouds import spacing
from upplied.planning.measures.attainable import attainable
from upplied.planning.surface.frames import frames_for, structure_in
from upplied.planning.surface.parts import labels_of
from upplied.planning.surface.samples import surface_samples
from upplied.planning.surface.skin import skin_parts
from upplied.planning.visibility.observations import TRULY
from upplied.proof.looks import looks_of
from upplied.proof.zones import Demand, Looked, judged, shown_as_required
from upplied.records import Bools, Camera, Cloud, Floats, Ints, Record, Structure, Trajectory
from upplied.threads import one_thread

_NEIGHBOURS = 5  # carried samples nearest to one of the target: it is in the zone where most of them are
_REACH = 3.0  # spacings of the target's samples that the nearest of them may be off
_PART = 0.1  # share of the zone from which a part of the source counts; the largest always does


@dataclass(frozen=True, eq=False, repr=False)
class CarriedZone(Record):
    """A zone on the target."""

    patches: Bools  # (N,) samples of the target
    probability: float  # that they are the right part; NaN where that cannot be known
    lost_pct: float  # of the zone, what has no counterpart


def carried_zone(
    where: str,
    source: Structure,
    target: Structure,
    surface: Cloud,
    settings: Settings,
    memo: Memo = no_memo,
    faces: Faces | None = None,
) -> CarriedZone:
    """The samples (N) of a target's surface that correspond to a zone of a source (see `inspection.zone_of`).

    Both structures are of one kind, and all is in declared frames. It is a SettingsError if the zone names
    no surface of the source.
    """
    here, there = frames_for(source, target, settings)
    with one_thread():
        pair = study_pair(structure_in(here, source), structure_in(there, target), settings, memo)
    fit = pair.surface
    skin = skin_parts(pair.source, pair.source_scene, fit.source).label
    zone = zone_of(where, pair.source, fit.source, skin, faces)
    assert zone is not None
    apart_m = spacing(fit.target)
    turned = there.from_declared(surface.points), surface.outward @ there.turn
    known = cKDTree(with_normals(fit.target.points, fit.target.outward, 2 * apart_m))
    nearest = known.query(with_normals(*turned, 2 * apart_m))[1]
    lost = zone & (fit.correspondences.target_index < 0)
    patches = np.asarray(_carried(fit, zone)[nearest], bool)
    return CarriedZone(patches, _probability(fit, zone), 100 * float(lost.sum() / zone.sum()))


def _carried(fit: Fit, zone: Bools) -> Bools:
    """Which of the target's samples (M,) the zone (N,) of the source's is carried to."""
    places = fit.correspondences.target_points
    known = np.isfinite(places).all(axis=1) & (fit.correspondences.target_index >= 0)
    if not (known & zone).any():
        return np.zeros(len(fit.target), bool)
    count = min(_NEIGHBOURS, int(known.sum()))
    off, nearest = cKDTree(places[known]).query(fit.target.points, k=range(1, count + 1))
    inside = zone[known][nearest].mean(axis=1) > 0.5
    return np.asarray(inside & (off[:, 0] <= _REACH * spacing(fit.target)), bool)


def _probability(fit: Fit, zone: Bools) -> float:
    """That the target's parts correspond to the parts of the zone: of the least certain one."""
    if fit.carried is None:
        return float("nan")
    share = np.bincount(labels_of(fit.source)[zone]) / zone.sum()
    parts = np.flatnonzero(share >= min(_PART, share.max())).tolist()
    partners = {part: fit.correspondences.target_parts(part).tolist() for part in parts}
    return min(certainty(fit, part, others) if others else 0.0 for part, others in partners.items())


@dataclass(frozen=True, eq=False, repr=False)
class _Zone(Record):
    patches: Bools  # (N,)
    carried: bool = False
    probability: float = 1.0
    origin: str = ""  # where it was carried from, in words


class RequiredZones:
    """The zones that are required of a structure, judged by views of it.

    Zones are carried from the structures that `structure` returns for their ids. A safe camera stays clear of
    what is supposed of the target; `camera` decides what it could see. Of each required zone there are name,
    set and version, who requires it, and its demand. For `faces` see `inspection.zone_of`.
    """

    def __init__(
        self,
        structure: Callable[[str], Structure],
        memo: Memo,
        target: Structure,
        supposed: records.SupposedSurface | None,
        camera: Camera,
        required: list[dict[str, Any]],
        faces: Faces | None = None,
    ) -> None:
        self._structure, self._memo, self._faces = structure, memo, faces
        self.target, self.camera, self._rows = target, camera, required
        self.scene = scene_for(target, supposed)
        self.surface = surface_samples(target, scene_of(target), CloudSettings())

    def patches(self, where: str) -> Bools:
        """The samples (N,) that a place names; a SettingsError if it names none."""
        patches = zone_of(where, self.target, self.surface, self._skin, self._faces)
        if patches is None:
            raise SettingsError("the zone", "names no place", "landmarks, parts, boxes or balls")
        return patches

    def planned(self, plan: records.Plan, camera: Camera) -> Looked:
        """How a plan that has a path sees the samples; a picture is taken at each viewpoint."""
        path = plan.trajectory
        assert path is not None
        flags = np.zeros(len(path), bool) if plan.is_viewpoint is None else plan.is_viewpoint
        return self.along(path, camera, path.t_s[flags], scene_for(self.target, plan.supposed))

    def along(self, path: Trajectory, camera: Camera, photo_s: Floats, scene: Scene | None = None) -> Looked:
        """How a path sees the samples: the nearest view, and the most frontal within each required range."""
        gsd_mm = sorted({demand.gsd_mm for demand, _ in self._zones if demand.gsd_mm is not None})
        focal = focal_px(camera.width_px, camera.hfov_deg) if camera.width_px else 0.0
        within_m = [1e-3 * each * focal for each in gsd_mm] if focal else []
        looks = looks_of(path, self.surface, camera, scene or self.scene, None, photo_s, within_m)
        return Looked(looks.distance_m, looks.incidence_deg, 0.0, camera, looks.pictures, looks.frontal)

    def judged(self, *looks: Looked) -> list[dict[str, Any]]:
        """Of each zone its name and set, its status, the share that is shown and why it is not met.

        ``seen_by`` are the numbers of the looks that saw any of it. One that names nothing here is
        ``not judged``.
        """
        return [self._verdict(row, *zone, looks) for row, zone in zip(self._rows, self._zones, strict=True)]

    def _verdict(
        self, row: dict[str, Any], demand: Demand, zone: _Zone | str, looks: tuple[Looked, ...]
    ) -> dict[str, Any]:
        about = {name: row[name] for name in ("set", "version", "asked_by", "zone")}
        if isinstance(zone, str):
            unknown = dict.fromkeys(("probability", "pct"), float("nan"))
            return about | unknown | {"on": demand.on, "status": "not judged", "why": zone, "seen_by": []}
        verdict = judged(demand, zone.patches, self._attainable, looks)
        about |= {"on": demand.on if zone.carried else "", "probability": zone.probability}
        why = "; ".join(filter(None, (verdict.why, zone.origin)))
        seen_by = [at for at, look in enumerate(looks) if np.isfinite(look.distance_m[zone.patches]).any()]
        return about | {"status": verdict.status, "pct": verdict.shown_pct, "why": why, "seen_by": seen_by}

    def required(self) -> tuple[records.RequiredSurface, tuple[str, ...]]:
        """All zones as one surface, each sample with the strictest demand on it; and those that name none."""
        surface, unknown = self.surface, []
        required = np.zeros(len(surface), bool)
        gsd_m, incidence = np.full(len(surface), np.inf), np.full(len(surface), 90.0)
        for demand, zone in self._zones:
            if isinstance(zone, str):
                unknown.append(f"zone {demand.zone} is not planned for: {zone}")
                continue
            required |= zone.patches
            for least, limit, unit in ((gsd_m, demand.gsd_mm, 1e-3), (incidence, demand.incidence_deg, 1.0)):
                if limit is not None:
                    least[zone.patches] = np.minimum(least[zone.patches], unit * limit)
        of_all = surface.points, surface.outward, required, gsd_m, incidence
        return records.RequiredSurface(*of_all), tuple(unknown)

    def missed(self, *looks: Looked) -> list[tuple[dict[str, Any], Demand, Bools]]:
        """Of each zone that is known here its row, its demand, and the samples (N,) not shown as required."""
        return [
            (row, demand, zone.patches & ~shown_as_required(demand, len(self.surface), looks))
            for row, (demand, zone) in zip(self._rows, self._zones, strict=True)
            if not isinstance(zone, str)
        ]

    @cached_property
    def _zones(self) -> list[tuple[Demand, _Zone | str]]:
        """The demands, each with its zone, or why it names none here, such as an unknown landmark."""
        zones = list[tuple[Demand, _Zone | str]]()
        for row in self._rows:
            demand = Demand(**{name: row[name] for name in Demand.__dataclass_fields__ if name in row})
            try:
                zones.append((demand, self._zone(demand)))
            except UppliedError as error:
                zones.append((demand, str(error)))
        return zones

    def _zone(self, demand: Demand) -> _Zone:
        """The samples of a zone, carried from the structure that it is on where that is another one."""
        if demand.on in ("", self.target.structure_id):
            return _Zone(self.patches(demand.where))
        known = settings_for("recommended"), self._memo, self._faces
        zone = carried_zone(demand.where, self._structure(demand.on), self.target, self.surface, *known)
        origin = f"carried from {demand.on}"
        origin += f" with probability {zone.probability:.2f}" if np.isfinite(zone.probability) else ""
        origin += f", {zone.lost_pct:.0f} % of it has no counterpart" if zone.lost_pct >= 1 else ""
        return _Zone(zone.patches, True, zone.probability, origin)

    @cached_property
    def _skin(self) -> Ints:
        return skin_parts(self.target, scene_of(self.target), self.surface).label

    @cached_property
    def _attainable(self) -> Bools:
        route, around = settings_for("recommended").route, self.target.surroundings
        airspace = Airspace(self.scene, route.clearance_m, around, route.ground_clearance_m)
        return attainable(self.surface, airspace, self.camera, TRULY)

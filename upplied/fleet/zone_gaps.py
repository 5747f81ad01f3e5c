"""What flights left out of the zones that are asked of a structure."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from upplied.catalog import Catalog
from upplied.catalog.schema.rows import Row
from upplied.catalog.verbs.required import zones_of
from upplied.config import digest, focal_px
from upplied.geometry.vectors import with_normals
from upplied.outputs.zones import flown_rows, looked
from upplied.planning.geometry.clouds import spacing
from upplied.proof.gap import square_metres
from upplied.proof.required_zones import RequiredZones
from upplied.proof.zone_gap import ZoneGap
from upplied.proof.zones import Demand
from upplied.records import Bools, Camera, Cloud, Ints, Structure


@dataclass(frozen=True)
class Zone:
    """A zone that is missed, with what is to be shown of it and how that is told."""

    row: dict[str, Any]  # which names it
    demand: Demand
    gap: ZoneGap

    def summary(self, shown: Bools, unattainable: Bools) -> str:
        """What a flight makes of it, in square metres."""
        cloud, named = self.gap.cloud, f"zone {self.row['zone']} ({self.row['set']} {self.row['version']})"
        area, all_of_it = square_metres(cloud, shown), square_metres(cloud, np.ones(len(cloud), bool))
        text = f"{named}: shows {area:.1f} of {all_of_it:.1f} m2 that was not seen as it asks"
        if unattainable.any():
            text += f"; {square_metres(cloud, unattainable):.1f} m2 of it no safe pose shows so"
            text += ": the camera's pixels are not known" if self.gap.farthest_m == 0 else ""
        if self.demand.looks > 1:
            text += f"; it requires {self.demand.looks} pictures, this flight shows each place at least once"
        return text


def missed_zones(
    catalog: Catalog, row: Row, target: Structure, camera: Camera
) -> tuple[list[Zone], tuple[str, ...]]:
    """What of zones a flight (its row) and all others did not show; and zones without surface, in words."""
    asking = _asking(catalog, row, target, camera)
    if asking is None:
        return [], ()
    surface = asking.surface
    misses = []
    for named, demand, missed in asking.missed(*looked(catalog, _flights(catalog, row), surface)):
        if missed.any():
            cloud = Cloud(surface.points[missed], surface.outward[missed], surface.areas[missed])
            most = 90.0 if demand.incidence_deg is None else demand.incidence_deg
            misses.append(Zone(named, demand, ZoneGap(demand.zone, cloud, _farthest_m(demand, camera), most)))
    return misses, asking.required()[1]


def zones_left_out(catalog: Catalog, row: Row) -> str:
    """The zones that some safe camera can see and that were not seen as they ask, in words."""
    target = catalog.structure(str(row["target_id"]))
    camera = catalog.demonstration(str(row["demonstration_id"])).camera
    asking = _asking(catalog, row, target, camera)
    if asking is None:
        return ""
    judged = asking.judged(*looked(catalog, _flights(catalog, row), asking.surface))
    return ", ".join(f"zone {each['zone']}" for each in judged if each["status"] == "missed")


def key_of(zones: list[Zone]) -> list[str]:
    """What a plan for these zones is named by, beside its flight; nothing where there are none."""
    parts: list[Any] = []
    for zone in zones:
        gap, named = zone.gap, [zone.row[name] for name in ("zone", "set", "version")]
        demanded = [zone.demand.looks, gap.farthest_m, gap.incidence_deg]
        parts.append([*named, *demanded, gap.cloud.points.tolist()])
    return [digest(parts)] if parts else []


def nearest(surface: Cloud, cloud: Cloud) -> Ints:
    """The sample of a surface that is nearest to each of a cloud's, on its side of a thin plate."""
    apart = spacing(surface)
    known = cKDTree(with_normals(surface.points, surface.outward, 2 * apart))
    return np.asarray(known.query(with_normals(cloud.points, cloud.outward, 2 * apart))[1], np.int64)


def _asking(catalog: Catalog, row: Row, target: Structure, camera: Camera) -> RequiredZones | None:
    zones = zones_of(catalog, target.kind, target.structure_id)
    if not zones:
        return None
    known = target, catalog.supposed(str(row["transfer_id"])), camera, zones
    return RequiredZones(catalog.structure, catalog.cache, *known, catalog.faces_labelled)


def _flights(catalog: Catalog, row: Row) -> list[Row]:
    """The flight and all that were really flown."""
    every = flown_rows(catalog, str(row["target_id"]))
    return every + [row] * (row["flight_id"] not in {each["flight_id"] for each in every})


def _farthest_m(demand: Demand, camera: Camera) -> float:
    """From how far off a pixel covers little enough, m; 0 where the camera's pixels are not known."""
    if demand.gsd_mm is None:
        return float("inf")
    return 1e-3 * demand.gsd_mm * focal_px(camera.width_px, camera.hfov_deg) if camera.width_px else 0.0

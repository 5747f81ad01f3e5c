"""Inspections of scanned structures, and the truth about what is decided or planned: from the generator."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import numpy as np
from scans import member_of, scan, true_parts
from scipy.spatial import cKDTree

from upplied.config import settings_for
from upplied.geometry.scene import scene_of
from upplied.planning.demonstration.repetition import Take
from upplied.planning.geometry.clouds import spacing
from upplied.planning.surface.samples import surface_samples
from upplied.records import Bools, Cloud, Demonstration, Floats
from upplied.samples.pilot import fly

Correspondence = dict[str, Any]
RIGHT = 0.8  # of what corresponds, or of what the demonstration shows, that must be on a right part
_LOOKED_AT = 0.4  # attention from which a sample was inspected
_REACH = 2.5  # spacings: a sample of the target this near a counterpart is reached
_THERE = 0.01  # of the diagonal: a clean sample this near the scan's surface was scanned

#: By kind: the source that is flown in decisions and plans.
SOURCE = {
    "airliner": "a320-v1",
    "wind_turbine": "turbine-1-v1",
    "bridge": "bridge-1-v1",
    "ship": "cruise-v1",
}


def sort(name: str) -> str:
    """What sort of part a name says: ``engine`` of ``engine_left_outer``, ``pier`` of ``pier_2``."""
    return re.sub(r"_(left|right|outer|inner|front|back|\d+)", "", name)


def side(name: str) -> str:
    """``left`` or ``right``, where a name says one."""
    return next((side for side in ("left", "right") if side in name), "")


@dataclass(frozen=True)
class Case:
    """One inspection, its settings, and the parts of the target that are right."""

    inspection: str
    sort: str  # of the parts that are meant
    side: str = ""
    correspondence: Correspondence = field(default_factory=dict)
    every: bool = False  # whether each of the right parts must be reached, not one of them
    place: str = ""  # what the name of a right part says, where any name does

    def right(self, kind: str, target: str) -> list[str]:
        """The names of the target's parts that are meant; of a real mesh, those that `learn` was told."""
        if "/" in target:
            return _LEARNED.get((target, self.inspection, self.label), ([], 1.0))[0]
        names = [
            name
            for name in member_of(kind, target).part_names
            if sort(name) == self.sort and (not self.side or side(name) == self.side)
        ]
        return [name for name in names if self.place in name] or names

    @property
    def label(self) -> str:
        """The settings in words."""
        return str(self.correspondence or "once")


CASES = {
    "airliner": (
        Case("engine_left", "engine", "left"),
        Case("engine_left", "engine", correspondence={"repeat": "each"}, every=True),
        Case("engine_left", "engine", "left", {"counterparts": (("engine_left", "outer"),)}, place="outer"),
        Case("wings", "wing", every=True),
        Case("fuselage", "fuselage"),
    ),
    "wind_turbine": (Case("tower", "tower"),),
    "bridge": (
        Case("piers", "pier"),
        Case("piers", "pier", correspondence={"repeat": "each"}, every=True),
    ),
    "ship": (Case("hull", "hull"),),
}


#: By real mesh, inspection and settings: the parts that are right, and how much of them is reached.
_LEARNED: dict[tuple[str, str, str], tuple[list[str], float]] = {}
_ANSWERS = 0.2  # share of what corresponds, from which a part of a real mesh is one that is meant


def learn(kind: str, case: Case, target: str, takes: Sequence[Take]) -> None:
    """Take the parts of a real mesh that correspond on the mesh as modelled for the right ones."""
    names, areas = np.empty(0, str), np.empty(0)
    for take in takes:
        main, area = _main_and_area(kind, case, take)
        points = take.pair.surface.correspondences.target_points[main]
        known = np.isfinite(points[:, 0])
        names = np.append(names, true_parts(kind, target, points[known]))
        areas = np.append(areas, area[main][known])
    each = np.unique(names)
    right = [str(name) for name in each if areas[names == name].sum() * len(takes) >= _ANSWERS * areas.sum()]
    key = target, case.inspection, case.label
    _LEARNED[key] = right, 1.0
    _LEARNED[key] = right, max(truth(kind, case, target, "model", takes)["reach"], 1e-9)


@cache
def flown(kind: str, inspection: str) -> Demonstration:
    """The flight of a case, round the source of its kind."""
    return fly(member_of(kind, SOURCE[kind]).structure, inspection, seed=2)


@cache
def clean_cloud(kind: str, target: str) -> Cloud:
    """Samples of the structure as it was modelled."""
    whole = member_of(kind, target).structure
    return surface_samples(whole, scene_of(whole, 1), settings_for("recommended").clouds)


def area_of(cloud: Cloud) -> Floats:
    """(N,) m^2, 1 where it is not known."""
    return np.ones(len(cloud)) if cloud.area_m2 is None else cloud.area_m2


def present(kind: str, case: Case, target: str, variant: str) -> float:
    """Share of the right parts that was scanned: of the least where all count, of the most where one does."""
    cloud = clean_cloud(kind, target)
    name, area, there = (
        true_parts(kind, target, cloud.points),
        area_of(cloud),
        _scanned(kind, target, variant),
    )
    if not case.every and not case.side:
        mine = np.isin(name, case.right(kind, target))
        return float(area[mine & there].sum() / max(area[mine].sum(), 1e-9))
    shares = [
        float(area[mine & there].sum() / max(area[mine].sum(), 1e-9))
        for mine in (name == each for each in case.right(kind, target))
    ]
    return (min if case.every else max)(shares, default=0.0)


def _scanned(kind: str, target: str, variant: str) -> Bools:
    """Which clean samples lie near the scan's surface."""
    cloud, there = clean_cloud(kind, target), scan(kind, target, variant)
    if variant == "model":
        return np.ones(len(cloud), bool)
    corners = there.vertices[there.triangles].mean(axis=1) if len(there.triangles) else there.vertices
    points = np.vstack([corners, there.vertices[np.unique(there.triangles)]])
    near = max(2 * spacing(cloud), _THERE * member_of(kind, target).structure.diagonal_m)
    return np.asarray(cKDTree(points).query(cloud.points)[0] < near, bool)


def truth(kind: str, case: Case, target: str, variant: str, takes: Sequence[Take]) -> dict[str, Any]:
    """Share of what corresponds that is on a right part, and how much of each right part that reaches."""
    on_right, counted, reached, shown = 0.0, 0.0, np.empty((0, 3)), 1.0
    usual = _LEARNED.get((target, case.inspection, case.label), ([], 1.0))[1]
    for take in takes:
        fit, (main, area) = take.pair.surface, _main_and_area(kind, case, take)
        name = true_parts(kind, SOURCE[kind], fit.source.points)
        whole = area[np.isin(name, np.unique(name[main]))].sum()
        shown = min(shown, float(area[main].sum() / max(whole, 1e-9)))
        points = fit.correspondences.target_points[main]
        known = np.isfinite(points[:, 0])
        good = np.isin(true_parts(kind, target, points[known]), case.right(kind, target))
        on_right += float(area[main][known][good].sum())
        counted += float(area[main][known].sum())
        reached = np.vstack([reached, points[known]])
    return {
        "right": on_right / max(counted, 1e-9),
        "counted": counted > 0,
        "reach": _reach(kind, case, target, variant, reached) / max(shown, 1e-9) / usual,
    }


def _main_and_area(kind: str, case: Case, take: Take) -> tuple[Bools, Floats]:
    """Which samples of the source are inspected and of the sort that is meant, and the area of all."""
    cloud = take.pair.surface.source
    of_sort = [sort(str(each)) == case.sort for each in true_parts(kind, SOURCE[kind], cloud.points)]
    return (take.inspection.attention.weight > _LOOKED_AT) & np.array(of_sort), area_of(cloud)


def _reach(kind: str, case: Case, target: str, variant: str, reached: Floats) -> float:
    """Least share of a right part, of what of it was scanned, that has a counterpart."""
    clean, there = clean_cloud(kind, target), _scanned(kind, target, variant)
    name, area = true_parts(kind, target, clean.points), area_of(clean)
    near = np.zeros(len(clean), bool)
    if len(reached):
        near = cKDTree(reached).query(clean.points)[0] < _REACH * spacing(clean)
    shares = [
        float(area[mine & near].sum() / max(area[mine & there].sum(), 1e-9))
        for mine in (name == each for each in case.right(kind, target))
    ]
    return (min if case.every else max)(shares, default=0.0)

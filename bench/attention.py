"""What surface a flight was about: weight on the intended part, and how much of that part is found.

    python bench/attention.py [--random N] [--real] [--changes] [--only WORD]

Rows are the simulated pilot's flights round the sample fleet, with ``--random`` round so many structures
of each kind that nobody built, with ``--real`` round the real ones (bench/real_data.py). `weight` is the
share of the weight on what the flight was meant for, with what is attached to it (fin, stabilisers and
fairings of a fuselage, nacelles of a wing, the pylon of an engine); `strict` without; `area` is what area
alone would say; `recall` is the share of intended samples shown for a second within 60 deg at half the
best resolution that weigh more than 0.5. ``--changes`` prints by how many points weight and recall change
with the camera's reach, the log's rate, noise, hovering, transits, unwelded meshes and the sampling's seed.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache

import numpy as np
from attention_changes import Row, Truth, changed
from random_members import random_member
from real_data import real_folder, real_structure

from upplied.config import CloudSettings, InspectionSettings
from upplied.errors import UppliedError
from upplied.geometry.scene import scene_of
from upplied.planning.demonstration.attention import attention
from upplied.planning.surface.samples import surface_samples
from upplied.planning.surface.skin import skin_study
from upplied.planning.visibility.observations import TRULY, moments, stations_at, views
from upplied.records import Bools, Cloud, Demonstration, Structure
from upplied.samples.airframe import airframe, left_nacelle, tower_of
from upplied.samples.fleet import member
from upplied.samples.pilot import fly
from upplied.samples.surfaces import Member

#: Names of the sample fleet's parts: strictly meant, and what is attached to them.
INTENDED = {
    "engine_left": (("engine_left", "nacelle_left"), ("pylon_left",)),
    "fuselage": (("fuselage", "fairing"), ("fin", "stabiliser", "endplate")),
    "wings": (("wing_", "winglet_"), ("engine_", "nacelle_", "pylon_", "fairing")),
    "tower": (("tower",), ()),
    "hull": (("hull",), ("deck_1", "boat", "lifeboat")),
    "sides": (("side", "left", "right", "front", "rear", "back"), ()),
    "piers": (("pier", "cap"), ()),
}
FLIGHTS = {
    "airliner": ("fuselage", "wings", "engine_left"),
    "wind_turbine": ("tower",),
    "ship": ("hull",),
    "box": ("sides",),
    "bridge": ("piers",),
}
SAMPLES = (
    ("a320-v1", "fuselage"),
    ("a320-v1", "wings"),
    ("a320-v1", "engine_left"),
    ("turbine-1-v1", "tower"),
    ("cruise-v1", "hull"),
    ("cube-v1", "sides"),
    ("bridge-1-v1", "piers"),
)
REAL = (
    ("airplane/a320_fr24", ("fuselage", "wings", "engine_left")),
    ("airplane/b744_fr24", ("fuselage", "wings", "engine_left")),
    ("airplane/b738_fr24", ("fuselage", "wings", "engine_left")),
    ("airplane/e190_fr24", ("wings", "engine_left")),
    ("airplane/md11_fgstatic", ("wings", "engine_left")),
    ("wind_turbine/enercon_e82_98m", ("tower",)),
    ("wind_turbine/vestas_v90_105m", ("tower",)),
    ("ship/cruise_ship_219m", ("hull",)),
    ("ship/ferry_88m", ("hull",)),
    ("building/office_30x47_fg", ("sides",)),
    ("building/hotel_generic_fg", ("sides",)),
    ("bridge/larics_bridge", ("piers",)),
)
STEP_S = 0.5


@dataclass(frozen=True)
class Judgement:
    """What attention says of a flight, in percent."""

    strict: float
    weight: float
    recall: float
    area: float
    subject_m: float
    seconds: float


def rows(random: int, real: bool) -> Iterator[Row]:
    """The flights that are judged; those that a structure has no room for are left out."""
    for name, inspection in SAMPLES:
        sample = member(name)
        yield _row(name, inspection, sample.structure, _by_name(sample, inspection))
    for kind, flights in FLIGHTS.items():
        for seed in range(100, 100 + random):
            sample = random_member(kind, seed)
            for inspection in flights:
                try:
                    yield _row(f"{kind} {seed}", inspection, sample.structure, _by_name(sample, inspection))
                except UppliedError as error:
                    print(f"left out: {kind} {seed} {inspection}: {error}")
    folder = real_folder()
    for place, flights in REAL if real and folder is not None else ():
        assert folder is not None
        structure = real_structure(folder, place)
        for inspection in flights:
            try:
                yield _row(place.split("/")[1], inspection, structure, _by_place(structure, inspection))
            except UppliedError as error:
                print(f"left out: {place} {inspection}: {error}")


def _row(title: str, inspection: str, structure: Structure, truth: Truth) -> Row:
    return Row(f"{title} {inspection}", inspection, structure, fly(structure, inspection, seed=5), truth)


def _by_name(sample: Member, inspection: str) -> Truth:
    strict, attached = INTENDED[inspection]

    def truth(cloud: Cloud) -> tuple[Bools, Bools]:
        triangle = scene_of(sample.structure).closest(cloud.points)[1]
        names = np.array(sample.part_names)[sample.part_of_triangle[triangle]]
        mine, also = (
            np.array([name.startswith(some) if some else False for name in names], bool)
            for some in (strict, strict + attached)
        )
        return mine, also

    return truth


def _by_place(structure: Structure, inspection: str) -> Truth:
    """Where the part lies that the pilot recognises on a mesh without names."""
    scene = scene_of(structure)

    def truth(cloud: Cloud) -> tuple[Bools, Bools]:
        x, y, z = cloud.points.T
        low, high = structure.vertices.min(axis=0), structure.vertices.max(axis=0)
        assert cloud.normals is not None
        if inspection in ("engine_left", "fuselage", "wings"):
            frame = airframe(structure, scene)
            middle = (low[1] + high[1]) / 2
            beside = np.abs(y - middle) > 1.15 * frame.half_width
            out = np.clip(np.abs(y - middle), frame.wing_y[0], frame.wing_y[-1])
            edges = [np.interp(out, frame.wing_y, edge) for edge in (frame.leading_x, frame.trailing_x)]
            over = beside & (x < edges[0] + 1.5) & (x > edges[1] - 1.5)
            if inspection == "wings":
                around = beside & (x < edges[0] + 6) & (x > edges[1] - 4)
                return over, around | (np.abs(z - frame.axis_z) < frame.half_height) & over
            if inspection == "fuselage":
                body = (np.abs(y - middle) < 1.1 * frame.half_width) & (
                    z < frame.axis_z + 1.15 * frame.half_height
                )
                tail = x < frame.tail_x + 0.2 * (frame.nose_x - frame.tail_x)
                return body, body | (tail & (np.abs(y - middle) < 0.6 * frame.semi_span)) | (
                    np.abs(y - middle) < 1.2 * frame.half_width
                )
            engine = left_nacelle(structure, frame, scene)
            off = cloud.points - engine.centre
            near = np.hypot(off[:, 1], off[:, 2]) < 1.25 * engine.radius_m
            strict = near & (np.abs(off[:, 0]) < 0.5 * engine.length_m + 0.4 * engine.radius_m)
            around = (np.abs(off[:, 1]) < 1.3 * engine.radius_m) & (off[:, 2] < 2.2 * engine.radius_m)
            return strict, strict | (around & (np.abs(off[:, 0]) < 0.9 * engine.length_m))
        if inspection == "tower":
            tower = tower_of(structure)
            near = np.hypot(x - tower.axis_xy[0], y - tower.axis_xy[1]) < 1.3 * tower.radius_m
            mine = near & (z < tower.top_z + 0.5)
            return mine, mine
        if inspection == "hull":
            mine = z < low[2] + 0.42 * (high[2] - low[2])
            return mine & (np.abs(cloud.normals[:, 2]) < 0.8), mine
        if inspection == "sides":
            mine = np.abs(cloud.normals[:, 2]) < 0.8
            return mine, mine
        mine = (z < low[2] + 0.7 * (high[2] - low[2])) & (np.abs(cloud.normals[:, 2]) < 0.8)
        return mine, mine

    return truth


@cache
def _surface(structure: Structure, seed: int) -> tuple[Cloud, np.ndarray, float]:
    """Samples, stretches of the skin (J, N), and the CPU seconds of those."""
    scene = scene_of(structure)
    cloud = surface_samples(structure, scene, CloudSettings(seed=seed))
    began = time.process_time()
    stretch = skin_study(structure, scene, cloud).of(cloud)
    return cloud, stretch, time.process_time() - began


def judged(row: Row, seed: int = 0, view: Demonstration | None = None) -> Judgement:
    """What attention says of a row; recall is asked of `view`'s pictures, the flight's own if not given."""
    cloud, stretch, seconds = _surface(row.structure, seed)
    flight = row.flight
    shown = views(flight.trajectory, cloud, flight.camera, TRULY, scene_of(row.structure))
    began = time.process_time()
    weights = attention(
        flight.trajectory, flight.breaks, flight.camera, cloud, shown, stretch, InspectionSettings()
    )
    seconds += time.process_time() - began
    strict, attached = row.truth(cloud)
    weight = weights.weight * cloud.area_m2
    good = _well_shown(row.flight if view is None else view, row.structure, cloud, strict)
    whole = max(float(weight.sum()), 1e-12)
    return Judgement(
        100 * float(weight[strict].sum()) / whole,
        100 * float(weight[attached].sum()) / whole,
        100 * float(np.mean(weights.weight[good] > 0.5)) if good.any() else float("nan"),
        100 * float(cloud.area_m2[attached & shown.total].sum() / cloud.area_m2[shown.total].sum()),
        weights.subject_m,
        seconds,
    )


def _well_shown(flight: Demonstration, structure: Structure, cloud: Cloud, mine: Bools) -> Bools:
    """Intended samples that are shown for a second within 60 deg at half the best resolution."""
    shown = views(flight.trajectory, cloud, flight.camera, TRULY, scene_of(structure))
    steps = moments(flight.trajectory, flight.breaks)
    seen = shown.seen[stations_at(shown, steps)] & mine
    near, dwell_s = np.full(len(cloud), np.inf), np.zeros(len(cloud))
    for at, row, step in zip(steps.poses.positions, seen, steps.step_s, strict=True):
        ray = at - cloud.points[row]
        distance = np.linalg.norm(ray, axis=1)
        frontal = (ray * cloud.normals[row]).sum(axis=1) >= 0.5 * distance
        index = np.flatnonzero(row)[frontal]
        near[index] = np.minimum(near[index], distance[frontal])
        dwell_s[index] += step
    known = np.isfinite(near)
    if not known.any():
        return known
    return known & (1 / near >= 0.5 * np.quantile(1 / near[known], 0.9)) & (dwell_s >= 1.0)


def main() -> None:
    """Print the rows, the worst, and what the changes do."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--random", type=int, default=0)
    parser.add_argument("--real", action="store_true")
    parser.add_argument("--changes", action="store_true")
    parser.add_argument("--only", default="")
    options = parser.parse_args()
    print(f"{'flight':36}{'strict':>8}{'weight':>8}{'recall':>8}{'area':>8}{'subject m':>11}{'CPU s':>7}")
    results: list[tuple[str, Judgement]] = []
    largest: dict[str, list[tuple[float, float, str]]] = {}
    for row in rows(options.random, options.real):
        if options.only not in row.title:
            continue
        one = judged(row)
        results.append((row.title, one))
        print(
            f"{row.title:36}{one.strict:8.1f}{one.weight:8.1f}{one.recall:8.1f}{one.area:8.1f}"
            f"{one.subject_m:11.1f}{one.seconds:7.2f}", flush=True,
        )  # fmt: skip
        for name, other, seed, view in changed(row) if options.changes else ():
            new = judged(other, seed, view)
            change = (abs(new.weight - one.weight), abs(new.recall - one.recall), row.title)
            largest.setdefault(name, []).append(change)
            if max(change[:2]) > 3:
                print(f"    {name:14} weight {new.weight:6.1f} recall {new.recall:6.1f}", flush=True)
    weight, recall = (np.array([getattr(one, of) for _, one in results]) for of in ("weight", "recall"))
    print(f"mean weight {np.nanmean(weight):.1f}, recall {np.nanmean(recall):.1f}")
    for name, values, least in (("weight", weight, 85), ("recall", recall, 90)):
        below = [f"{results[k][0]} {values[k]:.1f}" for k in np.argsort(values) if values[k] < least]
        print(f"{name} below {least}: {'; '.join(below) or 'none'}")
    for name, changes in largest.items():
        far = sum(max(change[:2]) > 3 for change in changes)
        worst = max(changes, key=lambda change: max(change[:2]))
        print(f"{name:14} largest change {worst[0]:.1f} weight, {worst[1]:.1f} recall: {worst[2]}; "
              f"{far} of {len(changes)} rows above 3")  # fmt: skip


if __name__ == "__main__":
    main()

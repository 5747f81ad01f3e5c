"""`findings.py` carried, missions, queries: places on other structures, flights to them, CPU of questions."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from findings_cases import (
    CAMERA,
    KINDS,
    catalog_of,
    demonstration_of,
    members_of,
    path_round,
    real_meshes,
    scan_of,
    spots_on,
)
from findings_looks import rendered
from random_members import random_member
from scipy.spatial import cKDTree
from true_counterparts import true_counterparts

from upplied.catalog import Catalog, open_catalog
from upplied.config import CloudSettings, digest
from upplied.errors import RefusedError, UppliedError
from upplied.findings.adding import add_marks
from upplied.findings.carried import Carrying
from upplied.findings.looks import Spot, spot_of
from upplied.findings.marks import Mark
from upplied.findings.queries import by_reference, photographed
from upplied.findings.rays import pixels_of, rays_of
from upplied.findings.reshoot import plan_reshoot
from upplied.geometry.poses import interpolate, matrices
from upplied.geometry.scene import Scene, scene_of
from upplied.geometry.vectors import points_on_triangles
from upplied.planning.surface.samples import surface_samples
from upplied.records import Floats, Plan, Structure, SurfaceStates, Trajectory

_STEP = 0.02  # of the structure's size: what counts as carried rightly
_STRETCH = np.array([1.15, 1.08, 0.92])  # of real meshes, whose counterparts are known by it


def carried(seed: int, real: int) -> None:
    """Places on another structure of the kind, against the truth."""
    rng = np.random.default_rng(seed)
    rows = []
    for name, source, target, spots, truth in _pairs(seed, real, rng):
        try:
            there = Carrying(catalog_of([source, target])).to(spots, target.structure_id)
        except UppliedError as error:
            print(f"carried {name}, {source.structure_id}: {error}"[:300], flush=True)
            continue
        off = np.linalg.norm(there.place - truth, axis=1)
        lacks, none = np.isnan(truth[:, 0]), np.isnan(there.place[:, 0])
        wrong = np.where(lacks, ~none, none | (off > _STEP * target.diagonal_m))
        both = ~lacks & ~none
        rows.append(
            (name, wrong, there.doubtful, off[both] <= there.error_m[both], off[both] / target.diagonal_m)
        )
    names = list(dict.fromkeys(row[0] for row in rows))
    for name in (*names, "all"):
        own = [row for row in rows if row[0] == name or (name == "all" and row[0] in KINDS)]
        wrong, doubtful, within, off = (np.concatenate([row[at] for row in own]) for at in range(1, 5))
        print(
            f"carried {name:28}within 2 % {100 * (1 - wrong.mean()):.1f} %, "
            f"median {100 * np.median(off):.2f} %, within the stated error {100 * within.mean():.1f} %, "
            f"doubtful {100 * doubtful.mean():.1f} %, "
            f"wrong without a word {int((wrong & ~doubtful).sum())} of {len(wrong)}"
        )


def _pairs(
    seed: int, real: int, rng: np.random.Generator
) -> Iterator[tuple[str, Structure, Structure, list[Spot], Floats]]:
    """Names, sources, targets, places on the sources, and where they truly are on the targets."""
    for kind in KINDS:
        for one, other in ((seed + 300, seed + 301), (seed + 302, seed + 303)):
            source, target = random_member(kind, one), random_member(kind, other)
            for name, count in ((kind, 60), ("hidden", 20)):
                spots = spots_on(source.structure, count, rng, hidden=name == "hidden")
                if spots:
                    places = np.array([spot.place for spot in spots])
                    truth = true_counterparts(source, target, places)
                    yield name, source.structure, target.structure, spots, truth
    for source in real_meshes(seed, real):
        vertices, sha256 = _STRETCH * source.vertices, digest([source.sha256, "stretched"])
        drawn = replace(source, structure_id="stretched", vertices=vertices, sha256=sha256)
        spots = spots_on(source, 40, rng)
        truth = _STRETCH * [spot.place for spot in spots]
        for name, target in (("real, drawn", drawn), ("real, scan", scan_of(drawn, rng))):
            yield name, source, target, spots, truth


def missions(seed: int) -> None:
    """Whether missions show each place as finely as asked, keep clear, and how long they are."""
    rng = np.random.default_rng(seed)
    fine, clear, ratios, places, refused = [], [], [], 0, 0
    for kind, structure in members_of(seed + 400):
        catalog = catalog_of([structure], [demonstration_of(structure, path_round(structure))])
        path = catalog.demonstration("flight").trajectory
        moments = rng.uniform(0, path.t_s[-1], 30)
        corners = rng.uniform([400, 400], [3600, 2500], (30, 2))
        marks = [Mark(str(at), flight="flight", t_s=float(t), pixels=((float(x), float(y)),))
                 for at, (t, (x, y)) in enumerate(zip(moments, corners, strict=True))]  # fmt: skip
        add_marks(catalog, marks, "bench")
        rows = [{str(k): v for k, v in row.items()} for row in catalog.findings().to_dict("records")]
        for mm_px in (1.0, 2.0):
            places += len(rows)
            try:
                mission = plan_reshoot(catalog, rows, structure.structure_id, mm_px)
            except RefusedError as error:
                print(f"missions {kind} at {mm_px} mm: {error}"[:200])
                refused += len(rows)
                continue
            refused += len(mission.refused)
            plan = catalog.plan(mission.transfer_id)
            assert plan.trajectory is not None and plan.is_viewpoint is not None
            shots = plan.trajectory.take(plan.is_viewpoint)
            for row in rows:
                if row["finding_id"] in mission.shown:
                    fine.append(_finest_mm(scene_of(structure), shots, spot_of(row)) <= mm_px)
            cloud = points_on_triangles(structure, 200_000, rng)[0]
            between = interpolate(plan.trajectory, np.arange(0, plan.trajectory.t_s[-1], 0.1)).positions
            clear.append(float(cKDTree(cloud).query(between)[0].min()))
            words = mission.words[0].split()
            flew, need = float(words[words.index("m") - 1]), float(words[-2])
            ratios.append(flew / need if need >= 5 else 1.0)
    line = f"{places} places, {refused} refused with a reason, {100 * np.mean(fine):.1f} % of others as fine"
    tours = f"tours {np.mean(ratios):.2f} of the bound, most {max(ratios):.2f}"
    print(f"missions: {line} as required; least clearance {min(clear):.2f} m of 2; {tours}")


def _finest_mm(scene: Scene, shots: Trajectory, spot: Spot) -> float:
    """The longer side of what the pixel that shows a spot covers, mm, in the finest photo; by rays."""
    finest = np.inf
    for at in rendered(scene, shots, spot):
        position, quat = shots.positions[at], shots.quat_xyzw[at]
        pixel = pixels_of(CAMERA, position, quat, spot.place[None])[0]
        corners = pixel + 0.5 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
        rays = rays_of(CAMERA, corners) @ matrices(quat).T
        away = ((spot.place - position) @ spot.normal) / (rays @ spot.normal)
        sides = np.linalg.norm(np.diff(position + away[:3, None] * rays[:3], axis=0), axis=1)
        finest = min(finest, 1e3 * float(sides.max()))
    return finest


def queries(seed: int, folder: Path | None, members: int = 200, each: int = 50) -> None:
    """CPU of questions over a large fleet: the first time, and once what is carried is remembered."""
    structures = [random_member("box", seed + 500 + at).structure for at in range(members)]
    catalog = open_catalog(folder or tempfile.mkdtemp(prefix="findings-"))
    if not (Path(catalog.location) / "catalog.json").exists():
        _fill(catalog, structures, each, seed)
    spots = spots_on(structures[0], 2, np.random.default_rng(seed))
    began, carrying = time.process_time(), Carrying(catalog)
    carrying.study("box")  # as planning does, for which their pairs were studied
    print(f"queries: pairs studied and carried in {time.process_time() - began:.0f} s of CPU", flush=True)
    questions = {
        "open findings of a class": lambda: catalog.findings(
            kind="box", class_name="corrosion", state="open"
        ),
        "not photographed at 5 mm": lambda: photographed(catalog, spots[0], mm_px=5.0, since="2020-01-01"),
        "the same of another place": lambda: photographed(catalog, spots[1], mm_px=5.0),
        "findings by reference": lambda: by_reference(
            catalog, structures[0].structure_id, class_name="corrosion"
        ),
    }
    for name, ask in questions.items():
        spent = []
        for _ in range(2):
            began = time.process_time()
            answer = ask()
            spent.append(time.process_time() - began)
        print(
            f"queries {name:28}{len(answer)} rows, first {spent[0]:.2f}, then {spent[1]:.2f} s of CPU",
            flush=True,
        )


def _fill(catalog: Catalog, structures: list[Structure], each: int, seed: int) -> None:
    """Findings, plans and flights of a large fleet."""
    rng, first = np.random.default_rng(seed), structures[0]
    catalog.add_structures(structures)
    catalog.add_demonstrations([demonstration_of(first, path_round(first))])
    rows, plans = [], []
    for structure in structures:
        for spot in spots_on(structure, each, rng):
            x, y, z = spot.place.tolist()
            rows.append({
                "finding_id": digest([structure.structure_id, x, y, z])[:12],
                "target_id": structure.structure_id, "kind": "box", "state": "open",
                "class": rng.choice(["corrosion", "crack", "dent"]),
                "x_m": x, "y_m": y, "z_m": z, "normal_json": str(spot.normal.tolist()), "place_error_m": 0.1,
                "structure_sha256": structure.sha256,
            })  # fmt: skip
        path = path_round(structure)
        plan = Plan("flight", first.structure_id, structure.structure_id, "box", "recommended", "ok",
                    trajectory=path, is_viewpoint=np.ones(len(path), bool), flyable=True,
                    surface=SurfaceStates(np.zeros((1, 3)), np.ones(1, np.int64)))  # fmt: skip
        plans.append((digest(structure.structure_id), plan, {}))
    catalog.add_findings(rows, "bench")
    catalog.add_plans(plans)
    for row in catalog.transfers().to_dict("records"):
        structure = catalog.structure(row["target_id"])
        cloud = surface_samples(structure, scene_of(structure), CloudSettings(surface_samples=1500))
        values = dict.fromkeys(("distance_m", "incidence_deg", "speed_mps", "t_s", "frontal_distance_m",
                                "frontal_incidence_deg"), np.full(len(cloud), 5.0))  # fmt: skip
        seen = rng.random(len(cloud)) < 0.5
        flight = {"flight_id": digest(["flown", row["target_id"]]), "transfer_id": row["transfer_id"],
                  "kind": "flown", "target_id": row["target_id"], "demonstration_id": "flight",
                  "flown_at": catalog.clock.now(),
                  "looks_sha256": catalog.put_looks(cloud.points, cloud.normals, seen, values)}  # fmt: skip
        catalog.add_flight(flight, path_round(structure))

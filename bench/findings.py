"""Findings against the truth: places and their stated errors, looks, counterparts, missions and queries.

    python bench/findings.py [--seed N] [--only places,flights,looks,carried,missions,queries]
                             [--meshes FOLDER] [--count N]

Structures are members of the sample kinds that are in no fleet, made anew for each seed, and real meshes
where a folder of them is named. Marks are painted on a mesh: a ray follows a pixel of a true pose.

* places: the pose is then told with an error, the pixel is read with one, and half of the structures are
  known as scans with noise. How often does the place lie within its stated 95 %?
* flights: the same for flights in wind with the faults of bench/proof.py, aligned with their plan, and with
  the noise of gimbal and mark that places have.
* looks: photos that show a place, by the poses as they are told, against rays from the true poses.
* carried: places that a photo can show, carried to another member of the kind, against the generator's
  truth; those hidden inside of other parts apart.
* missions: the ground sample distance of each place by rays through the corners of a pixel, and the clearance
  by the nearest of many points on the surface.
* queries: CPU of the questions over 10 000 findings on 200 structures, after their plans were made.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import trimesh
from proof_faults import FAULTS
from random_members import random_member
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation
from true_counterparts import true_counterparts

from upplied.catalog import Catalog, open_catalog
from upplied.catalog.verbs.looks import put_looks
from upplied.config import CloudSettings, digest
from upplied.errors import RefusedError, UppliedError
from upplied.findings.adding import add_marks, escaping, on_surface
from upplied.findings.carried import Carrying
from upplied.findings.looks import Spot, looks_at_spot, spot_of
from upplied.findings.marks import Mark
from upplied.findings.place import _WITHIN_3D, Errors, located
from upplied.findings.queries import by_reference, photographed
from upplied.findings.rays import pixels_of, rays_of
from upplied.findings.reshoot import plan_reshoot
from upplied.geometry.poses import interpolate, look_at, matrices
from upplied.geometry.scene import Scene, scene_of
from upplied.geometry.vectors import points_on_triangles
from upplied.planning.surface.samples import surface_samples
from upplied.proof.align import align
from upplied.records import Camera, Demonstration, Plan, Structure, SurfaceStates, Trajectory
from upplied.samples.pilot import fly
from upplied.simulate import Wind, fly_trajectory

_KINDS = {"airliner": "fuselage", "wind_turbine": "tower", "ship": "hull", "box": "sides", "bridge": "piers"}
_CAMERA = Camera(70.0, 55.0, 1.0, 60.0, 4000, 2973)
_ERRORS = Errors(pose_m=0.3, attitude_deg=0.4, pixel_px=1.0)
_NOISE_M = 0.02  # of scans, one sigma along the normal
_FREE = 0.02  # share of the directions before a place that lead outside, from which on a photo can show it
_STEP = 0.02  # of the structure's size: what counts as carried rightly


def main() -> None:
    """Print a line for each measure."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", default="places,flights,looks,carried,missions,queries")
    parser.add_argument("--meshes", type=Path, help="folder of real meshes, for places")
    parser.add_argument("--count", type=int, default=1000, help="marks")
    parser.add_argument(
        "--folder", type=Path, help="of the catalog of queries: made where it is empty, and kept"
    )
    options = parser.parse_args()
    measures = {
        "places": lambda: places(options.seed, options.count, options.meshes),
        "flights": lambda: flights(options.seed, options.count // 2),
        "looks": lambda: looks(options.seed),
        "carried": lambda: carried(options.seed),
        "missions": lambda: missions(options.seed),
        "queries": lambda: queries(options.seed, options.folder),
    }
    for name in options.only.split(","):
        began = time.process_time()
        measures[name]()
        print(f"{name}: {time.process_time() - began:.0f} s of CPU\n", flush=True)


def places(seed: int, count: int, meshes: Path | None) -> None:
    """How often a place lies within its stated 95 %, and how far off it is."""
    rng = np.random.default_rng(seed)
    grounds = [(f"{kind}, drawn", structure, structure) for kind, structure in _members(seed)]
    grounds += [
        (f"{kind}, scan", structure, _scan(structure, rng)) for kind, structure in _members(seed + 100)
    ]
    grounds += [(f"{path.stem}, real", structure, structure) for path, structure in _real(meshes)]
    every: list[tuple[float, float, float]] = []
    for name, truth, known in grounds:
        cases = list(_marked(name, truth, known, _path(truth), _ERRORS, count // len(grounds), rng))
        every += cases
        print(f"places {name:28}{_said(cases)}", flush=True)
    print(f"places {'all':28}{_said(every)}")


def _marked(
    name: str, truth: Structure, known: Structure, path: Trajectory, errors: Errors, count: int,
    rng: np.random.Generator,
) -> Iterator[tuple[float, float, float]]:  # fmt: skip
    """Off, stated error, and footprint of a pixel beside the pose's own error, m, of marks on a structure."""
    scene, seen = scene_of(truth), scene_of(known)
    errors = replace(errors, mesh_m=1.96 * _NOISE_M if known is not truth else 0.0)
    done = tried = 0
    while done < count and tried < 30 * count:
        tried += 1
        pose = interpolate(path, np.array([rng.uniform(0, path.t_s[-1])]))
        position, quat = pose.positions[0], pose.quat_xyzw[0]
        pixel = rng.uniform([0, 0], [_CAMERA.width_px, _CAMERA.height_px])
        ray = rays_of(_CAMERA, pixel) @ matrices(quat).T
        reach = scene.cast(position[None], ray[None])[0][0]
        if not np.isfinite(reach):
            continue
        logged = position + rng.normal(0, errors.pose_m / _WITHIN_3D, 3)
        wobble = Rotation.from_rotvec(rng.normal(0, np.radians(errors.attitude_deg), 3))
        turned = (Rotation.from_quat(quat) * wobble).as_quat()
        read = pixel + rng.normal(0, errors.pixel_px, 2)
        try:
            one = located(name, seen, _CAMERA, logged, turned, read[None], errors)
        except RefusedError:
            continue
        done += 1
        off = float(np.linalg.norm(one.place - (position + reach * ray)))
        own = float(np.linalg.norm(logged - position)) + errors.attitude_deg * np.pi / 180 * reach
        yield off, one.error_m, 1.5 * one.mm_px * 1e-3 + own


def flights(seed: int, count: int) -> None:
    """The same for flights with faults, aligned with their plans, which states their error."""
    rng = np.random.default_rng(seed)
    for fault, inject in FAULTS.items():
        rows_of_kind = []
        for kind, structure in _members(seed + 7):
            scene, plan = scene_of(structure), _path(structure)
            plan = plan.take(plan.t_s <= 180.0)
            try:
                case = inject(fly_trajectory(plan, wind=Wind(5.0, towards_deg=40.0 * seed), seed=seed))
                flown = align(plan, case.log)
            except UppliedError as error:
                print(f"flights {fault}, {kind}: {error}")
                continue
            errors = replace(_ERRORS, pose_m=max(flown.place_error_m, flown.residual_p95_m))
            for moment in rng.uniform(case.log_photo_s[0], case.log_photo_s[-1], count // 5 // len(FAULTS)):
                at = np.array([moment])
                true, logged = interpolate(case.truth, at - case.clock_s), interpolate(flown.flown, at)
                pixel = rng.uniform([0, 0], [_CAMERA.width_px, _CAMERA.height_px])
                ray = rays_of(_CAMERA, pixel) @ matrices(true.quat_xyzw[0]).T
                reach = scene.cast(true.positions, ray[None])[0][0]
                wobble = Rotation.from_rotvec(rng.normal(0, np.radians(errors.attitude_deg), 3))
                turned = (Rotation.from_quat(logged.quat_xyzw[0]) * wobble).as_quat()
                read = pixel + rng.normal(0, errors.pixel_px, 2)
                if not np.isfinite(reach):
                    continue
                try:
                    one = located(kind, scene, _CAMERA, logged.positions[0], turned, read[None], errors)
                except RefusedError:
                    continue
                off = float(np.linalg.norm(one.place - (true.positions[0] + reach * ray)))
                rows_of_kind.append((off, one.error_m, flown.place_error_m))
        print(f"flights {fault:28}{_said(rows_of_kind)}", flush=True)


def looks(seed: int) -> None:
    """Which photos show a place, by told poses and by true ones, against rays from the true poses."""
    rng = np.random.default_rng(seed)
    counts = {name: np.zeros(3) for name in ("exact poses", "told poses", "rays from told poses")}
    for kind, structure in _members(seed + 200):
        scene, path = scene_of(structure), _path(structure)
        times = np.arange(0.0, path.t_s[-1], 2.0)
        shots = interpolate(path, times)
        wobble = Rotation.from_rotvec(rng.normal(0, np.radians(_ERRORS.attitude_deg), (len(path), 3)))
        logged = replace(
            path,
            positions=path.positions + rng.normal(0, _ERRORS.pose_m / _WITHIN_3D, 3),
            quat_xyzw=(Rotation.from_quat(path.quat_xyzw) * wobble).as_quat(),
        )
        spots = _spots(structure, 40, rng)
        for name, flown in (("exact poses", path), ("told poses", logged)):
            catalog = _catalog([structure], [_flown(structure, flown)])
            rows = [{"photo_id": digest([kind, at]), "flight_id": "flight",
                     "target_id": structure.structure_id, "name": f"{at}", "path": "-", "sha256": digest(at),
                     "t_s": float(t)}
                    for at, t in enumerate(times)]  # fmt: skip
            catalog.add_flight_photos(rows)
            for spot in spots:
                listed = {int(look.row["photo"]) for look in looks_at_spot(catalog, spot)}
                truly = set(_rendered(scene, shots, spot))
                counts[name] += [len(listed & truly), len(listed), len(truly)]
                if flown is logged:  # as good as it gets where nobody knows the pose better
                    listed = set(_rendered(scene, interpolate(logged, times), spot))
                    counts["rays from told poses"] += [len(listed & truly), len(listed), len(truly)]
    for name, (both, listed, truly) in counts.items():
        print(f"looks {name:28}F1 {2 * both / max(listed + truly, 1):.4f}, {truly:.0f} looks")


def _rendered(scene: Scene, shots: Trajectory, spot: Spot) -> list[int]:
    """The photos in whose picture the first thing hit in the direction of a spot is the spot."""
    ray = spot.place - shots.positions
    away = np.linalg.norm(ray, axis=1)
    reach = scene.cast(shots.positions, ray / away[:, None])[0]
    facing = -(ray @ spot.normal) / away >= np.cos(np.radians(75.0))
    errors_m = []
    for at in np.flatnonzero(facing & (np.abs(reach - away) < 2e-3 * away) & (away <= _CAMERA.max_range_m)):
        pixel = pixels_of(_CAMERA, shots.positions[at], shots.quat_xyzw[at], spot.place[None])[0]
        if (pixel >= 0).all() and (pixel <= [_CAMERA.width_px, _CAMERA.height_px]).all():
            errors_m.append(int(at))
    return errors_m


def carried(seed: int) -> None:
    """Places on another member of the kind, against the generator's truth."""
    rng = np.random.default_rng(seed)
    rows = []
    for kind in _KINDS:
        for one, other in ((seed + 300, seed + 301), (seed + 302, seed + 303)):
            source, target = random_member(kind, one), random_member(kind, other)
            catalog = _catalog([source.structure, target.structure])
            for name, count in ((kind, 60), ("hidden", 20)):
                spots = _spots(source.structure, count, rng, hidden=name == "hidden")
                if not spots:
                    continue
                truth = true_counterparts(source, target, np.array([spot.place for spot in spots]))
                there = Carrying(catalog).to(spots, target.structure.structure_id)
                off = np.linalg.norm(there.place - truth, axis=1)
                lacks, none = np.isnan(truth[:, 0]), np.isnan(there.place[:, 0])
                wrong = np.where(lacks, ~none, none | (off > _STEP * target.structure.diagonal_m))
                both = ~lacks & ~none
                within = off[both] <= there.error_m[both]
                rows.append((name, wrong, there.doubtful, within, off[both] / target.structure.diagonal_m))
    for name in (*_KINDS, "all", "hidden"):
        own = [row for row in rows if row[0] == name or (name == "all" and row[0] != "hidden")]
        if not own:
            continue
        wrong, doubtful, within, off = (np.concatenate([row[at] for row in own]) for at in range(1, 5))
        print(
            f"carried {name:28}within 2 % {100 * (1 - wrong.mean()):.1f} %, "
            f"median {100 * np.median(off):.2f} %, within the stated error {100 * within.mean():.1f} %, "
            f"doubtful {100 * doubtful.mean():.1f} %, "
            f"wrong without a word {int((wrong & ~doubtful).sum())} of {len(wrong)}"
        )


def missions(seed: int) -> None:
    """Whether missions show each place as finely as asked, keep clear, and how long they are."""
    rng = np.random.default_rng(seed)
    fine, kept, ratios, asked, refused = [], [], [], 0, 0
    for kind, structure in _members(seed + 400):
        catalog = _catalog([structure], [_flown(structure, _path(structure))])
        path = catalog.demonstration("flight").trajectory
        moments = rng.uniform(0, path.t_s[-1], 30)
        corners = rng.uniform([400, 400], [3600, 2500], (30, 2))
        marks = [Mark(str(at), flight="flight", t_s=float(t), pixels=((float(x), float(y)),))
                 for at, (t, (x, y)) in enumerate(zip(moments, corners, strict=True))]  # fmt: skip
        add_marks(catalog, marks, "bench")
        rows = [{str(k): v for k, v in row.items()} for row in catalog.findings().to_dict("records")]
        for mm_px in (1.0, 2.0):
            asked += len(rows)
            try:
                plan_made = plan_reshoot(catalog, rows, structure.structure_id, mm_px)
            except RefusedError as error:
                print(f"missions {kind} at {mm_px} mm: {error}"[:200])
                refused += len(rows)
                continue
            refused += len(plan_made.refused)
            plan = catalog.plan(plan_made.transfer_id)
            assert plan.trajectory is not None and plan.is_viewpoint is not None
            shots = plan.trajectory.take(plan.is_viewpoint)
            for row in rows:
                if row["finding_id"] in plan_made.shown:
                    fine.append(_finest_mm(scene_of(structure), shots, spot_of(row)) <= mm_px)
            cloud = points_on_triangles(structure, 200_000, rng)[0]
            between = interpolate(plan.trajectory, np.arange(0, plan.trajectory.t_s[-1], 0.1)).positions
            kept.append(float(cKDTree(cloud).query(between)[0].min()))
            words = plan_made.words[0].split()
            flew, need = float(words[words.index("m") - 1]), float(words[-2])
            ratios.append(flew / need if need >= 5 else 1.0)
    line = (
        f"{asked} asked, {refused} refused with the reason, {100 * np.mean(fine):.1f} % of others as fine as"
    )
    tours = f"tours {np.mean(ratios):.2f} of the bound, most {max(ratios):.2f}"
    print(f"missions: {line} asked; least clearance {min(kept):.2f} m of 2; {tours}")


def _finest_mm(scene: Scene, shots: Trajectory, spot: Spot) -> float:
    """The longer side of what the pixel that shows a spot covers, mm, in the finest photo; by rays."""
    finest = np.inf
    for at in _rendered(scene, shots, spot):
        position, quat = shots.positions[at], shots.quat_xyzw[at]
        pixel = pixels_of(_CAMERA, position, quat, spot.place[None])[0]
        corners = pixel + 0.5 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
        rays = rays_of(_CAMERA, corners) @ matrices(quat).T
        away = ((spot.place - position) @ spot.normal) / (rays @ spot.normal)
        sides = np.linalg.norm(np.diff(position + away[:3, None] * rays[:3], axis=0), axis=1)
        finest = min(finest, 1e3 * float(sides.max()))
    return finest


def queries(seed: int, folder: Path | None, members: int = 200, each: int = 50) -> None:
    """CPU of questions over a large fleet: the first time, and once what is carried is remembered."""
    structures = [random_member("box", seed + 500 + at).structure for at in range(members)]
    catalog = open_catalog(folder or tempfile.mkdtemp(prefix="findings-"))
    if not (Path(catalog.root) / "catalog.json").exists():
        _fill(catalog, structures, each, seed)
    spots = _spots(structures[0], 2, np.random.default_rng(seed))
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
    catalog.add_demonstrations([_flown(first, _path(first))])
    rows, plans = [], []
    for structure in structures:
        for spot in _spots(structure, each, rng):
            x, y, z = spot.place.tolist()
            rows.append({
                "finding_id": digest([structure.structure_id, x, y, z])[:12],
                "target_id": structure.structure_id, "kind": "box", "state": "open",
                "class": rng.choice(["corrosion", "crack", "dent"]),
                "x_m": x, "y_m": y, "z_m": z, "normal_json": str(spot.normal.tolist()), "place_error_m": 0.1,
                "structure_sha256": structure.sha256,
            })  # fmt: skip
        path = _path(structure)
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
                  "looks_sha256": put_looks(catalog, cloud.points, cloud.normals, seen, values)}  # fmt: skip
        catalog.add_flight(flight, _path(structure))


def _members(seed: int) -> Iterator[tuple[str, Structure]]:
    for kind in _KINDS:
        yield kind, random_member(kind, seed).structure


def _real(folder: Path | None) -> Iterator[tuple[Path, Structure]]:
    for path in sorted(folder.rglob("*")) if folder is not None else ():
        if path.suffix.lower() in (".stl", ".ply", ".obj", ".glb"):
            mesh = trimesh.load(path, force="mesh")
            vertices = (
                np.array(mesh.vertices) * 40.0 / max(float(mesh.scale), 1e-9)
            )  # as large as an airliner
            yield path, Structure(path.stem, "real", vertices, np.array(mesh.faces), sha256=digest(path.name))


def _scan(structure: Structure, rng: np.random.Generator) -> Structure:
    """The structure with noise along its normals, and many more vertices: as a scanner has it."""
    points, triangle = points_on_triangles(structure, 60_000, rng)
    corners = structure.vertices[structure.triangles[triangle]]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    points = points + rng.normal(0, _NOISE_M, (len(points), 1)) * normals
    none = np.empty((0, 3), np.int64)
    return replace(
        structure, vertices=points, triangles=none, normals=normals, sha256=digest(structure.sha256)
    )


def _path(structure: Structure) -> Trajectory:
    """An inspection of the structure by a simulated pilot; round what has none, a ring."""
    if structure.kind in _KINDS:
        return fly(structure, _KINDS[structure.kind], seed=1).trajectory
    low, high = structure.vertices.min(axis=0), structure.vertices.max(axis=0)
    angle, middle = np.linspace(0, 2 * np.pi, 400), (low + high) / 2
    radius = np.linalg.norm((high - low)[:2]) / 2 + 0.1 * structure.diagonal_m + 3
    ring = middle + radius * np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])
    ring[:, 2] += 0.3 * (high - low)[2] * np.sin(5 * angle) + 0.2 * radius
    return Trajectory(np.arange(400.0), ring, look_at(ring, np.broadcast_to(middle, ring.shape)))


def _flown(structure: Structure, path: Trajectory) -> Demonstration:
    t_ns = 1_770_000_000_000_000_000 + np.round(path.t_s * 1e9).astype(np.int64)
    return Demonstration("flight", structure.structure_id, t_ns, path.positions, path.quat_xyzw, _CAMERA,
                         sha256=digest(structure.structure_id))  # fmt: skip


def _catalog(structures: list[Structure], flown: list[Demonstration] | None = None) -> Catalog:
    catalog = open_catalog(tempfile.mkdtemp(prefix="findings-"))
    catalog.add_structures(structures)
    catalog.add_demonstrations(flown or [])
    return catalog


def _spots(structure: Structure, count: int, rng: np.random.Generator, hidden: bool = False) -> list[Spot]:
    """Places spread over what a photo can show of a structure; or over what lies inside of other parts."""
    points = points_on_triangles(structure, 4 * count, rng)[0]
    places, normals = on_surface(scene_of(structure), points)
    free = escaping(scene_of(structure), places, normals, structure.diagonal_m) > _FREE
    chosen = rng.permutation(np.flatnonzero(free != hidden))[:count]  # points come by triangles, in order
    return [Spot(structure.structure_id, places[at], normals[at], places[at][None]) for at in chosen]


def _said(found: list[tuple[float, float, float]]) -> str:
    if not found:
        return "none"
    off, stated, own = np.array(found, float).T
    return (f"{len(off):5} marks, within the stated error {100 * (off <= stated).mean():5.1f} %, median off "
            f"{100 * np.median(off):5.1f} cm, stated {100 * np.median(stated):5.1f} cm, "
            f"1.5 px and the pose's own {100 * np.median(own):5.1f} cm")  # fmt: skip


if __name__ == "__main__":
    main()

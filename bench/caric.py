"""The score of the CARIC challenge on its building and its cranes, of plans that carry one flight there.

    python bench/caric.py [--every S]

The scenes are others' and lie in `peers/caric` of the folder that `UPPLIED_REAL_DATA` names; without them
nothing is scored. A flight round a sample with the challenge's camera is planned on each scene by every
preset, whatever the gate and the verdict say, and takes a picture every 0.1 s, or as `--every` says.
`points` is the score (`planning.measures.picture_score`): the sum over the interest points of line of sight
times blur times resolution in the best picture of each. `of` is how many points lie on the mesh, `seen` how
many are worth anything. The challenge's own totals are of several vehicles in scenes that are not published:
the figures compare ways on one scene, nothing else.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from real_data import real_folder

from upplied.config import focal_px, settings_for
from upplied.geometry.poses import interpolate
from upplied.geometry.scene import Scene, scene_of
from upplied.inputs.manifests import StructureEntry
from upplied.inputs.meshes import read_structure
from upplied.overlap import Frames
from upplied.planning.measures.picture_score import picture_worth
from upplied.planning.plan import plan_transfer
from upplied.planning.visibility.observations import Moments, rates
from upplied.records import Camera, Cloud, Floats, Structure, Surroundings, Trajectory
from upplied.samples.fleet import member
from upplied.samples.pilot import fly

# Mesh, interest points, millimetres a pixel that are enough, and the flight that is carried there.
SCENES = (
    ("mbs", "mbs", 2.0, "cube-v1", "sides"),
    ("construction_crane_1", "crane", 1.5, "turbine-1-v1", "tower"),
    ("construction_crane_2", "crane", 1.5, "turbine-1-v1", "tower"),
)
NEAR_M = 0.1  # of a mesh, within which an interest point is its own
# As the challenge describes it: 16 mm, pixels of 4.35 micrometres, 1 ms; no limit of range is published.
CAMERA = Camera(80.0, 60.0, 0.0, 1e3, width_px=6173, exposure_s=1e-3)


def main() -> None:
    """Print a row for each scene and preset."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--every", type=float, default=0.1, help="seconds between pictures")
    options = parser.parse_args()
    folder = real_folder()
    if folder is None or not (folder / "peers" / "caric").is_dir():
        print("no scenes: UPPLIED_REAL_DATA names no folder with peers/caric")
        return
    camera = Camera(CAMERA.hfov_deg, CAMERA.vfov_deg, width_px=1920, exposure_s=CAMERA.exposure_s)
    print(f"{'scene':22}{'preset':>13}{'points':>8}{'of':>6}{'seen':>6}{'s':>7}{'m':>7}{'clear m':>8}")
    for mesh, points, enough_mm, source, inspection in SCENES:
        target = scene_structure(folder / "peers" / "caric" / f"{mesh}.stl")
        cloud = interest_points(folder / "peers" / "caric" / f"{points}_interest_points.pcd", target)
        flown = member(source).structure
        flight = fly(flown, inspection, camera=camera)
        for preset in ("recommended", "paper", "baseline"):
            rules = {"enforce": False, "most_size_ratio": 100.0}
            settings = settings_for(preset, verdict=rules, registration={"least_probability": 0.0})
            plan = plan_transfer(flight, flown, target, settings)
            title = f"{mesh:22}{preset:>13}"
            if plan.trajectory is None:
                print(f"{title}  refused: {plan.reason[:90]}", flush=True)
                continue
            path = plan.trajectory
            taken = interpolate(path, np.arange(path.t_s[0], path.t_s[-1], options.every))
            worth = score(taken, cloud, scene_of(target), enough_mm)
            figures = f"{worth.sum():8.0f}{len(cloud):6d}{(worth > 0).sum():6d}{path.t_s[-1]:7.0f}"
            figures += f"{plan.measures.path_length_m:7.0f}{plan.measures.min_clearance_m:8.1f}"
            print(f"{title}{figures}", flush=True)


def score(taken: Trajectory, cloud: Cloud, scene: Scene, enough_mm: float, camera: Camera = CAMERA) -> Floats:
    """The worth of each interest point (N,), of pictures taken at some poses."""
    frames = Frames(taken, camera, scene)
    seen = np.array([frames.shows(at, cloud.points) for at in range(len(taken))])
    pixel = np.full(len(taken), 1 / focal_px(camera.width_px, camera.hfov_deg))
    steps = Moments(taken, np.ones(len(taken)), *rates(taken))
    return picture_worth(steps, seen, cloud, np.full(len(cloud), 1e-3 * enough_mm), pixel, camera.exposure_s)


def scene_structure(path: Path) -> Structure:
    """A mesh of the challenge: metres, Z up, the ground at 0."""
    return read_structure(
        StructureEntry(path.stem, "building", path, unit_m=1.0, surroundings=Surroundings(ground_z_m=0.0))
    )


def interest_points(path: Path, structure: Structure) -> Cloud:
    """Those points (N, 3) of a binary PCD file, with their normals, that lie on a structure."""
    raw = path.read_bytes()
    begin = raw.index(b"\n", raw.index(b"DATA binary")) + 1
    lines = raw[:begin].decode().splitlines()
    head = {name: rest for name, *rest in (line.split() for line in lines if line and line[0] != "#")}
    columns = zip(*(head[name] for name in ("FIELDS", "TYPE", "SIZE", "COUNT")), strict=True)
    layout = np.dtype([(name, f"<{sort.lower()}{size}", int(count)) for name, sort, size, count in columns])
    rows = np.frombuffer(raw[begin:], layout, int(head["POINTS"][0]))
    points, normals = (
        _stacked(rows, names) for names in (("x", "y", "z"), ("normal_x", "normal_y", "normal_z"))
    )
    own = scene_of(structure).distance(points) <= NEAR_M
    return Cloud(points[own], normals[own])


def _stacked(rows: np.ndarray, names: list[str]) -> Floats:
    return np.column_stack([rows[name].reshape(len(rows)).astype(float) for name in names])


if __name__ == "__main__":
    main()

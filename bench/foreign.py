"""Plans of another planner as demonstrations: what they show, and what a plan of ours for the same shows.

    python bench/foreign.py [--only WORD] [--times SHARE ...] [--speed M_PER_S] [--acceleration M_PER_S2]

The clouds and the planned trajectories that are published with FC-Planner lie in `peers/fc_planner` of the
folder that `UPPLIED_REAL_DATA` names; without them nothing is measured. The first row of a structure is their
trajectory by our judge, with the camera of their launch files (75 x 55 degrees, 640 x 480 pixels): `seen`, of
the outer surface by area what is in view, in range, not occluded and not too oblique; `shown`, of what the
flight was about (`coverage_inspected_pct`); `mm` a pixel and `score` (`picture_score`). The other rows are
our plans for the same structure, as if theirs had been flown in these shares of its time, within their limits
of speed, acceleration and pitch, and sharp to a pixel of their camera. Passes are counted that were added;
none should be.
"""

from __future__ import annotations

import argparse
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
from real_data import real_folder

from upplied.config import Settings, settings_for
from upplied.geometry.poses import from_yaw_pitch
from upplied.geometry.scene import open3d, scene_of
from upplied.inputs.manifests import StructureEntry
from upplied.inputs.meshes import normalise
from upplied.inputs.raw import RawMesh
from upplied.planning.correspondence.memo import no_memo
from upplied.planning.measures.evaluate import judge
from upplied.planning.plan import decided, plan_transfer
from upplied.planning.visibility.observations import TRULY, views
from upplied.records import Camera, Cloud, Demonstration, Measures, Structure, Trajectory

# Cloud, trajectory, and the range of the camera in their launch file, m.
SCENES = (("christmore", "Christ", 8.0), ("MBSmore", "MBS", 11.0), ("pipe", "Pipe", 11.0))
CAMERA = Camera(75.0, 55.0, width_px=640, height_px=480)
_THINNED_M = 0.3  # of clouds, whose points lie 0.08 to 0.5 m apart


def main() -> None:
    """Print their row and ours for each structure."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--only", default="")
    parser.add_argument("--times", type=float, nargs="*", default=[1.0, 0.8, 0.6])
    parser.add_argument("--speed", type=float, default=2.0, help="most, m/s; theirs is 2")
    parser.add_argument("--acceleration", type=float, default=1.0, help="most, m/s2; theirs is 1")
    options = parser.parse_args()
    folder = real_folder()
    if folder is None or not (folder / "peers" / "fc_planner").is_dir():
        print("no plans: UPPLIED_REAL_DATA names no folder with peers/fc_planner")
        return
    limits = {
        "max_speed_mps": options.speed,
        "max_acceleration_mps2": options.acceleration,
        "max_gimbal_pitch_deg": 90.0,  # theirs looks up by 70
    }
    theirs = {"retime": limits, "inspection": {"width_px": CAMERA.width_px}}
    settings = settings_for("recommended", verdict={"enforce": False}, **theirs)
    names = ("seen %", "shown %", "mm 50", "mm 95", "fine %", "score", "blur", "s", "m", "clear m", "passes")
    print(f"{'structure':12}{'plan':>12}" + "".join(f"{name:>9}" for name in names))
    for cloud, name, range_m in SCENES:
        if options.only.lower() in name.lower():
            structure = foreign_structure(folder / "peers" / "fc_planner" / f"{cloud}.pcd")
            path = folder / "peers" / "fc_planner" / f"TrajInfo{name}.txt"
            _print_rows(structure, foreign_flight(path, structure, range_m), settings, options.times)


def foreign_structure(path: Path) -> Structure:
    """A cloud of theirs, thinned evenly, with normals outwards."""
    points = open3d().io.read_point_cloud(str(path)).voxel_down_sample(_THINNED_M)
    raw = RawMesh(np.asarray(points.points))
    return normalise(StructureEntry(path.stem, "building", path, unit_m=1.0), raw, path.stem)[0]


def foreign_flight(path: Path, structure: Structure, range_m: float) -> Demonstration:
    """Their trajectory: seconds, metres, and radians with the pitch upwards."""
    rows = [re.findall(r"(?<=: )-?[\d.]+", line) for line in path.read_text().splitlines()]
    t_s, *places, pitch, yaw = np.array(rows, float).T
    return Demonstration(
        demonstration_id=f"{path.stem}-v1",
        structure_id=structure.structure_id,
        t_ns=np.round(1e9 * t_s).astype(np.int64),
        positions=np.column_stack(places),
        quat_xyzw=from_yaw_pitch(yaw, pitch),
        camera=replace(CAMERA, max_range_m=range_m),
        sha256=path.stem,
    )


def _print_rows(structure: Structure, flight: Demonstration, settings: Settings, shares: list[float]) -> None:
    takes = decided(flight, structure, structure, settings, no_memo)[1]
    surface = takes[0].pair.surface.source
    theirs = judge(flight.trajectory, None, takes, settings)[0]
    _print_row(structure, "theirs", flight.trajectory, surface, flight.camera, theirs, 0)
    for share in shares:
        times = (flight.t_ns * share).astype(np.int64)
        sooner = replace(flight, t_ns=times, sha256=f"{flight.sha256} {share}")
        plan = plan_transfer(sooner, structure, structure, settings)
        if plan.trajectory is None:
            print(f"{structure.structure_id:12}{share:12g}  refused: {plan.reason[:80]}", flush=True)
            continue
        added = np.zeros(1, bool) if plan.added is None else plan.added
        passes = int((np.diff(added.astype(int), prepend=0) > 0).sum())
        named = f"ours x {share:g}"
        _print_row(structure, named, plan.trajectory, surface, flight.camera, plan.measures, passes)


def _print_row(
    structure: Structure,
    name: str,
    path: Trajectory,
    surface: Cloud,
    camera: Camera,
    measures: Measures,
    passes: int,
) -> None:
    seen = views(path, surface, camera, TRULY, scene_of(structure)).total
    share = 100 * surface.areas[seen].sum() / surface.areas.sum()
    figures = (
        share,
        measures.coverage_inspected_pct,
        measures.gsd_mm_p50,
        measures.gsd_mm_p95,
        measures.gsd_within_pct,
        measures.picture_score,
        measures.blur_px_p99,
        measures.duration_s,
        measures.path_length_m,
        measures.min_clearance_m,
        passes,
    )
    print(f"{structure.structure_id:12}{name:>12}" + "".join(f"{each:9.2f}" for each in figures), flush=True)


if __name__ == "__main__":
    main()

"""Findings against the truth: places and their stated errors, looks, counterparts, missions and queries.

    python bench/findings.py [--seed N] [--only places,flights,looks,carried,missions,queries]
                             [--real N] [--count N]

Structures are members of the sample kinds that are in no fleet, made anew for each seed, and N real meshes
(`real_data.py`), each as drawn and as a scan with noise. Marks are painted on a mesh: a ray follows a pixel
of a true pose.

* places: the pose is then told with an error, the pixel is read with one, and half of the structures are
  known as scans with noise. How often does the place lie within its stated 95 %?
* flights: the same for flights in wind with the faults of bench/proof.py, aligned with their plan, and with
  the noise of gimbal and mark that places have.
* looks: photos that show a place, by the poses as they are told, against rays from the true poses: how many
  of the certain ones do, how many of those that do are not listed, and how many are doubtful.
* carried: places that a photo can show, carried to another member of the kind, against the generator's
  truth; those hidden inside of other parts apart; and of real meshes to themselves, stretched unevenly.
* missions: the ground sample distance of each place by rays through the corners of a pixel, and the clearance
  by the nearest of many points on the surface.
* queries: CPU of the questions over 10 000 findings on 200 structures, after their plans were made.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from findings_cases import CAMERA, ERRORS, NOISE_M, grounds, members_of, path_round
from findings_fleet import carried, missions, queries
from findings_looks import looks
from proof_faults import FAULTS
from scipy.spatial.transform import Rotation

from upplied.errors import RefusedError, UppliedError
from upplied.findings.place import _WITHIN_3D, Errors, located
from upplied.findings.rays import rays_of
from upplied.geometry.poses import interpolate, matrices
from upplied.geometry.scene import scene_of
from upplied.proof.align import align
from upplied.records import Structure, Trajectory
from upplied.simulate import Wind, fly_trajectory


def main() -> None:
    """Print a line for each measure."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", default="places,flights,looks,carried,missions,queries")
    parser.add_argument("--real", type=int, default=6, help="real meshes, of the folder UPPLIED_REAL_DATA")
    parser.add_argument("--count", type=int, default=1000, help="marks")
    parser.add_argument(
        "--folder", type=Path, help="of the catalog of queries: made where it is empty, and kept"
    )
    options = parser.parse_args()
    measures = {
        "places": lambda: places(options.seed, options.count, options.real),
        "flights": lambda: flights(options.seed, options.count // 2),
        "looks": lambda: looks(options.seed, options.real),
        "carried": lambda: carried(options.seed, options.real),
        "missions": lambda: missions(options.seed),
        "queries": lambda: queries(options.seed, options.folder),
    }
    for name in options.only.split(","):
        began = time.process_time()
        measures[name]()
        print(f"{name}: {time.process_time() - began:.0f} s of CPU\n", flush=True)


def places(seed: int, count: int, real: int) -> None:
    """How often a place lies within its stated 95 %, and how far off it is."""
    rng = np.random.default_rng(seed)
    cases_of = list(grounds(seed, real))
    every: list[tuple[float, float, float]] = []
    for name, truth, known in cases_of:
        cases = list(_marked(name, truth, known, path_round(truth), ERRORS, count // len(cases_of), rng))
        every += cases
        print(f"places {name:28}{_words(cases)}", flush=True)
    print(f"places {'all':28}{_words(every)}")


def _marked(
    name: str, truth: Structure, known: Structure, path: Trajectory, errors: Errors, count: int,
    rng: np.random.Generator,
) -> Iterator[tuple[float, float, float]]:  # fmt: skip
    """Off, stated error, and footprint of a pixel beside the pose's own error, m, of marks on a structure."""
    scene, seen = scene_of(truth), scene_of(known)
    errors = replace(errors, mesh_m=1.96 * NOISE_M if known is not truth else 0.0)
    number = tried = 0
    while number < count and tried < 30 * count:
        tried += 1
        pose = interpolate(path, np.array([rng.uniform(0, path.t_s[-1])]))
        position, quat = pose.positions[0], pose.quat_xyzw[0]
        pixel = rng.uniform([0, 0], [CAMERA.width_px, CAMERA.height_px])
        ray = rays_of(CAMERA, pixel) @ matrices(quat).T
        reach = scene.cast(position[None], ray[None])[0][0]
        if not np.isfinite(reach):
            continue
        logged = position + rng.normal(0, errors.pose_m / _WITHIN_3D, 3)
        wobble = Rotation.from_rotvec(rng.normal(0, np.radians(errors.attitude_deg), 3))
        turned = (Rotation.from_quat(quat) * wobble).as_quat()
        read = pixel + rng.normal(0, errors.pixel_px, 2)
        try:
            one = located(name, seen, CAMERA, logged, turned, read[None], errors)
        except RefusedError:
            continue
        number += 1
        off = float(np.linalg.norm(one.place - (position + reach * ray)))
        own = float(np.linalg.norm(logged - position)) + errors.attitude_deg * np.pi / 180 * reach
        yield off, one.error_m, 1.5 * one.mm_px * 1e-3 + own


def flights(seed: int, count: int) -> None:
    """The same for flights with faults, aligned with their plans, which states their error."""
    rng = np.random.default_rng(seed)
    for fault, inject in FAULTS.items():
        rows_of_kind = []
        for kind, structure in members_of(seed + 7):
            scene, plan = scene_of(structure), path_round(structure)
            plan = plan.take(plan.t_s <= 180.0)
            try:
                case = inject(fly_trajectory(plan, wind=Wind(5.0, towards_deg=40.0 * seed), seed=seed))
                flown = align(plan, case.log)
            except UppliedError as error:
                print(f"flights {fault}, {kind}: {error}")
                continue
            errors = replace(ERRORS, pose_m=max(flown.place_error_m, flown.residual_p95_m))
            for moment in rng.uniform(case.log_photo_s[0], case.log_photo_s[-1], count // 5 // len(FAULTS)):
                at = np.array([moment])
                true, logged = interpolate(case.truth, at - case.clock_s), interpolate(flown.flown, at)
                pixel = rng.uniform([0, 0], [CAMERA.width_px, CAMERA.height_px])
                ray = rays_of(CAMERA, pixel) @ matrices(true.quat_xyzw[0]).T
                reach = scene.cast(true.positions, ray[None])[0][0]
                wobble = Rotation.from_rotvec(rng.normal(0, np.radians(errors.attitude_deg), 3))
                turned = (Rotation.from_quat(logged.quat_xyzw[0]) * wobble).as_quat()
                read = pixel + rng.normal(0, errors.pixel_px, 2)
                if not np.isfinite(reach):
                    continue
                try:
                    one = located(kind, scene, CAMERA, logged.positions[0], turned, read[None], errors)
                except RefusedError:
                    continue
                off = float(np.linalg.norm(one.place - (true.positions[0] + reach * ray)))
                rows_of_kind.append((off, one.error_m, flown.place_error_m))
        print(f"flights {fault:28}{_words(rows_of_kind)}", flush=True)


def _words(rows: list[tuple[float, float, float]]) -> str:
    if not rows:
        return "none"
    off, stated, own = np.array(rows, float).T
    return (f"{len(off):5} marks, within the stated error {100 * (off <= stated).mean():5.1f} %, median off "
            f"{100 * np.median(off):5.1f} cm, stated {100 * np.median(stated):5.1f} cm, "
            f"1.5 px and the pose's own {100 * np.median(own):5.1f} cm")  # fmt: skip


if __name__ == "__main__":
    main()

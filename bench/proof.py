"""Flights with injected faults against the truth: alignment, gaps, and the flights that close them.

    python bench/proof.py [--seeds N] [--only WORDS] [--wind M_PER_S]

Paths round the sample fleet are flown in simulated wind as if they were plans, with a photo every second
meanwhile, and one fault each. Some faults are of the flight (it is broken off, photos are lost, the gimbal
sticks): what was seen is really less. The others are of the log alone (a jump of the position, a turned
camera, a part that is cut, another clock): the flight is as planned, and the log says otherwise. The gap that
is found from the log is compared with that of the true flight by a ray test that shares no code with the one
that is tested: its own frustum, its own intersection of rays and triangles, in double precision.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass, replace

import numpy as np
from numba import njit

from upplied.config import CloudSettings, RetimeSettings, settings_for
from upplied.errors import RefusedError
from upplied.planning.airspace.roadmap import roadmap
from upplied.planning.airspace.rules import Airspace
from upplied.planning.surface.samples import surface_samples
from upplied.poses import from_yaw_pitch, interpolate, yaw_pitch
from upplied.proof.align import Alignment, align
from upplied.proof.as_flown import looks_of
from upplied.proof.gap import GapFlight, gap_flight
from upplied.records import Bools, Camera, Cloud, Floats, Structure, Trajectory
from upplied.samples.fleet import sample_demonstrations, sample_structures
from upplied.scene import scene_of
from upplied.simulate import Wind, fly_trajectory

_SAMPLES = 1200
_PHOTO_EVERY_S = 1.0
_LONGEST_S = 240.0  # of a path that is taken as a plan
_INCIDENCE_DEG = 75.0
_SLACK = 1e-3  # of a ray, at the sample, which lies on the surface itself


@dataclass(frozen=True)
class Case:
    """What was flown, and what the log says of it; the clocks of both begin with the plan."""

    truth: Trajectory
    photo_s: Floats
    log: Trajectory
    log_photo_s: Floats
    clock_s: float = 0.0  # the log's time at which the plan begins


def plain(truth: Trajectory) -> Case:
    """A flight without any fault."""
    photos = np.arange(truth.t_s[0], truth.t_s[-1], _PHOTO_EVERY_S)
    return Case(truth, photos, truth, photos)


def part(path: Trajectory, first_s: float, last_s: float) -> Trajectory:
    """A stretch of a path, with its times."""
    kept = (path.t_s >= first_s) & (path.t_s <= last_s)
    return Trajectory(path.t_s[kept], path.positions[kept], path.quat_xyzw[kept])


def aborted(truth: Trajectory) -> Case:
    """Broken off at 60 % of its time."""
    return plain(part(truth, 0.0, 0.6 * truth.t_s[-1]))


def photos_lost(truth: Trajectory) -> Case:
    """Every tenth photo lost."""
    case = plain(truth)
    kept = np.arange(len(case.photo_s)) % 10 != 9
    return replace(case, photo_s=case.photo_s[kept], log_photo_s=case.log_photo_s[kept])


def gimbal_stuck(truth: Trajectory) -> Case:
    """The camera stands for 20 s, which the log tells."""
    start = 0.4 * truth.t_s[-1]
    stuck = (truth.t_s >= start) & (truth.t_s < start + 20.0)
    quats = truth.quat_xyzw.copy()
    quats[stuck] = quats[stuck.argmax()]
    return plain(Trajectory(truth.t_s, truth.positions, quats))


def gnss_jump(truth: Trajectory) -> Case:
    """The logged position is 1 m off after half of the flight."""
    off = np.where(truth.t_s > truth.t_s[-1] / 2, 1.0, 0.0)[:, None] * np.array([0.6, -0.8, 0.0])
    case = plain(truth)
    return replace(case, log=Trajectory(truth.t_s, truth.positions + off, truth.quat_xyzw))


def heading_off(truth: Trajectory) -> Case:
    """The logged heading of the camera is 2 degrees off."""
    yaw, pitch = yaw_pitch(truth.quat_xyzw)
    case = plain(truth)
    return replace(
        case, log=Trajectory(truth.t_s, truth.positions, from_yaw_pitch(yaw + np.radians(2), pitch))
    )


def frame_off(truth: Trajectory) -> Case:
    """The log's frame is moved by half a metre and turned by 1 degree about its middle."""
    cos, sin, middle = np.cos(np.radians(1)), np.sin(np.radians(1)), truth.positions.mean(axis=0)
    turn = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    positions = (truth.positions - middle) @ turn.T + middle + np.array([0.4, 0.3, 0.0])
    yaw, pitch = yaw_pitch(truth.quat_xyzw)
    case = plain(truth)
    return replace(case, log=Trajectory(truth.t_s, positions, from_yaw_pitch(yaw + np.radians(1), pitch)))


def log_cut(truth: Trajectory) -> Case:
    """The log lacks the last fifth: what was seen then nobody can know, so it is no gap of the truth's."""
    end = 0.8 * truth.t_s[-1]
    case = plain(part(truth, 0.0, end))
    return replace(case, log_photo_s=case.log_photo_s[case.log_photo_s <= end])


def clock_shifted(truth: Trajectory) -> Case:
    """The log's clock is 3 s late."""
    case = plain(truth)
    log = Trajectory(truth.t_s + 3.0, truth.positions, truth.quat_xyzw)
    return replace(case, log=log, log_photo_s=case.log_photo_s + 3.0, clock_s=3.0)


FAULTS = {
    "none": plain,
    "aborted at 60 %": aborted,
    "every tenth photo lost": photos_lost,
    "gimbal stuck for 20 s": gimbal_stuck,
    "position off by 1 m after half": gnss_jump,
    "heading off by 2 deg": heading_off,
    "frame off by 0.5 m and 1 deg": frame_off,
    "log cut at 80 %": log_cut,
    "clock shifted by 3 s": clock_shifted,
}


#: Those of a list that the program is held to; the others are told beside them.
ASKED = (
    "aborted at 60 %", "every tenth photo lost", "gimbal stuck for 20 s", "position off by 1 m after half",
    "heading off by 2 deg", "log cut at 80 %", "clock shifted by 3 s",
)  # fmt: skip


def main() -> None:
    """Print one line a fault, over all flights, and those that went wrong."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--seeds", type=int, default=2, help="flights of each path and fault")
    parser.add_argument("--wind", type=float, default=5.0, help="mean wind, m/s")
    parser.add_argument("--only", default="", help="paths whose name contains this")
    parser.add_argument("--worst", action="store_true", help="print every flight")
    options = parser.parse_args()
    found: dict[str, list[Found]] = {name: [] for name in FAULTS}
    began = time.process_time()
    for demonstration in sample_demonstrations():
        if options.only not in demonstration.demonstration_id:
            continue
        (structure,) = [s for s in sample_structures() if s.structure_id == demonstration.structure_id]
        path = _as_plan(demonstration.trajectory)
        ground = Ground.of(structure, path, demonstration.camera)
        for seed in range(options.seeds):
            wind = Wind(options.wind, towards_deg=360.0 * seed / max(options.seeds, 1) + 20)
            truth = fly_trajectory(path, wind=wind, seed=seed)
            for name, inject in FAULTS.items():
                one = ground.judged(inject(truth))
                found[name].append(one)
                if options.worst:
                    print(f"{demonstration.demonstration_id:24}{name:32}{one}", flush=True)
    print(f"{'fault':32}{'flights':>8}{'gap %':>8}{'F1 area':>9}{'mean':>9}{'least':>8}{'closed %':>10}"
          f"{'length':>8}{'place cm':>10}{'most':>7}{'clock s':>9}{'most':>7}")  # fmt: skip
    for name, rows in found.items():
        print(f"{name:32}{_summary(rows)}")
    every = [row for rows in found.values() for row in rows]
    asked = [row for name in ASKED for row in found[name]]
    print(f"gap area of all flights: F1 {_pooled(every):.4f}; of those asked for {_pooled(asked):.4f}")
    lengths = np.array([row.length for row in every if np.isfinite(row.length)])
    print(
        f"closing flights: {lengths.mean():.2f} times the bound, {(lengths <= 1.3).mean():.0%} at most 1.3, "
        f"most {lengths.max():.2f}"
    )
    print(f"{sum(map(len, found.values()))} flights, {time.process_time() - began:.0f} s of CPU")


@dataclass(frozen=True)
class Found:
    """What came of one flight."""

    gap_pct: float  # of what the plan shows
    f1: float  # of the gap that is found against the true one; NaN where both are empty
    closed_pct: float  # of the attainable gap, by the flight that is to close it; NaN where there is none
    length: float  # of that flight over the bound; NaN where there is no bound
    place_cm: float  # error of the alignment, root of the mean square along the flight
    clock_s: float
    patches: tuple[int, int, int]  # of the gap: found and true, found, true

    def __str__(self) -> str:
        gap = f"gap {self.gap_pct:6.2f} %  F1 {self.f1:6.4f}"
        closing = f"closed {self.closed_pct:6.2f} %  length {self.length:5.2f}"
        return f"{gap}  {closing}  place {self.place_cm:5.1f} cm  clock {self.clock_s:6.3f} s"


@dataclass(frozen=True)
class Ground:
    """A structure, its plan, and what both are judged by."""

    plan: Trajectory
    structure: Structure
    surface: Cloud
    camera: Camera
    required: Bools

    @classmethod
    def of(cls, structure: Structure, path: Trajectory, camera: Camera) -> Ground:
        """What the plan shows, by the independent test, is required."""
        scene = scene_of(structure)
        surface = surface_samples(structure, scene, CloudSettings(surface_samples=_SAMPLES))
        camera = replace(camera, max_range_m=min(camera.max_range_m, 30.0))
        photos = np.arange(0.0, path.t_s[-1], _PHOTO_EVERY_S)
        required = truly_seen(structure, interpolate(path, photos), surface, camera)
        return cls(path, structure, surface, camera, required)

    def judged(self, case: Case) -> Found:
        """Align the log, find the gap, plan the flight that closes it, and compare all with the truth."""
        scene = scene_of(self.structure)
        start = case.log.t_s[0]
        log = Trajectory(case.log.t_s - start, case.log.positions, case.log.quat_xyzw)
        found = align(self.plan, log)
        seen = looks_of(found.flown, self.surface, self.camera, scene, case.log_photo_s - start).seen
        gap = self.required & ~seen
        photos = interpolate(case.truth, case.photo_s)
        true_gap = self.required & ~truly_seen(self.structure, photos, self.surface, self.camera)
        closing = self.closing(gap)
        closed = length = float("nan")
        if closing is not None:
            shown = truly_seen(self.structure, closing.trajectory, self.surface, self.camera)
            attainable = gap & ~closing.unattainable
            closed = 100 * float(shown[attainable].mean()) if attainable.any() else float("nan")
            length = closing.length_m / closing.bound_m if closing.bound_m > 1.0 else float("nan")
        return Found(
            100 * float(true_gap.sum() / max(self.required.sum(), 1)),
            _f1(gap, true_gap),
            closed,
            length,
            *_alignment_error(found, case),
            (int((gap & true_gap).sum()), int(gap.sum()), int(true_gap.sum())),
        )

    def closing(self, gap: Bools) -> GapFlight | None:
        """The flight that shows the gap; None where there is none."""
        airspace = Airspace(scene_of(self.structure), 1.5, self.structure.surroundings)
        try:
            graph = roadmap(airspace, self.surface, self.plan.positions[:: max(1, len(self.plan) // 300)])
            limits: RetimeSettings = settings_for("recommended").retime
            return gap_flight(self.plan, self.surface, gap, self.camera, graph, limits)
        except RefusedError:
            return None


def truly_seen(structure: Structure, poses: Trajectory, surface: Cloud, camera: Camera) -> Bools:
    """Which samples (N,) some pose sees: angles in the camera, range, incidence, and a ray to the sample.

    Rays are intersected with every triangle (Moeller and Trumbore 1997), in double precision; independent of
    `upplied.planning.visibility` and of Open3D.
    """
    assert surface.normals is not None
    corners = structure.vertices[structure.triangles]
    seen = np.zeros(len(surface), bool)
    yaw, pitch = yaw_pitch(poses.quat_xyzw)
    ahead = np.column_stack([np.cos(pitch) * np.cos(yaw), np.cos(pitch) * np.sin(yaw), np.sin(pitch)])
    left = np.column_stack([-np.sin(yaw), np.cos(yaw), np.zeros(len(yaw))])
    up = np.cross(ahead, left)
    for at in range(len(poses)):
        ray = surface.points - poses.positions[at]
        reach = np.linalg.norm(ray, axis=1)
        forward, across, above = ray @ ahead[at], ray @ left[at], ray @ up[at]
        inside = (forward > 0) & (reach >= camera.min_range_m) & (reach <= camera.max_range_m)
        inside &= np.abs(np.arctan2(across, forward)) <= np.radians(camera.hfov_deg / 2)
        inside &= np.abs(np.arctan2(above, forward)) <= np.radians(camera.vfov_deg / 2)
        inside &= -(ray * surface.normals).sum(axis=1) >= np.cos(np.radians(_INCIDENCE_DEG)) * reach
        some = np.flatnonzero(inside & ~seen)
        if len(some):
            seen[some] = ~_hidden(poses.positions[at], ray[some], corners, _SLACK)
    return seen


@njit(cache=True)
def _hidden(origin: Floats, rays: Floats, corners: Floats, slack: float) -> Bools:
    """Which rays (K, 3) from one origin meet a triangle (T, 3, 3) before their end."""
    hidden = np.zeros(len(rays), np.bool_)
    for k in range(len(rays)):
        d0, d1, d2 = rays[k]
        for t in range(len(corners)):
            a0, a1, a2 = corners[t, 0]
            e0, e1, e2 = corners[t, 1, 0] - a0, corners[t, 1, 1] - a1, corners[t, 1, 2] - a2
            f0, f1, f2 = corners[t, 2, 0] - a0, corners[t, 2, 1] - a1, corners[t, 2, 2] - a2
            p0, p1, p2 = d1 * f2 - d2 * f1, d2 * f0 - d0 * f2, d0 * f1 - d1 * f0
            scale = e0 * p0 + e1 * p1 + e2 * p2
            if scale == 0.0:
                continue
            s0, s1, s2 = origin[0] - a0, origin[1] - a1, origin[2] - a2
            u = (s0 * p0 + s1 * p1 + s2 * p2) / scale
            if u < 0.0 or u > 1.0:
                continue
            q0, q1, q2 = s1 * e2 - s2 * e1, s2 * e0 - s0 * e2, s0 * e1 - s1 * e0
            v = (d0 * q0 + d1 * q1 + d2 * q2) / scale
            if v < 0.0 or u + v > 1.0:
                continue
            along = (f0 * q0 + f1 * q1 + f2 * q2) / scale
            if 1e-9 < along < 1.0 - slack:
                hidden[k] = True
                break
    return hidden


def _as_plan(path: Trajectory) -> Trajectory:
    """A flight as a plan: every half second, no longer than four minutes."""
    times = np.arange(0.0, min(path.t_s[-1], _LONGEST_S), 0.5)
    return interpolate(path, times)


def _alignment_error(found: Alignment, case: Case) -> tuple[float, float]:
    """Distance between the corrected log and the truth at the same moments, cm, and of the clocks, s."""
    moments = found.flown.t_s + case.log.t_s[0] - case.clock_s
    truth = interpolate(case.truth, moments).positions
    place = np.sqrt(np.mean(((found.flown.positions - truth) ** 2).sum(axis=1)))
    return 100 * float(place), abs(found.clock_s + case.log.t_s[0] - case.clock_s)


def _pooled(rows: list[Found]) -> float:
    """F1 of the gap area of all flights together; NaN where there is none."""
    both, found, true = np.array([row.patches for row in rows]).sum(axis=0)
    return 2 * float(both) / float(found + true) if found + true else float("nan")


def _f1(found: Bools, true: Bools) -> float:
    both = int((found & true).sum())
    return 2 * both / int(found.sum() + true.sum()) if found.any() or true.any() else float("nan")


def _summary(rows: list[Found]) -> str:
    with np.errstate(all="ignore"):
        names = [name for name in Found.__dataclass_fields__ if name != "patches"]
        column = {name: np.array([getattr(row, name) for row in rows]) for name in names}
        return (
            f"{len(rows):8d}{np.mean(column['gap_pct']):8.2f}{_pooled(rows):9.4f}{_mean(column['f1']):9.4f}{_least(column['f1']):8.4f}"
            f"{_mean(column['closed_pct']):10.2f}{_mean(column['length']):8.2f}{_mean(column['place_cm']):10.1f}"
            f"{column['place_cm'].max():7.1f}{_mean(column['clock_s']):9.3f}{np.nanmax(column['clock_s']):7.3f}"
        )


def _mean(values: Floats) -> float:
    known = values[np.isfinite(values)]
    return float(known.mean()) if len(known) else float("nan")


def _least(values: Floats) -> float:
    known = values[np.isfinite(values)]
    return float(known.min()) if len(known) else float("nan")


if __name__ == "__main__":
    main()

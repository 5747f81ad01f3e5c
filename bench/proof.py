"""Flights with injected faults against the truth: alignment, gaps, and the flights that close them.

    python bench/proof.py [--seeds N] [--only WORDS] [--wind M_PER_S]

Paths round the sample fleet are flown in simulated wind as if they were plans, with a photo every second
meanwhile, and one fault each. Some faults are of the flight (it is broken off, photos are lost, the gimbal
sticks): what was seen is really less. The others are of the log alone (a jump of the position, a turned
camera, a part that is cut, another clock): the flight is as planned, and the log says otherwise. The gap that
is found from the log is compared with that of the true flight by a ray test that shares no code with the one
that is tested: its own frustum, its own intersection of rays and triangles, in double precision.

No log tells a shift of its frame from how the wind moved the vehicle, nor an offset of its clock from the
vehicle's lag behind its plan. So beside each error stands what a log without any fault has of it (`own`), and
what of the clock's error is beyond it.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass, replace

import numpy as np
from proof_faults import FAULTS, PHOTO_EVERY_S, PROMISED, Case
from proof_truth import truly_seen

from upplied.config import CloudSettings, RetimeSettings, settings_for
from upplied.errors import RefusedError
from upplied.geometry.poses import interpolate
from upplied.geometry.scene import scene_of
from upplied.planning.airspace.roadmap import roadmap
from upplied.planning.airspace.rules import Airspace
from upplied.planning.surface.samples import surface_samples
from upplied.proof.align import Alignment, align
from upplied.proof.gap import GapFlight, gap_flight
from upplied.proof.looks import looks_of
from upplied.records import Bools, Camera, Cloud, Floats, Structure, Trajectory
from upplied.samples.fleet import sample_demonstrations, sample_structures
from upplied.simulate import Wind, fly_trajectory

_SAMPLES = 1200
_LONGEST_S = 240.0  # of a path that is taken as a plan


def main() -> None:
    """Print one line a fault, over all flights, and those that went wrong."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--seeds", type=int, default=2, help="flights of each path and fault")
    parser.add_argument("--wind", type=float, default=5.0, help="mean wind, m/s")
    parser.add_argument("--only", default="", help="paths whose name contains this")
    parser.add_argument("--worst", action="store_true", help="print every flight")
    options = parser.parse_args()
    flights: dict[str, list[Judgement]] = {name: [] for name in FAULTS}
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
                flights[name].append(one)
                if options.worst:
                    print(f"{demonstration.demonstration_id:24}{name:32}{one}", flush=True)
    print(f"{'fault':32}{'flights':>8}{'gap %':>8}{'F1 area':>9}{'mean':>9}{'least':>8}{'closed %':>10}"
          f"{'length':>8}{'place cm':>10}{'most':>7}{'own':>6}{'clock s':>9}{'most':>7}"
          f"{'beyond':>8}")  # fmt: skip
    for name, rows in flights.items():
        print(f"{name:32}{_summary(rows)}")
    every = [row for rows in flights.values() for row in rows]
    named = [row for name in PROMISED for row in flights[name]]
    print(f"gap area of all flights: F1 {_pooled(every):.4f}; of the named faults {_pooled(named):.4f}")
    lengths = np.array([row.length for row in every if np.isfinite(row.length)])
    print(
        f"closing flights: {lengths.mean():.2f} times the bound, {(lengths <= 1.3).mean():.0%} at most 1.3, "
        f"most {lengths.max():.2f}"
    )
    print(f"{sum(map(len, flights.values()))} flights, {time.process_time() - began:.0f} s of CPU")


@dataclass(frozen=True)
class Judgement:
    """What came of one flight."""

    gap_pct: float  # of what the plan shows
    f1: float  # of the gap that is found against the true one; NaN where both are empty
    closed_pct: float  # of the attainable gap, by the flight that is to close it; NaN where there is none
    length: float  # of that flight over the bound; NaN where there is no bound
    place_cm: float  # error of the alignment, root of the mean square along the flight
    clock_s: float
    own_cm: float  # of that, what a log without any fault is off by: the vehicle's own stray from its plan
    beyond_s: float  # of the clock's error, what a log without any fault has not: the rest is lag
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
        photos = np.arange(0.0, path.t_s[-1], PHOTO_EVERY_S)
        required = truly_seen(structure, interpolate(path, photos), surface, camera)
        return cls(path, structure, surface, camera, required)

    def judged(self, case: Case) -> Judgement:
        """Align the log, find the gap, plan the flight that closes it, and compare all with the truth."""
        scene = scene_of(self.structure)
        start = case.log.t_s[0]
        log = Trajectory(case.log.t_s - start, case.log.positions, case.log.quat_xyzw)
        alignment = align(self.plan, log)
        seen = looks_of(alignment.flown, self.surface, self.camera, scene, case.log_photo_s - start).seen
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
        return Judgement(
            100 * float(true_gap.sum() / max(self.required.sum(), 1)),
            _f1(gap, true_gap),
            closed,
            length,
            *_alignment_error(alignment, case),
            *self.own(case, alignment),
            (int((gap & true_gap).sum()), int(gap.sum()), int(true_gap.sum())),
        )

    def own(self, case: Case, alignment: Alignment) -> tuple[float, float]:
        """How far the true flight strays from its plan as a whole, cm, and what its log adds to its lag, s.

        A shift of the log by as much, and a clock that is late by as much, look the same in it.
        """
        flown = align(self.plan, case.truth)
        moments = np.clip(case.truth.t_s - flown.clock_s, self.plan.t_s[0], self.plan.t_s[-1])
        off = (case.truth.positions - interpolate(self.plan, moments).positions).mean(axis=0)
        late = alignment.clock_s + case.log.t_s[0] - case.clock_s
        return 100 * float(np.linalg.norm(off)), abs(late - flown.clock_s)

    def closing(self, gap: Bools) -> GapFlight | None:
        """The flight that shows the gap; None where there is none."""
        airspace = Airspace(scene_of(self.structure), 1.5, self.structure.surroundings)
        try:
            graph = roadmap(airspace, self.surface, self.plan.positions[:: max(1, len(self.plan) // 300)])
            limits: RetimeSettings = settings_for("recommended").retime
            return gap_flight(self.plan, self.surface, gap, self.camera, graph, limits)
        except RefusedError:
            return None


def _as_plan(path: Trajectory) -> Trajectory:
    """A flight as a plan: every half second, no longer than four minutes."""
    times = np.arange(0.0, min(path.t_s[-1], _LONGEST_S), 0.5)
    return interpolate(path, times)


def _alignment_error(alignment: Alignment, case: Case) -> tuple[float, float]:
    """Distance between the corrected log and the truth at the same moments, cm, and of the clocks, s."""
    moments = alignment.flown.t_s + case.log.t_s[0] - case.clock_s
    truth = interpolate(case.truth, moments).positions
    place = np.sqrt(np.mean(((alignment.flown.positions - truth) ** 2).sum(axis=1)))
    return 100 * float(place), abs(alignment.clock_s + case.log.t_s[0] - case.clock_s)


def _pooled(rows: list[Judgement]) -> float:
    """F1 of the gap area of all flights together; NaN where there is none."""
    both, claimed, true = np.array([row.patches for row in rows]).sum(axis=0)
    return 2 * float(both) / float(claimed + true) if claimed + true else float("nan")


def _f1(claimed: Bools, true: Bools) -> float:
    both = int((claimed & true).sum())
    return 2 * both / int(claimed.sum() + true.sum()) if claimed.any() or true.any() else float("nan")


def _summary(rows: list[Judgement]) -> str:
    with np.errstate(all="ignore"):
        names = [name for name in Judgement.__dataclass_fields__ if name != "patches"]
        column = {name: np.array([getattr(row, name) for row in rows]) for name in names}
        return (
            f"{len(rows):8d}{np.mean(column['gap_pct']):8.2f}{_pooled(rows):9.4f}{_mean(column['f1']):9.4f}{_least(column['f1']):8.4f}"
            f"{_mean(column['closed_pct']):10.2f}{_mean(column['length']):8.2f}{_mean(column['place_cm']):10.1f}"
            f"{column['place_cm'].max():7.1f}{column['own_cm'].max():6.1f}{_mean(column['clock_s']):9.3f}"
            f"{np.nanmax(column['clock_s']):7.3f}{np.nanmax(column['beyond_s']):8.3f}"
        )


def _mean(values: Floats) -> float:
    known = values[np.isfinite(values)]
    return float(known.mean()) if len(known) else float("nan")


def _least(values: Floats) -> float:
    known = values[np.isfinite(values)]
    return float(known.min()) if len(known) else float("nan")


if __name__ == "__main__":
    main()

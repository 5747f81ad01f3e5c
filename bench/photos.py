"""Missions of every row in every format: photos, their times as the files state them, and what they cost.

    python bench/photos.py [--real] [--only WORD] [--trigger S] [--overlap ALONG]

Each plan of `recommended` is written in every format and read again from its bytes. `before` is what an
export would ask for that takes a photo at each viewpoint: how many, and the shortest time between two.
`least` is the shortest time between photos of any format, `+ s` how much longer the flight takes for them;
`off m` how far a photo of any file lies from where it was meant, `lost` how many are missing or too many;
`photos %` of the inspected surface they show, of the `plan %` that the plan shows. With ``--overlap`` that is
required along the flight, and `along` is what 95 % of the photos overlap by at least, by `overlaps`. Beside
them the resolution in millimetres a pixel, demonstrated and planned.
"""

from __future__ import annotations

import argparse
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from proof_truth import hidden
from scipy.spatial.transform import Rotation
from transfers import transfers

from upplied.config import settings_for
from upplied.outputs.missions import FORMATS, Mission, MissionOptions, export
from upplied.outputs.missions.read_back import read_mission
from upplied.planning.plan import plan_transfer
from upplied.records import Camera, Floats, Placement, Plan, Structure

_FINE = ("gsd_mm_p50", "gsd_mm_p95", "gsd_demonstrated_mm_p50", "gsd_demonstrated_mm_p95", "gsd_within_pct")
_POINTS = 20_000
PLACE = Placement(47.0, 8.0, 400.0, 30.0, "ellipsoid")


def main() -> None:
    """Print all rows, then the worst."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--real", action="store_true")
    parser.add_argument("--only", default="")
    parser.add_argument("--trigger", type=float, default=2.0)
    parser.add_argument("--overlap", type=float, default=0.0, help="percent")
    options = parser.parse_args()
    head = (
        "before",
        "least",
        "photos",
        "least",
        "off m",
        "lost",
        "along",
        "plan %",
        "photos %",
        "plan s",
        "+ s",
    )
    names = (*head, "mm 50", "mm 95", "was 50", "was 95", "fine %", "blur px")
    print(f"{'transfer':32}" + "".join(f"{name:>9}" for name in names), flush=True)
    worst, soonest = [], []
    for row in transfers(options.real, options.only):
        args = row.demonstration, row.source, row.target, settings_for("recommended")
        plan = plan_transfer(*args)
        if plan.trajectory is None or plan.is_viewpoint is None:
            print(f"{row.published.title:32} {plan.reason[:90]}", flush=True)
            continue
        written = written_of(plan, row.target, row.demonstration.camera, options.trigger, options.overlap)
        before = np.diff(plan.trajectory.t_s[plan.is_viewpoint])
        measures = plan.measures
        cells = [
            f"{len(before) + 1:9d}",
            f"{before.min():9.2f}",
            f"{written.count:9d}",
            f"{written.least_s:9.3f}",
        ]
        cells += [f"{written.off_m:9.3f}", f"{written.lost:9d}", f"{written.along_pct:9.1f}"]
        cells += [f"{measures.coverage_inspected_pct:9.1f}", f"{written.shown_pct:9.1f}"]
        cells += [f"{measures.duration_s:9.0f}", f"{written.flown_s - measures.duration_s:9.0f}"]
        cells += [f"{getattr(measures, name):9.1f}" for name in _FINE]
        print(f"{row.published.title:32}{''.join(cells)}{measures.blur_px_p99:9.2f}", flush=True)
        worst.append(float(np.mean(before < options.trigger)))
        soonest.append(written.least_s)
    print(f"\nbefore: {100 * np.mean(worst):.0f} % of photos within {options.trigger:g} s of the one before; "
          f"now the nearest two of any format are {min(soonest):.3f} s apart")  # fmt: skip


@dataclass(frozen=True)
class Written:
    """What the files of a plan state of its photos, in all formats together."""

    count: int
    least_s: float  # between two photos
    off_m: float  # from where a photo was meant
    lost: int  # photos that a file lacks, or has too many
    along_pct: float  # overlap with the photo before, 5th percentile; NaN where none was required
    shown_pct: float
    flown_s: float


def written_of(plan: Plan, target: Structure, camera: Camera, trigger_s: float, overlap: float) -> Written:
    """The missions of a plan, written in every format and read again."""
    required = f"{overlap:g}/0" if overlap else ""
    mission_options = MissionOptions(trigger_s=trigger_s, drone="m30t", overlap=required)
    placed, apart, off, lost = replace(target, placement=PLACE), [], [], 0
    with tempfile.TemporaryDirectory() as folder:
        for name in (name for name in FORMATS if name != "mcap"):
            goal = Path(folder) / f"m{FORMATS[name]}"
            done = export(plan, placed, name, goal, mission_options, camera)
            for path, mission in zip(done.paths, done.missions, strict=False):
                reading = read_mission(name, path.read_bytes(), mission)
                apart += np.diff(reading.photo_s).tolist()
                meant = mission.local[mission.photo]
                lost += abs(len(meant) - len(reading.photo_m))
                if len(meant) == len(reading.photo_m):
                    off += np.linalg.norm(reading.photo_m - meant, axis=1).tolist()
            if name == "csv":
                whole = done.missions
    inside = [mission.arrival_s[mission.inspect] for mission in whole]
    along = [overlaps(mission, target, camera) for mission in whole] if overlap else [np.full(1, np.nan)]
    return Written(
        count=sum(int(mission.photo.sum()) for mission in whole),
        least_s=min(apart),
        off_m=max(off),
        lost=lost,
        along_pct=float(np.percentile(np.concatenate(along), 5)),
        shown_pct=whole[0].shown_pct,
        flown_s=sum(float(np.ptp(times)) for times in inside),
    )


def overlaps(mission: Mission, target: Structure, camera: Camera) -> Floats:
    """Share of each picture (K - 1,), percent, that the one before shows too, without rays of ours.

    Points spread evenly over the mesh, each worth the solid angle that it stands for in a flat picture; what
    hides them by `proof_truth`, which tries every triangle.
    """
    corners = target.vertices[target.triangles]
    area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) / 2
    size, random = np.linalg.norm(area, axis=1), np.random.default_rng(0)
    triangle = random.choice(len(size), _POINTS, p=size / size.sum())
    side = np.sort(random.uniform(0, 1, (_POINTS, 2)), axis=1)
    parts = np.column_stack([side[:, 0], side[:, 1] - side[:, 0], 1 - side[:, 1]])
    points = np.einsum("nk,nkx->nx", parts, corners[triangle])
    normals = area[triangle] / size[triangle, None]
    shown, worth = [], []
    slopes = np.tan(np.radians([camera.hfov_deg, camera.vfov_deg]) / 2)
    for place, turn in zip(
        mission.local[mission.photo],
        Rotation.from_quat(mission.quat_xyzw[mission.photo]).as_matrix(),
        strict=True,
    ):
        ray = points - place
        ahead, *sides = (ray @ turn).T
        reach = np.linalg.norm(ray, axis=1)
        inside = (ahead > 0) & (np.abs(np.array(sides).T) <= ahead[:, None] * slopes).all(axis=1)
        inside &= (reach >= camera.min_range_m) & (reach <= camera.max_range_m)
        some = np.flatnonzero(inside)
        inside[some] = ~hidden(place, ray[some], corners, 1e-3)
        shown.append(inside)
        with np.errstate(divide="ignore"):
            worth.append(np.where(inside, np.abs((ray * normals).sum(axis=1)) / ahead**3, 0.0))
    return np.array(
        [
            100 * worth[at][shown[at - 1]].sum() / worth[at].sum()
            for at in range(1, len(shown))
            if worth[at].sum() > 0
        ]
    )


if __name__ == "__main__":
    main()

"""Missions of every row in every format: photos, their times as the files state them, and what they cost.

    python bench/photos.py [--real] [--only WORD] [--trigger S] [--overlap ALONG]

Each plan of `recommended` is written in every format and read again from its bytes. `before` is what an
export would ask for that takes a photo at each viewpoint: how many, and the shortest time between two.
`least` is the shortest time between photos of any format, `+ s` how much longer the flight takes for them;
`off m` how far a photo of any file lies from where it was meant, `lost` how many are missing or too many;
`photos %` of the inspected surface they show, of the `plan %` that the plan shows. With ``--overlap`` that is
required along the flight: `along` is what 95 % of the photos overlap by at least, by `overlaps`, and `across`
what half of them overlap with one of another pass, by `overlaps_across`. Beside them the resolution in
millimetres a pixel, demonstrated and planned.
"""

from __future__ import annotations

import argparse
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from proof_truth import met
from scipy.spatial.transform import Rotation
from transfers import transfers

from upplied.config import settings_for
from upplied.outputs.missions import FORMATS, Mission, MissionOptions, export
from upplied.outputs.missions.read_back import read_mission
from upplied.planning.plan import plan_transfer
from upplied.records import Bools, Camera, Floats, Placement, Plan, Structure

_FINE = ("gsd_mm_p50", "gsd_mm_p95", "gsd_demonstrated_mm_p50", "gsd_demonstrated_mm_p95", "gsd_within_pct")
_CELLS, _COARSE = (60, 45), (24, 18)  # of a picture, each with a ray
_PICTURES = 40  # whose overlap with other passes is measured
_GROWN, _SLACK = 0.02, 1e-3  # more than rays tell apart; of a sight line, at its end
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
        "across",
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
        cells += [f"{written.across_pct:9.1f}"]
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
    across_pct: float  # overlap with a photo of another pass, median
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
            files = export(plan, placed, name, goal, mission_options, camera)
            for path, mission in zip(files.paths, files.missions, strict=False):
                reading = read_mission(name, path.read_bytes(), mission)
                apart += np.diff(reading.photo_s).tolist()
                expected_m = mission.local[mission.photo]
                lost += abs(len(expected_m) - len(reading.photo_m))
                if len(expected_m) == len(reading.photo_m):
                    off += np.linalg.norm(reading.photo_m - expected_m, axis=1).tolist()
            if name == "csv":
                whole = files.missions
    inside = [mission.arrival_s[mission.inspect] for mission in whole]
    nothing = np.full(1, np.nan)
    along, across = (
        np.concatenate([of(mission, target, camera) for mission in whole]) if overlap else nothing
        for of in (overlaps, overlaps_across)
    )
    return Written(
        count=sum(int(mission.photo.sum()) for mission in whole),
        least_s=min(apart),
        off_m=max(off),
        lost=lost,
        along_pct=float(np.percentile(along, 5)),
        across_pct=float(np.median(across)),
        shown_pct=whole[0].shown_pct,
        flown_s=sum(float(np.ptp(times)) for times in inside),
    )


def overlaps(mission: Mission, target: Structure, camera: Camera) -> Floats:
    """Share of each picture (K - 1,), percent, that the one before shows too, without rays of ours.

    A ray through each cell of a picture, somewhere in it by chance, meets the surface by `proof_truth.met`,
    which tries every triangle; so does the ray to there from the picture before.
    """
    corners, random = target.vertices[target.triangles], np.random.default_rng(0)
    places, axes = _taken(mission)
    shares = []
    for at in range(1, len(places)):
        points = pictured(places[at], axes[at], corners, camera, random, _CELLS)
        if len(points):
            before = shows(places[at - 1], axes[at - 1], points, corners, camera)
            shares.append(100 * float(before.mean()))
    return np.array(shares)


def overlaps_across(mission: Mission, target: Structure, camera: Camera) -> Floats:
    """Share, percent, of some pictures that one of another pass shows at best, by the same rays.

    A pass ends where the overlap with a picture, on the way before or behind it, has fallen and grows again.
    """
    corners, random = target.vertices[target.triangles], np.random.default_rng(0)
    places, axes = _taken(mission)
    most = []
    for at in np.unique(np.linspace(0, len(places) - 1, _PICTURES).astype(int)):
        points = pictured(places[at], axes[at], corners, camera, random, _COARSE)
        if not len(points):
            continue
        share = [shows(*other, points, corners, camera).mean() for other in zip(places, axes, strict=True)]
        others = [0.0]
        for way in (share[at:], share[at::-1]):
            grown = np.flatnonzero(np.array(way) > np.minimum.accumulate(way) + _GROWN)
            others += way[grown[0] :] if len(grown) else []
        most.append(100 * float(max(others)))
    return np.array(most)


def _taken(mission: Mission) -> tuple[Floats, Floats]:
    """Positions (K, 3) and axes (K, 3, 3) of the photos."""
    return mission.local[mission.photo], Rotation.from_quat(mission.quat_xyzw[mission.photo]).as_matrix()


def pictured(
    place: Floats,
    axes: Floats,
    corners: Floats,
    camera: Camera,
    random: np.random.Generator,
    number: tuple[int, int],
) -> Floats:
    """The points (K, 3) of the surface that rays through so many cells of a picture meet within range, m.

    Where no triangle reaches behind the camera, the cells divide the rectangle in which it shows them.
    """
    cells = np.stack(np.meshgrid(*map(np.arange, number)), axis=-1).reshape(-1, 2)
    low, high, local = np.full(2, -1.0), np.ones(2), (corners - place) @ axes
    ahead = local[(local[:, :, 0] > 0).any(axis=1)].reshape(-1, 3)
    if len(ahead) and (ahead[:, 0] > 0).all():
        shown = ahead[:, 1:] / ahead[:, :1] / _slopes(camera)
        low, high = np.clip(shown.min(axis=0), -1, 1), np.clip(shown.max(axis=0), -1, 1)
    within = low + (high - low) * (cells + random.uniform(0, 1, cells.shape)) / number
    rays = np.column_stack([np.ones(len(cells)), within * _slopes(camera)]) @ axes.T
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    reach = met(place, rays, corners)
    near = (reach >= camera.min_range_m) & (reach <= camera.max_range_m)
    return np.asarray(place + rays[near] * reach[near, None])


def shows(place: Floats, axes: Floats, points: Floats, corners: Floats, camera: Camera) -> Bools:
    """Which points (N, 3) are in a picture, with nothing before them."""
    rays = points - place
    ahead, *sides = (rays @ axes).T
    reach = np.linalg.norm(rays, axis=1)
    inside = (ahead > 0) & (np.abs(np.array(sides).T) <= ahead[:, None] * _slopes(camera)).all(axis=1)
    inside &= (reach >= camera.min_range_m) & (reach <= camera.max_range_m)
    inside[inside] = met(place, rays[inside], corners) > 1 - _SLACK
    return inside


def _slopes(camera: Camera) -> Floats:
    return np.tan(np.radians([camera.hfov_deg, camera.vfov_deg]) / 2)


if __name__ == "__main__":
    main()

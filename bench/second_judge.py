"""Resolution of every row by a second judge, with a ray test of its own, beside the plan's measure.

    python bench/second_judge.py [--real] [--own] [--only WORD] [--rows FILE]

`within` is `gsd_within_pct` of the plan: of the inspected surface that a safe camera can show so, what is no
coarser than 1.1 times the demonstrated millimetres a pixel. `second` is the same by `proof_truth`, which
intersects rays with every triangle and shares no code of visibility with the planner: looks every quarter of
a second on the flight as logged and on the plan, and for what is missed 300 cameras at random in direction
and distance, one of which has to show it as finely, clear of structure and ground. `whole` counts what none
of them shows, too. Counterparts and weights are the plan's. `time` is the plan's duration over what is
allowed: 1.25 times the demonstration's, times how much larger the surface is, where it is larger. With
``--own`` each flight is planned for its own structure. Rows that FILE holds are not planned again.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from proof_truth import finest_looks, least_distance, truly_seen
from transfers import Transfer, transfers

from upplied.config import settings_for
from upplied.geometry.poses import interpolate, look_at
from upplied.planning.carry.inspected_surface import area_ratio, inspected_by
from upplied.planning.correspondence.memo import no_memo
from upplied.planning.demonstration.repetition import Take, look_limits
from upplied.planning.plan import decided, plan_transfer
from upplied.planning.surface.frames import demonstration_in, frames_for, in_frame, structure_in
from upplied.records import Camera, Cloud, Floats, Plan, Structure, Trajectory

_EVERY_S, _FINE, _MOST_DEG = 0.25, 1.1, 75.0
_LONGER = 1.25  # times the demonstrated time
_TRIED = 300  # cameras for each patch that is missed
SETTINGS = settings_for("recommended")
_COLUMNS = ("within", "second", "whole", "score", "blur", "passes", "flown_s", "planned_s", "area", "time")


@dataclass(frozen=True)
class Judged:
    """What the second judge says of one plan, percent."""

    whole: float  # of all that was shown and has a counterpart
    within: float  # of that, what some camera can show so


def finest(
    structure: Structure,
    path: Trajectory,
    cloud: Cloud,
    camera: Camera,
    limits: tuple[float, float],
    enough_m: Floats,
) -> Floats:
    """What a pixel covers at best (N,), over its angle, m, in looks every quarter of a second."""
    ends = path.t_s[0], path.t_s[-1]
    times = np.arange(*ends, _EVERY_S)
    times = np.random.default_rng(0).permutation(times)  # so the finest is known soon
    before, after = (interpolate(path, np.clip(times + by, *ends)) for by in (-_EVERY_S, _EVERY_S))
    rule = limits[0], float(np.degrees(np.arccos(limits[1])))
    looks = interpolate(path, times)
    return finest_looks(structure, looks, (before, after), cloud, camera, rule, enough_m)


def judged(take: Take, plan: Trajectory) -> Judged:
    """Shares of the patches that a plan, in the frame of the pair, shows as finely."""
    pair, inspection = take.pair, take.inspection
    limits, camera = look_limits([take], SETTINGS.inspection), inspection.camera
    source, target = pair.surface.source, pair.surface.target
    index, weight = pair.surface.correspondences.target_index, inspection.attention.weight * source.areas
    chosen = np.flatnonzero((weight > 0) & (index >= 0))
    flown = finest(pair.source, inspection.logged, source.at(chosen), camera, limits, np.zeros(len(chosen)))
    chosen, limit_m = chosen[np.isfinite(flown)], _FINE * flown[np.isfinite(flown)]
    weight, index = weight[chosen], index[chosen]
    samples, at = np.unique(index, return_inverse=True)
    least, most = np.full(len(samples), np.inf), np.zeros(len(samples))
    np.minimum.at(least, at, limit_m)
    np.maximum.at(most, at, limit_m)
    shown = finest(pair.target, plan, target.at(samples), camera, limits, least)[at]
    fine = shown <= limit_m
    missed = np.unique(at[~fine])
    possible = np.ones(len(samples), bool)
    for sample in missed:
        possible[sample] = shows(pair.target, target.at(samples[[sample]]), camera, most[sample])
    counted = fine | possible[at]
    shares = weight @ fine / weight.sum(), weight[counted] @ fine[counted] / weight[counted].sum()
    return Judged(*(100 * float(share) for share in shares))


def shows(structure: Structure, sample: Cloud, camera: Camera, limit_m: float) -> bool:
    """Whether one of some cameras round a sample, safe and above the ground, shows it as finely."""
    random = np.random.default_rng(1)
    point, normal = sample.points[0], sample.outward[0]
    cosine = random.uniform(np.cos(np.radians(_MOST_DEG)), 1.0, _TRIED)
    ways = random.normal(size=(_TRIED, 3))
    ways -= (ways @ normal)[:, None] * normal
    ways *= np.sqrt(1 - cosine**2)[:, None] / np.linalg.norm(ways, axis=1, keepdims=True)
    ways += cosine[:, None] * normal
    nearest = max(camera.min_range_m, SETTINGS.route.clearance_m)
    farthest = np.minimum(limit_m * cosine, camera.max_range_m)
    reach = nearest + random.uniform(0, 1, _TRIED) * (farthest - nearest)
    places = (point + ways * reach[:, None])[farthest > nearest]
    ground = structure.surroundings.ground_z_m
    if ground is not None:
        places = places[places[:, 2] >= ground + SETTINGS.route.ground_clearance_m]
    for place in places:
        looking = Trajectory(np.zeros(1), place[None], look_at(place[None], point[None]))
        seen = bool(truly_seen(structure, looking, sample, camera)[0])
        if seen and least_distance(structure, place[None]) >= SETTINGS.route.clearance_m:
            return True
    return False


def row(transfer: Transfer, plan: Plan) -> dict[str, Any]:
    """What is printed of a plan."""
    measures = plan.measures
    if plan.trajectory is None:
        return {"title": transfer.published.title, "reason": plan.reason[:90]}
    here, there = frames_for(transfer.source, transfer.target, SETTINGS)
    inputs = demonstration_in(here, transfer.demonstration), structure_in(here, transfer.source)
    take = decided(*inputs, structure_in(there, transfer.target), SETTINGS, no_memo)[1][0]
    times = take.inspection.flight.t_s
    flown_s = float(times[-1] - times[0])
    ratio = area_ratio([take], inspected_by(take, SETTINGS))
    second = judged(take, in_frame(there, plan.trajectory))
    added = np.concatenate([[False], np.zeros(0, bool) if plan.added is None else plan.added])
    return {
        "title": transfer.published.title,
        "within": measures.gsd_within_pct,
        "second": second.within,
        "whole": second.whole,
        "score": measures.picture_score,
        "blur": measures.blur_px_p99,
        "passes": int((np.diff(added.astype(int)) > 0).sum()),
        "flown_s": flown_s,
        "planned_s": measures.duration_s,
        "area": ratio,
        "time": measures.duration_s / (_LONGER * flown_s * max(ratio, 1.0)),
    }


def chosen(options: argparse.Namespace) -> Iterator[Transfer]:
    """The transfers that the options ask for, or each flight of theirs to its own structure."""
    names = set()
    for real in (False, True) if options.real else (False,):
        for each in transfers(real, options.only):
            named = f"{'real ' if real else ''}{each.published.title}"
            target = each.target
            if options.own:
                named, target = f"{named.split(' > ')[0]} > itself", each.source
            if named not in names:
                names.add(named)
                yield Transfer(replace(each.published, title=named), each.demonstration, each.source, target)


def main() -> None:
    """Print a row a transfer, then the means and the worst."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--real", action="store_true")
    parser.add_argument("--own", action="store_true")
    parser.add_argument("--only", default="")
    parser.add_argument("--rows", type=Path, help="JSON lines, that are read and added to")
    options = parser.parse_args()
    rows = []
    if options.rows and options.rows.exists():
        rows = [json.loads(line) for line in options.rows.read_text().splitlines()]
    known = {each["title"] for each in rows}
    for transfer in chosen(options):
        if transfer.published.title in known:
            continue
        plan = plan_transfer(transfer.demonstration, transfer.source, transfer.target, SETTINGS)
        rows.append(row(transfer, plan))
        if options.rows:
            with options.rows.open("a") as file:
                file.write(json.dumps(rows[-1]) + "\n")
    print(f"{'transfer':38}" + "".join(f"{name:>10}" for name in _COLUMNS))
    for each in rows:
        cells = each.get("reason") or "".join(f"{each[name]:10.2f}" for name in _COLUMNS)
        print(f"{each['title']:38}{cells}")
    flown = [each for each in rows if "within" in each]
    for name in ("within", "second"):
        values = [each[name] for each in flown]
        print(f"{name}: mean {np.mean(values):.2f}, worst {np.min(values):.2f} of {len(values)}")
    apart = [abs(each["second"] - each["within"]) for each in flown]
    print(f"apart by {np.mean(apart):.2f} points in the mean, {np.max(apart):.2f} at most; "
          f"time over limit {max(each['time'] for each in flown):.2f} at most")  # fmt: skip


if __name__ == "__main__":
    main()

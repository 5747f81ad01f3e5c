"""Errors of the correspondences against the truth, which is known on the sample fleet.

    python bench/correspondence.py [--random N]

For the paper's nearest neighbours on voxel clouds and for what `recommended` does on the surface:
distance between where a point is carried and where it truly belongs, as share of the target's
diagonal; pairs that join surfaces facing opposite ways; points on the left engines carried to the
right part.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator

import numpy as np

from upplied.config import settings_for
from upplied.planning.pair import Fit, study_pair
from upplied.samples.correspondence import true_counterparts
from upplied.samples.fleet import member, random_member
from upplied.samples.surfaces import Member
from upplied.scene import scene_of

_PAIRS = (
    ("a320-v1", "beluga-v1"),
    ("a320-v1", "b747-v1"),
    ("a320-v1", "b777-v1"),
    ("turbine-1-v1", "turbine-2-v1"),
    ("turbine-1-v1", "turbine-3-v1"),
    ("cruise-v1", "yacht-1-v1"),
    ("cruise-v1", "yacht-2-v1"),
    ("cube-v1", "cuboid-v1"),
    ("bridge-1-v1", "bridge-2-v1"),
)
_KINDS = ("airliner", "wind_turbine", "ship", "box", "bridge")


def main() -> None:
    """Print one line per pair and method."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--random", type=int, default=0, help="also so many random pairs of each kind")
    options = parser.parse_args()
    heads = ("p50 m", "p95 m", "p50 %", "opposite %", "engine %", "none %")
    print(f"{'pair':46}{'method':14}" + "".join(f"{head:>11}" for head in heads) + f"{'CPU s':>8}")
    for one, other in _members(options.random):
        began = time.process_time()
        pair = study_pair(one.structure, other.structure, settings_for("recommended"))
        seconds = time.process_time() - began
        name = f"{one.structure.structure_id} > {other.structure.structure_id}"
        for method, fit in (("nearest", pair.voxels), ("recommended", pair.surface)):
            print(f"{name:46}{method:14}{_errors(one, other, fit)}{seconds:8.1f}", flush=True)


def _members(random: int) -> Iterator[tuple[Member, Member]]:
    for one, other in _PAIRS:
        yield member(one), member(other)
    for kind in _KINDS:
        for seed in range(random):
            yield random_member(kind, 2 * seed), random_member(kind, 2 * seed + 1)


def _errors(one: Member, other: Member, fit: Fit) -> str:
    true = true_counterparts(one, other, fit.source.points)
    carried = fit.correspondences.target_points
    known = np.isfinite(true).all(axis=1)
    made = known & np.isfinite(carried).all(axis=1)
    off = np.linalg.norm(carried[made] - true[made], axis=1)
    lost = 100 * (known & ~made).sum() / known.sum()
    return (
        f"{np.median(off):11.2f}{np.percentile(off, 95):11.2f}"
        f"{100 * np.median(off) / other.structure.diagonal_m:11.2f}"
        f"{_opposite(fit):11.1f}{_engines(one, other, fit):11.1f}{lost:11.1f}"
    )


def _opposite(fit: Fit) -> float:
    """Percentage of the pairs whose normals oppose each other; NaN on clouds without normals."""
    if fit.source.normals is None or fit.target.normals is None:
        return float("nan")
    index = fit.correspondences.target_index
    agree = np.einsum("ij,ij->i", fit.source.normals[index >= 0], fit.target.normals[index[index >= 0]])
    return float(100 * (agree < 0).mean())


def _engines(one: Member, other: Member, fit: Fit) -> float:
    """Percentage of the points on engines whose counterpart lies on the engine that answers."""
    right = total = 0
    source_part, target_part = (
        _part_of(each, cloud.points) for each, cloud in ((one, fit.source), (other, fit.target))
    )
    for name in ("engine_left", "engine_right"):
        if name in one.part_names and name in other.part_names:
            points = np.flatnonzero(source_part == one.part_names.index(name))
            index = fit.correspondences.target_index[points]
            total += len(points)
            right += int((target_part[index[index >= 0]] == other.part_names.index(name)).sum())
    return 100 * right / total if total else float("nan")


def _part_of(each: Member, points: np.ndarray) -> np.ndarray:
    return each.part_of_triangle[scene_of(each.structure).closest(points)[1]]


if __name__ == "__main__":
    main()

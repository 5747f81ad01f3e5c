"""Errors of the correspondences against the truth, which is known on the sample fleet.

    python bench/correspondence.py [--random N]

For the paper's nearest neighbours on voxel clouds and for what `recommended` does on the surface:
distance between where a point is carried and where it truly belongs, in metres and as share of the
target's diagonal (goal: 1 % in the mean); points whose counterpart lies on the right part, or that
rightly have none (goal: 99 %); pairs that join surfaces facing opposite ways; points lost, which
have a counterpart that was not found, and invented, which have none and were given one.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator

import numpy as np
from random_members import random_member
from true_counterparts import true_counterparts

from upplied.config import settings_for
from upplied.geometry.scene import scene_of
from upplied.planning.correspondence.fit import Fit
from upplied.planning.correspondence.pair import study_pair
from upplied.samples.fleet import member
from upplied.samples.surfaces import Member

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
    heads = ("mean m", "p95 m", "mean %", "part %", "opposite %", "lost %", "invented %")
    print(f"{'pair':46}{'method':14}" + "".join(f"{head:>11}" for head in heads) + f"{'CPU s':>8}")
    rows: dict[str, list[tuple[float, ...]]] = {}
    for one, other in _members(options.random):
        began = time.process_time()
        pair = study_pair(one.structure, other.structure, settings_for("recommended"))
        seconds = time.process_time() - began
        name = f"{one.structure.structure_id} > {other.structure.structure_id}"
        for method, fit in (("nearest", pair.voxels), ("recommended", pair.surface)):
            row = _errors(one, other, fit)
            rows.setdefault(method, []).append(row)
            print(f"{name:46}{method:14}{_line(row)}{seconds:8.1f}", flush=True)
    for method, errors in rows.items():
        good = sum(row[2] <= 1 and row[3] >= 99 for row in errors)
        mean = tuple(np.mean(errors, axis=0))
        print(
            f"{'mean of all pairs':46}{method:14}{_line(mean)}   both goals in {good} of {len(errors)} pairs"
        )


def _members(random: int) -> Iterator[tuple[Member, Member]]:
    for one, other in _PAIRS:
        yield member(one), member(other)
    for kind in _KINDS:
        for seed in range(random):
            yield random_member(kind, 2 * seed), random_member(kind, 2 * seed + 1)


def _line(row: tuple[float, ...]) -> str:
    return "".join(f"{value:11.2f}" for value in row)


def _errors(one: Member, other: Member, fit: Fit) -> tuple[float, ...]:
    true = true_counterparts(one, other, fit.source.points)
    index, carried = fit.correspondences.target_index, fit.correspondences.target_points
    known, matched = np.isfinite(true).all(axis=1), index >= 0
    area = np.ones(len(fit.source)) if fit.source.area_m2 is None else fit.source.area_m2
    both = known & matched
    off = np.linalg.norm(carried[both] - true[both], axis=1)
    mean = float(np.average(off, weights=area[both]))
    there = np.array(other.part_names)[_part_of(other, fit.target.points)][index]
    here = np.array(one.part_names)[_part_of(one, fit.source.points)]
    right = np.where(known, matched & (there == here), ~matched)
    shares = [100 * np.average(flags, weights=area) for flags in (right, known & ~matched, ~known & matched)]
    return (
        mean,
        float(np.percentile(off, 95)),
        100 * mean / other.structure.diagonal_m,
        shares[0],
        _opposite(fit),
        *shares[1:],
    )


def _opposite(fit: Fit) -> float:
    """Percentage of the pairs whose normals oppose each other; NaN on clouds without normals."""
    if fit.source.normals is None or fit.target.normals is None:
        return float("nan")
    index = fit.correspondences.target_index
    agree = np.einsum("ij,ij->i", fit.source.normals[index >= 0], fit.target.normals[index[index >= 0]])
    return float(100 * (agree < 0).mean())


def _part_of(each: Member, points: np.ndarray) -> np.ndarray:
    return each.part_of_triangle[scene_of(each.structure).closest(points)[1]]


if __name__ == "__main__":
    main()

"""The data card of a dataset in LeRobot's layout: what it holds, how to read it, and what it is not."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

import upplied

_HEADLINES = ("coverage_inspected_pct", "coverage_seen_pct", "min_clearance_m", "frechet_z")


def data_card(
    episodes: Sequence[Mapping[str, Any]], info: Mapping[str, Any], licence: str, attribution: str
) -> str:
    """``README.md`` in Markdown, with the head that dataset hubs read.

    Parameters
    ----------
    episodes : sequence of mapping
        Rows of ``meta/episodes``.
    info : mapping
        ``meta/info.json``.
    licence, attribution : str
        Empty where none was given.
    """
    counts = Counter((row["kind"], row["split"], row["origin"]) for row in episodes)
    kinds = sorted({kind for kind, _, _ in counts})
    table = [
        f"| {kind} | {split} | {counts[kind, split, 'demonstration']} | {counts[kind, split, 'plan']} |"
        for kind in kinds
        for split in dict.fromkeys(row["split"] for row in episodes)
        if counts[kind, split, "demonstration"] + counts[kind, split, "plan"]
    ]
    plans = [row for row in episodes if row["origin"] == "plan"]
    measures = [_line(name, [row[name] for row in plans]) for name in _HEADLINES] if plans else []
    return _CARD.format(
        licence=json.dumps(licence or "unknown"),
        rights=licence or "none was stated: ask whoever gave you this before you pass it on",
        whom=f" Please name: {attribution}." if attribution else "",
        episodes=len(episodes),
        frames=info["total_frames"],
        fps=info["fps"],
        tasks=info["total_tasks"],
        counts="\n".join(table),
        measures="\n".join(measures) or "There are no plans.",
        version=upplied.__version__,
    )


def _line(name: str, values: Sequence[float | None]) -> str:
    known = np.array([value for value in values if value is not None and value == value], float)
    if not len(known):
        return f"- `{name}`: not computed"
    low, middle, high = np.quantile(known, (0, 0.5, 1))
    return f"- `{name}`: {middle:.4g} in the median, {low:.4g} to {high:.4g} ({len(known)} plans)"


_CARD = """\
---
license: {licence}
task_categories: [robotics]
tags: [LeRobot, drone, inspection, trajectories]
configs:
- config_name: default
  data_files: data/*/*.parquet
---

# Inspection flights: demonstrations, and their plans on other structures

{episodes} episodes of {frames} frames at {fps} frames a second, {tasks} tasks. An episode is what an
expert flew round one structure (`origin` is `demonstration`; a log with gaps is an episode for each
stretch without one), or what was planned from that for another structure of its kind (`plan`). Written by
upplied {version} in LeRobot's layout, version 3.

## Frames

`observation.state` is the pose of the camera in the frame of its structure: `x_m`, `y_m`, `z_m` (m; Z up,
+X forward) and the quaternion `qx`, `qy`, `qz`, `qw` that turns camera vectors (x along the optical axis,
y left, z up) into that frame. Its sign does not change from frame to frame, so `qw` may be negative.
`action` is the pose of the next frame, in the last frame its own. There are no pictures and no meshes:
`upplied catalog export --format parquet` writes the structures' meshes, under the ids and hashes that
stand here.

## Episodes

`meta/episodes` says of each where it comes from (`demonstration_id`, `transfer_id`, `source_id`,
`structure_id`, hashes and versions), its `split`, its camera (`hfov_deg`, `vfov_deg`: full angles) and,
of plans, what they were measured to be:

{measures}

Coverage is a share of area: of what the expert inspected, how much the plan shows at least as well
(`inspected`), or sees at all (`seen`). `min_clearance_m` is the least distance from the structure. Of
demonstrations these are NaN.

| kind | split | episodes of demonstrations | of plans |
|---|---|---|---|
{counts}

## Splits

`meta/info.json` has them as ranges of episodes, `meta/splits.json` by structure and by kind. No structure
is on two sides: an episode goes where the structure goes that it flies round. A plan for a structure in
training may follow a demonstration on one in test, and the other way round; who wants neither leaves out
episodes whose `source_id` is on another side than their `structure_id`.

## Limits

Plans are computed, not flown: what an operator released says so in `state`. `not_flyable` says why a plan
may not be flown as it is. Positions between logged poses are interpolated. Measures are those of the
program's models of camera and surface.

## Licence

{rights}.{whom}
"""

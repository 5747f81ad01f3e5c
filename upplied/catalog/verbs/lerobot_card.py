"""The data card of a dataset in LeRobot's layout: what it holds, how to read it, and what it is not."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from importlib.resources import files
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
    text = files(__package__).joinpath("texts", "lerobot.md").read_text(encoding="utf-8")
    return text.format(
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

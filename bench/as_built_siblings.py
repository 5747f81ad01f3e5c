"""Which structures of a fleet are asked for the parts of a scan of a structure that nobody built."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from as_built_cases import SOURCE
from scans import member_of, real_names, scan

from upplied.config import settings_for
from upplied.planning.correspondence.siblings import nearest_in_proportions
from upplied.records import Structure
from upplied.samples.fleet import sample_structures

_OTHER_SEEDS = range(101, 111)
_MOST_SIBLINGS = settings_for("recommended").correspondence.siblings


def siblings_for(kind: str, target: str, variant: str, sorts: str) -> list[Structure]:
    """Those of a fleet that would be asked about a target, of the sorts that are named."""
    first = np.random.default_rng(int(target[1:])).integers(4)  # what `random_airliner` draws first
    base = ("a320-v1", "beluga-v1", "b747-v1", "b777-v1")[first] if kind == "airliner" else ""
    return nearest_of(scan(kind, target, variant), pool(kind, base, sorts), kind)


def pool(kind: str, but: str, sorts: str) -> list[str]:
    """The names of a fleet, but for one."""
    names: list[str] = []
    if "samples" in sorts:
        names += [one.structure_id for one in sample_structures() if one.kind == kind]
    if "random" in sorts:
        names += [f"r{seed}" for seed in _OTHER_SEEDS]
    if "real" in sorts:
        names += real_names(kind)
    return [name for name in names if name not in (but, SOURCE[kind])]


def nearest_of(whole: Structure, names: Sequence[str], kind: str) -> list[Structure]:
    """Those of a pool that the fleet would ask about a scan: the nearest in proportions."""
    some = {one.structure_id: one for one in (member_of(kind, name).structure for name in names)}
    if not some:
        return []
    sizes = np.array([np.ptp(one.vertices, axis=0) for one in some.values()])
    chosen = nearest_in_proportions(np.ptp(whole.vertices, axis=0), list(some), sizes, _MOST_SIBLINGS)
    return [some[name] for name in chosen]

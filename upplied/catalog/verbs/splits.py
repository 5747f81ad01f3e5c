"""Which side of learning each structure is on, and with it its plans and demonstrations."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping
from itertools import zip_longest
from typing import Any

from upplied.catalog.database import Catalog

SHARES = {"train": 0.8, "validation": 0.1, "test": 0.1}
_HELD_BACK = ("test", "validation")


def splits_of(
    catalog: Catalog, plans: Iterable[Mapping[str, Any]], demonstrations: Iterable[str] | None = None
) -> dict[str, dict[str, dict[str, list[Any]]]]:
    """What is for training of some plans and demonstrations (all in use): the content of ``splits.json``.

    By structure: none on two sides, each kind on all where it has enough members; by kind: one after the
    other left out.
    """
    kinds, flights = kinds_of(catalog), catalog.demonstrations()
    flown = dict(zip(flights["demonstration_id"], flights["structure_id"], strict=True))
    planned = {str(row["transfer_id"]): str(row["target_id"]) for row in plans}
    names = flown if demonstrations is None else demonstrations
    owned = {"plans": planned, "demonstrations": {name: flown[name] for name in names}}

    def parted(sides: Iterable[str], side_of: Mapping[str, str], structure_of: Mapping[str, Any]) -> Any:
        """By side, then by sort, the names of what belongs to structures on that side."""
        return {
            side: {
                sort: sorted(name for name, at in each.items() if side_of.get(at) == side)
                for sort, each in structure_of.items()
            }
            for side in sides
        }

    every = {"structures": {name: name for name in kinds}, **owned}
    return {
        "by_structure": parted(SHARES, split_of(kinds), every),
        "by_kind": parted(sorted(set(kinds.values())), kinds, owned),
    }


def kinds_of(catalog: Catalog) -> dict[str, str]:
    """The kind of each structure in the fleet."""
    structures = catalog.structures()
    return dict(zip(structures["structure_id"], structures["kind"], strict=True))


def split_of(kinds: Mapping[str, str]) -> dict[str, str]:
    """The side of each structure, the same on every machine: by the hash of its name, kind by kind."""
    sides: dict[str, str] = {}
    for kind in sorted(set(kinds.values())):
        names = [name for name in kinds if kinds[name] == kind]
        names.sort(key=lambda name: hashlib.sha256(name.encode()).hexdigest())
        count = {side: round(len(names) * SHARES[side]) or int(len(names) >= 3) for side in _HELD_BACK}
        held_back = [side for side in _HELD_BACK for _ in range(count[side])]
        sides |= zip_longest(names, held_back, fillvalue="train")
    return sides

"""Why a pair is planned anew: what changed since the newest plan that the catalog has of it."""

from __future__ import annotations

from functools import cached_property

import pyarrow as pa

from upplied.catalog import Catalog
from upplied.catalog.schema.plan_rows import is_foreign, transfer_id
from upplied.catalog.schema.rows import json_text
from upplied.config import Settings
from upplied.fleet.siblings import Siblings
from upplied.planning.plan import METHOD_VERSION
from upplied.provenance import causes
from upplied.records import Demonstration, Structure

Candidate = tuple[Demonstration, Structure, Structure, Settings, Siblings]


class Past:
    """What the catalog's plans were made from."""

    def __init__(self, catalog: Catalog) -> None:
        self._catalog = catalog
        self._known: dict[tuple[str, ...], tuple[str, ...]] = {}  # causes by what rows say of the program

    @cached_property
    def _rows(self) -> pa.Table:
        """The newest plan of each demonstration, target and preset; a quiet night never asks."""
        columns = [*_SLOT, *_CHANGES.values(), *_PROGRAM, "imported_from"]
        return self._catalog.newest_plans(columns).combine_chunks()

    @cached_property
    def _places(self) -> dict[tuple[str, ...], int]:
        encoded = [self._rows[name].combine_chunks() for name in _SLOT]
        texts = (map(each.dictionary.to_pylist().__getitem__, each.indices.to_numpy()) for each in encoded)
        return {name: place for place, name in enumerate(zip(*texts, strict=True))}

    def why(self, candidate: Candidate, key: str) -> str:
        """What changed since the newest plan of the pair, in words."""
        demonstration, source, target, settings, siblings = candidate
        place = self._places.get((demonstration.demonstration_id, target.structure_id, settings.preset))
        if place is None:
            return "new pair"
        # Texts are missing in rows of before there was such a column.
        before = {name: self._rows[name][place].as_py() or "" for name in self._rows.column_names}
        if before["transfer_id"] == transfer_id(key):
            return "imported, not measured here" if is_foreign(before) else "failed before"
        others = json_text([list(one) for one in siblings]) if siblings else ""
        now = (demonstration.sha256, source.sha256, target.sha256, settings.sha256, others)
        compared = zip(_CHANGES.items(), now, strict=True)
        changes = [f"{what} changed" for (what, name), value in compared if before[name] != value]
        program = tuple(before[name] for name in _PROGRAM)
        if program not in self._known:  # few rows differ in it; another machine plans the same
            self._known[program] = tuple(causes(dict(zip(_PROGRAM, program, strict=True)), METHOD_VERSION))
        return ", ".join([*changes, *self._known[program]]) or "an older version is back"


_CHANGES = {name: f"{name}_sha256" for name in ("demonstration", "source", "target", "settings")}
_CHANGES["siblings"] = "siblings"
_PROGRAM = ("method_version", "code_version", "sources_sha256", "libraries")
_SLOT = ("demonstration_id", "target_id", "preset")

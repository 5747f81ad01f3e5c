"""Why a pair is planned anew: what changed since the newest plan that the catalog has of it."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property

import pyarrow as pa

from upplied.catalog import Catalog
from upplied.catalog.schema.plan_rows import transfer_id
from upplied.catalog.schema.rows import json_text
from upplied.config import Settings
from upplied.fleet.siblings import Siblings
from upplied.planning.plan import METHOD_VERSION
from upplied.provenance import causes
from upplied.records import Demonstration, Ints, Structure


class Past:
    """What the catalog's plans were made from."""

    def __init__(self, catalog: Catalog) -> None:
        self._catalog = catalog
        self._told: dict[tuple[str, ...], tuple[str, ...]] = {}

    @cached_property
    def _rows(self) -> pa.Table:
        """The newest plan of each demonstration, target and preset; a quiet night never asks."""
        return self._catalog.newest_plans(_COMPARED)

    @cached_property
    def _places(self) -> dict[tuple[str, str, str], int]:
        names = (_texts(self._rows[name]) for name in _COMPARED[:3])
        return {name: place for place, name in enumerate(zip(*names, strict=True))}

    @cached_property
    def _columns(self) -> list[tuple[list[str], Ints]]:
        """What the rows say, by column: the texts, and which of them each row has."""
        encoded = (self._rows[name].combine_chunks() for name in _COMPARED[3:])
        # Missing in rows of before there was such a column: the last text, by index -1, is none.
        return [
            ([*column.dictionary.to_pylist(), ""], column.indices.fill_null(-1).to_numpy())
            for column in encoded
        ]

    def why(
        self,
        demonstration: Demonstration,
        source: Structure,
        target: Structure,
        settings: Settings,
        siblings: Siblings,
        key: str,
    ) -> str:
        """What changed since the newest plan of the pair, in words."""
        place = self._places.get((demonstration.demonstration_id, target.structure_id, settings.preset))
        if place is None:
            return "new pair"
        if self._rows["transfer_id"][place].as_py() == transfer_id(key):
            return "failed before"
        texts_now = [texts[codes[place]] for texts, codes in self._columns]
        others = json_text([list(one) for one in siblings]) if siblings else ""
        now = (demonstration.sha256, source.sha256, target.sha256, settings.sha256, others)
        changed = zip(_CHANGES, texts_now[: len(_CHANGES)], now, strict=True)
        changes = [f"{what} changed" for what, was, is_now in changed if was != is_now]
        return ", ".join([*changes, *self._causes(*texts_now[len(_CHANGES) :])]) or "an older version is back"

    def _causes(self, *said: str) -> tuple[str, ...]:
        """Why the program may plan otherwise; few rows differ in what they say of theirs."""
        if said not in self._told:
            row = dict(zip(_PROGRAM, said, strict=True))  # another machine plans the same
            self._told[said] = tuple(causes(row, METHOD_VERSION))
        return self._told[said]


def _texts(column: pa.ChunkedArray) -> Iterator[str]:
    """The texts of a column with a dictionary, each kept once."""
    encoded = column.combine_chunks()
    return map(encoded.dictionary.to_pylist().__getitem__, encoded.indices.to_numpy())


_CHANGES = {
    "demonstration": "demonstration_sha256",
    "source": "source_sha256",
    "target": "target_sha256",
    "settings": "settings_sha256",
    "siblings": "siblings",
}
_PROGRAM = ("method_version", "code_version", "sources_sha256", "libraries")
_COMPARED = ("demonstration_id", "target_id", "preset", *_CHANGES.values(), *_PROGRAM)

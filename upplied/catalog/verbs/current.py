"""The current version of single rows, for processes that ask for one after the other."""

from __future__ import annotations

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.dataset as ds

from upplied.catalog.schema import rows
from upplied.catalog.schema.rows import Row
from upplied.catalog.store.delta import StoredTable
from upplied.catalog.store.errors import explained
from upplied.catalog.verbs import ordering

_MOST_ROWS = 50_000  # kept at hand, a kilobyte each


class Current:
    """Finds the newest row of an id; a table that is small is read once for each of its versions.

    Parameters
    ----------
    table : StoredTable
        `structures` or `demonstrations`.
    """

    def __init__(self, table: StoredTable) -> None:
        self._table = table
        self._name = table.declared.names[0]
        self._at_hand: tuple[ds.Dataset, pa.Table, dict[str, list[int]]] | None = None

    def row(self, name: str) -> Row | None:
        """The current version of an id, retired or not; None where there is none."""
        dataset = self._table.dataset()
        if dataset is None:
            return None
        held = self._at_hand
        if held is None or held[0] is not dataset:
            if explained(self._table.uri, dataset.count_rows) > _MOST_ROWS:
                newest = ordering.newest_rows(self._table, pc.field(self._name) == name)
                return newest[0] if newest else None
            held = self._at_hand = dataset, *self._read()
        _, table, places = held
        return ordering.newest_of(rows.rows_of(table.take(places[name]))) if name in places else None

    def _read(self) -> tuple[pa.Table, dict[str, list[int]]]:
        table = self._table.read()
        places: dict[str, list[int]] = {}
        for place, name in enumerate(table[self._name].to_pylist()):
            places.setdefault(name, []).append(place)
        return table, places

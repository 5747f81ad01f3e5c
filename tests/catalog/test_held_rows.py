"""What is held of many rows takes no more memory than it is made of."""

from __future__ import annotations

from dataclasses import replace

import pyarrow as pa
from catalog_records import demonstration, key_of, plan, structure

from upplied.catalog import open_catalog, verify


def test_rows_that_are_held_take_their_own_bytes_alone(tmp_path):
    """Columns as they were read kept what they were decoded in: fourteen times as much."""
    catalog = open_catalog(tmp_path)
    catalog.add_plans([(key_of(0), plan("t0", 0), {})])
    table = catalog.tables["transfers"]
    names = pa.array([f"{number:020d}" for number in range(40_000)])
    rows = table.read().take(pa.array([0] * len(names)))
    at = rows.schema.get_field_index("transfer_id")
    table.append(rows.set_column(at, rows.schema.field(at), names))
    before = pa.total_allocated_bytes()
    narrow = table.narrow(["transfer_id", "waypoints_sha256", "settings_json", "target_id"])
    assert len(narrow) == len(names) + 1
    assert pa.total_allocated_bytes() - before < 1.5 * narrow.nbytes


def test_steps_are_found_in_whatever_order_their_owners_came(tmp_path):
    catalog = open_catalog(tmp_path)
    catalog.add_structures([structure("boxy"), structure("target", 1)])
    for number, name in enumerate(("second", "first", "third")):
        catalog.add_demonstrations([replace(demonstration(), demonstration_id=name, sha256="")])
        catalog.add_plans([(key_of(number), plan("target", number), {})])
    findings = [each for each in verify(catalog) if "is not in" not in each.found]
    assert findings == []

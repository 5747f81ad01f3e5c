"""How long the history of one patch takes to ask for, in a catalog of many flights.

    python bench/history.py [--structures N] [--flights N] [--patches N]

The rows of `flights` are those of all structures; the looks of one structure's flights are stored, since
nobody asks for those of others. What the files of a page cache cost is not told.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from datetime import UTC, datetime, timedelta

import numpy as np

from upplied.catalog import open_catalog
from upplied.catalog.schema.rows import table_of
from upplied.catalog.schema.tables import TABLES
from upplied.catalog.verbs.maintenance import merge

_BATCH = 500  # structures whose flights are committed together
_START = datetime(2024, 1, 1, tzinfo=UTC)


def main() -> None:
    """Fill a catalog and print how long it takes to ask."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--structures", type=int, default=10_000)
    parser.add_argument("--flights", type=int, default=36, help="of each structure, a month apart")
    parser.add_argument("--patches", type=int, default=5000, help="of each structure")
    options = parser.parse_args()
    rng = np.random.default_rng(0)
    with tempfile.TemporaryDirectory() as place:
        catalog = open_catalog(place).create()
        points = rng.random((options.patches, 3)) * 50
        structure_id, looks = f"s{options.structures // 2:05}", []
        for _ in range(options.flights):
            seen = rng.random(options.patches) < 0.6
            values = {name: rng.random(options.patches) for name in ("distance_m", "incidence_deg")}
            values |= {name: rng.random(options.patches) for name in ("speed_mps", "t_s")}
            looks.append(catalog.put_looks(points, None, seen, values))
        began = time.perf_counter()
        for first in range(0, options.structures, _BATCH):
            names = [f"s{at:05}" for at in range(first, min(first + _BATCH, options.structures))]
            rows = [_row(name, month, looks[month]) for name in names for month in range(options.flights)]
            catalog.tables["flights"].append(table_of(TABLES["flights"], rows))
        merge(catalog.tables["flights"], 1 << 20)
        print(f"{options.structures * options.flights} flights kept in {time.perf_counter() - began:.1f} s")
        again = open_catalog(place)
        for what in ("first", "again", "again"):
            began, cpu = time.perf_counter(), time.process_time()
            history = again.looks_at(structure_id, points[17])
            wall, cpu = time.perf_counter() - began, time.process_time() - cpu
            saw = f"{history['seen'].sum()} of {len(history)} saw it"
            print(f"{what:6} {wall:.3f} s, {cpu:.3f} s of CPU: {saw}")


def _row(structure: str, month: int, looks: str) -> dict[str, object]:
    return {
        "flight_id": f"{structure}-{month}",
        "transfer_id": f"plan-{structure}",
        "kind": "flown",
        "target_id": structure,
        "flown_at": _START + timedelta(days=30 * month),
        "findings": "no photo times are known: the camera is taken to see all the time",
        "flight_sha256": looks,
        "looks_sha256": looks,
        "commit_id": "bench",
    }


if __name__ == "__main__":
    main()

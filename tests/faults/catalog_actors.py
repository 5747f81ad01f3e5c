"""What the processes of the catalog's fault test do, each until it is killed or told to stop."""

from __future__ import annotations

import json
import multiprocessing
import os
import sys
import time
import traceback
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd

sys.path.insert(0, str(Path(__file__).parents[1]))

from catalog_records import key_of, plan

from upplied.catalog import compact, export_tables, open_catalog, published_tables, vacuum
from upplied.catalog.database import Catalog

BATCH = 5
POINTS = 20


def write(catalog: Catalog, place: Path, seed: int) -> Callable[[], None]:
    """Add plans; note those that were acknowledged, after they were. Every fourth batch is everybody's."""
    rng = np.random.default_rng(seed)
    notes = os.open(place / f"acknowledged-{seed}", os.O_WRONLY | os.O_CREAT | os.O_APPEND)
    number_written = 0

    def once() -> None:
        nonlocal number_written
        owner = "shared" if number_written % 4 == 3 else seed
        number = int(rng.integers(40)) if owner == "shared" else number_written
        batch = []
        for at in range(BATCH):
            name = f"t-{owner}-{number}-{at}"
            record = replace(plan(name, number, POINTS), surface=None)
            batch.append((key_of(name), record, {"run_id": f"writer-{seed}"}))
        catalog.add_plans(batch)
        os.write(notes, "".join(f"{key}\n" for key, _, _ in batch).encode())
        number_written += 1

    return once


def read(catalog: Catalog, place: Path, seed: int) -> Callable[[], None]:
    """Look for anything that must not be: fewer rows, a plan twice, a trajectory without its points."""
    rng = np.random.default_rng(seed)
    rows, published, reads = 0, 0, 0

    def once() -> None:
        nonlocal rows, published, reads
        rows_now = catalog.transfers(columns=["key", "transfer_id", "n_waypoints"])
        assert len(rows_now) >= rows, f"{len(rows_now)} rows after {rows}"
        assert rows_now["key"].is_unique
        rows = len(rows_now)
        for name in rng.choice(rows_now["transfer_id"], min(3, rows), replace=False):
            assert len(catalog.waypoints(name)) == POINTS
        if (place / "reports" / "tables" / "current").exists():
            transfers, points = published_ids(place / "reports")
            assert len(transfers) >= published, f"{len(transfers)} published rows after {published}"
            counts = points["transfer_id"].value_counts()
            assert (counts.reindex(transfers["transfer_id"], fill_value=0) == POINTS).all()
            published = len(transfers)
        reads += 1
        counts = {"reads": reads, "rows": rows, "published": published}
        (place / f"reads-{seed}").write_text(json.dumps(counts))

    return once


def published_ids(place: Path) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Of one generation: two were published since where it is gone before it is read."""
    while True:
        tables = published_tables(place)
        try:
            transfers, points = (
                pd.read_parquet(tables[name], columns=["transfer_id"]) for name in ("transfers", "waypoints")
            )
        except (FileNotFoundError, KeyError):
            continue
        return transfers, points


def publish(catalog: Catalog, place: Path, seed: int) -> Callable[[], None]:
    """Publish the tables again and again."""
    return lambda: export_tables(catalog, place / "reports") and None


def maintain(catalog: Catalog, place: Path, seed: int) -> Callable[[], None]:
    """Compact and vacuum again and again, keeping the shortest history there is."""

    def once() -> None:
        compact(catalog)
        vacuum(catalog, keep_days=1 / 24)
        time.sleep(0.2)

    return once


ROLES = {"writer": write, "reader": read, "publisher": publish, "maintenance": maintain}


def act(role: str, place: str, seed: int) -> None:
    """Play a role until killed, told to stop or left alone; whatever goes wrong is noted."""
    folder, stage = Path(place), multiprocessing.parent_process()
    try:
        once = ROLES[role](open_catalog(folder / "catalog"), folder, seed)
        while not (folder / "stop").exists() and (stage is None or stage.is_alive()):
            once()
    except BaseException:
        (folder / f"trouble-{role}-{seed}").write_text(traceback.format_exc())
        raise

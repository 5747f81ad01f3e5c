"""How many of the bytes and fields of a catalog that are rewritten behind its back `catalog verify` finds.

    python bench/custody.py --count 1000

Every other time one byte of a random file becomes another, and every other time one field of a random row,
with which its data file is written again. Told besides: of how many fields the row was named too. It is not
where the log says that a column is empty, which is then never read.
"""

from __future__ import annotations

import argparse
import random
import shutil
import sys
import tempfile
from collections import Counter
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from upplied.catalog import Catalog, open_catalog, verify
from upplied.errors import CatalogError
from upplied.records import Demonstration, Measures, Plan, Structure, SurfaceStates, Trajectory

PLANS = 4


def write_catalog(place: Path) -> None:
    """A small catalog that has something in every table and folder."""
    rng = np.random.default_rng(0)
    catalog = open_catalog(place)
    corners = rng.normal(size=(40, 3)) * 10
    faces = rng.integers(0, 40, (30, 3))
    catalog.add_structures(
        [Structure(name, "box", corners + at, faces, sha256=name * 8) for at, name in enumerate("ab")]
    )
    path = Trajectory(np.arange(20.0), rng.normal(size=(20, 3)), np.tile([0.0, 0, 0, 1], (20, 1)))
    t_ns = (path.t_s * 1e9).astype(np.int64) + 1_700_000_000_000_000_000
    catalog.add_demonstrations(
        [Demonstration("flight", "a", t_ns, path.positions, path.quat_xyzw, sha256="c" * 64)]
    )
    for at in range(PLANS):
        surface = SurfaceStates(corners, rng.integers(0, 5, 40))
        about = {"is_viewpoint": path.t_s > at, "measures": Measures(min_clearance_m=3.0), "flyable": True}
        inputs = ("flight", "a", "b", "box", "recommended", "ok")
        plan = Plan(*inputs, trajectory=path, surface=surface, **about)
        catalog.add_plans([(f"{at}" * 64, plan, {})])
        _decide(catalog, f"{at}" * 20, path, corners)
    catalog.set("kind", "box", {"route.clearance_m": 3.0}, "Ada")
    photo = {"photo_id": "p" * 64, "flight_id": "flight", "target_id": "b", "name": "a.jpg", "path": "a.jpg",
             "sha256": "d" * 64, "t_s": 1.0}  # fmt: skip
    catalog.add_flight_photos([photo], "Ada")
    finding = {"finding_id": "f" * 64, "target_id": "b", "kind": "box", "state": "open", "class": "crack",
             "x_m": 1.0, "y_m": 2.0, "z_m": 3.0, "gsd_mm": 7.0, "structure_sha256": "b" * 8}  # fmt: skip
    catalog.add_findings([finding], "Ada")
    catalog.set_finding("f", "watched", "Grace", "no longer than before")
    catalog.require("structure", "b", "welds", [{"zone": "z", "where": "box 0 0 0 1 1 1"}], "Ada")


def _decide(catalog: Catalog, name: str, path: Trajectory, points: Any) -> None:
    row = catalog.transfer(name)
    catalog.review(name, "Grace", "looks right")
    catalog.release(name, "Ada")
    looks = dict.fromkeys(("distance_m", "incidence_deg", "speed_mps", "t_s"), np.ones(len(points)))
    flight = {"flight_id": f"f{name}", "transfer_id": name, "waypoints_sha256": row["waypoints_sha256"],
              "kind": "flown", "demonstration_id": "flight", "target_id": "b", "min_clearance_m": 2.5,
              "flown_at": datetime(2026, 11, 1, tzinfo=UTC)}  # fmt: skip
    flight["looks_sha256"] = catalog.put_looks(points, None, points[:, 0] > 0, looks)
    catalog.add_flight(flight, path)
    overruled = {"transfer_id": name, "way": "export", "format": "csv", "rule": "zoom", "found": "it zooms"}
    catalog.add_overruled([overruled])
    catalog.add_edit({"edit_id": f"e{name}", "base_id": name, "transfer_id": name, "by": "Ada",
                      "demonstration_id": "flight", "target_id": "b", "words": "moved"})  # fmt: skip


def rewrite_byte(place: Path, rng: random.Random) -> tuple[str, list[str]]:
    """Change a byte of a file; what was changed, and words that findings of it must have."""
    files = sorted(path for path in place.rglob("*") if path.is_file() and path.stat().st_size)
    path = rng.choice([path for path in files if "cache" not in path.relative_to(place).parts])
    content = bytearray(path.read_bytes())
    at = rng.randrange(len(content))
    content[at] ^= rng.randrange(1, 256)
    path.write_bytes(content)
    return f"byte {at} of {path.relative_to(place)}", []


def rewrite_field(place: Path, rng: random.Random) -> tuple[str, list[str]]:
    """Change a field of a row in the data file that holds it."""
    live = {table.declared.name: table for table in open_catalog(place).tables.values()}
    name = rng.choice(sorted(name for name, table in live.items() if table.delta() is not None))
    path = Path(rng.choice(sorted(live[name].dataset().files)))  # type: ignore[union-attr]
    path = place / name / path.name
    rows = pq.read_table(path)
    at, column = rng.randrange(len(rows)), rng.choice(rows.column_names)
    values = rows[column].to_pylist()
    values[at] = another(values[at], rows.schema.field(column).type, rng)
    index = rows.column_names.index(column)
    field = rows.schema.field(column)
    pq.write_table(rows.set_column(index, field, pa.array(values, field.type)), path, compression="zstd")
    return f"{name}.{column} of row {at}", [name]


def another(value: Any, kind: pa.DataType, rng: random.Random) -> Any:
    """Another value of a type."""
    if pa.types.is_string(kind):
        return f"{value or ''}{rng.choice('abc019')}"
    if pa.types.is_boolean(kind):
        return not value
    if pa.types.is_timestamp(kind):
        return datetime(2001, 1, 1, tzinfo=UTC)
    step = rng.choice([1e-9, 0.5, 1.0, 100.0]) if pa.types.is_floating(kind) else rng.choice([1, 7, 1000])
    return step if value is None else value + step


def run(count: int, seed: int, folder: Path) -> tuple[Counter[str], list[str]]:
    """How many were found, by kind, and what was not."""
    write_catalog(folder / "sound")
    first = verify(open_catalog(folder / "sound"))
    assert first == [], first
    rng, detected, missed = random.Random(seed), Counter[str](), list[str]()
    for number in range(count):
        place = folder / "rewritten"
        shutil.copytree(folder / "sound", place)
        kind, rewrite = (("bytes", rewrite_byte), ("fields", rewrite_field))[number % 2]
        what, words = rewrite(place, rng)
        try:
            findings = [str(one) for one in verify(open_catalog(place))]
        except CatalogError as error:  # of what tells that it is a catalog
            findings = [str(error)]
        by_content = [one for one in findings if "changed after it was written; take it" not in one]
        detected[kind] += bool(findings)
        detected["fields whose row is named"] += any(word in one for word in words for one in by_content)
        if not findings:
            missed.append(what)
        shutil.rmtree(place)
    return detected, missed


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        detected, missed = run(options.count, options.seed, Path(folder))
    for what in missed:
        print("not found:", what)
    print(f"found {dict(detected)} of {options.count} rewritten bytes and fields; {len(missed)} not")
    return int(bool(missed))


if __name__ == "__main__":
    sys.exit(main())

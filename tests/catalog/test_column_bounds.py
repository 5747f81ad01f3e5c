"""What the columns of every table allow follows from what they measure."""

from __future__ import annotations

import pyarrow as pa
import pytest

from upplied.catalog.schema.tables import TABLES, Column, Table
from upplied.catalog.verbs.verification import broken as broken_mask

COLUMNS = [(table, column) for table in TABLES.values() for column in table.columns]
#: Lengths and times that are places on an axis, and not sizes.
PLACES = {"x_m", "y_m", "z_m", "alt_m", "lowest_m", "min_clearance_m", "clock_s", "t_ns"}
ANGLES = {"lat_deg": (-90, 90), "lon_deg": (-180, 360), "hfov_deg": (0, 360), "vfov_deg": (0, 180),
          "incidence_p95_deg": (0, 90)}  # fmt: skip
NUMBERS = {
    "qx": (-1, 1), "qy": (-1, 1), "qz": (-1, 1), "qw": (0, 1), "fidelity_order": (-1, 1), "seq": (0, None),
    "commit_version": (-1, None), "runner_up_gap": (None, None), "seed": (None, None), "photos": (None, None),
    "n_vertices": (1, None), "n_poses": (1, None), "picture_score": (0, 1),
}  # fmt: skip
#: What a row of each table is nothing without, beside what names it and its commit.
ESSENTIAL = {
    "structures": {"kind", "mesh_sha256", "n_vertices", "n_triangles"},
    "demonstrations": {"structure_id", "poses_sha256", "n_poses"},
    "poses": {"t_ns"},
    "transfers": {"demonstration_id", "source_id", "target_id", "preset", "status", "n_viewpoints",
                  "n_waypoints", "planned_at", "key"},
    "waypoints": {"t_s", "is_viewpoint"},
    "flights": {"transfer_id", "flight_sha256"},
    "decisions": {"transfer_id", "demonstration_id", "target_id", "state", "by"},
    "overruled": {"transfer_id", "way", "rule"},
    "settings": {"scope", "owner", "setting", "by"},
    "requirements": {"scope", "owner", "name", "by"},
    "edits": {"base_id", "demonstration_id", "target_id", "by"},
    "flight_photos": {"flight_id", "target_id", "name", "path", "sha256", "t_s"},
    "findings": {"finding_id", "target_id", "state", "by", "x_m", "y_m", "z_m", "structure_sha256"},
}  # fmt: skip


def bounds_of(column: Column) -> tuple[float | None, float | None]:
    """By its name and unit, from the physics."""
    if column.unit == "%":
        return 0, None if column.name == "coverage_paper_pct" else 100  # more may be seen than was shown
    if column.unit == "deg":
        return ANGLES.get(column.name, (None, None))
    if column.name.endswith("_probability"):
        return 0, 1
    if column.unit == "1":
        first = 1 if column.name == "version" and column.low is not None else 0
        return NUMBERS.get(column.name, (first, None))
    sized = column.unit in ("m", "mm", "m2", "s", "ns", "m/s", "m/s2", "px") and column.name not in PLACES
    return (0 if sized else None), None


@pytest.mark.parametrize(("table", "column"), COLUMNS, ids=lambda each: each.name)
def test_bounds_follow_from_what_is_measured(table: Table, column: Column) -> None:
    bounds = bounds_of(column)
    if table.name == "requirements" and column.name == "version":
        bounds = (None, None)
    assert (column.low, column.high) == bounds


@pytest.mark.parametrize("table", TABLES.values(), ids=lambda each: each.name)
def test_what_a_row_is_nothing_without_is_required(table: Table) -> None:
    required = {column.name for column in table.columns if column.required}
    named = {table.columns[0].name, "commit_id"} | ({"seq"} if "seq" in table.names else set())
    # A version is counted when it is asked for, and is not stored.
    stamped = {"added_at", "commit_version"} & set(table.names)
    assert required == ESSENTIAL[table.name] | named | stamped
    assert set(table.key) - {"version"} <= required and set(table.order) <= set(table.names)


def test_a_constraint_in_words() -> None:
    def words(**how: object) -> str:
        return Column("name", None, "", "", **how).constraint  # type: ignore[arg-type]

    assert words() == "" and words(required=True) == "required"
    assert words(required=True, allowed=("a", "b")) == "required, one of a, b"
    assert words(low=0, high=360) == "0 to 360" and words(low=0.5) == "at least 0.5" and words(high=3) == ""
    assert words(low=0, required=True) == "required, at least 0"


def broken(values: list[object], kind: object, **how: object) -> list[bool]:
    array = pa.chunked_array([values], kind)
    mask = broken_mask(Column("name", kind, "", "", **how), array)  # type: ignore[arg-type]
    return [False] * len(values) if mask is None else mask.to_pylist()


def test_values_beyond_what_a_column_allows_are_broken() -> None:
    text, real = pa.string(), pa.float64()
    assert broken(["a", "", None], text) == [False, False, False]
    assert broken(["a", "", None], text, required=True) == [False, True, True]
    assert broken(["a", "c", "", None], text, allowed=("a", "b")) == [False, True, False, False]
    assert broken(["a", "c", "", None], text, allowed=("a", "b"), required=True) == [False, True, True, True]
    assert broken([-1.0, 0, 5, 9, 9.1, None], real, low=0, high=9) == [True, False, False, False, True, False]
    assert broken([1.0, None], real, required=True, low=2) == [True, True]
    assert broken([1.0, 3.0], real, high=2) == [False, True]

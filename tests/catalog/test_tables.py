"""The declared columns: what the reports and other programs rely on."""

import re
from pathlib import Path

import pytest

from upplied.catalog.schema.tables import SCHEMA_VERSION, TABLES, data_dictionary

ROOT = Path(__file__).parents[2]

REQUIRED = {
    "transfers": "transfer_id demonstration_id source_id target_id kind preset status reason icp_score_m2 "
    "coverage_inspected_pct inspected_without_counterpart_pct inspected_unattainable_pct "
    "coverage_of_target_pct coverage_context_pct fidelity_resolution_p50 fidelity_resolution_p05 "
    "fidelity_incidence_deg_p95 fidelity_looks_kept_pct fidelity_dwell_kept_pct fidelity_order "
    "camera_turn_ratio pan_fast_pct path_turn_ratio standoff_mode gsd_mm_p50 gsd_mm_p95 "
    "gsd_demonstrated_mm_p50 gsd_demonstrated_mm_p95 frechet_floored "
    "coverage_paper_pct coverage_seen_pct coverage_attainable_pct frechet_z frechet_m min_clearance_m "
    "path_length_m duration_s standoff_ratio_p50 standoff_kept_pct incidence_p95_deg acceptance "
    "runner_up_gap counterpart_summary peak_speed_mps peak_acceleration_mps2 n_viewpoints "
    "n_waypoints planned_at run_id code_version",
    "waypoints": "transfer_id seq t_s x_m y_m z_m qx qy qz qw is_viewpoint",
    "poses": "demonstration_id seq t_ns x_m y_m z_m qx qy qz qw",
    "structures": "structure_id kind",
    "demonstrations": "demonstration_id structure_id",
}

_UNITS = {"m": "m", "m2": "m2", "s": "s", "ns": "ns", "deg": "deg", "pct": "%", "px": "px", "mm": "mm"}
_UNITS |= {"mps": "m/s", "mps2": "m/s2", "mm2": "mm2"}


@pytest.mark.parametrize("name", REQUIRED)
def test_required_columns_are_declared(name: str):
    assert set(REQUIRED[name].split()) <= set(TABLES[name].names)


def test_the_dictionary_is_current():
    written = (ROOT / "catalog" / "README.md").read_text(encoding="utf-8")
    assert written == data_dictionary(), "run: python -m upplied.catalog.schema.tables"


@pytest.mark.parametrize("table", TABLES.values(), ids=lambda table: table.name)
def test_columns_are_unique_explained_and_keyed(table):
    assert len(set(table.names)) == len(table.names)
    assert set(table.key) <= set(table.names)
    assert all(column.meaning for column in table.columns)
    assert table.schema.names == table.names


@pytest.mark.parametrize("table", TABLES.values(), ids=lambda table: table.name)
def test_a_name_carries_its_unit(table):
    for column in table.columns:
        suffix = re.sub(r"_p\d\d$", "", column.name).rsplit("_", 1)[-1]
        if suffix in _UNITS and column.name not in ("frechet_z",):
            assert column.unit == _UNITS[suffix], column.name
        elif column.unit not in ("", "1", "UTC"):
            pytest.fail(f"{column.name} is in {column.unit} and does not say so")


def test_dictionary_names_the_schema_version():
    assert f"schema version {SCHEMA_VERSION}" in data_dictionary()

"""Records to rows and back: equal in every field, bit by bit."""

from dataclasses import replace

import numpy as np
import pytest
from catalog_records import demonstration, differences, key_of, plan, structure

from upplied.catalog.schema import plan_rows, rows
from upplied.catalog.schema.steps import poses_sha256, stored_quats
from upplied.catalog.schema.tables import TABLES
from upplied.catalog.verbs.recipes import settings_of
from upplied.config import settings_for
from upplied.errors import CatalogError
from upplied.records import Measures, Structure, Surroundings, Trajectory


def through(table: str, row: dict) -> dict:
    """A row as it comes back from Arrow."""
    return rows.table_of(TABLES[table], [row]).to_pylist()[0]


@pytest.mark.parametrize("seed", range(3))
def test_structure_round_trip(seed: int):
    record = structure(seed=seed)
    back = rows.structure_of(through("structures", rows.structure_row(record, "0" * 64)), record)
    assert differences(record, back) == []


def test_bare_structure_round_trip():
    record = Structure("a", "box", np.eye(3), np.empty((0, 3), np.int64), normals=np.eye(3))
    back = rows.structure_of(through("structures", rows.structure_row(record, "0" * 64)), record)
    assert differences(record, back) == []
    assert differences(Surroundings(), back.surroundings) == []
    rallied = replace(record, surroundings=Surroundings(rally_m=np.array([[3.0, -4.0, 2.0]])))
    back = rows.structure_of(through("structures", rows.structure_row(rallied, "0" * 64)), record)
    assert back.surroundings.rally_m.tolist() == [[3.0, -4.0, 2.0]]


@pytest.mark.parametrize(("surface", "stated"), [("drawn", 0.0), ("scanned", 0.15), (None, None)])
def test_what_is_stated_of_a_surface_comes_back_and_an_older_row_states_nothing(
    surface: str | None, stated: float | None
):
    record = structure(surface=surface, surface_error_m=stated)
    row = rows.structure_row(record, "0" * 64)
    back = rows.structure_of(through("structures", row), record)
    assert (back.surface, back.surface_error_m) == (surface, stated)
    del row["surface"], row["surface_error_m"]
    older = rows.structure_of(through("structures", row), record)
    assert older.surface is None and older.surface_error_m is None


@pytest.mark.parametrize("seed", range(3))
def test_demonstration_round_trip(seed: int):
    record = demonstration(seed=seed)
    row = through("demonstrations", rows.demonstration_row(record))
    assert differences(record, rows.demonstration_of(row, rows.pose_table(record))) == []


def test_path_length_leaves_breaks_out():
    line = np.column_stack([[0.0, 1, 2, 100, 101], np.zeros(5), np.zeros(5)])
    record = demonstration(count=5, positions=line, breaks=np.array([3]))
    assert rows.demonstration_row(record)["path_length_m"] == pytest.approx(3.0)


@pytest.mark.parametrize("status", ["ok", "refused", "failed"])
def test_plan_round_trip(status: str):
    record = replace(plan(status=status), surface=None)
    row = through("transfers", plan_rows.transfer_row(key_of(status), record, {}))
    steps = plan_rows.waypoint_table({"id": record})
    assert differences(record, plan_rows.plan_of(row, steps)) == []


def test_missing_measures_are_null_not_nan():
    record = replace(plan(), measures=Measures(frechet_m=1.0))
    row = through("transfers", plan_rows.transfer_row(key_of(1), record, {}))
    assert row["frechet_m"] == 1.0
    assert row["coverage_seen_pct"] is None
    assert np.isnan(
        plan_rows.plan_of(row, plan_rows.waypoint_table({"id": record})).measures.coverage_seen_pct
    )


def test_numbers_of_any_sort_are_stored_and_what_is_none_is_null():
    none = [None, np.nan, np.float64(np.nan), np.float32(np.nan)]
    values = [1, 1.5, np.float32(2.5), np.float64(0.1), np.int64(3), True, np.inf, *none]
    stored = rows.table_of(TABLES["transfers"], [{"planning_s": value} for value in values])["planning_s"]
    assert stored.to_pylist() == [1.0, 1.5, 2.5, 0.1, 3.0, 1.0, np.inf, *[None] * 4]


def test_settings_are_stored_with_their_own_hash_however_their_numbers_are_written():
    """1 and 1.0 are equal: what was stored for the one is not the text of the other."""
    for weight in (1, 1.0, 1):
        settings = settings_for("recommended", optimise={"axis": weight})
        row = plan_rows.transfer_row(key_of(0), plan(), {"settings": settings})
        assert settings_of(row["settings_json"]).sha256 == row["settings_sha256"] == settings.sha256


def test_stored_orientations_have_w_not_negative_and_are_the_same():
    quats = np.random.default_rng(1).normal(size=(40, 4))
    stored = stored_quats(quats)
    assert (stored[:, 3] >= 0).all()
    assert np.array_equal(np.abs(stored), np.abs(quats))
    sign = np.sign(stored[:, 0] * quats[:, 0])
    assert np.array_equal(stored, quats * sign[:, None])


def test_the_hash_of_poses_sees_every_number():
    path = plan().trajectory
    before = poses_sha256(path.t_s, path.positions, path.quat_xyzw)
    for name in ("t_s", "positions", "quat_xyzw"):
        changed = getattr(path, name).copy()
        changed.flat[-1] = np.nextafter(changed.flat[-1], 2)
        other = replace(path, **{name: changed})
        assert poses_sha256(other.t_s, other.positions, other.quat_xyzw) != before
    opposite = Trajectory(path.t_s, path.positions, -path.quat_xyzw)
    assert poses_sha256(opposite.t_s, opposite.positions, opposite.quat_xyzw) == before


def test_provenance_is_kept_and_a_slip_is_named():
    settings = settings_for("paper", route={"clearance_m": 3.0})
    row = plan_rows.transfer_row(key_of(0), plan(preset="paper"), {"settings": settings, "run_id": "r"})
    assert row["settings_sha256"] == settings.sha256
    assert '"clearance_m":3.0' in row["settings_json"]
    with pytest.raises(CatalogError, match="runid"):
        plan_rows.transfer_row(key_of(0), plan(), {"runid": "r"})

"""Changes of plans: kept as such, judged as every plan, taken over to plans made later, or told why not."""

from __future__ import annotations

import hashlib
import json
from dataclasses import replace

import numpy as np
import pytest

from upplied.catalog import open_catalog
from upplied.catalog.database import Catalog
from upplied.errors import InputError
from upplied.fleet.edits import carry_edits, edit_plan, write_edit
from upplied.geometry.poses import interpolate
from upplied.geometry.scene import scene_of
from upplied.planning.airspace.rules import path_clearance
from upplied.proof.carried_edit import (
    StoredEdit,
    ViewpointChange,
    combined,
    edit_from_json,
    edit_json,
    matched_edit,
    stored_edit,
)
from upplied.proof.edit import AirspaceLimits, Edit, Viewpoint, viewpoints_of
from upplied.records import Plan
from upplied.samples.fleet import member
from upplied.samples.pilot import fly

CUBE = member("cube-v1").structure
FLOWN = fly(CUBE, "sides", seed=1)
PATH = interpolate(FLOWN.trajectory, np.arange(0.0, 60.0, 0.5))
FLAGS = np.arange(len(PATH)) % 10 == 0
BEFORE = viewpoints_of(PATH, FLAGS)
LITTLE = np.array([0.0, 0.0, 0.1])
BOX = (0.0, 0.0, 0.0, 1.0, 1.0, 1.0)


def planned(name: str, **fields) -> tuple[str, Plan, dict]:
    """A plan of the cube, flown as it was demonstrated, and its key."""
    plan = Plan(FLOWN.demonstration_id, "cube-v1", "cube-v1", CUBE.kind, "recommended", "ok",
                trajectory=PATH, is_viewpoint=FLAGS, flyable=True)  # fmt: skip
    return hashlib.sha256(name.encode()).hexdigest(), replace(plan, **fields), {}


@pytest.fixture
def catalog(tmp_path) -> Catalog:
    catalog = open_catalog(tmp_path / "catalog")
    catalog.add_structures([CUBE])
    catalog.add_demonstrations([FLOWN])
    catalog.add_plans([planned("first", counterpart_summary="its only part")])
    return catalog


def changed(catalog: Catalog, tmp_path, plan: str, by: str = "Ada", **edits) -> str:
    """The plan with viewpoint 3 left out and viewpoint 6 half a metre higher, and what else is asked."""
    path = write_edit(catalog, plan, tmp_path / "edit.json")
    edit = json.loads(path.read_text()) | edits
    edit["viewpoints"] = [row for row in edit["viewpoints"] if row["viewpoint"] != 3]
    edit["viewpoints"][5]["z_m"] += 0.5
    path.write_text(json.dumps(edit))
    return edit_plan(catalog, plan, path, by)


def newest(catalog: Catalog):
    (row,) = catalog.transfers(preset="recommended").to_dict("records")
    return row


def places(catalog: Catalog, plan: str) -> np.ndarray:
    steps = catalog.waypoints(plan)
    return steps.loc[steps["is_viewpoint"], ["x_m", "y_m", "z_m"]].to_numpy()


@pytest.mark.ci
def test_a_change_is_carried_over_to_the_next_draft_once(catalog, tmp_path):
    first = newest(catalog)["transfer_id"]
    draft = changed(catalog, tmp_path, first)
    (row,) = catalog.edits().to_dict("records")
    assert (row["base_id"], row["transfer_id"], row["by"]) == (first, draft, "Ada")
    assert newest(catalog)["transfer_id"] == draft and carry_edits(catalog) == []
    assert newest(catalog)["counterpart_summary"] == "its only part"  # the changed plan says it as well
    # the night plans the pair anew, a little lower: the same two viewpoints are changed in it
    lower = replace(PATH, positions=PATH.positions - LITTLE)
    catalog.add_plans([planned("second", trajectory=lower)])
    second = newest(catalog)["transfer_id"]
    assert carry_edits(catalog) == []
    third = newest(catalog)
    assert third["transfer_id"] not in (first, draft, second)
    assert "changed by Ada, carried over" in json.loads(third["warnings"])[0]
    expected = np.array([v.position for n, v in enumerate(BEFORE) if n not in (3, 6)]) - LITTLE
    actual = places(catalog, third["transfer_id"])
    gaps = np.linalg.norm(actual[:, None] - expected[None], axis=2).min(axis=0)
    assert gaps.max() < 1e-6  # all the others, as they were planned
    assert np.linalg.norm(actual - BEFORE[3].position, axis=1).min() > 0.3  # left out
    raised = np.array(BEFORE[6].position) + 5 * LITTLE
    assert np.linalg.norm(actual - raised, axis=1).min() < 1e-3  # where the person wanted it
    assert carry_edits(catalog) == [] and newest(catalog)["transfer_id"] == third["transfer_id"]
    assert list(catalog.edits()["base_id"]) == [first, second]


@pytest.mark.slow
def test_a_change_that_a_kill_left_without_its_plan_is_carried_over(catalog, tmp_path, monkeypatch):
    plan = newest(catalog)["transfer_id"]

    def killed(*_: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(Catalog, "add_plans", killed)
        changed(catalog, tmp_path, plan)
    assert newest(catalog)["transfer_id"] == plan and len(catalog.edits()) == 1
    catalog.add_plans([planned("second", trajectory=replace(PATH, positions=PATH.positions + LITTLE))])
    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(Catalog, "add_plans", killed)
        carry_edits(catalog)
    assert carry_edits(catalog) == []
    assert "carried over" in newest(catalog)["warnings"] and len(catalog.edits()) == 2


@pytest.mark.ci
def test_what_has_no_place_in_the_next_draft_is_told_and_kept(catalog, tmp_path):
    changed(catalog, tmp_path, newest(catalog)["transfer_id"])
    away = replace(PATH, positions=PATH.positions + 400 * LITTLE)
    catalog.add_plans([planned("elsewhere", trajectory=away)])
    (message,) = carry_edits(catalog)
    assert "the change by Ada" in message and "is not in the newest draft" in message and "m off" in message
    last = catalog.edits().iloc[-1]
    assert last["transfer_id"] == "" and last["lost"] and carry_edits(catalog) == []


@pytest.mark.ci
def test_a_rejected_change_is_not_carried_over(catalog, tmp_path):
    draft = changed(catalog, tmp_path, newest(catalog)["transfer_id"])
    catalog.reject(draft, "Ben")
    catalog.add_plans([planned("second", trajectory=replace(PATH, positions=PATH.positions + LITTLE))])
    second = newest(catalog)["transfer_id"]
    assert carry_edits(catalog) == [] and newest(catalog)["transfer_id"] == second


@pytest.mark.ci
def test_more_distance_is_kept_and_kept_on_when_the_plan_is_changed_again(catalog, tmp_path):
    plan = newest(catalog)
    scene = scene_of(CUBE)
    clearance_m = path_clearance(scene, PATH.positions).distance_m + 0.4
    path = write_edit(catalog, plan["transfer_id"], tmp_path / "more.json")
    path.write_text(json.dumps(json.loads(path.read_text()) | {"clearance_m": clearance_m}))
    draft = edit_plan(catalog, plan["transfer_id"], path, "Ada")
    assert newest(catalog)["min_clearance_m"] >= clearance_m - 1e-6
    path = write_edit(catalog, draft, tmp_path / "again.json")
    edit = json.loads(path.read_text())
    edit["viewpoints"] = edit["viewpoints"][1:]
    path.write_text(json.dumps(edit))
    edit_plan(catalog, draft, path, "Ben")
    assert newest(catalog)["min_clearance_m"] >= clearance_m - 1e-6
    stored = edit_from_json(catalog.edits().iloc[-1]["edit_json"])
    assert stored.airspace.clearance_m == pytest.approx(clearance_m) and len(stored.touched) == 1
    with pytest.raises(InputError, match="changes nothing"):
        path = write_edit(catalog, draft, tmp_path / "same.json")
        edit_plan(catalog, draft, path, "Ben")


def test_two_changes_together_are_one():
    up = replace(BEFORE[6], position=(*BEFORE[6].position[:2], BEFORE[6].position[2] + 0.5))
    further = replace(up, pitch_deg=-30.0)
    one = stored_edit(BEFORE, Edit((3,), {6: up}), AirspaceLimits((BOX,), None), False)
    two = StoredEdit(
        (ViewpointChange(up, further), ViewpointChange(BEFORE[8], None)), AirspaceLimits((BOX,), 3.0), True
    )
    both = combined(one, two)
    assert both.touched == (
        ViewpointChange(BEFORE[3], None),
        ViewpointChange(BEFORE[6], further),
        ViewpointChange(BEFORE[8], None),
    )
    assert both.airspace == AirspaceLimits((BOX,), 3.0) and both.replanned
    assert edit_from_json(edit_json(both)) == both
    assert matched_edit(both, BEFORE) == (Edit((3, 8), {6: further}), ())
    for text in ("", "[]", '{"touched":[{"was":null,"wanted":null}]}', '{"touched": 3}'):
        with pytest.raises(InputError, match="cannot be read"):
            edit_from_json(text)


def test_a_viewpoint_is_found_again_by_its_place_and_its_direction():
    stored = StoredEdit((ViewpointChange(BEFORE[4], None),))
    turned = [replace(v, yaw_deg=v.yaw_deg + 90) for v in BEFORE]
    edit, lost = matched_edit(stored, turned)
    assert edit == Edit() and "no viewpoint corresponds" in lost[0]
    again, lost = matched_edit(
        StoredEdit((ViewpointChange(BEFORE[4], None), ViewpointChange(BEFORE[4], None))), BEFORE[:5]
    )
    assert again.deleted == (4,) and len(lost) == 1  # not two of one
    assert matched_edit(StoredEdit(), [Viewpoint((0, 0, 0), 0, 0)]) == (Edit(), ())

"""What people decide about plans: nothing that plans puts one in force, and the order of commits counts."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from dataclasses import replace
from datetime import timedelta
from pathlib import Path

import pandas as pd
import pytest
from catalog_records import copied, demonstration, key_of, plan, structure
from hypothesis import given
from hypothesis import strategies as st

from upplied.catalog import export_dataset, export_tables, import_dataset, open_catalog, verify
from upplied.catalog.database import Catalog
from upplied.catalog.verbs.ordering import standing_of
from upplied.errors import RefusedError, SettingsError
from upplied.outputs.render import undecided

TARGET_SHA = structure("target", 1).sha256


def key(name: str) -> str:
    return key_of(name)[:20]


def add(catalog: Catalog, name: str, seed: int = 1, purpose: str = "", **more) -> str:
    record = replace(plan("target", seed, **more), flyable=True)
    catalog.add_plans([(key_of(name), record, {"purpose": purpose})])
    return key(name)


@pytest.fixture(scope="module")
def begun(tmp_path_factory) -> Catalog:
    catalog = open_catalog(tmp_path_factory.mktemp("begun"))
    catalog.add_structures([structure(), structure("target", 1)])
    catalog.add_demonstrations([demonstration()])
    add(catalog, "first")
    return catalog


@pytest.fixture
def catalog(begun, tmp_path) -> Catalog:
    return copied(begun, tmp_path / "catalog")


def states(catalog: Catalog) -> dict[str, str]:
    every = catalog.transfers(every=True)
    return dict(zip(every["transfer_id"], every["state"], strict=True))


@pytest.mark.ci
def test_the_released_plan_stays_in_force_while_newer_ones_are_planned(catalog, tmp_path):
    assert states(catalog) == {key("first"): "draft"} and not len(catalog.in_force())
    catalog.review(key("first"), "Ada", "looks right")
    assert states(catalog) == {key("first"): "reviewed"}
    catalog.release(key("first"), "Grace", "for May")
    second = add(catalog, "second", 2)
    assert list(catalog.transfers()["transfer_id"]) == [second]
    (row,) = catalog.in_force().to_dict("records")
    assert (row["transfer_id"], row["newer_draft"]) == (key("first"), second)
    assert (row["state_by"], row["state_note"], row["target_changed"]) == ("Grace", "for May", False)
    export_tables(catalog, tmp_path / "out")
    published = pd.read_parquet(tmp_path / "out" / "transfers.parquet")
    assert list(published["transfer_id"]) == [key("first")] and list(published["state"]) == ["released"]
    assert len(pd.read_parquet(tmp_path / "out" / "waypoints.parquet")) == published["n_waypoints"].sum()
    assert list(pd.read_parquet(tmp_path / "out" / "decisions.parquet")["state"]) == ["reviewed", "released"]
    catalog.release(second, "Grace")
    assert states(catalog) == {key("first"): "superseded", second: "released"}
    assert verify(catalog) == []


def test_what_was_in_force_is_told_of_a_moment(catalog):
    catalog.release(key("first"), "Grace")
    then = catalog.decisions()["added_at"].iloc[-1]
    catalog.release(add(catalog, "second", 2), "Grace")
    query = {"in_force": True, "columns": ["transfer_id", "state"]}
    assert list(catalog.transfers(as_of=then, **query)["transfer_id"]) == [key("first")]
    assert list(catalog.transfers(**query)["transfer_id"]) == [key("second")]


def test_a_plan_that_is_rejected_or_recalled_leaves_nothing_in_force(catalog):
    catalog.release(key("first"), "Grace")
    second = add(catalog, "second", 2)
    catalog.release(second, "Grace")
    catalog.reject(second, "Ada", "too near the mast")
    assert not len(catalog.in_force())
    assert states(catalog) == {key("first"): "superseded", second: "rejected"}
    with pytest.raises(RefusedError, match=r"it was rejected.*--force rejected"):
        catalog.release(second, "Grace")
    catalog.release(second, "Grace", force=["rejected"])
    assert catalog.decisions(second)["forced"].iloc[-1] == "rejected: it was rejected"
    assert list(catalog.in_force()["transfer_id"]) == [second]


def test_what_was_decided_against_is_not_given_out(catalog):
    """Neither as a mission nor as a trajectory; a draft is looked at, and what is in force is flown."""

    def broken(name):
        rows = catalog.transfers(every=True).set_index("transfer_id", drop=False)
        return [breach.rule for breach in undecided(catalog, rows.loc[name].to_dict())]

    first = key("first")
    assert broken(first) == ["released"] and len(catalog.trajectory(first).t_s) == 60
    catalog.release(first, "Grace")
    second = add(catalog, "second", 2)
    assert broken(first) == [] and len(catalog.trajectory(first).t_s) == 60  # though there is a newer draft
    catalog.reject(second, "Ada", "too near the mast")
    assert broken(second) == ["rejected"]
    with pytest.raises(RefusedError, match=r'rejected: the plan is rejected.*force=\["rejected"\]'):
        catalog.trajectory(second)
    assert len(catalog.trajectory(second, ["rejected"]).t_s) == 60
    catalog.recall(catalog.transfer(first), "a new mast", TARGET_SHA, "the check")
    assert broken(first) == ["recalled"]
    with pytest.raises(RefusedError, match="the plan is recalled"):
        catalog.trajectory(first)


@pytest.mark.parametrize(
    ("change", "rule"),
    [
        ({"flyable": False, "not_flyable": "0.4 m"}, "verdict"),
        ({"preset": "baseline", "flyable": True}, "preset"),
    ],
)
def test_what_must_not_be_flown_is_released_by_the_name_of_its_rule_alone(catalog, change, rule):
    catalog.add_plans([(key_of("bad"), replace(plan("target", 3), **change), {})])
    for force in ([], ["changed"]):
        with pytest.raises(RefusedError, match=f"--force {rule}"):
            catalog.release(key("bad"), "Grace", force=force)
    with pytest.raises(SettingsError, match="one of preset, verdict"):
        catalog.release(key("bad"), "Grace", force=["everything"])
    catalog.release(key("bad"), "Grace", force=[rule])
    assert list(catalog.in_force()["transfer_id"]) == [key("bad")]


def test_what_has_no_path_is_never_decided_about(catalog):
    add(catalog, "refused", status="refused")
    for decide in (catalog.review, catalog.reject, catalog.release):
        with pytest.raises(RefusedError, match="has no path"):
            decide(key("refused"), "Grace")
    with pytest.raises(SettingsError, match="Say --by NAME"):
        catalog.release(key("first"), " ")


def test_a_plan_of_a_structure_that_changed_since_is_not_released_unseen(catalog):
    catalog.release(key("first"), "Grace")
    catalog.add_structures([structure("target", 5)])
    assert list(catalog.in_force()["target_changed"]) == [True]
    with pytest.raises(RefusedError, match="target changed since it was planned"):
        catalog.release(key("first"), "Grace")
    catalog.release(key("first"), "Grace", force=["changed"])
    assert list(catalog.in_force()["target_changed"]) == [False]


def test_an_experiment_is_never_current_and_never_in_force(catalog):
    tried = add(catalog, "tried", 4, purpose="experiment near")
    assert list(catalog.transfers()["transfer_id"]) == [key("first")]
    assert list(catalog.transfers(purpose="experiment near")["transfer_id"]) == [tried]
    assert set(catalog.settled([key_of("first"), key_of("tried")])) == {key_of("first"), key_of("tried")}
    with pytest.raises(RefusedError, match="an experiment is never in force"):
        catalog.release(tried, "Grace", force=["preset", "verdict"])


def test_decisions_stay_where_they_were_made(catalog, tmp_path):
    catalog.release(key("first"), "Grace")
    export_dataset(catalog, tmp_path / "set", "boxes-v1", [key("first")], "CC0-1.0")
    there = open_catalog(tmp_path / "there")
    import_dataset(there, tmp_path / "set")
    assert states(there) == {key("first"): "draft"} and not len(there.in_force())


# --- two at once, clocks, kills ----------------------------------------------------------------


def test_of_two_who_release_at_once_the_second_is_told(catalog):
    second = add(catalog, "second", 2)
    before = ""  # what both saw: nothing was decided yet
    catalog.release(second, "Ada", after=before)
    with pytest.raises(RefusedError, match=f"Ada released {second}"):
        catalog.release(key("first"), "Grace", after=before)
    assert list(catalog.in_force()["transfer_id"]) == [second]
    assert states(catalog) == {key("first"): "draft", second: "released"}


def test_many_who_release_at_once_leave_one_plan_in_force(catalog):
    names = [add(catalog, f"n{at}", at + 2) for at in range(4)]
    winners: list[str] = []
    gate = threading.Barrier(len(names))

    def one(name: str) -> None:
        own = open_catalog(catalog.location)
        gate.wait()
        try:
            own.release(name, name, after="")
            winners.append(name)
        except RefusedError:
            pass

    threads = [threading.Thread(target=one, args=(name,)) for name in names]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(winners) == 1 and list(catalog.in_force()["transfer_id"]) == winners
    assert len(catalog.decisions()) == len(names)  # the others are on record, and do not count


def test_a_clock_that_runs_behind_does_not_change_what_is_in_force(catalog, monkeypatch):
    catalog.release(key("first"), "Grace")
    second = add(catalog, "second", 2)
    late = open_catalog(catalog.location)
    now = late.clock.now()
    for table in late.tables.values():
        monkeypatch.setattr(table._clock, "now", lambda: now - timedelta(days=400))
    late.release(second, "Ada")
    assert catalog.decisions()["added_at"].is_monotonic_increasing  # nor what is told of a moment
    assert list(catalog.in_force()["transfer_id"]) == [second]


def _plan_and_die(place: Path, moment: str) -> None:
    """A run that plans anew and is killed before or after its draft is committed."""
    catalog = open_catalog(place)
    table = catalog.tables["transfers"]
    append = table.append

    def dying(rows) -> None:
        if moment == "after":
            append(rows)
        os.kill(os.getpid(), signal.SIGKILL)

    table.append = dying
    catalog.add_plans([(key_of("second"), replace(plan("target", 2), flyable=True), {})])


@pytest.mark.slow
@pytest.mark.parametrize("moment", ["before", "after"])
def test_a_run_that_is_killed_leaves_the_released_plan_in_force(catalog, moment):
    catalog.release(key("first"), "Grace")
    process = multiprocessing.get_context("spawn").Process(
        target=_plan_and_die, args=(catalog.location, moment)
    )
    process.start()
    process.join()
    assert process.exitcode == -signal.SIGKILL
    again = open_catalog(catalog.location)
    assert list(again.in_force()["transfer_id"]) == [key("first")]
    assert (key("second") in states(again)) == (moment == "after")
    assert verify(again) == []


# --- the rules, whatever the order -------------------------------------------------------------

_ROW = {"demonstration_id": "d", "target_id": "t", "purpose": "", "by": "x", "note": "", "added_at": None}


@given(st.lists(st.tuples(st.sampled_from("abc"), st.sampled_from(["reviewed", "released", "rejected",
       "recalled", "rechecked"]), st.booleans()), max_size=12))  # fmt: skip
def test_at_most_one_plan_is_in_force_and_only_by_a_release_that_knew_what_was_decided(decisions):
    rows, last = [], ""
    for at, (plan_id, state, knows) in enumerate(decisions):
        after = last if knows else "other"
        row = {**_ROW, "decision_id": f"n{at}", "transfer_id": plan_id, "state": state, "after": after}
        rows.append({**row, "target_sha256": f"s{at}"})
        if state in ("rejected", "recalled") or (state == "released" and knows):
            last = f"n{at}"
    now = standing_of(rows)
    released = [name for name, state in now.state.items() if state == "released"]
    assert len(released) <= 1 and released == [row["transfer_id"] for row in now.in_force.values()]
    assert now.void == {r["decision_id"] for r in rows if r["state"] == "released" and r["after"] == "other"}
    for row in now.in_force.values():
        later = rows[rows.index(row) + 1 :]
        ended = [r for r in later if r["transfer_id"] == row["transfer_id"]]
        assert not [r for r in ended if r["state"] in ("rejected", "recalled")]

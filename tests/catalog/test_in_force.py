"""What is in force follows from the decisions in the order of their commits, whatever clocks say."""

from __future__ import annotations

import json
from dataclasses import replace
from datetime import UTC, datetime, timedelta

import pyarrow as pa
import pytest
from catalog_records import copied, demonstration, key_of, plan, structure
from hypothesis import given
from hypothesis import strategies as st

from upplied.catalog import Catalog, open_catalog
from upplied.catalog.schema.rows import table_of
from upplied.catalog.schema.tables import TABLES
from upplied.catalog.verbs import ordering
from upplied.catalog.verbs.ordering import standing_of
from upplied.cli import main

(DECISION_STATES,) = (column.allowed for column in TABLES["decisions"].columns if column.name == "state")
START = datetime(2026, 1, 1, tzinfo=UTC)
NAMES = ("first", "second")

one = st.tuples(
    st.sampled_from("abc"),  # plan
    st.sampled_from("tu"),  # target
    st.sampled_from(DECISION_STATES),
    st.booleans(),  # whether who releases knows what was decided
    st.integers(0, 10**6),  # seconds by the clock of who decides
)


def rows_of(drawn) -> list[dict]:
    """Decisions, of which a release that knows names the last that a release must know."""
    rows: list[dict] = []
    last: dict[str, str] = {}
    for at, (name, target, state, knows, clock) in enumerate(drawn):
        row = {"decision_id": f"n{at}", "transfer_id": name + target, "demonstration_id": "d", "purpose": ""}
        row |= {"target_id": target, "state": state, "by": "x", "note": "", "target_sha256": f"s{at}"}
        row |= {"after": last.get(target, "") if knows else "other", "commit_version": at}
        rows.append({**row, "added_at": START + timedelta(seconds=clock)})
        if state in ("rejected", "recalled") or (state == "released" and knows):
            last[target] = f"n{at}"
    return rows


def judgements(rows: list[dict]) -> dict[str, tuple[str | None, dict[str, str], str]]:
    """By target: what is in force, the state of each plan, and the target it was judged on; told naively."""
    by_target = {}
    for target in "tu":
        own = [row for row in rows if row["target_id"] == target]
        counted = [row for row in own if row["state"] != "released" or row["after"] != "other"]
        force, states, judged = None, {}, ""
        for row in counted:
            name, state = row["transfer_id"], row["state"]
            if state == "released":
                states |= {force: "superseded"} if force not in (None, name) else {}
                force, judged, states[name] = name, row["target_sha256"], "released"
            elif state in ("rejected", "recalled"):
                force, states[name] = (None if force == name else force), state
            elif state == "reviewed" and states.get(name, "draft") == "draft":
                states[name] = "reviewed"
            elif state == "rechecked" and force == name:
                judged = row["target_sha256"]
        by_target[target] = force, states, judged if force else ""
    return by_target


@given(st.lists(one, max_size=14))
def test_what_is_in_force_is_what_a_naive_reader_tells(drawn):
    rows = rows_of(drawn)
    now = standing_of(rows)
    for target, (force, states, judged) in judgements(rows).items():
        unit = ("d", target, "")
        assert now.in_force.get(unit, {}).get("transfer_id") == force
        assert {name: state for name, state in now.state.items() if name.endswith(target)} == states
        assert force is None or now.judged[unit] == judged
        assert list(states.values()).count("released") == (force is not None)


@given(st.lists(one, max_size=14), st.randoms(use_true_random=False))
def test_commits_order_decisions_and_no_clock_does(drawn, chance):
    rows = rows_of(drawn)
    stored = list(rows)
    chance.shuffle(stored)  # as files are read
    again = ordering.by_commit(table_of(TABLES["decisions"], stored))
    assert [row["decision_id"] for row in again] == [row["decision_id"] for row in rows]


@given(st.lists(one, max_size=14), one)
def test_a_review_never_changes_what_is_in_force_nor_takes_a_rejection_back(drawn, more):
    before = standing_of(rows_of(drawn))
    after = standing_of(rows_of([*drawn, (more[0], more[1], "reviewed", *more[3:])]))
    assert after.in_force == before.in_force and after.last == before.last
    decided = {name: state for name, state in before.state.items() if state != "draft"}
    assert {name: after.state[name] for name in decided} == decided


@given(st.lists(one, max_size=14))
def test_what_was_rejected_or_recalled_comes_back_by_a_release_alone(drawn):
    rows = rows_of(drawn)
    for end in range(1, len(rows)):
        before, row, now = standing_of(rows[:end]), rows[end], standing_of(rows[: end + 1])
        for name, state in before.state.items():
            if state in ("rejected", "recalled") and now.state[name] != state:
                assert row["transfer_id"] == name and row["state"] in ("released", "rejected", "recalled")


def test_the_newest_plan_is_that_of_the_last_commit_whatever_clocks_say():
    columns = {"transfer_id": ["a", "b"], "status": ["ok", "ok"], "commit_version": [2, 1]}
    columns |= {"planned_at": pa.array([START, START + timedelta(days=9)], pa.timestamp("us", "UTC"))}
    columns |= {name: ["x", "x"] for name in ordering.SLOT}
    assert ordering.in_order(pa.table(columns), newest=True)["transfer_id"].to_pylist() == ["a"]


def test_the_newest_version_of_a_structure_is_that_of_the_last_commit_whatever_clocks_say():
    class Table:
        declared = TABLES["structures"]

        @staticmethod
        def read(*_: object) -> pa.Table:
            columns = {"structure_id": ["s", "s"], "retired": [False, True], "commit_version": [2, 1]}
            when = pa.array([START, START + timedelta(days=9)], pa.timestamp("us", "UTC"))
            return pa.table(columns | {"added_at": when, "commit_id": ["last", "first"]})

    assert ordering.newest_rows(Table())["s"]["commit_id"] == "last" and ordering.retired(Table()) == []
    assert ordering.by_commit(Table.read())[-1]["commit_id"] == "last"  # as a dataset is read


# --- the command -----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def begun(tmp_path_factory) -> Catalog:
    catalog = open_catalog(tmp_path_factory.mktemp("begun"))
    catalog.add_structures([structure(), structure("target", 1), structure("other", 2)])
    catalog.add_demonstrations([demonstration()])
    for at, (name, target) in enumerate(zip(NAMES, ("target", "other"), strict=True)):
        catalog.add_plans([(key_of(name), replace(plan(target, at), flyable=True), {})])
        catalog.release(key_of(name)[:20], "Grace")
    return catalog


@pytest.fixture
def catalog(begun, tmp_path) -> Catalog:
    return copied(begun, tmp_path / "catalog")


def listed(catalog: Catalog, capsys, *more: str) -> tuple[int, list[dict], str]:
    code = main(["in-force", "--json", "--catalog", str(catalog.location), *more])
    output = capsys.readouterr()
    return code, json.loads(output.out), output.err


def test_the_command_tells_what_is_in_force_with_all_its_columns_and_exits_with_0(catalog, capsys):
    code, rows, complaints = listed(catalog, capsys)
    assert (code, complaints) == (0, "")
    assert {row["transfer_id"] for row in rows} == {key_of(name)[:20] for name in NAMES}
    for row in rows:
        assert (row["state"], row["state_by"], row["altered"]) == ("released", "Grace", "")
        assert row["target_changed"] is False and row["newer_draft"] == ""
        assert row["min_clearance_m"] == catalog.transfer(row["transfer_id"])["min_clearance_m"]
    assert [row["target_id"] for row in listed(catalog, capsys, "--structure", "other")[1]] == ["other"]


@pytest.mark.ci
def test_the_command_exits_with_1_while_a_recalled_plan_has_no_successor(catalog, capsys):
    row = catalog.transfer(key_of("first")[:20])
    catalog.recall(row, "a new mast", structure("target", 1).sha256, "the check")
    code, rows, complaints = listed(catalog, capsys)
    assert code == 1 and [each["target_id"] for each in rows] == ["other"]
    assert "recalled:" in complaints and "a new mast" in complaints
    catalog.release(row["transfer_id"], "Grace", force=["recalled"])
    assert listed(catalog, capsys)[0] == 0
    catalog.reject(row["transfer_id"], "Grace")  # a person did so: nobody need be told
    assert listed(catalog, capsys)[0] == 0


def test_a_rejected_plan_that_is_reviewed_is_still_rejected(catalog, capsys):
    name = key_of("first")[:20]
    catalog.reject(name, "Ada", "too near")
    catalog.review(name, "Grace", "fine to me")
    assert dict(catalog.transfers(every=True)[["transfer_id", "state"]].to_numpy())[name] == "rejected"
    assert main(["release", name, "--by", "Grace", "--catalog", str(catalog.location)]) == 1
    assert "--force rejected" in capsys.readouterr().err

"""What happened, what changed, and a plan made again from its row."""

from __future__ import annotations

import json
from datetime import UTC, datetime

import numpy as np
import pytest
from catalog_records import copied, demonstration, differences, key_of, plan, structure

from upplied.catalog import diff, history, open_catalog, recipe, runs
from upplied.catalog.verbs.recipes import settings_of
from upplied.config import PRESETS, settings_for
from upplied.errors import CatalogError


@pytest.fixture(scope="module")
def begun(tmp_path_factory):
    catalog = open_catalog(tmp_path_factory.mktemp("begun"))
    catalog.add_structures([structure("boxy"), structure("target", 1), structure("other", 2)])
    catalog.add_demonstrations([demonstration()])
    return catalog


@pytest.fixture
def catalog(begun, tmp_path):
    return copied(begun, tmp_path)


def planned(catalog, seed, target="target", run="run", **attributes):
    catalog.add_plans([(key_of(seed, target), plan(target, seed), {"run_id": run, **attributes})])
    return key_of(seed, target)[:20]


def test_history_tells_every_commit_newest_first(catalog):
    planned(catalog, 1)
    planned(catalog, 2)
    commits = history(catalog)
    added = commits[commits["operation"] == "add"]
    assert added.groupby("table")["rows_added"].sum().to_dict() == {
        "structures": 3,
        "demonstrations": 1,
        "transfers": 2,
    }
    assert commits["at"].is_monotonic_decreasing
    assert len(history(catalog, limit=2)) == 2
    version = added[added["table"] == "transfers"]["version"].max()
    assert len(catalog.transfers(version=int(version) - 1, every=True)) == 1


def test_runs_count_their_outcomes(catalog):
    planned(catalog, 1, run="monday")
    catalog.add_plans([(key_of(9), plan("other", status="refused"), {"run_id": "monday"})])
    planned(catalog, 2, run="tuesday")
    table = runs(catalog).set_index("run_id")
    assert list(table.index) == ["tuesday", "monday"]
    assert table.loc["monday", ["ok", "refused", "failed"]].tolist() == [1, 1, 0]


def test_diff_says_what_changed_and_why(catalog):
    planned(catalog, 1, "target", target_sha256="old")
    planned(catalog, 1, "other")
    before = datetime.now(UTC)
    planned(
        catalog,
        2,
        "target",
        target_sha256="new",
        settings=settings_for("recommended", route={"clearance_m": 3.0}),
    )
    planned(catalog, 1, "boxy")
    catalog.retire_structures(["other"])
    changes = diff(catalog, before).set_index("target_id")
    assert changes["change"].to_dict() == {"target": "replanned", "boxy": "added", "other": "gone"}
    assert changes.loc["target", "why"] == "target changed, settings changed"
    expected = plan(seed=2).measures.coverage_seen_pct - plan(seed=1).measures.coverage_seen_pct
    assert changes.loc["target", "coverage_seen_pct_change"] == pytest.approx(expected)
    assert diff(catalog, datetime.now(UTC)).empty


def test_diff_of_versions(catalog):
    for seed in (1, 2):
        planned(catalog, seed)
    assert list(diff(catalog, 1, 2)["change"]) == ["replanned"]
    assert diff(catalog, 2, 2).empty


@pytest.mark.parametrize("preset", PRESETS)
def test_settings_come_back_from_their_text(catalog, preset):
    settings = settings_for(
        preset, correspondence={"counterparts": (("engine", "outer"),)}, transfer={"gsd_m": 0.001}
    )
    catalog.add_plans([(key_of(preset), plan(preset=preset), {"settings": settings})])
    text = catalog.transfer(key_of(preset)[:20])["settings_json"]
    assert settings_of(text) == settings
    assert settings_of(text).sha256 == settings.sha256
    elsewhere = json.loads(text)
    elsewhere["optimise"]["of_another_version"] = elsewhere["of_another_version"] = {"weight": 0.002}
    elsewhere["optimise"]["__class__"] = elsewhere["sha256"] = "no setting, though settings have it"
    assert settings_of(json.dumps(elsewhere)) == settings


def test_a_recipe_holds_the_versions_that_were_read(catalog):
    name = planned(catalog, 1)
    catalog.add_structures([structure("target", 7)])
    catalog.add_demonstrations([demonstration(seed=7)])
    versions = recipe(catalog, name)
    assert differences(versions.target, structure("target", 1)) == []
    assert differences(versions.source, structure("boxy")) == []
    assert differences(versions.demonstration, demonstration()) == []
    assert versions.settings == settings_for("recommended")
    assert versions.doubts == ()


def test_a_recipe_compares_byte_for_byte(catalog):
    versions = recipe(catalog, planned(catalog, 1))
    assert versions.differences(plan("target", 1)) == []
    other = plan("target", 1)
    other.trajectory.positions[3, 1] = np.nextafter(other.trajectory.positions[3, 1], 9.0)
    assert versions.differences(other) == ["waypoints_sha256"]
    assert "coverage_seen_pct" in versions.differences(plan("target", 2))


def test_a_recipe_without_its_inputs_says_which(catalog):
    name = planned(catalog, 1, source_sha256="f" * 64)
    with pytest.raises(CatalogError, match=r"structure boxy: no version with hash ffffffffffff"):
        recipe(catalog, name)

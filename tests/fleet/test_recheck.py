"""A plan in force whose structure changed is judged on it as it now is, and recalled where it is not safe."""

from __future__ import annotations

import hashlib
from dataclasses import replace

import pytest
from fake_catalog import FakeCatalog, box_structure

from upplied.catalog import open_catalog
from upplied.catalog.database import Catalog
from upplied.cli import main
from upplied.errors import RefusedError
from upplied.fleet import recheck
from upplied.outputs.missions import MissionOptions
from upplied.outputs.pairs import pairs_of
from upplied.outputs.publish import publish_pages
from upplied.outputs.render import export_transfer

NAMED = "cuboid-0"


@pytest.fixture
def catalog(tmp_path) -> Catalog:
    """One plan in force on a box of 10 m by 8 m by 6 m, flown some 10 m from its sides."""
    fake = FakeCatalog(targets=1)
    catalog = open_catalog(tmp_path / "catalog")
    catalog.add_structures([fake.structure("cube"), fake.structure(NAMED)])
    catalog.add_demonstrations([fake.demonstration("orbit-1")])
    plan = replace(fake.plans["t0000"], flyable=True)
    catalog.add_plans([(hashlib.sha256(b"plan").hexdigest(), plan, {})])
    catalog.release(catalog.transfers()["transfer_id"].iloc[0], "Grace")
    return catalog


def changed(size: tuple[float, float, float]):
    return replace(box_structure(NAMED, size), sha256=f"changed-{size}")


def test_nothing_is_judged_again_while_nothing_changed(catalog):
    assert recheck(catalog) == [] and list(catalog.decisions()["state"]) == ["released"]


@pytest.mark.ci
def test_a_plan_that_comes_too_near_the_changed_structure_is_recalled_and_everybody_is_told(
    catalog, tmp_path, capsys
):
    plan = catalog.in_force()["transfer_id"].iloc[0]
    catalog.add_structures([changed((20, 16, 6))])
    (verdict,) = recheck(catalog)
    assert verdict.recalled and "clearance" in verdict.note and str(verdict).startswith("RECALLED")
    assert recheck(catalog) == []  # it is told once; what follows tells it until another is released
    assert not len(catalog.in_force()) and list(catalog.decisions()["state"]) == ["released", "recalled"]
    (pair,) = pairs_of(catalog.transfers(), catalog.transfers(every=True))
    assert pair.main["state"] == "recalled" and "clearance" in pair.main["state_note"]
    publish_pages(catalog, tmp_path / "reports", pictures=0)
    index = (tmp_path / "reports" / "index.html").read_text()
    assert '"recalled"' in index and "clearance" in index
    assert main(["in-force", "--catalog", catalog.location]) == 1
    assert plan in capsys.readouterr().err
    with pytest.raises(RefusedError, match="recalled by the check of changed structures"):
        export_transfer(catalog, plan, "mcap", tmp_path / "x.mcap", MissionOptions(draft=True))


@pytest.mark.slow
def test_a_plan_that_is_still_safe_stays_in_force_and_its_coverage_is_told(catalog):
    catalog.add_structures([changed((10, 8, 6.2))])
    (verdict,) = recheck(catalog)
    assert not verdict.recalled and "safe" in verdict.note
    assert list(catalog.decisions()["state"]) == ["released", "rechecked"]
    assert list(catalog.in_force()["target_changed"]) == [False] and recheck(catalog) == []
    assert main(["in-force", "--catalog", catalog.location]) == 0

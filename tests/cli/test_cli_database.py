"""The commands that ask the catalog, and what they say to those who mistype."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from catalog_records import demonstration, key_of, plan, structure

from upplied import fleet
from upplied.catalog import open_catalog
from upplied.catalog.database import Catalog
from upplied.catalog.store.files import remedy_of
from upplied.checks import pair_name
from upplied.cli import main
from upplied.errors import CatalogError, InputError

ID = key_of(0)[:20]


@pytest.fixture
def catalog(tmp_path, monkeypatch) -> Catalog:
    catalog = open_catalog(tmp_path / "catalog")
    catalog.add_structures([structure("boxy"), structure("target", 1), structure("ferry", 2, kind="ship")])
    catalog.add_demonstrations([demonstration()])
    catalog.add_plans([(key_of(at), plan("target", at), {}) for at in range(2)])
    monkeypatch.setenv("UPPLIED_CATALOG", str(catalog.location))
    return catalog


def test_a_target_of_another_kind_is_refused_in_words(catalog, capsys):
    assert main(["transfer", "flight", "--to", "ferry"]) == 2
    message = capsys.readouterr().err
    assert "is of kind ship" in message and "of kind box" in message
    with pytest.raises(InputError, match="is of kind ship, flown was box"):
        fleet.decide(catalog, fleet.PlanRequest(targets=("ferry",)))


def test_one_target_that_is_wrong_does_not_stop_the_others(catalog, capsys, monkeypatch):
    jobs = []
    monkeypatch.setattr(
        "upplied.cli.transfer.run",
        lambda catalog, decision, *_: jobs.extend(decision.jobs) or fleet.Result(),
    )
    to = ["--to", "targit", "target", "ferry", "--preset", "recommended"]
    assert main(["transfer", "flight", *to]) == 1
    message = capsys.readouterr().err
    assert "structure targit: is not in the catalog (did you mean target?)" in message
    assert "structure ferry: is of kind ship" in message
    assert [job.target_id for job in jobs] == ["target"]
    assert main(["transfer", "flight", "--to", "targit", "nothing"]) == 2


@pytest.mark.parametrize(
    ("command", "suggestion"),
    [
        (["transfer", "fligth", "--to", "target"], "did you mean flight?"),
        (["demonstrations", "retire", "fligth"], "did you mean flight?"),
        (["render", "structure", "boxxy", "-o", "x.png"], "did you mean boxy?"),
        (["catalog", "show", ID[:-2] + "zz"], f"did you mean {ID}?"),
        (["export", ID[:-2] + "zz", "--to", "csv", "-o", "x.csv"], f"did you mean {ID}?"),
    ],
)
def test_unknown_ids_are_suggested(catalog, capsys, command, suggestion):
    assert main(command) == 2
    assert suggestion in capsys.readouterr().err


def test_the_start_of_an_id_is_enough(catalog, capsys):
    assert catalog.find_transfer(ID[:6]) == catalog.find_transfer(ID) == ID
    with pytest.raises(CatalogError, match="not in the catalog"):
        catalog.find_transfer("zz")
    catalog.add_plans([("abcdef" + key_of(at)[6:], plan("boxy", at, preset="paper"), {}) for at in (7, 8)])
    with pytest.raises(CatalogError, match="may be 2: abcdef"):
        catalog.find_transfer("abcdef")
    assert main(["catalog", "show", ID[:6]]) == 0
    assert ID in capsys.readouterr().out


@pytest.mark.parametrize(("what", "name"), [("structure", "boxy"), ("demonstration", "flight"), ("plan", ID)])
def test_one_item_is_shown_whole(catalog, capsys, what, name):
    assert main(["catalog", "show", name]) == 0
    assert name in capsys.readouterr().out
    assert main(["catalog", "show", name, "--json"]) == 0
    (row,) = json.loads(capsys.readouterr().out)
    assert row["what"] == what
    if what == "plan":
        assert row["warnings"] == ["wind", 'a "quote"']
        assert row["settings_json"]["preset"] == "recommended"
        assert row["current"] is False
        assert row["min_clearance_m"] == plan("target", 0).measures.min_clearance_m


def test_json_has_every_measure_and_the_warnings(catalog, capsys):
    assert main(["catalog", "transfers", "--json"]) == 0
    (row,) = json.loads(capsys.readouterr().out)
    assert row["warnings"] == ["wind", 'a "quote"']
    assert {*vars(plan().measures)} <= set(row)


def test_demonstrations_are_retired_and_come_back(catalog, capsys):
    assert main(["demonstrations", "retire", "flight"]) == 0
    assert "1 retired, 0 already retired" in capsys.readouterr().out
    assert catalog.demonstrations().empty
    assert main(["demonstrations", "retire", "flight"]) == 0
    assert "0 retired, 1 already retired" in capsys.readouterr().out
    catalog.add_demonstrations([demonstration()])
    assert list(catalog.demonstrations()["demonstration_id"]) == ["flight"]


@pytest.mark.parametrize(
    "command",
    [
        ["export", ID, "--to", "csv", "-o", "missing/folder/x.csv"],
        ["brief", ID, "-o", "missing/folder/x.html"],
        ["render", "structure", "boxy", "-o", "missing/folder/x.png"],
    ],
)
def test_no_folder_is_made_unasked(catalog, tmp_path, monkeypatch, capsys, command):
    monkeypatch.chdir(tmp_path)
    assert main(command) == 2
    assert "mkdir -p missing/folder" in capsys.readouterr().err
    assert not Path("missing").exists()


def test_a_file_uri_is_a_folder(catalog, tmp_path):
    spaced = open_catalog((tmp_path / "a b").as_uri())
    spaced.add_structures([structure("boxy")])
    assert list(open_catalog(tmp_path / "a b").structures()["structure_id"]) == ["boxy"]
    assert open_catalog(f"file://{catalog.location}").location == catalog.location
    with pytest.raises(CatalogError, match="no file of this machine"):
        open_catalog("file://elsewhere/catalog")


def test_pages_of_different_pairs_have_different_names():
    ids = ("a", "b", "a--b", "b--c", "c", "a-", "a--", "b--c--1")
    names = [pair_name(left, right) for left in ids for right in ids]
    assert len(set(names)) == len(names)
    assert pair_name("flight-1", "a320-v1") == "flight-1--a320-v1"


def test_errors_of_a_store_say_bucket_endpoint_and_what_is_not_set(monkeypatch):
    for name in (
        "AWS_ACCESS_KEY_ID",
        "AWS_SECRET_ACCESS_KEY",
        "AWS_REGION",
        "AWS_DEFAULT_REGION",
        "AWS_ALLOW_HTTP",
    ):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", "hidden")
    monkeypatch.setenv("AWS_ENDPOINT_URL", "http://someone:hidden@127.0.0.1:9")
    message = remedy_of("s3://fleet/catalog/transfers", "connection refused")
    assert "bucket fleet was requested at http://127.0.0.1:9" in message
    assert "not set in the environment: AWS_ACCESS_KEY_ID, AWS_REGION, AWS_ALLOW_HTTP=true" in message
    assert "hidden" not in message


def test_the_studio_opens_nothing_where_there_is_no_catalog(tmp_path, capsys):
    assert main(["studio", "--no-open", "--catalog", str(tmp_path / "nowhere")]) == 2
    printed = capsys.readouterr()
    assert "is no catalog" in printed.err and "Open http" not in printed.out


@pytest.mark.parametrize("words", ["known: a, b", "did you mean b?", "such as a", "the last ones: a"])
def test_a_suggestion_is_not_called_a_rule(words):
    assert str(InputError("structure c", "is not in the catalog", words)).endswith(f"catalog ({words})")
    assert str(InputError("x", "is 3", "0 to 2", "change it")) == "x: is 3 (rule: 0 to 2). Change it"

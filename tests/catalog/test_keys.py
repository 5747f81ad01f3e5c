"""Who may release is on a roster, by a name that cannot be mistaken, and signs; that is checked offline."""

from __future__ import annotations

import json
import stat
from dataclasses import replace
from pathlib import Path

import pytest
from catalog_records import copied, demonstration, key_of, plan, structure

from upplied.catalog import Catalog, open_catalog, verify
from upplied.catalog.verbs.roster import Roster, check_name, key_path, new_key
from upplied.cli import main
from upplied.errors import CatalogError, InputError, RefusedError, SettingsError, UppliedError

FIRST = key_of("first")[:20]


@pytest.fixture(autouse=True)
def keys(tmp_path, monkeypatch) -> Path:
    monkeypatch.setenv("UPPLIED_KEYS", str(tmp_path / "keys"))
    return tmp_path / "keys"


@pytest.fixture(scope="module")
def begun(tmp_path_factory) -> Catalog:
    catalog = open_catalog(tmp_path_factory.mktemp("begun"))
    catalog.add_structures([structure(), structure("target", 1)])
    catalog.add_demonstrations([demonstration()])
    catalog.add_plans([(key_of("first"), replace(plan("target"), flyable=True), {})])
    return catalog


@pytest.fixture
def catalog(begun, tmp_path) -> Catalog:
    return copied(begun, tmp_path / "catalog")


def altered(catalog: Catalog) -> list[str]:
    return list(catalog.in_force()["altered"])


def test_without_a_roster_everybody_releases_and_nothing_is_signed(catalog):
    catalog.release(FIRST, "Anybody")
    assert altered(catalog) == [""] and set(catalog.decisions()["signature"]) == {""}


def test_only_who_is_on_the_roster_and_has_the_key_releases(catalog, keys, capsys):
    where = ["--catalog", str(catalog.location)]
    assert main(["keys", "new", "Grace Hopper"]) == 0
    public = capsys.readouterr().out.split()[4]
    assert stat.S_IMODE(key_path("Grace Hopper").stat().st_mode) == 0o600
    assert main(["keys", "add", "Grace Hopper", public, *where]) == 0
    with pytest.raises(RefusedError, match=r"release by 'Ada': is not on the roster .*Grace Hopper"):
        catalog.release(FIRST, "Ada")
    catalog.release(FIRST, "Grace Hopper")
    assert altered(catalog) == [""] and verify(catalog) == []
    assert len(catalog.decisions()["signature"].iloc[-1]) == 128
    key_path("Grace Hopper").rename(keys / "elsewhere")
    with pytest.raises(RefusedError, match="there is no key at"):
        catalog.release(FIRST, "Grace Hopper")
    new_key("Grace Hopper")
    with pytest.raises(RefusedError, match="another key than the roster's"):
        catalog.release(FIRST, "Grace Hopper")
    assert len(catalog.decisions()) == 1
    assert main(["keys", "list", "--json", *where]) == 0


def test_a_release_of_before_the_roster_does_not_count_until_it_is_signed(catalog, tmp_path, monkeypatch):
    catalog.release(FIRST, "Grace")
    monkeypatch.setenv("UPPLIED_ROSTER", str(tmp_path / "roster.json"))
    with pytest.raises(CatalogError, match="there is no such file"):
        catalog.in_force()
    (tmp_path / "roster.json").write_text('{"people": []}')
    assert altered(catalog) == ["its release does not count: Grace is not on the roster"]
    Roster(catalog.location).add("Grace", new_key("Grace"))
    assert altered(catalog) == ["its release does not count: it is not signed by Grace"]
    with pytest.raises(RefusedError, match="altered: its release does not count"):
        catalog.trajectory(FIRST)
    assert any("does not count" in str(each) for each in verify(catalog))
    catalog.release(FIRST, "Grace")
    assert altered(catalog) == [""] and not (Path(catalog.location) / "roster.json").exists()


@pytest.mark.parametrize(
    "name", ["by", "note", "state", "plan_sha256", "plan_row_sha256", "transfer_id", "after"]
)
def test_each_word_of_a_release_is_signed(catalog, name):
    roster = Roster(catalog.location)
    roster.add("Grace", new_key("Grace"))
    decision = catalog.release(FIRST, "Grace", "for May")
    row, order = catalog.standing().why[FIRST], {decision: 0}
    assert roster.fault(row, order) == ""
    roster.people.append(replace(roster.people[0], name="Grace2"))
    assert "is not signed by" in roster.fault({**row, name: f"{row[name]}2"}, order)


def test_who_was_retired_releases_no_longer_and_what_they_released_stays(catalog, capsys):
    Roster(catalog.location).add("Grace", new_key("Grace"))
    catalog.release(FIRST, "Grace")
    assert main(["keys", "retire", "Grace", "--catalog", str(catalog.location)]) == 0
    assert altered(catalog) == [""]
    with pytest.raises(RefusedError, match="who may release: nobody"):
        catalog.release(FIRST, "Grace")
    with pytest.raises(InputError, match="nobody who may release"):
        Roster(catalog.location).retire("Grace", "")
    row = catalog.standing().why[FIRST]
    later = {row["decision_id"]: 5, "another": 6}
    assert Roster(catalog.location).fault(row, later) == ""
    assert (
        Roster(catalog.location).fault({**row, "decision_id": "another"}, later)
        == "Grace may no longer release"
    )


@pytest.mark.parametrize("phrase", ["", "secret"])
def test_a_private_key_may_be_encrypted(catalog, monkeypatch, phrase):
    monkeypatch.setenv("UPPLIED_KEY_PASSPHRASE", phrase)
    Roster(catalog.location).add("Grace", new_key("Grace"))
    assert (b"ENCRYPTED" in key_path("Grace").read_bytes()) == bool(phrase)
    catalog.release(FIRST, "Grace")
    assert altered(catalog) == [""]
    monkeypatch.setenv("UPPLIED_KEY_PASSPHRASE", "other")
    with pytest.raises(InputError, match="UPPLIED_KEY_PASSPHRASE"):
        catalog.release(FIRST, "Grace")
    with pytest.raises(InputError, match="is there already"):
        new_key("Grace")


@pytest.mark.parametrize(
    "name",
    [
        "Grac\u0435",  # Cyrillic e
        "Gra\u200bce",  # nothing between
        "\u202eecarG",  # written from the right
        "Gra\u0301ce\u0301",  # not composed
        "\uff27race",  # wide
        "Grace\u00a0H",  # another space
        "Grace\nHopper",
        "\u0391da",  # Greek A
        "",
        "G" * 201,
    ],
)
def test_names_with_tricks_are_refused(catalog, name):
    for act in (check_name, catalog.location and (lambda one: catalog.review(FIRST, one or " "))):
        with pytest.raises(UppliedError):
            act(name if name.strip() or act is check_name else " ")
    with pytest.raises(SettingsError):
        Roster(catalog.location).add(name, "0" * 64)
    assert catalog.decisions().empty and Roster(catalog.location).people is None


@pytest.mark.parametrize(
    "name", ["Zoë Müller", "Анна", "山田 はなこ", "김민준", "नेहा", "O'Neil-Smith, J. (ops)"]
)
def test_names_of_people_are_names(name):
    assert check_name(name) == name


def test_names_that_look_like_others_are_not_added(catalog):
    roster = Roster(catalog.location)
    roster.add("Oleg Popo", "1" * 64)
    for other in ("oleg popo", "0leg Popo", "Oleg-Popo", "Oieg Popo"):
        with pytest.raises(InputError, match="looks like it"):
            roster.add(other, "2" * 64)
    roster.add("Ada", "2" * 64)
    with pytest.raises(InputError, match="looks like it"):
        roster.add("\u0410\u0501\u0430", "3" * 64)  # all in Cyrillic
    with pytest.raises(InputError, match="64 hexadecimal digits"):
        roster.add("Eve", "x" * 64)


@pytest.mark.parametrize(
    "content",
    [
        *("[]", "{", "[" * 99_999, '{"people": [{"name": "A"}]}', '{"people": [{"name": "A", "key": 5}]}'),
        '{"people": [{"name": "Grac\u0435", "key": "00"}]}',
    ],
)
def test_a_roster_that_cannot_be_read_lets_nobody_release(catalog, content):
    (Path(catalog.location) / "roster.json").write_text(content)
    with pytest.raises(CatalogError, match="is no roster"):
        catalog.release(FIRST, "Grace")
    assert catalog.decisions().empty


def test_a_folder_in_the_place_of_the_roster_lets_nobody_release(catalog):
    (Path(catalog.location) / "roster.json").mkdir()
    with pytest.raises(CatalogError, match="is no roster"):
        catalog.release(FIRST, "Grace")
    assert catalog.decisions().empty


def test_the_roster_is_plain(catalog):
    Roster(catalog.location).add("Grace", "ab" * 32)
    roster = json.loads((Path(catalog.location) / "roster.json").read_text())
    assert roster["people"] == [{"name": "Grace", "key": "ab" * 32, "until": ""}]

"""The report folder: it follows the catalog, is written only where it changed, and nothing foreign runs."""

from __future__ import annotations

import base64
import errno
import hashlib
import json
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from catalog_records import demonstration, key_of, plan, structure
from fake_catalog import FakeCatalog, orbit
from PIL import Image

from upplied import files
from upplied.catalog import Catalog, open_catalog
from upplied.checks import pair_name
from upplied.errors import CatalogError, InputError, RefusedError, SettingsError
from upplied.outputs import publish as publishing
from upplied.outputs import render
from upplied.outputs.missions import FORMATS, MissionOptions
from upplied.outputs.pairs import Pair, first_pairs
from upplied.outputs.publish import publish, publish_file, publish_pages
from upplied.records import Placement

EVIL = "</script><script>document.title='broken'</script>"


class Page(HTMLParser):
    """Scripts, policy and data of a page, as a browser would cut it up."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.scripts: list[tuple[dict, str]] = []
        self.policy = ""
        self.tags: set[str] = set()
        self.links: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        attributes = dict(attrs)
        self.tags.add(tag)
        self.links += [attributes[name] for name in ("src", "href") if name in attributes]
        if tag == "meta" and "content-security-policy" in attributes.get("http-equiv", "").lower():
            self.policy = attributes["content"]
        if tag == "script":
            self.scripts.append((attributes, ""))

    def handle_data(self, data):
        if self.scripts and self.cdata_elem == "script":
            attributes, text = self.scripts[-1]
            self.scripts[-1] = (attributes, text + data)

    @property
    def data(self) -> dict:
        return json.loads(next(text for attributes, text in self.scripts if attributes.get("id") == "data"))


@pytest.fixture(scope="module")
def catalog() -> FakeCatalog:
    return FakeCatalog(targets=2)


@pytest.fixture(scope="module")
def folder(catalog, tmp_path_factory) -> Path:
    root = tmp_path_factory.mktemp("reports")
    publish_pages(catalog, root, pictures=1)
    return root


def page(path: Path) -> Page:
    return Page(path.read_text("utf-8"))


def contents(root: Path) -> dict[str, bytes]:
    return {str(path.relative_to(root)): path.read_bytes() for path in root.rglob("*") if path.is_file()}


@pytest.mark.ci
def test_every_pair_has_a_page_and_those_that_need_a_person_a_picture(folder):
    names = {"orbit-1--cuboid-0", "orbit-1--cuboid-1", "orbit-1--odd"}
    assert {path.stem for path in (folder / "transfers").iterdir()} == names
    assert {path.stem for path in (folder / "pictures").iterdir()} == {"orbit-1--odd"}
    assert {path.stem for path in (folder / "thumbnails").iterdir()} == {"cuboid-0", "cuboid-1", "odd"}
    shot = Image.open(folder / "thumbnails" / "cuboid-1.png")
    assert shot.size == (128, 88) and len(shot.getcolors(10_000)) > 10  # a shaded box, no blank


def test_links_stay_inside_the_folder_and_lead_somewhere(folder):
    for path in [folder / "index.html", *(folder / "transfers").iterdir()]:
        for link in page(path).links:
            goal = (path.parent / link).resolve()
            assert goal.is_relative_to(folder.resolve()) and goal.is_file(), link


def test_the_worst_come_first_and_refusals_keep_their_reason(folder):
    fleet = page(folder / "index.html").data["fleet"]
    rows = [dict(zip(fleet["columns"], row, strict=True)) for row in fleet["rows"]]
    assert [row["target"] for row in rows] == ["odd", "cuboid-1", "cuboid-0"]
    assert "above gamma" in rows[0]["reason"] and rows[0]["coverage"] is None
    assert rows[1]["coverage"] == 91.0 and rows[1]["baseline"] == 86.0


def test_what_a_page_draws_is_what_the_catalog_holds(folder, catalog):
    transfer = page(folder / "transfers" / "orbit-1--cuboid-1.html").data["transfer"]
    plan = next(each for each in transfer["plans"] if each["preset"] == "recommended")
    script = (folder / "data" / "cuboid-1.js").read_text()
    origin = np.array(json.loads(re.search(r"= (\{.*\});", script)[1])["origin"])
    drawn = np.frombuffer(base64.b64decode(plan["path"]["xyz"]["data"]), "<f4").reshape(-1, 3) + origin
    steps = catalog.waypoints(plan["provenance"]["transfer_id"])
    assert np.allclose(drawn, steps[["x_m", "y_m", "z_m"]], atol=1e-4)
    assert plan["measures"]["frechet_z"] is None and plan["measures"]["coverage_paper_pct"] == 94.0


@pytest.mark.ci
def test_a_flight_in_simulation_stands_beside_its_plan_until_another_takes_its_place(tmp_path):
    catalog = FakeCatalog(targets=1)
    publish_pages(catalog, tmp_path, pictures=0)
    catalog.fly("t0000")
    assert publish_pages(catalog, tmp_path, pictures=0).written == ("transfers/orbit-1--cuboid-0.html",)
    plans = page(tmp_path / "transfers" / "orbit-1--cuboid-0.html").data["transfer"]["plans"]
    (flight,) = [plan["flown"] for plan in plans if "flown" in plan]
    origin = np.array(
        json.loads((tmp_path / "data/cuboid-0.js").read_text()[:-2].partition("= ")[2])["origin"]
    )
    drawn = np.frombuffer(base64.b64decode(flight["path"]["xyz"]["data"]), "<f4").reshape(-1, 3) + origin
    assert np.allclose(drawn, catalog.path.positions, atol=1e-4)
    assert flight["measures"]["min_clearance_m"] == 3.25 and "3.25 m (planned 4.00 m)" in flight["summary"]
    assert not publish_pages(catalog, tmp_path, pictures=0).written


def test_no_text_of_a_log_becomes_markup(folder):
    for path in folder.rglob("*.html"):
        text = path.read_text("utf-8")
        parsed = Page(text)
        assert "img" not in parsed.tags and "b" not in parsed.tags
        assert EVIL not in text
        assert all(
            attributes.get("src") or attributes.get("type") == "application/json"
            for attributes, _ in parsed.scripts
        )
        assert "script-src 'self';" in parsed.policy and "default-src 'none'" in parsed.policy
    assert page(folder / "transfers" / "orbit-1--odd.html").data["transfer"]["demonstration"]["notes"] == EVIL


@pytest.mark.ci
@pytest.mark.anew
def test_publishing_again_writes_nothing_and_equal_catalogs_give_equal_bytes(folder, catalog, tmp_path):
    again = publish_pages(catalog, folder, pictures=1)
    assert not again.written and not again.removed and again.unchanged
    publish_pages(FakeCatalog(targets=2), tmp_path, pictures=1)
    assert contents(tmp_path) == contents(folder)


@pytest.mark.ci
def test_only_what_changed_is_written_and_what_is_gone_is_removed(tmp_path):
    catalog = FakeCatalog(targets=2)
    publish_pages(catalog, tmp_path, pictures=0)
    (tmp_path / "mine.txt").write_text("not ours")
    catalog.add(catalog.planned("cuboid-0", "recommended", 80.0), "2026-11-21T02:00:00Z")
    news = publish_pages(catalog, tmp_path, pictures=0)
    pages = {"transfers/orbit-1--cuboid-0.html", "structures/cuboid-0.html"}
    assert set(news.written) == pages | {"index.html"}
    fleet = page(tmp_path / "index.html").data["fleet"]
    row = next(dict(zip(fleet["columns"], row, strict=True)) for row in fleet["rows"] if "cuboid-0" in row[0])
    assert row["change"] == "coverage -15.0%"
    catalog.rows = [row for row in catalog.rows if row["target_id"] != "cuboid-1"]
    news = publish_pages(catalog, tmp_path, pictures=0)
    gone = {"transfers/orbit-1--cuboid-1.html", "structures/cuboid-1.html", "data/cuboid-1.js"}
    gone.add("thumbnails/cuboid-1.png")
    assert set(news.removed) == gone
    assert (tmp_path / "mine.txt").exists()


@pytest.mark.parametrize("record", ["", "[]", '{"../../victim": "x", "victim": "x"}', "\x00"])
def test_a_damaged_record_costs_time_but_no_file_of_others(tmp_path, record):
    root = tmp_path / "reports"
    root.mkdir()
    for victim in (tmp_path / "victim", root / "victim"):
        victim.write_text("keep")
    (root / ".published.json").write_text(record)
    publish_pages(FakeCatalog(targets=1), root, pictures=0)
    assert (tmp_path / "victim").exists() and (root / "victim").exists() and (root / "index.html").exists()


def test_one_broken_structure_costs_its_own_page_only(tmp_path):
    class Broken(FakeCatalog):
        def structure(self, structure_id):
            if structure_id == "cuboid-0":
                raise InputError("cuboid-0", "its mesh is gone")
            return super().structure(structure_id)

    result = publish_pages(Broken(targets=2), tmp_path, pictures=0)
    assert len(result.problems) == 1 and "cuboid-0" in result.problems[0]
    assert (tmp_path / "transfers" / "orbit-1--cuboid-1.html").exists()
    fleet = page(tmp_path / "index.html").data["fleet"]
    linked = {row[0]: row[fleet["columns"].index("page")] for row in fleet["rows"]}
    assert not linked["orbit-1--cuboid-0"] and linked["orbit-1--cuboid-1"]


def test_an_id_that_is_no_file_name_makes_no_file(tmp_path):
    catalog = FakeCatalog(targets=1)
    catalog.rows[0]["target_id"] = "../../evil"
    result = publish_pages(catalog, tmp_path / "a" / "reports", pictures=0)
    assert len(result.problems) == 1 and not list(tmp_path.rglob("*evil*"))


def test_an_empty_catalog_has_an_empty_page(tmp_path):
    catalog = FakeCatalog(targets=1)
    catalog.rows.clear()
    publish_pages(catalog, tmp_path)
    assert page(tmp_path / "index.html").data["fleet"]["rows"] == []


@pytest.fixture(scope="module")
def stored(tmp_path_factory) -> Catalog:
    """The same fleet in a real catalog."""
    fake = FakeCatalog(targets=1)
    catalog = open_catalog(tmp_path_factory.mktemp("kept") / "catalog")
    catalog.add_structures(list(fake._structures.values()))
    catalog.add_demonstrations([fake.demonstration("orbit-1")])
    provenance = {"planned_at": pd.Timestamp("2026-11-20T02:00:00Z").to_pydatetime(), "run_id": "r"}
    plans = [(hashlib.sha256(key.encode()).hexdigest(), plan, provenance) for key, plan in fake.plans.items()]
    catalog.add_plans(plans)
    return catalog


@pytest.mark.ci
def test_a_catalog_becomes_tables_that_pandas_reads_and_pages(stored, tmp_path):
    result = publish(stored, tmp_path, pictures=0)
    assert not result.problems and result.index == tmp_path / "index.html"
    transfers = pd.read_parquet(tmp_path / "transfers.parquet")
    assert len(transfers) == 4 and set(transfers["status"]) == {"ok", "refused"}
    assert len(pd.read_parquet(tmp_path / "waypoints.parquet")) == transfers["n_waypoints"].sum()
    plans = page(tmp_path / "transfers" / "orbit-1--cuboid-0.html").data["transfer"]["plans"]
    assert [plan["preset"] for plan in plans] == ["recommended", "paper", "baseline"]
    assert all("states" in plan for plan in plans)
    before = contents(tmp_path)
    assert not publish(stored, tmp_path, pictures=0).written and contents(tmp_path).keys() == before.keys()


@pytest.mark.parametrize("seed", range(6))
def test_of_many_pairs_those_are_shown_that_need_a_person_first(seed):
    """The first of all pairs in the order of attention, whatever was planned, decided and measured."""
    rng, fake = np.random.default_rng(seed), FakeCatalog(targets=1)
    fake.rows.clear()
    at = pd.Timestamp("2026-11-20T02:00:00Z")
    for number in range(120):
        status = rng.choice(["ok", "ok", "refused", "failed"])
        state = rng.choice(["draft", "draft", "released", "recalled", "superseded"]) if status == "ok" else ""
        flyable = rng.choice([True, True, False]) if status == "ok" else None
        plan = fake.planned("cube", "recommended", 90.0)
        measured = {
            name: rng.choice([np.nan, *rng.integers(0, 3, 2)])
            for name in ("coverage_inspected_pct", "coverage_seen_pct", "min_clearance_m")
        }
        target, preset = (
            f"t{rng.integers(0, 25)}",
            str(rng.choice(["recommended", "paper", "baseline", "own"])),
        )
        for row in fake.rows:
            if (row["target_id"], row["state"], state) == (target, "released", "released"):
                row["state"] = "superseded"  # of a pair one plan is in force
        fake.add(replace(plan, target_id=target, preset=preset, status=str(status)))
        fake.rows[-1] |= measured | {
            "state": str(state), "state_at": at + pd.Timedelta(minutes=number), "flyable": flyable,
            "not_flyable": "too little is seen" if flyable is False and rng.random() < 0.8 else "",
        }  # fmt: skip

    def order(pair: Pair) -> tuple:
        plans = {preset: row["transfer_id"] for preset, row in pair.plans.items()}
        return pair.name, pair.decided, plans, {p: row["transfer_id"] for p, row in pair.earlier.items()}

    every, known = first_pairs(fake, 1000)
    assert known == len(every) > 15
    for most in (1, 7, 15):
        pairs, of = first_pairs(fake, most)
        assert ([order(pair) for pair in pairs], of) == ([order(pair) for pair in every[:most]], known)
    assert [pair.target_id for pair in first_pairs(fake, 9, target="t3")[0]] == ["t3"]


def test_a_fleet_beyond_what_a_browser_lists_says_so(catalog, tmp_path):
    result = publish_pages(catalog, tmp_path, pictures=0, most=2)
    fleet = page(tmp_path / "index.html").data["fleet"]
    assert (len(fleet["rows"]), fleet["known"]) == (2, 3)
    assert sorted(row[0] for row in fleet["rows"]) == sorted(
        path.stem for path in (tmp_path / "transfers").iterdir()
    )
    assert fleet["rows"][0][0] == "orbit-1--odd" and not result.problems
    with pytest.raises(SettingsError, match="61 transfers chosen"):
        publish_file(FakeCatalog(targets=60), tmp_path / "many.html")


@pytest.mark.slow
def test_pictures_and_missions_by_id(stored, tmp_path):
    row = stored.transfers(preset="recommended", status="ok").iloc[0]
    for png in (
        render.render_structure(stored, "cube", ("top",)),
        render.render_transfer(stored, row["transfer_id"]),
        render.render_comparison(stored, "orbit-1", "cuboid-0"),
    ):
        assert png.startswith(b"\x89PNG")
    with pytest.raises(RefusedError, match="released: it is a draft plan"):
        render.export_transfer(stored, row["transfer_id"], "mcap", tmp_path / "p.mcap")
    draft = MissionOptions(draft=True)
    files = render.export_transfer(stored, row["transfer_id"], "mcap", tmp_path / "p.mcap", draft)
    assert b"DRAFT, NOT RELEASED" in files.paths[0].read_bytes()
    with pytest.raises(RefusedError, match="place on the Earth is unknown"):
        render.export_transfer(stored, row["transfer_id"], "kml", tmp_path / "p.kml", draft)
    with pytest.raises(CatalogError, match="not in the catalog"):
        render.render_transfer(stored, "0" * 20)
    with pytest.raises(CatalogError, match="no transfer"):
        render.render_comparison(stored, "orbit-1", "nowhere")


def test_the_mailed_file_needs_nothing_and_runs_only_our_scripts(catalog, tmp_path):
    parsed = page(publish_file(catalog, tmp_path / "report.html"))
    assert not [link for link in parsed.links if not link.startswith("#")]
    code = [text for attributes, text in parsed.scripts if attributes.get("type") != "application/json"]
    allowed = re.findall(r"'sha256-([^']+)'", parsed.policy)
    assert [base64.b64encode(hashlib.sha256(text.encode()).digest()).decode() for text in code] == allowed
    assert set(parsed.data["pairs"]) == {"orbit-1--cuboid-0", "orbit-1--cuboid-1", "orbit-1--odd"}
    assert set(parsed.data["structures"]) == {"cube", "cuboid-0", "cuboid-1", "odd"}
    one = page(publish_file(catalog, tmp_path / "one.html", target_id="odd"))
    assert set(one.data["pairs"]) == {"orbit-1--odd"}
    with pytest.raises(SettingsError, match="0 transfers"):
        publish_file(catalog, tmp_path / "none.html", target_id="nothing")


def test_no_two_pairs_share_a_page():
    ids = [*("a", "b", "c", "a-", "a--", "a--b", "b--c", "a-b", "a--b--c", "b-", "c-"), "c--a"]
    names = [pair_name(demonstration, target) for demonstration in ids for target in ids]
    assert len(set(names)) == len(ids) ** 2
    assert pair_name("cube-sides-v1", "cuboid-v1") == "cube-sides-v1--cuboid-v1"


@pytest.mark.ci
def test_a_plan_that_breaks_a_rule_of_the_gate_says_so_on_its_page_and_in_the_result(tmp_path):
    """Whatever its row says: its steps are judged again when its page is made."""
    catalog = FakeCatalog(targets=1)
    near = catalog.planned("cuboid-0", "recommended", 90.0)
    path = replace(near.trajectory, positions=near.trajectory.positions * [0.55, 0.55, 1.0])
    catalog.add(replace(near, trajectory=path))
    result = publish_pages(catalog, tmp_path)
    (fault,) = [problem for problem in result.problems if "clearance: " in problem]
    assert "limit 2 m" in fault
    page = (tmp_path / "transfers" / f"{pair_name('orbit-1', 'cuboid-0')}.html").read_text()
    (plan,) = [each for each in Page(page).data["transfer"]["plans"] if each["preset"] == "recommended"]
    assert any("clearance: " in words for words in plan["verdict"]["look"]) and plan["overruled"] == []
    assert plan["status"] == "not flyable" and not plan["verdict"]["flyable"]


@pytest.mark.ci
def test_what_was_overruled_for_a_plan_stands_on_its_page(tmp_path):
    catalog = FakeCatalog(targets=1)
    (name,) = [row["transfer_id"] for row in catalog.rows if row["preset"] == "baseline"]
    overruling = {"way": "export", "format": "kml", "rule": "preset", "found": "preset: <b>baseline</b>"}
    rows = [{"transfer_id": name, "added_at": pd.Timestamp("2026-11-21T03:04Z"), **overruling}]
    catalog.overruled = lambda: pd.DataFrame(rows)
    publish_pages(catalog, tmp_path)
    text = (tmp_path / "transfers" / f"{pair_name('orbit-1', 'cuboid-0')}.html").read_text()
    plans = {each["preset"]: each for each in Page(text).data["transfer"]["plans"]}
    assert plans["baseline"]["overruled"] == ["export kml, 2026-11-21 03:04 UTC: preset: <b>baseline</b>"]
    assert plans["recommended"]["overruled"] == [] and "<b>baseline</b>" not in text
    rows.clear()
    written = publish_pages(catalog, tmp_path).written
    assert f"transfers/{pair_name('orbit-1', 'cuboid-0')}.html" in written  # it says what it no longer should


@pytest.mark.slow
def test_a_released_plan_has_its_missions_beside_its_page_or_the_reason(tmp_path):
    catalog = FakeCatalog(targets=1)
    here = Placement(47.0, 8.0, 400.0, 0.0, "ellipsoid")
    catalog._structures["cuboid-0"] = replace(catalog.structure("cuboid-0"), placement=here)
    for row in catalog.rows:
        row |= {"state": "draft", "state_by": "Ada", "state_at": row["planned_at"], "state_note": ""}
    publish_pages(catalog, tmp_path, pictures=0)
    assert not (tmp_path / "missions").exists(), "what nobody released is no mission"
    name = pair_name("orbit-1", "cuboid-0")
    catalog.rows[0]["state"] = "released"
    publish_pages(catalog, tmp_path, pictures=0)
    links = Page((tmp_path / "transfers" / f"{name}.html").read_text()).data["transfer"]["missions"]
    assert links == {label: f"../missions/{name}{FORMATS[kind]}" for kind, label in publishing.LABELS.items()}
    plan = json.loads((tmp_path / "missions" / f"{name}.plan").read_text())
    assert plan["fileType"] == "Plan" and "draft" not in json.dumps(plan).lower()
    catalog.rows[0]["state"] = "recalled"
    publish_pages(catalog, tmp_path, pictures=0)
    assert not list((tmp_path / "missions").iterdir())
    catalog.rows[0]["state"] = "released"
    catalog.plans["t0000"] = replace(
        catalog.plans["t0000"], trajectory=orbit(catalog.structure("cuboid-0"), -2.0)
    )
    publish_pages(catalog, tmp_path, pictures=0)
    links = Page((tmp_path / "transfers" / f"{name}.html").read_text()).data["transfer"]["missions"]
    assert all(link.startswith("not available: ") and "clearance" in link for link in links.values()), links


def test_a_mission_of_several_sorties_is_not_given_out_as_its_first(monkeypatch):
    files = [("m-1of2.plan", b"1"), ("m-2of2.plan", b"2"), ("m.plan.zones.json", b"{}")]
    monkeypatch.setattr(publishing, "mission_files", lambda *_: files)
    with pytest.raises(RefusedError, match="2 sorties"):
        publishing._mission(FakeCatalog(targets=1), "t0000", "qgc-plan")
    del files[1]  # the results of required zones are no sortie
    assert publishing._mission(FakeCatalog(targets=1), "t0000", "qgc-plan") == b"1"


@pytest.mark.slow
@pytest.mark.parametrize("before", [1, *(pytest.param(at, marks=pytest.mark.slow) for at in (0, 3))])
def test_a_disk_that_fills_up_among_the_pages_is_said_and_each_file_is_whole(tmp_path, before):
    catalog = open_catalog(tmp_path / "catalog")
    catalog.add_structures([structure("boxy"), structure("target", 1)])
    catalog.add_demonstrations([demonstration()])
    catalog.add_plans([(key_of(0), plan("target"), {})])
    publish(catalog, tmp_path / "whole", pictures=0)
    written, really = [], files.replace_file

    def until_full(path, content):
        if len(written) == before:
            raise OSError(errno.ENOSPC, "No space left on device", str(path))
        written.append(path)
        return really(path, content)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(publishing, "replace_file", until_full)
        with pytest.raises(CatalogError, match=r"No space left.*publish again"):
            publish(catalog, tmp_path / "reports", pictures=0)
    assert len(written) == before
    publish(catalog, tmp_path / "reports", pictures=0)
    assert {name for name in contents(tmp_path / "reports") if "tables" not in name} == {
        name for name in contents(tmp_path / "whole") if "tables" not in name
    }

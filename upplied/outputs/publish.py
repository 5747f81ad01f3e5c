"""The report folder: tables, pages, pictures and missions, each replaced whole where something changed."""

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property, partial
from pathlib import Path
from typing import Any

from upplied import __version__
from upplied.catalog import Catalog
from upplied.catalog.store.files import locked
from upplied.catalog.verbs.published import local_folder, publish_generation
from upplied.checks import check_id
from upplied.config import digest
from upplied.errors import CatalogError, RefusedError, SettingsError, UppliedError
from upplied.files import replace_file
from upplied.outputs import pages
from upplied.outputs.missions import FORMATS
from upplied.outputs.page_data import fleet_data, marks, places
from upplied.outputs.pairs import Pair, first_pairs
from upplied.outputs.render import ZONES, mission_files
from upplied.outputs.reports import Reader
from upplied.outputs.site import ENDINGS, TITLE, MapOf, Site, findings_html

PICTURES = 200  # the default limit: each takes a second
PAGES = 10_000  # likewise; a list that a browser still shows at once, and about a gigabyte
_RECORD = ".published.json"
_MAILED = 60  # pairs that one file may hold

#: Formats published beside a plan's page, with their labels; other formats by `upplied export`.
LABELS = {"qgc-plan": "QGroundControl", "kml": "KML", "mcap": "MCAP"}


@dataclass(frozen=True)
class Published:
    """The result of a publication."""

    index: Path
    written: tuple[str, ...]  # files, relative to the folder
    unchanged: int  # files that were up to date
    removed: tuple[str, ...]
    problems: tuple[str, ...]  # pairs whose page failed, or whose plan fails the gate, with the reason


@dataclass
class _Folder:
    root: Path
    before: dict[str, str]
    site: Site
    now: dict[str, str] = field(default_factory=dict)
    written: list[str] = field(default_factory=list)

    @cached_property
    def code(self) -> str:
        """Hash of the program and its scripts, on which every page depends."""
        return digest([__version__, {name: digest(text) for name, text in pages.assets().items()}])

    def attempt(self, name: str, put: Callable[[], None], title: str = "") -> None:
        """Write pages, or note the reason why that failed."""
        try:
            put()
        except UppliedError as error:
            self.site.problems[name] = f"{title or name}: {error}"

    def make(self, room: str, name: str, key: str) -> None:
        """Write the site's content of this name, unless the file is up to date."""
        path = f"{room}/{name}{ENDINGS[room]}"
        self.put(path, key, partial(self.site.content, room, name))

    def put(self, name: str, key: str, make: Callable[[], bytes | str]) -> None:
        """Write a file unless it exists with the same key."""
        if name in self.now:
            return
        path = self.root / name
        if self.before.get(name) != key or not path.is_file():
            text = make()
            content = text.encode() if isinstance(text, str) else text
            if not path.is_file() or path.read_bytes() != content:
                replace_file(path, content)
                self.written.append(name)
        self.now[name] = key

    def remove_others(self) -> list[str]:
        """Remove files of an earlier publication that this one does not have."""
        rooms, gone = [self.root / room for room in (*ENDINGS, "assets", "missions") if room], list[str]()
        for name in self.before:
            path = self.root / name
            if name not in self.now and path.parent in rooms and not path.is_symlink():
                path.unlink(missing_ok=True)
                gone.append(name)
        return gone


def publish(
    catalog: Catalog,
    folder: str | Path,
    *,
    pictures: int = PICTURES,
    pages: int = PAGES,
    progress: Callable[[str], None] = lambda _: None,
    force: bool = False,
    map_of: MapOf | None = None,
) -> Published:
    """Write tables, pages and pictures of everything in a catalog.

    Parameters
    ----------
    catalog, progress : Catalog, callable
        The latter receives the name of each finished pair.
    folder : path
        People open ``index.html``, pandas reads ``transfers.parquet``. Files of other programs there are
        not changed.
    pictures, pages : int
        Number of pairs that get a PNG for documents, and a page with a row on the fleet's page, those first
        that need attention. The tables hold all, and `publish_file` makes a page of any pair.
    force : bool
        Also replace a publication that is newer, of another catalog, or would shrink to nothing.
    map_of : callable, optional
        Map structure of a kind, and its findings there; without it no page shows them.
    """
    catalog.identity.required()
    place = local_folder(folder)
    with locked(place):
        for left in filter(Path.is_file, place.glob("**/.*.draft")):
            left.unlink(missing_ok=True)  # of a publisher that was stopped
        publish_generation(catalog, place, force)
        try:
            return publish_pages(
                catalog, place, pictures=pictures, most=pages, progress=progress, map_of=map_of
            )
        except OSError as error:
            remedy = "free space or correct the permissions, then publish again; existing files are intact"
            raise CatalogError(str(place), f"cannot be written: {error}", "", remedy) from None


def publish_pages(
    catalog: Catalog,
    folder: str | Path,
    *,
    pictures: int = PICTURES,
    most: int = PAGES,
    progress: Callable[[str], None] = lambda _: None,
    map_of: MapOf | None = None,
) -> Published:
    """The pages and pictures alone, as `publish` writes them, without its tables."""
    site = Site(catalog, most, map_of)
    place = _Folder(Path(folder), _recorded(Path(folder)), site)
    for name, text in pages.assets().items():
        place.put(f"assets/{name}", digest(text), partial(str, text))
    site.pictured = {pair.name for pair in site.pairs[:pictures]}
    ordered = sorted(site.pairs, key=lambda pair: (pair.target_id, pair.source_id, pair.name))
    for pair in ordered:  # so that each mesh is read once
        place.attempt(pair.name, partial(_put_pair, place, pair))
        progress(pair.name)
    for row in catalog.demonstrations().to_dict("records"):
        place.attempt(str(row["demonstration_id"]), partial(_put_passport, place, row))
    for name in dict.fromkeys(pair.target_id for pair in site.pairs if pair.name not in site.problems):
        place.attempt(name, partial(_put_structure, place, name))
    for kind in sorted(set(catalog.findings()["kind"])) if map_of else ():
        place.attempt(f"findings {kind}", partial(_put_map, place, kind), f"findings of {kind}")
    html = site.content("")
    place.put("index.html", digest(html), lambda: html)
    removed = place.remove_others()
    replace_file(place.root / _RECORD, json.dumps(place.now, indent=0, sort_keys=True) + "\n")
    unchanged = len(place.now) - len(place.written)
    refused = (f"{name}: {'; '.join(why)}" for name, why in site.reader.refused.items())
    problems = (*site.problems.values(), *refused)
    return Published(place.root / "index.html", tuple(place.written), unchanged, tuple(removed), problems)


def publish_file(
    catalog: Catalog, path: str | Path, *, demonstration_id: str | None = None, target_id: str | None = None
) -> Path:
    """One HTML file with everything inside, for mail; a `SettingsError` if nothing or too much matches."""
    chosen, known = first_pairs(catalog, _MAILED, demonstration_id, target_id)
    if not 0 < known <= _MAILED:
        rule = f"1 to {_MAILED}", "choose a demonstration"
        raise SettingsError("single-file report", f"{known} transfers chosen", *rule)
    reader = Reader(catalog)
    used = sorted({name for pair in chosen for name in (pair.source_id, pair.target_id)})
    data = {
        "fleet": fleet_data(chosen, TITLE, (), known, places(catalog)),
        "pairs": {pair.name: reader.pair_data(pair) for pair in chosen},
        "structures": {name: reader.structure_data(name) for name in used},
    }
    return replace_file(path, pages.single_page(TITLE, data, f"{TITLE}: this page needs scripts."))


def _put_pair(place: _Folder, pair: Pair) -> None:
    reader, target, code = place.site.reader, pair.target_id, place.code
    for what in ("demonstration_id", "source_id", "target_id"):
        check_id(getattr(pair, what), what)  # they become file names
    hashes = {name: reader.sha256("structures", name) for name in (pair.source_id, target)}
    for name, sha256 in hashes.items():
        place.make("data", name, digest([code, name, sha256]))
    flown = reader.sha256("demonstrations", pair.demonstration_id)
    rows = [_plain(pair.plans), _plain(pair.earlier), _plain({"draft": pair.draft or {}}), pair.decided]
    key = digest([code, *rows, list(hashes.values()), flown])
    words = [[reader.flown(row), reader.overruled(row)] for row in pair.plans.values()]
    zones = _plain({row["zone"]: row for row in reader.zones(target)})
    place.make("thumbnails", target, digest([code, hashes[target]]))
    missions = place.site.missions[pair.name] = _put_missions(place, pair, digest([key, zones]))
    picture = pair.name in (place.site.pictured or ())
    place.make("transfers", pair.name, digest([key, words, picture, zones, missions]))
    if picture:
        place.make("pictures", pair.name, key)


def _put_missions(place: _Folder, pair: Pair, key: str) -> dict[str, str]:
    """Missions of the released plan by label: the address of each, or why it is not available."""
    transfer_id = released(pair.plans)
    put: dict[str, str] = {}
    for kind, label in LABELS.items() if transfer_id else ():
        name = f"missions/{pair.name}{FORMATS[kind]}"
        try:
            place.put(name, key, partial(_mission, place.site.reader.catalog, transfer_id, kind))
            put[label] = f"../{name}"
        except UppliedError as error:
            put[label] = f"not available: {error}"
    return put


def released(plans: Mapping[str, Mapping[str, Any]]) -> str:
    """ID of the released plan of a pair; empty if there is none."""
    ids = [str(row["transfer_id"]) for row in plans.values() if row.get("state") == "released"]
    return ids[0] if ids else ""


def _mission(catalog: Catalog, transfer_id: str, format: str) -> bytes:
    """The bytes of a mission's only file; several sorties are refused, since one would look complete."""
    files = mission_files(catalog, transfer_id, format)
    sorties = [content for name, content in files if not name.endswith(ZONES)]
    if len(sorties) > 1:
        what, rule = f"the mission of {transfer_id}", "one file here"
        export = f"upplied export {transfer_id} --to {format}"
        raise RefusedError(what, f"takes {len(sorties)} sorties", rule, export)
    return sorties[0]


def _put_passport(place: _Folder, row: Mapping[Any, Any]) -> None:
    name = check_id(str(row["demonstration_id"]), "demonstration_id")
    words = [str(row.get(key, "")) for key in ("sha256", "passport_json", "notes")]
    surface, structure = place.site.inspected.get(name, ("", ""))[1], str(row["structure_id"])
    sha256 = place.site.reader.sha256("structures", structure)
    place.make("demonstrations", name, digest([place.code, name, *words, surface, sha256]))


def _put_structure(place: _Folder, name: str) -> None:
    reader, plans = place.site.reader, place.site.plans_of(name)
    rows = [[_plain(pair.plans), _plain({"draft": pair.draft or {}})] for pair in plans]
    words = [reader.flown(pair.main) for pair in plans]
    drawn = [pair.name for pair in plans if pair.name in (place.site.pictured or ())]
    zones = _plain({row["zone"]: row for row in reader.zones(name)})
    facts = [rows, words, drawn, zones, marks(reader.catalog, name)]
    place.make("structures", name, digest([place.code, reader.sha256("structures", name), *facts]))


def _put_map(place: _Folder, kind: str) -> None:
    reader, map_of = place.site.reader, place.site.map_of
    assert map_of is not None
    name, rows = map_of(reader.catalog, check_id(kind, "kind"))
    place.make("data", name, digest([place.code, name, reader.sha256("structures", name)]))
    key, make = digest([place.code, name, rows.to_csv()]), partial(findings_html, name, rows, "../")
    place.put(f"findings/{kind}.html", key, make)
    place.site.mapped.append(kind)


def _plain(rows: Any) -> dict[str, dict[str, str]]:
    return {preset: {name: str(value) for name, value in row.items()} for preset, row in rows.items()}


def _recorded(root: Path) -> dict[str, str]:
    """The keys of the last publication; if they cannot be read, every file is written again."""
    try:
        noted = json.loads((root / _RECORD).read_text("utf-8"))
    except (OSError, ValueError):
        return {}
    return {str(key): str(value) for key, value in noted.items()} if isinstance(noted, dict) else {}

"""The pages of a fleet, its plans, structures and demonstrations, in a folder or made when opened."""

import math
from collections.abc import Callable, Mapping
from functools import cached_property, partial
from pathlib import Path

import pandas as pd

from upplied.catalog import Catalog
from upplied.errors import CatalogError
from upplied.files import replace_file
from upplied.outputs import pages
from upplied.outputs.page_data import fleet_data, fleet_findings, mark, places
from upplied.outputs.pairs import Pair, first_pairs
from upplied.outputs.reports import Reader

TITLE = "Inspection fleet"
#: Map structure of a kind, and the findings of the kind from `upplied.findings.queries.by_reference`.
MapOf = Callable[[Catalog, str], tuple[str, pd.DataFrame]]
#: Rooms of a report folder that the site fills, with the ending of their files; "" is the fleet's own page.
ENDINGS = {
    **dict.fromkeys(("", "transfers", "structures", "demonstrations", "findings"), ".html"),
    "data": ".js",
    "pictures": ".png",
    "thumbnails": ".png",
}


class Site:
    """The content of each file of a report folder, by room and name.

    At most so many pairs have a page, those first that need a person. On `live` pages a person who signed in
    may decide, export and edit.
    """

    def __init__(self, catalog: Catalog, most: int, map_of: MapOf | None = None, live: bool = False) -> None:
        self.reader = Reader(catalog)
        self.pairs, self.known = first_pairs(catalog, most)
        self.pair = {pair.name: pair for pair in self.pairs}
        self.map_of, self.live = map_of, live
        self.pictured: set[str] | None = None  # names of the pairs that have a picture; None: all
        self.mapped: list[str] = []  # kinds whose findings have a page of their own
        self.problems: dict[str, str] = {}  # pages that could not be made: nothing links there
        self.missions: dict[str, Mapping[str, str]] = {}  # of each pair the addresses of files, by label
        self.decision: Callable[[str], str] = lambda _: ""  # the last one about a plan of this id
        self._page = partial(pages.page, live=live)

    @cached_property
    def inspected(self) -> dict[str, tuple[str, str]]:
        """By demonstration a plan that knows the inspected surface, and the hash of that."""
        plans: dict[str, tuple[str, str]] = {}
        for pair in self.pairs:
            if known := pair.main.get("inspected_sha256"):
                plans.setdefault(pair.demonstration_id, (str(pair.main["transfer_id"]), str(known)))
        return plans

    def content(self, room: str, name: str = "") -> str | bytes:
        """A page, a structure's script or a picture; a `CatalogError` if there is nothing of that name."""
        makers: dict[str, Callable[[str], str | bytes]] = {
            "": self._fleet,
            "findings": self._findings,
            "data": lambda name: pages.structure_script(self.reader.structure_data(name)),
            "thumbnails": self.reader.thumbnail,
            "structures": self._structure,
            "demonstrations": self._passport,
            "pictures": lambda name: self.reader.picture(self.pair[name]),
            "transfers": self._plans,
        }
        if room in ("pictures", "transfers") and name not in self.pair:
            raise CatalogError(name[:150], "does not exist")
        return makers[room](name)

    def _fleet(self, name: str) -> str:
        catalog = self.reader.catalog
        fleet = fleet_data(self.pairs, TITLE, self.problems, self.known, places(catalog))
        data = {"fleet": fleet | {"findings": fleet_findings(catalog, self.mapped), "thumbnails": True}}
        tables = "" if self.live else " The tables are in transfers.parquet."
        fallback = f"{TITLE}: {self.known} plans.{tables} This page needs scripts."
        return self._page("fleet", TITLE, data, fallback)

    def _findings(self, kind: str) -> str:
        if self.map_of is None:
            raise CatalogError(kind[:150], "does not exist")
        return findings_html(*self.map_of(self.reader.catalog, kind), "../", self.live)

    def _plans(self, name: str) -> str:
        pair = self.pair[name]
        title = f"{pair.demonstration_id} → {pair.target_id}"
        fallback = f"{title}: {pair.main['status']}. {pair.main.get('reason') or ''} This page needs scripts."
        picture = self.pictured is None or name in self.pictured
        shown = f"../pictures/{name}.png" if picture else ""
        content = self.reader.pair_data(pair, shown, picture)
        content["missions"] = dict(self.missions.get(name, {}))
        content["plans"][0]["known"] = self.decision(str(pair.main["transfer_id"]))
        scripts = [f"data/{one}.js" for one in dict.fromkeys((pair.source_id, pair.target_id))]
        return self._page("transfer", title, {"transfer": content}, fallback, "../", scripts)

    def plans_of(self, structure_id: str) -> list[Pair]:
        """The pairs whose plans the page of a structure shows."""
        own = [pair for pair in self.pairs if pair.target_id == structure_id]
        return [pair for pair in own if pair.name not in self.problems]

    def _structure(self, name: str) -> str:
        plans = self.plans_of(name)
        pictured = [pair.name for pair in plans if self.pictured is None or pair.name in self.pictured]
        facts = self.reader.structure_page(name, plans, f"../pictures/{pictured[0]}.png" if pictured else "")
        drawn = [f"data/{name}.js"] if facts["marks"] else []  # the surface that findings are drawn on
        fallback = f"{name}: this page needs scripts."
        return self._page("structure", name, {"structure": facts}, fallback, "../", drawn)

    def _passport(self, name: str) -> str:
        data = {"about": self.reader.passport(name, self.inspected.get(name, ("", ""))[0])}
        return self._page("about", name, data, f"{name}: this page needs scripts.", "../")


def findings_html(structure_id: str, rows: pd.DataFrame, root: str = "", live: bool = False) -> str:
    """The page of findings of many structures by their places on one; `root` leads to the report folder."""
    marks = []
    for row in rows.to_dict("records"):
        place = {axis: float(row[f"reference_{axis}"]) for axis in ("x_m", "y_m", "z_m")}
        known = place["x_m"] == place["x_m"]
        one = mark(row | place)
        doubt = ", doubtful" if row["reference_doubtful"] else ""
        where = f"{one['place']}{doubt}" if known else "none"
        error = math.hypot(float(row["reference_error_m"]), one["error"] or 0.0)
        shown = {"place": f"{where}, from {row['target_id']}", "error": error or None}
        marks.append(one | shown | {"xyz": one["xyz"] if known else None})
    title = f"Findings on {structure_id}"
    data = {"id": structure_id, "facts": [], "findings": [], "zones": [], "marks": marks, "plans": [],
            "flights": [], "history": [], "map": True, "alone": not root}  # fmt: skip
    fallback, scripts = f"{title}: this page needs scripts.", [f"data/{structure_id}.js"]
    return pages.page("structure", title, {"structure": data}, fallback, root, scripts, live)


def write_findings_page(catalog: Catalog, structure_id: str, rows: pd.DataFrame, folder: Path) -> Path:
    """Write a folder with that page alone; returns the path of the page.

    `structure_id` is the map of the kind, `rows` are from `upplied.findings.queries.by_reference`; findings
    without a place there are only listed.
    """
    for name, text in pages.assets().items():
        replace_file(folder / "assets" / name, text)
    script = pages.structure_script(Reader(catalog).structure_data(structure_id))
    replace_file(folder / "data" / f"{structure_id}.js", script)
    return replace_file(folder / "index.html", findings_html(structure_id, rows))

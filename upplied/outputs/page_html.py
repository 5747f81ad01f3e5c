"""The pages of a fleet, its plans, structures and demonstrations as HTML, in a folder or made when opened."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

from upplied.outputs import pages
from upplied.outputs.fleet_page import fleet_data
from upplied.outputs.pairs import Pair
from upplied.outputs.reports import Reader
from upplied.outputs.structure_page import fleet_findings, places


def fleet_html(
    reader: Reader,
    pairs: Sequence[Pair],
    title: str,
    known: int,
    problems: Collection[str] = (),
    live: bool = False,
    mapped: Collection[str] = (),
) -> str:
    """The page of the fleet; `mapped` are the kinds whose findings have a page of their own."""
    fleet = fleet_data(list(pairs), title, problems, known, places(reader.catalog))
    findings = fleet_findings(reader.catalog, mapped)
    data = {"fleet": fleet | {"findings": findings, "thumbnails": True}}
    tables = "" if live else " The tables are in transfers.parquet."
    return pages.page(
        "fleet", title, data, f"{title}: {known} plans.{tables} This page needs scripts.", live=live
    )


def pair_html(
    reader: Reader,
    pair: Pair,
    missions: Mapping[str, str] | None = None,
    picture: bool = True,
    live: bool = False,
    known: str = "",
) -> str:
    """The page of one demonstration on one structure.

    `missions` are addresses of files by label; `known` is the last decision, where a person may decide.
    """
    title = f"{pair.demonstration_id} → {pair.target_id}"
    fallback = f"{title}: {pair.main['status']}. {pair.main.get('reason') or ''} This page needs scripts."
    shown = f"../pictures/{pair.name}.png" if picture else ""
    content = reader.pair_data(pair, shown, picture) | {"missions": dict(missions or {})}
    content["plans"][0]["known"] = known
    data = {"transfer": content}
    scripts = [f"data/{name}.js" for name in dict.fromkeys((pair.source_id, pair.target_id))]
    return pages.page("transfer", title, data, fallback, "../", scripts, live)


def structure_html(
    reader: Reader,
    structure_id: str,
    pairs: Sequence[Pair],
    published: Collection[str] | None = None,
    live: bool = False,
) -> str:
    """The page of a structure; `published` names the files that a report folder holds."""
    pictures = [f"pictures/{pair.name}.png" for pair in pairs if pair.target_id == structure_id]
    shown = next((name for name in pictures if published is None or name in published), "")
    facts = reader.structure_page(structure_id, pairs, f"../{shown}" if shown else "")
    fallback = f"{structure_id}: this page needs scripts."
    drawn = [f"data/{structure_id}.js"] if facts["marks"] else []  # the surface that findings are drawn on
    return pages.page("structure", structure_id, {"structure": facts}, fallback, "../", drawn, live)


def passport_html(reader: Reader, demonstration_id: str, pairs: Sequence[Pair], live: bool = False) -> str:
    """The page of a demonstration."""
    planned = inspected_plans(pairs).get(demonstration_id, ("", ""))[0]
    data = {"about": reader.passport(demonstration_id, planned)}
    fallback = f"{demonstration_id}: this page needs scripts."
    return pages.page("about", demonstration_id, data, fallback, "../", live=live)


def inspected_plans(pairs: Sequence[Pair]) -> dict[str, tuple[str, str]]:
    """By demonstration a plan that knows the inspected surface, and the hash of that."""
    plans: dict[str, tuple[str, str]] = {}
    for pair in pairs:
        if known := pair.main.get("inspected_sha256"):
            plans.setdefault(pair.demonstration_id, (str(pair.main["transfer_id"]), str(known)))
    return plans

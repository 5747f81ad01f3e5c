"""`upplied recommend`: which expert's flight fits a structure."""

from __future__ import annotations

from dataclasses import asdict
from typing import Annotated

from cyclopts import App, Parameter

from upplied.cli.options import CatalogOption, JsonOption, StructureArgument
from upplied.cli.terminal import complain, errors, next_step, opened, plain, say, show

app = App(name="recommend", help="Rank demonstrations by how well they fit a structure.")

COLUMNS = {
    "rank": "rank", "demonstration_id": "demonstration", "kind": "kind", "verdict": "verdict",
    "misfit": "misfit", "predicted_seen_pct": "seen %", "without_pct": "lost %",
    "inspected_pct": "inspected %",
}  # fmt: skip
MostOption = Annotated[int, Parameter(name="--most", help="Number of demonstrations to show.")]


@app.default
def recommend(
    structure: StructureArgument,
    /,
    *,
    most: MostOption = 10,
    catalog: CatalogOption = "catalog",
    json: JsonOption = False,
) -> int:
    """Rank the catalog's demonstrations by how well they would transfer; nothing is planned."""
    from upplied.recommend.ranking import recommend as rank

    with errors.status("comparing shapes"):
        ranks = [asdict(one) for one in rank(opened(catalog), structure, most)]
    if json:
        show("", [plain(row) for row in ranks], json)
    else:
        rows = [{title: row[name] for name, title in COLUMNS.items()} for row in ranks]
        show(f"demonstrations for {structure}", rows, spare=("inspected %", "lost %"))
        for row in ranks:
            say(f"{row['rank']}. {row['demonstration_id']}: {row['why']}")
    if not json and any(row["verdict"] == "fits" for row in ranks):
        next_step(f"transfer --best {structure}", "transfer the best one", catalog)
    return int(ranks[0]["verdict"] not in ("own", "fits"))


def best(location: str, structure: str) -> str:
    """The demonstration that fits a structure best, other than its own.

    Raises
    ------
    InputError
        If none fits beyond doubt, or the best is of another declared kind.
    """
    from upplied.errors import InputError
    from upplied.recommend.ranking import recommend as rank

    store = opened(location)
    others = [one for one in rank(store, structure, 100) if one.verdict != "own"]
    fitting = next((one for one in others if one.verdict == "fits"), None)
    if fitting is None:
        closest = f"; the closest is {others[0].demonstration_id}: {others[0].why}" if others else ""
        raise InputError(f"structure {structure}", f"no demonstration fits beyond doubt{closest}")
    kind = store.newest("structures", structure)["kind"]
    if kind != fitting.kind:
        raise InputError(
            f"structure {structure}",
            f"is declared a {kind}, but {fitting.demonstration_id}, which fits best, was flown on a "
            f"{fitting.kind}",
            "demonstrations are transferred within a kind",
            "if both are of one kind, correct the manifest",
        )
    complain(f"{fitting.demonstration_id}: {fitting.why}")
    return fitting.demonstration_id

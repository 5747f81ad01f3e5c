"""`upplied recommend`: which expert's flight fits a structure."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from upplied.cli.options import StructureArgument
from upplied.cli.terminal import PRINTED, Results, complain, errors, plain, say
from upplied.errors import InputError
from upplied.outputs.labels import LABELS

if TYPE_CHECKING:
    from upplied.catalog import Catalog

MostOption = Annotated[int, Parameter(help="Number of demonstrations to show.")]


def recommend(structure: StructureArgument, /, *, most: MostOption = 10, results: Results = PRINTED) -> int:
    """Rank demonstrations by how well they would transfer to a structure; nothing is planned."""
    from upplied.recommend.ranking import recommend as rank

    with errors.status("comparing shapes"):
        ranks = [asdict(one) for one in rank(results.opened(), structure, most)]
    if results.json:
        results.show("", [plain(row) for row in ranks])
    else:
        rows = [{title: row[name] for name, title in LABELS["recommended"].items()} for row in ranks]
        results.show(f"demonstrations for {structure}", rows, ("inspected %", "unmatched %"))
        for row in ranks:
            say(f"{row['rank']}. {row['demonstration_id']}: {row['why']}")
    if any(row["verdict"] == "fits" for row in ranks):
        results.next_step(f"transfer --best {structure}", "transfer the best one")
    return int(ranks[0]["verdict"] not in ("own", "fits"))


def best(store: Catalog, structure: str) -> str:
    """The demonstration that fits a structure best, other than its own.

    Raises
    ------
    InputError
        If none fits beyond doubt, or the best is of another declared kind.
    """
    from upplied.recommend.ranking import recommend as rank

    others = [one for one in rank(store, structure, 100) if one.verdict != "own"]
    fitting = next((one for one in others if one.verdict == "fits"), None)
    if fitting is None:
        closest = f"; the closest is {others[0].demonstration_id}: {others[0].why}" if others else ""
        raise InputError(f"structure {structure}", f"no demonstration clearly fits{closest}")
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

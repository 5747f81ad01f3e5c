"""`upplied report`: the published tables, pages and pictures."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import App, Parameter

from upplied.cli.options import CatalogOption
from upplied.cli.terminal import complain, next_step, opened, progress, say

if TYPE_CHECKING:
    from upplied.catalog import Catalog

app = App(name="report", help="Publish tables, pages and pictures.")

FileOption = Annotated[
    Path | None, Parameter(name="--self-contained", help="One HTML file with everything inside, for mail.")
]


@app.default
def report(
    folder: str | None = None,
    *,
    self_contained: FileOption = None,
    demonstration: Annotated[
        str | None, Parameter(help="Only this demonstration in the single file.")
    ] = None,
    target: Annotated[str | None, Parameter(help="Only this structure in the single file.")] = None,
    pages: Annotated[
        int, Parameter(help="Maximum number of pages, those that need attention first; the tables hold all.")
    ] = 10_000,
    force: Annotated[
        bool,
        Parameter(help="Replace a publication that is newer, from another catalog, or would become empty."),
    ] = False,
    catalog: CatalogOption = "catalog",
) -> int:
    """Publish the catalog as Parquet, HTML pages and pictures, or as one file for mail.

    Parameters
    ----------
    folder : str
        Folder to write, by default `reports`; only changed files are written.
    """
    from upplied import fleet
    from upplied.findings.queries import kind_map
    from upplied.outputs.publish import publish_file

    store = opened(catalog)
    problems: tuple[str, ...] = ()
    if folder is not None or self_contained is None:
        with progress("publishing", min(pages, pairs_in(store))) as advance:
            published = fleet.publish(
                store,
                folder or "reports",
                pages=pages,
                progress=lambda _: advance(),
                force=force,
                map_of=kind_map,
            )
        say(str(published.index))
        problems = published.problems
    if self_contained is not None:
        index = publish_file(store, self_contained, demonstration_id=demonstration, target_id=target)
        say(index)
    if not problems:
        next_step("fly TRANSFER", "simulate a plan in wind; its ID is on its page", catalog)
    for problem in problems:
        complain(f"problem: {problem}")
    return int(bool(problems))


def pairs_in(catalog: Catalog) -> int:
    """How many pairs of a demonstration and a target there are."""
    return len(catalog.transfers(columns=["demonstration_id", "target_id"]).drop_duplicates())

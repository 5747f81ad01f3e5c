"""A folder with one page: a structure in 3-D, coloured by the findings of its whole kind."""

from __future__ import annotations

from pathlib import Path

import pandas as pd

from upplied.catalog import Catalog
from upplied.outputs import pages
from upplied.outputs.files import replace_file
from upplied.outputs.reports import Reader
from upplied.outputs.structure_page import mark


def write_findings_page(catalog: Catalog, structure_id: str, rows: pd.DataFrame, folder: Path) -> Path:
    """Write a page that shows findings of many structures by their places on one of them.

    Parameters
    ----------
    catalog : Catalog
    structure_id : str
        The structure that is the map for all.
    rows : DataFrame
        As `upplied.findings.queries.by_reference` returns it; those without a place there are listed only.
    folder : path
        Made where it does not exist.

    Returns
    -------
    path
        Of the page.
    """
    marks = []
    for row in rows.to_dict("records"):
        place = {axis: float(row[f"reference_{axis}"]) for axis in ("x_m", "y_m", "z_m")}
        known = place["x_m"] == place["x_m"]
        one = mark({str(key): value for key, value in row.items()} | place)
        doubt = ", doubtful" if row["reference_doubtful"] else ""
        where = (
            f"{one['place']}{doubt}, from {row['target_id']}" if known else f"none, from {row['target_id']}"
        )
        error = float(row["reference_error_m"])
        marks.append(one | {"place": where, "error": error, "xyz": one["xyz"] if known else None})
    title = f"Findings on {structure_id}"
    data = {"id": structure_id, "facts": [], "findings": [], "zones": [], "marks": marks, "plans": [],
            "flights": [], "history": [], "map": True}  # fmt: skip
    for name, text in pages.assets().items():
        replace_file(folder / "assets" / name, text)
    script = f"data/{structure_id}.js"
    replace_file(folder / script, pages.structure_script(Reader(catalog).structure_data(structure_id)))
    fallback = f"{title}: this page needs scripts."
    return replace_file(
        folder / "index.html", pages.page("structure", title, {"structure": data}, fallback, "", [script])
    )

"""The page with the findings of a whole kind on one structure, its map: a table and a coloured surface."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import pandas as pd

from upplied.catalog import Catalog
from upplied.files import replace_file
from upplied.outputs import pages
from upplied.outputs.reports import Reader
from upplied.outputs.structure_page import mark

#: Map structure of a kind, and the findings of the kind from `upplied.findings.queries.by_reference`.
MapOf = Callable[[Catalog, str], tuple[str, pd.DataFrame]]


def findings_html(structure_id: str, rows: pd.DataFrame, root: str = "", live: bool = False) -> str:
    """The page of findings of many structures by their places on one; `root` leads to the report folder."""
    marks = []
    for row in rows.to_dict("records"):
        place = {axis: float(row[f"reference_{axis}"]) for axis in ("x_m", "y_m", "z_m")}
        known = place["x_m"] == place["x_m"]
        one = mark({str(key): value for key, value in row.items()} | place)
        doubt = ", doubtful" if row["reference_doubtful"] else ""
        where = (
            f"{one['place']}{doubt}, from {row['target_id']}" if known else f"none, from {row['target_id']}"
        )
        error = math.hypot(float(row["reference_error_m"]), one["error"] or 0.0)
        marks.append(one | {"place": where, "error": error or None, "xyz": one["xyz"] if known else None})
    title = f"Findings on {structure_id}"
    data = {"id": structure_id, "facts": [], "findings": [], "zones": [], "marks": marks, "plans": [],
            "flights": [], "history": [], "map": True, "alone": not root}  # fmt: skip
    fallback, scripts = f"{title}: this page needs scripts.", [f"data/{structure_id}.js"]
    return pages.page("structure", title, {"structure": data}, fallback, root, scripts, live)


def write_findings_page(catalog: Catalog, structure_id: str, rows: pd.DataFrame, folder: Path) -> Path:
    """Write a folder with that page alone.

    Parameters
    ----------
    catalog : Catalog
    structure_id : str
        The map of the kind.
    rows : DataFrame
        From `upplied.findings.queries.by_reference`; findings without a place there are only listed.
    folder : path
        Made where it does not exist.

    Returns
    -------
    path
        Of the page.
    """
    for name, text in pages.assets().items():
        replace_file(folder / "assets" / name, text)
    script = pages.structure_script(Reader(catalog).structure_data(structure_id))
    replace_file(folder / "data" / f"{structure_id}.js", script)
    return replace_file(folder / "index.html", findings_html(structure_id, rows))

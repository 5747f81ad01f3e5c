"""`upplied report`: the published tables, pages and pictures."""

from __future__ import annotations

from pathlib import Path

from cyclopts import App

from upplied.cli.terminal import CatalogOption, console, errors, opened

app = App(name="report", help="Publish tables, pages and pictures.")


@app.default
def report(folder: Path = Path("reports"), *, catalog: CatalogOption = "catalog") -> int:
    """Publish the catalog as plain Parquet, an HTML page and pictures.

    Parameters
    ----------
    folder : Path
        Where to; what it held is replaced.
    """
    from upplied import fleet

    with errors.status("publishing"):
        fleet.publish(opened(catalog), folder)
    console.print(f"{folder / 'index.html'}", soft_wrap=True)
    return 0

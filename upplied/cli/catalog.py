"""`upplied catalog`: what is kept, and how much of it."""

from __future__ import annotations

from cyclopts import App

from upplied.cli.terminal import CatalogOption, JsonOption, opened, show

app = App(name="catalog", help="The catalog itself.")


@app.command
def info(*, catalog: CatalogOption = "catalog", json: JsonOption = False) -> int:
    """Count what the catalog holds."""
    store = opened(catalog)
    transfers = store.transfers()
    rows = [
        {"what": "structures", "count": len(store.structures())},
        {"what": "demonstrations", "count": len(store.demonstrations())},
        {"what": "transfers", "count": len(transfers)},
    ]
    for status, count in transfers["status"].value_counts().sort_index().items():
        rows.append({"what": f"transfers {status}", "count": int(count)})
    show(f"catalog {store.location}", rows, json)
    return 0

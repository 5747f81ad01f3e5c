"""What all commands share: the catalog option, tables, JSON and progress bars."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter
from rich.console import Console

if TYPE_CHECKING:
    from upplied.catalog import Catalog
    from upplied.fleet import Ingested

console = Console(highlight=False, width=None if sys.stdout.isatty() else 160)  # pipes have no edge
errors = Console(highlight=False, stderr=True)

CatalogOption = Annotated[
    str,
    Parameter(
        name="--catalog",
        env_var="UPPLIED_CATALOG",
        help="Folder or object-store URI of the catalog.",
    ),
]
JsonOption = Annotated[bool, Parameter(name="--json", negative="", help="Print JSON instead of a table.")]
WorkersOption = Annotated[int, Parameter(name="--workers", help="Processes; 0 takes one per core.")]

Advance = Callable[[], None]


def opened(location: str) -> Catalog:
    """The catalog at a location."""
    from upplied.catalog import open_catalog

    return open_catalog(location)


def show(title: str, rows: Sequence[Mapping[str, Any]], as_json: bool = False) -> None:
    """Print rows as a table, or as JSON."""
    if as_json:
        text = json.dumps(list(rows), indent=2, default=str, allow_nan=False)
        sys.stdout.write(f"{text}\n")  # asked for: even where --quiet is
        return
    if not rows:
        console.print(f"{title}: none")
        return
    from rich import box
    from rich.table import Table
    from rich.text import Text

    table = Table(title=title, title_justify="left", box=box.SIMPLE_HEAD)
    for name in rows[0]:
        numbers = any(isinstance(row[name], int | float) for row in rows)
        table.add_column(name, justify="right" if numbers else "left", overflow="fold")
    for row in rows:
        table.add_row(*(Text(_cell(value)) for value in row.values()))
    console.print(table)


def _cell(value: Any) -> str:
    if value is None:
        return ""
    return f"{value:.2f}" if isinstance(value, float) else str(value)


def ingested_report(ingested: Sequence[Ingested]) -> int:
    """Say what became of the files; 1 when one of them failed."""
    for item in ingested:
        if item.status == "failed":
            errors.print(f"failed: {item.reason}", markup=False, soft_wrap=True)
    counts = {
        status: sum(item.status == status for item in ingested)
        for status in ("added", "unchanged", "retired", "failed")
    }
    console.print(
        ", ".join(f"{count} {status}" for status, count in counts.items() if count) or "nothing to read"
    )
    return int(counts["failed"] > 0)


@contextmanager
def progress(title: str, total: int | None) -> Iterator[Advance]:
    """A bar with rate and remaining time on a terminal; nothing where output is piped."""
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        Task,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    class Rate(TextColumn):
        def __init__(self) -> None:
            super().__init__("")

        def render(self, task: Task) -> Any:
            self.text_format = f"{task.speed:.1f}/s" if task.speed else ""
            return super().render(task)

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        Rate(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=errors, disable=console.quiet or not errors.is_terminal) as bar:
        task = bar.add_task(title, total=total)
        yield lambda: bar.advance(task)

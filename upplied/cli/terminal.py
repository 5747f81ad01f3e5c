"""Shared by all commands: the catalog, tables, JSON and progress bars."""

from __future__ import annotations

import json
import math
import os
import shlex
import sys
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter
from rich.console import Console

from upplied.errors import InputError

if TYPE_CHECKING:
    import pandas as pd

    from upplied.catalog import Catalog
    from upplied.fleet import Ingested

console = Console(highlight=False, width=None if sys.stdout.isatty() else 160)  # pipes have no edge
errors = Console(highlight=False, stderr=True)

Advance = Callable[[], None]
ID_DIGITS = 12  # of the id of a flight, where people read it
REASONS = 10  # that are printed one by one


@Parameter(name="*")
@dataclass(frozen=True)
class Where:
    """The catalog that a command works on."""

    location: Annotated[
        str,
        Parameter("--catalog", env_var="UPPLIED_CATALOG", help="Folder or object-store URI of the catalog."),
    ] = "catalog"

    def opened(self) -> Catalog:
        from upplied.catalog import open_catalog

        return open_catalog(self.location)

    def plan(self, transfer: str) -> tuple[Catalog, str]:
        """The catalog, and the full ID of a plan from the beginning of it."""
        catalog = self.opened()
        return catalog, catalog.find_transfer(transfer)

    def next_step(self, command: str, why: str) -> None:
        """Suggest the next command on a terminal, with the catalog if it is not the default."""
        elsewhere = self.location != os.environ.get("UPPLIED_CATALOG", "catalog")
        place = f" --catalog {shlex.quote(self.location)}" if elsewhere else ""
        hint(f"Next: upplied {command}{place}  ({why})")


@Parameter(name="*")
@dataclass(frozen=True)
class Results(Where):
    """The catalog, and whether results are printed as JSON."""

    json: Annotated[bool, Parameter("--json", help="Print JSON instead of a table.")] = False

    def show(self, title: str, rows: Sequence[Mapping[str, Any]], spare: Sequence[str] = ()) -> None:
        """Print rows as a table, or as JSON; `spare` columns go first where the terminal is too narrow."""
        if self.json:
            text = json.dumps(list(rows), indent=2, default=str, allow_nan=False)
            sys.stdout.write(f"{text}\n")  # even with --quiet
            return
        if not rows:
            console.print(f"{title}: none")
            return
        from rich import box
        from rich.table import Table
        from rich.text import Text

        cells = {name: [_cell(row[name]) for row in rows] for name in rows[0]}
        left_out = _left_out(cells, spare)
        table = Table(title=title, title_justify="left", box=box.SIMPLE_HEAD, pad_edge=False)
        table.padding = (0, 1, 0, 0)
        for name in (columns := [name for name in cells if name not in left_out]):
            numbers = any(isinstance(row[name], int | float) for row in rows)
            # A long text may be wrapped.
            whole = numbers and not any(isinstance(row[name], str) for row in rows)
            table.add_column(name, justify="right" if whole else "left", overflow="fold", no_wrap=whole)
        for texts in zip(*(cells[name] for name in columns), strict=True):
            table.add_row(*map(Text, texts))
        console.print(table)
        if left_out:
            hint(f"hidden columns (terminal too narrow): {', '.join(left_out)}")

    def show_frame(
        self, title: str, frame: pd.DataFrame, columns: Mapping[str, str], spare: Sequence[str] = ()
    ) -> None:
        """Print some columns of a frame under other names as a table, or all of them as JSON."""
        rows = rows_of(frame, None if self.json else columns)
        if not self.json and "flight" in columns.values():
            rows = [{**row, "flight": row["flight"][:ID_DIGITS]} for row in rows]
        self.show(title, rows, spare)

    def show_facts(self, title: str, facts: Mapping[str, Any]) -> None:
        known = {name: value for name, value in facts.items() if value not in ("", None)}
        self.show(title, [{"item": name, "value": value} for name, value in known.items()])

    def say(self, text: object) -> None:
        """Print a line below a table; not with JSON."""
        if not self.json:
            say(text)

    def next_step(self, command: str, why: str) -> None:
        """Suggest the next command on the same catalog; not with JSON."""
        if not self.json:
            super().next_step(command, why)


HERE, PRINTED = Where(), Results()


def say(text: object) -> None:
    """Print a line without wrapping: people copy IDs and paths from it."""
    console.print(str(text), markup=False, soft_wrap=True)


def complain(text: object) -> None:
    errors.print(str(text), markup=False, soft_wrap=True)


def complain_each(what: str, reasons: Sequence[str]) -> None:
    for reason in reasons[:REASONS]:
        complain(f"{what}: {reason}")
    if len(reasons) > REASONS:
        complain(f"{what}: {len(reasons) - REASONS} more")


def beside(output: Path) -> Path:
    """The file to write, if its folder exists."""
    if not output.absolute().parent.is_dir():
        remedy = f"create it first: mkdir -p {shlex.quote(str(output.parent))}"
        raise InputError(str(output), "its folder does not exist", "", remedy)
    return output


def rows_of(frame: pd.DataFrame, names: Mapping[str, str] | None = None) -> list[dict[str, Any]]:
    """The rows of a frame with the columns of `names` under new names; None for missing values.

    Without names all columns, with JSON texts parsed.
    """
    chosen = frame if names is None else frame[list(names)].rename(columns=names)
    for name in chosen.select_dtypes("datetimetz"):
        chosen = chosen.assign(**{name: chosen[name].dt.strftime("%Y-%m-%d %H:%M:%SZ")})
    rows: list[dict[str, Any]] = chosen.astype(object).where(chosen.notna(), None).to_dict("records")
    texts = {name for name in chosen if name.endswith("_json") or name == "warnings"} if names is None else ()
    for row in rows:
        row |= {name: json.loads(row[name]) for name in texts if isinstance(row[name], str) and row[name]}
    return rows


def plain(row: Mapping[str, Any]) -> dict[str, Any]:
    """A row with None in place of NaN and infinity, which JSON lacks."""
    lacking = {name for name, value in row.items() if isinstance(value, float) and not math.isfinite(value)}
    return {name: None if name in lacking else value for name, value in row.items()}


def point_text(point: Sequence[float]) -> str:
    return f"({', '.join(f'{value:g}' for value in point)}) m"


def number(value: Any) -> float | None:
    return None if value is None or value != value else float(value)


def compared(
    titles: Mapping[str, str], rows: Mapping[str, Mapping[Any, Any]], difference: tuple[str, str, str]
) -> list[dict[str, Any]]:
    """A row for each measure: its title, its value in each of `rows`, and the difference of two."""
    lines = []
    for measure, title in titles.items():
        values = {name: number(row[measure]) for name, row in rows.items()}
        line: dict[str, Any] = {"measure": title, **values}
        if len(values) == 2:
            first, second = (values[name] for name in difference[1:])
            line[difference[0]] = None if first is None or second is None else first - second
        lines.append(line)
    return lines


def _left_out(cells: Mapping[str, Sequence[str]], spare: Sequence[str]) -> list[str]:
    """The first spare columns, as many as must be hidden for the others to fit."""
    widths = {name: max(len(text) for text in (name, *texts)) + 2 for name, texts in cells.items()}
    gone = [name for name in spare if name in widths]
    for count in range(len(gone)):
        if 2 + sum(width for name, width in widths.items() if name not in gone[:count]) <= console.width:
            return gone[:count]
    return gone


def hint(line: str) -> None:
    if console.is_terminal:
        console.print(line, markup=False, soft_wrap=True, style="dim")


def _cell(value: Any) -> str:
    if value is None or value != value:
        return ""
    if isinstance(value, float):
        return f"{value:.2f}" if abs(value) < 100 else f"{value:.1f}"
    return str(value)


def ingested_report(ingested: Sequence[Ingested]) -> int:
    shown = [item for item in ingested if item.file and item.status != "unchanged"]
    if shown:
        above = os.path.commonpath([os.path.dirname(item.file) for item in shown])
        texts = [item.words or item.reason.removeprefix(f"{item.file}: ") for item in shown]
        rows = [{"file": os.path.relpath(item.file, above), "result": item.status, "details": text}
                for item, text in zip(shown, texts, strict=True)]  # fmt: skip
        PRINTED.show("flights", rows)
    for item in ingested:
        if item.status == "failed":
            complain(f"failed: {item.reason}")
        for finding in item.findings:
            say(f"{item.name}: {finding}")
    counts = Counter(item.status for item in ingested)
    order = ("added", "readable", "unchanged", "retired", "failed", "passed over")
    say(", ".join(f"{counts[status]} {status}" for status in order if counts[status]) or "nothing to read")
    return int(counts["failed"] > 0)


@contextmanager
def progress(title: str, total: int | None) -> Iterator[Advance]:
    """A progress bar on a terminal; nothing if output is piped."""
    from rich.progress import MofNCompleteColumn, Progress, TimeElapsedColumn

    words, bar, _, remaining = Progress.get_default_columns()
    columns = (words, bar, MofNCompleteColumn(), TimeElapsedColumn(), remaining)
    with Progress(*columns, console=errors, disable=console.quiet or not errors.is_terminal) as shown:
        task = shown.add_task(title, total=total)
        yield lambda: shown.advance(task)

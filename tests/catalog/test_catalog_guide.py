"""The guide runs as it stands, and the same question has the same answer whoever is asked."""

from __future__ import annotations

import ast
import re
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import duckdb
import pandas as pd
import polars as pl
import pytest
from catalog_records import demonstration, key_of, plan, structure

from upplied.catalog import export_tables, open_catalog

GUIDE = Path(__file__).parents[2] / "docs" / "queries.md"


@pytest.fixture(scope="module")
def place(tmp_path_factory) -> Path:
    """A folder with a catalog of two nights and what was published from it."""
    folder = tmp_path_factory.mktemp("guide")
    catalog = open_catalog(folder / "catalog")
    catalog.add_structures([structure("boxy"), *(structure(f"t{at}", at) for at in range(4))])
    catalog.add_demonstrations([demonstration()])
    for night in (2, 0):
        batch = []
        for at in range(4):
            for preset in ("recommended", "baseline"):
                status = "refused" if at == 3 and preset == "baseline" else "ok"
                item = replace(plan(f"t{at}", 10 * night + at, status=status, preset=preset), surface=None)
                attributes = {
                    "planned_at": datetime.now(UTC) - timedelta(days=night),
                    "run_id": f"night-{night}",
                    "method_version": str(3 - night),
                }
                batch.append((key_of(night, at, preset), item, attributes))
        catalog.add_plans(batch)
    export_tables(catalog, folder / "reports")
    return folder


def answers(text: str) -> list[Any]:
    """The values of all bare expressions in the code of a document, in order."""
    names: dict[str, Any] = {}
    replies = []
    for code in re.findall(r"```python\n(.*?)```", text, re.DOTALL):
        for node in ast.parse(code).body:
            if isinstance(node, ast.Expr):
                replies.append(eval(compile(ast.Expression(node.value), str(GUIDE), "eval"), names))  # noqa: S307
            else:
                exec(compile(ast.Module([node], []), str(GUIDE), "exec"), names)
    return replies


@pytest.mark.ci
def test_every_question_of_the_guide_has_an_answer(place, monkeypatch):
    monkeypatch.chdir(place)
    text = GUIDE.read_text(encoding="utf-8")
    assert len(re.findall(r"^\*\*\d+\. ", text, re.MULTILINE)) >= 12
    replies = answers(text)
    tables = [answer for answer in replies if isinstance(answer, pd.DataFrame | pd.Series | pl.DataFrame)]
    assert len(tables) >= 16
    assert all(len(table) for table in tables[:5])
    assert [answer for answer in replies if isinstance(answer, list)] == [[], []]  # siblings, verify


def test_pandas_duckdb_polars_and_the_catalog_agree(place):
    ours = (
        open_catalog(place / "catalog").transfers(status="ok").groupby("preset")["coverage_seen_pct"].mean()
    )
    path = str(place / "reports" / "transfers.parquet")
    pandas = pd.read_parquet(path).query("status == 'ok'").groupby("preset")["coverage_seen_pct"].mean()
    question = "SELECT preset, avg(coverage_seen_pct) m FROM '{}' WHERE status = 'ok' GROUP BY preset"
    duck = duckdb.sql(question.format(f"{path}/**/*.parquet")).df().set_index("preset")["m"]
    scanned = pl.scan_parquet(path).filter(pl.col("status") == "ok").group_by("preset")
    polars = dict(scanned.agg(pl.col("coverage_seen_pct").mean()).collect().iter_rows())
    for preset, value in ours.items():
        for other in (pandas, duck, polars):
            assert other[preset] == pytest.approx(value, rel=1e-12)

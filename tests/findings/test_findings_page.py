"""The how-to page of findings: every block is run as it stands."""

from __future__ import annotations

import re
import shlex
from dataclasses import replace
from pathlib import Path

import pytest
from PIL import Image
from test_findings import BEGAN_NS, CUBE, CUBOID, flown

from upplied.catalog import open_catalog, verify
from upplied.cli import main

PAGE = Path(__file__).parents[2] / "docs" / "how-to" / "findings.md"


@pytest.mark.slow
def test_every_block_of_the_page_runs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    catalog = open_catalog("catalog")
    tanks = [replace(each, structure_id=f"tank-{at}") for at, each in enumerate((CUBE, CUBOID), 1)]
    catalog.add_structures(tanks)
    catalog.add_demonstrations(
        [replace(flown(), demonstration_id=f"round-{each.structure_id}", structure_id=each.structure_id)
         for each in tanks]
    )  # fmt: skip
    Path("photos").mkdir()
    lines = ["name,t_ns"]
    for number in range(3):
        Image.new("RGB", (1600, 1190)).save(f"photos/IMG_{number}.png", compress_level=1)
        lines.append(f"IMG_{number}.png,{BEGAN_NS + number * 5_000_000_000}")
    Path("photos/times.csv").write_text("\n".join(lines))
    ran = 0
    for language, text in re.findall(
        r"^```(\w+)\n(.*?)^```", PAGE.read_text("utf-8"), re.DOTALL | re.MULTILINE
    ):
        if language == "python":
            exec(text, {})
            ran += 1
            continue
        for line in filter(None, (line.split(" #")[0].strip() for line in text.splitlines())):
            known = catalog.findings()["finding_id"]
            command = line.replace("FLIGHT", "round-tank-1").replace(
                "FINDING", known.iloc[-1] if len(known) else ""
            )
            if " campaign " in command:  # the demonstration on tank 2 showed it at 3.6 mm/px
                command = command.replace("--mm-px 8", "--mm-px 3")
            if "--findings open" in line:  # the page has set it to be watched
                assert main(["findings", "set", known.iloc[-1], "open", "--by", "Ada"]) == 0
            assert main(shlex.split(command)[1:]) == 0, line
            ran += 1
    drafts = catalog.transfers(every=True)
    assert ran == 11 and sorted(drafts["target_id"]) == ["tank-1", "tank-2"] and verify(catalog) == []
    assert "tank-1" in Path("map/index.html").read_text() and Path("map/data/tank-2.js").is_file()
    assert len(list(Path("looks").glob("look-*.png"))) >= 1

"""The page that comes first: its commands lead from sample files to a mission and a brief."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest

from upplied.catalog import open_catalog
from upplied.cli import main

PAGE = (Path(__file__).parents[2] / "docs" / "ten-minutes.md").read_text(encoding="utf-8")


@pytest.mark.slow
def test_the_commands_of_the_page_lead_to_a_mission(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("UPPLIED_CATALOG", raising=False)
    blocks = re.findall(r"```(?:bash|sh)\n(.*?)```", PAGE, re.DOTALL)
    lines = [line for block in blocks for line in block.splitlines()]
    assert len(lines) > 7
    for line in lines:
        words = shlex.split(line)[1:]
        if words == ["studio"]:
            continue  # serves until it is stopped; web/test_studio.py does so
        if "ID" in words:
            plans = open_catalog("catalog").transfers(preset="recommended", status="ok")
            words = [plans["transfer_id"].iloc[0] if word == "ID" else word for word in words]
        allowed = (0, 1) if words[0] == "transfer" else (0,)  # 1: where the baseline must not be flown
        assert main(words) in allowed, line
    assert '"fileType": "Plan"' in (tmp_path / "cuboid.plan").read_text()
    assert "All safety checks passed" in (tmp_path / "brief.html").read_text()

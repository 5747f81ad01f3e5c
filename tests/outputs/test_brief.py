"""The page for the pilot: figures are those of the missions, names stay text, and it is one file."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from made_missions import made_plan, placed_box
from PIL import Image

from upplied.outputs.brief import Line, brief_html, map_png, side_png
from upplied.outputs.missions import MissionOptions, missions_of

ROW = {
    "transfer_id": "abc", "demonstration_id": "demo", "target_id": "box", "preset": "recommended",
    "method_version": "3",
    "planned_at": "2026-01-02 03:04:05+00:00", "coverage_seen_pct": 98.76, "min_clearance_m": 6.0,
    "path_length_m": float("nan"),
}  # fmt: skip


@pytest.fixture(scope="module")
def made():
    structure, options = placed_box(), MissionOptions(endurance_s=120.0)
    return missions_of(made_plan(), structure, options), structure, options


def test_the_page_says_what_the_missions_are(made):
    missions, structure, options = made
    page = brief_html(ROW, missions, structure, options, ["mind the mast"])
    assert len(missions) > 1
    for mission in missions:
        assert (
            f"<td>{mission.number} of {mission.count}</td>" in page
            and f"<td>{mission.duration_s:.0f}</td>" in page
        )
    highest = max(mission.local[:, 2].max() for mission in missions)
    assert f"highest point above ground</td><td>{highest:.1f} m" in page
    assert f"at least {missions[0].return_height_m:.1f} m" in page
    assert "98.8 %" in page and "inspection path" not in page  # what was not measured is left out
    assert "mind the mast" in page and "All safety checks passed" in page
    assert all(note in page for note in missions[0].notes)


def test_it_is_one_file_without_scripts_and_names_stay_text(made):
    missions, structure, options = made
    page = brief_html(
        ROW | {"target_id": "<img src=x onerror=alert(1)>"}, missions, structure, options, ["<b>"]
    )
    assert "<img src=x" not in page and "&lt;img" in page and "&lt;b&gt;" in page
    assert "<script" not in page and not re.search(r'(src|href)="(?!data:)', page)
    assert "default-src 'none'" in page


def test_what_was_overruled_is_the_verdict(made):
    missions, structure, options = made
    forced = [replace(each, notes=("OVERRULED clearance: 0.50 m", *each.notes)) for each in missions]
    page = brief_html(ROW, forced, structure, options, [])
    assert "Safety rules were overruled" in page and "OVERRULED clearance: 0.50 m" in page
    assert "All safety checks passed" not in page


def test_the_map_has_north_up_and_every_line_in_it():
    """A flight due north of a structure that looks east is drawn above it."""
    structure = placed_box(keep_out_m=np.array([[[-9.0, -9, 0], [-7, -7, 5]]]))
    north = Line(*(np.array([[0.0, y, 5], [0.1, y + 1.0, 5]]) for y in (20.0, 21.0, 22.0)))
    import io

    def rows_of(png, shade):
        """Rows of the picture, above its legend, whose light has a tint."""
        pixels = np.asarray(Image.open(io.BytesIO(png)).convert("RGB"), float)[50:560]
        red, _, blue = np.moveaxis(pixels, 2, 0)
        tint = {"blue": blue - red > 90, "red": red - blue > 90, "grey": (red < 230) & (blue - red < 40)}
        return np.argwhere(tint[shade])[:, 0]

    drawn = map_png(structure, [north], 90.0)  # +X looks east, so +Y is north
    assert rows_of(drawn, "blue").mean() < rows_of(drawn, "grey").mean() - 100
    assert len(rows_of(drawn, "red")) > 20  # the keep-out box
    turned = map_png(structure, [north], 270.0)
    assert rows_of(turned, "blue").mean() > rows_of(turned, "grey").mean() + 100
    assert side_png(structure, [north])[:4] == b"\x89PNG"


def test_a_draft_says_so_first(made):
    missions, structure, options = made
    draft = [
        replace(each, notes=("DRAFT, NOT RELEASED: it is a draft plan", *each.notes)) for each in missions
    ]
    page = brief_html(ROW, draft, structure, options, [])
    assert "This plan is a draft" in page and "All safety checks passed" not in page

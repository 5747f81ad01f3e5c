"""The page for the pilot: figures are those of the missions, names stay text, and it is one file."""

from __future__ import annotations

import base64
import io
import re
from dataclasses import replace

import numpy as np
import pytest
from made_missions import made_plan, placed_box
from PIL import Image

from upplied.geometry.poses import look_at
from upplied.outputs.brief import brief_html
from upplied.outputs.mission_drawing import Flight, MissionDrawing
from upplied.outputs.missions import MissionOptions, missions_of
from upplied.records import Camera

ROW = {
    "transfer_id": "abc", "demonstration_id": "demo", "target_id": "box", "preset": "recommended",
    "method_version": "3",
    "planned_at": "2026-01-02 03:04:05+00:00", "coverage_seen_pct": 98.76, "min_clearance_m": 6.0,
    "path_length_m": float("nan"),
}  # fmt: skip


@pytest.fixture(scope="module")
def mission_set():
    structure, options = placed_box(), MissionOptions(endurance_s=120.0)
    return missions_of(made_plan(), structure, options), structure, options


def test_the_page_says_what_the_missions_are(mission_set):
    missions, structure, options = mission_set
    page = brief_html(ROW, missions, structure, Camera(), options, ["mind the mast"])
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


def test_it_is_one_file_without_scripts_and_names_stay_text(mission_set):
    missions, structure, options = mission_set
    page = brief_html(
        *(
            ROW | {"target_id": "<img src=x onerror=alert(1)>"},
            missions,
            structure,
            Camera(),
            options,
            ["<b>"],
        )
    )
    assert "<img src=x" not in page and "&lt;img" in page and "&lt;b&gt;" in page
    assert "<script" not in page and not re.search(r'(src|href)="(?!data:)', page)
    assert "default-src 'none'" in page


def test_what_was_overruled_is_the_verdict(mission_set):
    missions, structure, options = mission_set
    forced = [replace(each, notes=("OVERRULED clearance: 0.50 m", *each.notes)) for each in missions]
    page = brief_html(ROW, forced, structure, Camera(), options, [])
    assert "Safety rules were overruled" in page and "OVERRULED clearance: 0.50 m" in page
    assert "All safety checks passed" not in page


def drawing_of(heading_deg, **around):
    """A flight round a box with a photo at each end: it comes from the west and ends 20 m to its +Y."""
    structure = placed_box(**around)
    path = np.array([[-30.0, 0, 3], [0, 19, 5], [0, 20, 5], [0.1, 21, 5]])
    gaze = look_at(path, np.tile([0.0, 0.0, 5.0], (len(path), 1)))
    flight = Flight(path, gaze, np.array([False, True, True, True]), np.array([False, True, False, True]))
    home = np.array([-30.0, 0.0, 1.0])
    return MissionDrawing(structure, [flight], Camera(), heading_deg, home, 12.0)


def decoded(address):
    kind, content = address.split(",")
    assert kind in ("data:image/svg+xml;base64", "data:image/png;base64")
    return base64.b64decode(content)


def places(svg, style):
    """The corners (N, 2) of the paths in a style, px from the upper left."""
    lines = re.findall(rf'd="M([^"]+)" style="{style}', svg)
    return np.array([corner.rstrip("Z").split()[:2] for line in lines for corner in line.split("L")], float)


def test_the_map_has_north_up_and_every_line_in_it():
    """A flight due north of a structure that looks east is drawn above it."""
    boxes = np.array([[[-9.0, -9, 0], [-7, -7, 5]]])
    for heading_deg, side in ((90.0, -1), (270.0, 1)):  # where +X looks east, +Y is north
        svg = decoded(drawing_of(heading_deg, keep_out_m=boxes).map()).decode()
        masks = [Image.open(io.BytesIO(decoded(each))) for each in re.findall('href="([^"]+)"', svg)]
        surface, footprints = (np.argwhere(np.asarray(mask))[:, ::-1] for mask in masks)
        path, limits = places(svg, "stroke: #0072b2"), places(svg, "stroke: #b3261e")
        assert (side * (path[:, 1] - surface[:, 1].mean()) > 100).all()
        assert len(path) == 3 and len(limits) == 4 and len(places(svg, "stroke: #7a7a7a")) >= 2
        assert len(surface) > 500 and ">N</text>" in svg and ">H</text>" in svg
        low, high = surface.min(axis=0) - 3, surface.max(axis=0) + 3
        assert ((footprints > low) & (footprints < high)).all(), (
            "on the structure alone, and on its near side"
        )
        assert len(footprints) > 20 and side * (footprints[:, 1].mean() - surface[:, 1].mean()) > 5


def test_the_heights_count_from_take_off_and_show_ground_ceiling_and_return():
    drawing = drawing_of(90.0, ceiling_z_m=20.0, ground_z_m=0.0)
    svg = decoded(drawing.heights()).decode()
    assert all(f">{words} m</text>" in svg for words in ("ground -1", "return to home 12", "ceiling 19", "0"))
    path, leg = places(svg, "stroke: #0072b2"), places(svg, "stroke: #7a7a7a")
    ground = places(svg, "stroke: #5f6b78")[0, 1]
    per_m = (ground - places(svg, "stroke: #b3261e")[0, 1]) / 20.0  # the ceiling is 20 m above the ground
    assert path[:, 1] == pytest.approx(ground - 5.0 * per_m, abs=0.11)
    assert leg[:, 1].max() == pytest.approx(ground - per_m, abs=0.11), "it starts at take-off"
    assert (np.diff(path[:, 0]) > 0).all() and "-0 m" not in svg


def test_the_legend_names_what_is_drawn():
    names = [name for name, _, _ in drawing_of(90.0, keep_out_m=np.zeros((1, 2, 3))).legend()]
    assert names == ["take-off", "inspection path", "transit legs", "keep-out area or geofence",
                     "photo", "footprint of a photo"]  # fmt: skip
    alone = replace(drawing_of(90.0), home=None)
    assert [name for name, _, _ in alone.legend()] == ["inspection path", "photo", "footprint of a photo"]


def test_a_draft_says_so_first(mission_set):
    missions, structure, options = mission_set
    draft = [
        replace(each, notes=("DRAFT, NOT RELEASED: it is a draft plan", *each.notes)) for each in missions
    ]
    page = brief_html(ROW, draft, structure, Camera(), options, [])
    assert "This plan is a draft" in page and "All safety checks passed" not in page

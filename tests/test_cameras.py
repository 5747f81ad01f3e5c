"""The cameras of the list: complete, with a source each, and as their data sheets say."""

from __future__ import annotations

import math
from dataclasses import fields

import pytest

from upplied.cameras import (
    DEFAULT_TRIGGER_S,
    assumptions,
    completed,
    known_camera,
    known_cameras,
    least_interval,
    named_by_exif,
)
from upplied.config import InspectionSettings
from upplied.errors import SettingsError
from upplied.records import Camera

RULE = InspectionSettings()


def test_there_are_ten_and_each_names_its_data_sheet() -> None:
    entries = known_cameras()
    assert len(entries) >= 10
    for name, entry in entries.items():
        assert entry["source"].startswith("https://"), name
        assert entry.keys() >= {"name", "exif", "width_px", "height_px", "focal_mm", "trigger_s"}, name
        assert ("sensor_mm" in entry) != ("dfov_deg" in entry), name
        camera = known_camera(name)
        assert 0.3 <= camera.trigger_s <= 10 and 20 < camera.vfov_deg < camera.hfov_deg < 90


@pytest.mark.parametrize(
    ("name", "diagonal_deg", "pixel_um"),  # of the same sheets
    [
        ("dji-zenmuse-p1-35", 63.5, 4.4),
        ("dji-phantom-4-rtk", 84.0, 2.4),
        ("phase-one-ixm-100-35", 76.0, 3.76),
    ],
)
def test_fields_of_view_and_pixels_are_those_of_the_sheets(name, diagonal_deg, pixel_um) -> None:
    camera = known_camera(name)
    across, up = (math.tan(math.radians(angle) / 2) for angle in (camera.hfov_deg, camera.vfov_deg))
    assert math.degrees(2 * math.atan(math.hypot(across, up))) == pytest.approx(diagonal_deg, abs=0.8)
    assert 2e3 * camera.focal_mm * across / camera.width_px == pytest.approx(pixel_um, rel=0.02)


def test_the_file_format_says_how_long_a_photo_takes() -> None:
    assert [known_camera("dji-mavic-3e", kind).trigger_s for kind in ("jpeg", "raw")] == [0.7, 3.0]
    assert known_camera("dji-phantom-4-rtk", "raw").trigger_s == 2.5  # the sheet is silent about it
    for wrong in (("nikon-f",), ("dji-mavic-3e", "tiff")):
        with pytest.raises(SettingsError, match="one of"):
            known_camera(*wrong)


def test_exif_names_a_camera_by_its_model_and_lens() -> None:
    assert named_by_exif("DJI ZenmuseP1", 35.0) == "dji-zenmuse-p1-35"
    assert named_by_exif("DJI ZenmuseP1", 24.0) == ""
    assert named_by_exif("DJI FC6310R", 8.8) == "dji-phantom-4-rtk"
    assert named_by_exif("? ?", 0.0) == ""


def test_what_was_measured_counts_before_the_list() -> None:
    known = known_camera("dji-phantom-4-rtk")
    found = completed(Camera(hfov_deg=60.0, width_px=1000, trigger_s=5.0), known)
    assert (found.hfov_deg, found.width_px, found.trigger_s) == (60.0, 1000, 5.0)
    assert (found.model, found.focus_m, found.f_number) == ("dji-phantom-4-rtk", 1.0, 2.8)


def test_the_interval_says_where_it_is_known_from() -> None:
    assert least_interval(None)[0] == least_interval(Camera())[0] == DEFAULT_TRIGGER_S == 2.0
    assert "nobody says" in least_interval(Camera())[1]
    assert least_interval(Camera(trigger_s=1.5)) == (1.5, "as the demonstration took them")
    assert "dji-phantom-4-rtk" in least_interval(known_camera("dji-phantom-4-rtk"))[1]


def test_what_is_assumed_is_named() -> None:
    said = assumptions(Camera(), RULE.exposure_s, RULE.width_px)
    assert said == [
        "4000 pixels of width", "an exposure of 1/500 s", "2 s between photos", "everything in focus"
    ]  # fmt: skip
    assert assumptions(known_camera("dji-phantom-4-rtk"), 1 / 500, 4000) == ["an exposure of 1/500 s"]


def test_an_unknown_optic_leaves_a_camera_as_it_was_stored() -> None:
    later = [item.name for item in fields(Camera) if item.metadata.get("later")]
    assert later == ["model", "exposure_s", "trigger_s", "focus_m", "focal_mm", "f_number"]
    assert not any(getattr(Camera(), name) for name in later)


def test_a_known_exposure_and_finer_pixels_ask_for_slower_flight() -> None:
    usual = RULE.sharp_radps(75.0)
    assert RULE.sharp_radps(75.0, 1440) == usual  # coarser pixels are no licence
    assert RULE.sharp_radps(75.0, 8000) == pytest.approx(usual / 2)
    assert RULE.sharp_radps(75.0, 0, 1 / 250) == pytest.approx(usual / 2)

"""The cameras of the list: complete, with a source each, and their doubtful figures named."""

from __future__ import annotations

import math
from dataclasses import fields

import pytest

from upplied.cameras import (
    DEFAULT_TRIGGER_S,
    completed,
    known_camera,
    known_cameras,
    least_interval,
    named_by_exif,
    unverified,
)
from upplied.config import InspectionSettings
from upplied.errors import SettingsError
from upplied.records import Camera

RULE = InspectionSettings()


def test_there_are_ten_and_each_names_what_its_figures_were_read_from() -> None:
    entries = known_cameras()
    assert len(entries) >= 10
    for name, entry in entries.items():
        doubtful = set(entry.get("unverified", ()))
        assert doubtful <= entry.keys(), name
        read = entry.keys() & {"width_px", "height_px", "sensor_mm", "dfov_deg", "focal_mm"} - doubtful
        assert ("https://" in entry["source"]) == bool(read), name
        assert entry.keys() >= {"name", "exif", "width_px", "height_px", "focal_mm", "trigger_s"}, name
        assert ("sensor_mm" in entry) != ("dfov_deg" in entry), name
        camera = known_camera(name)
        assert 0.3 <= camera.trigger_s <= 10 and 20 < camera.vfov_deg < camera.hfov_deg < 90


@pytest.mark.parametrize(
    ("name", "diagonal_deg", "pixel_um"),
    [
        ("dji-zenmuse-p1-35", 63.5, 4.4),
        ("dji-phantom-4-rtk", 84.0, 2.4),
        ("phase-one-ixm-100-35", 76.0, 3.76),
    ],
)
def test_fields_of_view_and_pixels_follow_from_the_figures(name, diagonal_deg, pixel_um) -> None:
    camera = known_camera(name)
    across, up = (math.tan(math.radians(angle) / 2) for angle in (camera.hfov_deg, camera.vfov_deg))
    assert math.degrees(2 * math.atan(math.hypot(across, up))) == pytest.approx(diagonal_deg, abs=0.8)
    assert 2e3 * camera.focal_mm * across / camera.width_px == pytest.approx(pixel_um, rel=0.02)


def test_the_file_format_says_how_long_a_photo_takes() -> None:
    assert [known_camera("dji-mavic-3e", kind).trigger_s for kind in ("jpeg", "raw")] == [0.7, 3.0]
    assert known_camera("dji-phantom-4-rtk", "raw").trigger_s == 2.5  # nothing is stated of it
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
    camera = completed(Camera(hfov_deg=60.0, width_px=1000, trigger_s=5.0), known)
    assert (camera.hfov_deg, camera.width_px, camera.trigger_s) == (60.0, 1000, 5.0)
    assert (camera.model, camera.focus_m, camera.f_number) == ("dji-phantom-4-rtk", 1.0, 2.8)


def test_the_interval_says_where_it_is_known_from() -> None:
    assert least_interval(None)[0] == least_interval(Camera())[0] == DEFAULT_TRIGGER_S == 2.0
    assert "is unknown" in least_interval(Camera())[1]
    assert least_interval(Camera(trigger_s=1.5)) == (1.5, "as the demonstration took them")
    assert "dji-phantom-4-rtk" in least_interval(known_camera("dji-phantom-4-rtk"))[1]


def test_figures_that_were_read_nowhere_are_named_but_for_those_the_flight_has() -> None:
    assert unverified("sony-a7r-iv-35") == ""
    words = unverified("dji-mavic-3e")
    assert words.startswith("sensor width, focal length") and words.endswith("of dji-mavic-3e not verified")
    assert "sensor" not in unverified("dji-mavic-3e", ["hfov_deg"])
    assert unverified("dji-phantom-4-rtk", ["focus_m", "trigger_s"]) == ""
    assert least_interval(known_camera("sony-a7r-iv-35"))[1] == "of the camera sony-a7r-iv-35"
    assert least_interval(known_camera("dji-mavic-3e"))[1].endswith("not verified")


def test_an_unknown_optic_leaves_a_camera_as_it_was_stored() -> None:
    later = [item.name for item in fields(Camera) if item.metadata.get("later")]
    assert later == ["model", "exposure_s", "trigger_s", "focus_m", "focal_mm", "f_number", "lens"]
    assert not any(getattr(Camera(), name) for name in later)


def test_a_known_exposure_and_finer_pixels_ask_for_slower_flight() -> None:
    usual = RULE.sharp_radps(75.0)
    assert RULE.sharp_radps(75.0, 1440) == usual  # coarser pixels are no licence
    assert RULE.sharp_radps(75.0, 8000) == pytest.approx(usual / 2)
    assert RULE.sharp_radps(75.0, 0, 1 / 250) == pytest.approx(usual / 2)

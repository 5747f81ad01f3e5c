"""What is said of a flight: forms, sources, and which of them wins."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from upplied.checks import check_id
from upplied.errors import InputError
from upplied.inputs.sidecar import LogOptions, inspection, placed, safe_id
from upplied.records import Placement


def facts_of(
    tmp_path: Path, sidecar: str = "", options: LogOptions | None = None, **metadata: str
) -> LogOptions:
    """The facts from these sources."""
    path = tmp_path / "flight 7.mcap"
    if sidecar:
        path.with_suffix(".toml").write_text(f"[inspection]\n{sidecar}\n")
    return inspection(path, [("rosbag2", {"x": "y"}), ("inspection", metadata)], options or LogOptions())[0]


def test_each_fact_comes_from_its_strongest_source(tmp_path: Path) -> None:
    options = LogOptions(structure_id="a", operator="a", site="a")
    facts = facts_of(tmp_path, 'structure_id = "c"', options, structure_id="b", operator="b")
    assert (facts.structure_id, facts.operator, facts.site) == ("c", "b", "a")
    assert facts.demonstration_id == "flight-7"


def test_what_to_read_is_the_choice_of_the_caller(tmp_path: Path) -> None:
    facts = facts_of(tmp_path, 'topic = "/c"\nstart_s = 3', LogOptions(topic="/a", stop_s=9.0))
    assert (facts.topic, facts.start_s, facts.stop_s) == ("/a", 3.0, 9.0)


def test_text_and_numbers_tell_the_same(tmp_path: Path) -> None:
    as_text = facts_of(tmp_path, structure_position_m="1 2 3.5", camera_max_range_m="40", start_ns="17")
    as_numbers = facts_of(
        tmp_path, "structure_position_m = [1, 2, 3.5]\ncamera_max_range_m = 40\nstart_ns = 17"
    )
    assert as_text == as_numbers
    assert as_text.structure_position_m == (1.0, 2.0, 3.5)


def test_several_records_add_up_and_others_may_hold_what_they_like(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    records = [
        ("inspection", {"structure_id": "a", "hw": "v6c"}),
        ("inspection", {"operator": "Ada", "site": ""}),
    ]
    facts, _ = inspection(path, records, LogOptions(site="hall"))
    assert (facts.structure_id, facts.operator, facts.site) == ("a", "Ada", "hall")


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ('structure_idd = "a"', "unknown key 'structure_idd'"),
        ("gap_s = 3", "unknown key 'gap_s'"),
        ('structure_id = "../etc"', "A-Z a-z 0-9"),
        ('demonstration_id = "<b>"', "A-Z a-z 0-9"),
        ("structure_id = 7", "A-Z a-z 0-9"),
        (f"operator = '{'x' * 3000}'", "at most 2000 characters"),
        ("structure_position_m = [1, 2]", "3 finite numbers"),
        ("structure_position_m = [1, 2, nan]", "3 finite numbers"),
        ('structure_position_m = "1 2 x"', "3 finite numbers"),
        ("structure_quat_xyzw = [0, 0, 0, 2]", "unit quaternion"),
        ("structure_lat_deg = 91", "-90 to 90"),
        ("camera_hfov_deg = 0", "1 to 360"),
        ("camera_max_range_m = inf", "finite"),
        ('body_frame = "nose"', "one of camera, optical, body"),
        ('structure_datum = "geoid"', "one of ellipsoid, amsl"),
        ('schema_version = "2"', "schema_version 1"),
        ("start_s = true", "a finite number"),
        ("structure_id = ", "no TOML"),
    ],
)
def test_a_wrong_line_is_named(tmp_path: Path, line: str, message: str) -> None:
    with pytest.raises(InputError, match=message) as caught:
        facts_of(tmp_path, line)
    assert "flight 7.toml" in str(caught.value)


def test_a_wrong_side_car_is_named(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    for content in (b"structure_id = 'a'", b"\xff\xfe", b"inspection = 3", b"[" * 5000, b"#" * 2**21):
        path.with_suffix(".toml").write_bytes(content)
        with pytest.raises(InputError, match=r"a\.toml"):
            inspection(path, [], LogOptions())


def test_a_place_on_the_earth_fills_what_the_log_does_not_say() -> None:
    stands = Placement(47.0, 8.0, 400.0, 30.0, "amsl")
    facts = placed(LogOptions(), stands)
    assert (facts.structure_lat_deg, facts.structure_datum) == (47.0, "amsl")
    assert placed(LogOptions(structure_lat_deg=1.0), stands).structure_lat_deg == 1.0
    assert placed(LogOptions(), None) == LogOptions()


@given(st.text(max_size=100))
def test_every_file_name_makes_an_id(name: str) -> None:
    safe = safe_id(name)
    assert check_id(safe, "id") == safe
    assert safe_id(safe) == safe


def test_what_was_inspected_is_told_by_the_log_or_the_side_car(tmp_path: Path) -> None:
    assert facts_of(tmp_path, about="engine_left").about == "engine_left"
    assert facts_of(tmp_path, 'about = "box 0 0 0 1 1 1"', about="engine_left").about == "box 0 0 0 1 1 1"

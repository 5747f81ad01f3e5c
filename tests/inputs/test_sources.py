"""Whatever a known flight was recorded with, the same demonstration is read of it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from made_logs import Flight, flight
from made_missions import made_plan, placed_box
from made_sources import UNTIMED, WRITERS, bag2, photos
from PIL import Image
from scipy.spatial.transform import Rotation

from upplied.errors import InputError
from upplied.geometry.poses import angle_between
from upplied.inputs.logs import LogOptions, fingerprint, read_demonstration
from upplied.inputs.passport.rules import RULES
from upplied.inputs.sources import door
from upplied.outputs.missions import FORMATS, MissionOptions, export
from upplied.records import Demonstration, Lens
from upplied.samples.fleet import member


def spiral() -> Flight:
    """Twelve seconds round a structure, ten poses a second, a few degrees of roll."""
    flown = flight(120, 10.0)
    return Flight(flown.t_ns + 250_000_000, flown.positions, flown.quat_xyzw)


def thin(flown: Flight, step: int = 30) -> Flight:
    return Flight(flown.t_ns[::step], flown.positions[::step], flown.quat_xyzw[::step])


@pytest.mark.parametrize("form", WRITERS)
def test_every_form_of_a_flight_gives_the_same_poses(tmp_path: Path, form: str) -> None:
    flown = thin(flight(1200, 10.0)) if form == "photos" else spiral()
    path, facts = WRITERS[form](tmp_path / "p" if form in ("photos", "ros2") else tmp_path, flown)
    actual = read_demonstration(path, LogOptions(structure_id="tank", **facts))
    assert len(actual) == len(flown.t_ns) and not actual.dropped and not len(actual.breaks)
    assert np.abs(actual.positions - flown.positions).max() < 0.01
    assert np.degrees(angle_between(actual.quat_xyzw, flown.quat_xyzw)).max() < 0.1
    if form in UNTIMED:
        assert "one photo every 2 s" in actual.notes
    elif form == "photos":
        assert np.abs(actual.t_ns - flown.t_ns).max() < 10**9  # EXIF holds seconds
    elif form in ("kitti", "airdata"):  # from the start alone; with a date to the second
        assert form == "kitti" or np.abs(actual.t_ns - flown.t_ns).max() < 10**8
        assert np.abs(np.diff(actual.t_ns) - np.diff(flown.t_ns)).max() < 10**6
    else:
        assert np.abs(actual.t_ns - flown.t_ns).max() <= 10**6
    assert fingerprint(path, LogOptions(structure_id="tank", **facts)) == (
        actual.demonstration_id,
        actual.sha256,
    )


def test_a_bag_without_definitions_is_read_by_the_names_of_its_types(tmp_path: Path) -> None:
    path, facts = bag2(tmp_path / "bag", spiral(), defined=False)
    actual = read_demonstration(path, LogOptions(structure_id="tank", **facts))
    assert np.abs(actual.positions - spiral().positions).max() < 1e-9


def test_photos_without_a_place_are_counted_as_lost(tmp_path: Path) -> None:
    path, facts = photos(tmp_path / "photos", thin(flight(1200, 10.0)))
    for name in sorted(path.iterdir())[::4]:  # a program that resizes photos drops their tags
        Image.new("RGB", (8, 8)).save(name)
    actual = read_demonstration(path, LogOptions(structure_id="tank", **facts))
    assert len(actual) == 30 and actual.degraded and "30 of 40 photos have a place" in actual.notes


def test_a_yaw_that_counts_from_the_nose_is_told_from_the_series(tmp_path: Path) -> None:
    flown = thin(flight(1200, 10.0))
    turning = Flight(flown.t_ns, *(np.array(part) for part in (flown.positions, flown.quat_xyzw)))
    path, facts = photos(tmp_path / "mini", turning, relative_yaw=True)
    actual = read_demonstration(path, LogOptions(structure_id="tank", **facts))
    assert "counts from the aircraft's nose" in actual.notes
    assert np.degrees(angle_between(actual.quat_xyzw, flown.quat_xyzw)).max() < 0.1


BROWN = Lens("brown", (-0.1, 0.02, 1e-3, -2e-3, 0.004), (2010 / 4000, 1490 / 3000))
LENSES = {  # form: what its file has for a camera without distortion, what instead, and the lens
    "opensfm": ('"projection_type": "perspective"', '"projection_type": "brown", "k1": -0.1, "k2": 0.02, '
                '"k3": 0.004, "p1": 0.001, "p2": -0.002, "c_x": 0.0025, "c_y": -0.0025', BROWN),
    "colmap text": ("PINHOLE 4000 3000 3200 3200 2000 1500", "FULL_OPENCV 4000 3000 3200 3200 2010 1490 -0.1 "
                    "0.02 0.001 -0.002 0.004 0 0 0", BROWN),
    "nerfstudio": ('"fl_x": 3200', '"fl_x": 3200, "cx": 2010, "cy": 1490, "k1": -0.1, "k2": 0.02, '
                   '"p1": 0.001, "p2": -0.002, "k3": 0.004', BROWN),
    "metashape": ("<f>3200</f>", "<f>3200</f><cx>10</cx><cy>-10</cy><k1>-0.1</k1><k2>0.02</k2><k3>0.004</k3>"
                  "<p1>-0.002</p1><p2>0.001</p2>", BROWN),
}  # fmt: skip


@pytest.mark.parametrize("form", LENSES)
def test_a_project_says_how_its_lens_distorts(tmp_path: Path, form: str) -> None:
    path, facts = WRITERS[form](tmp_path, spiral())
    file = path.with_name("cameras.txt") if form == "colmap text" else path
    plain, distorted, lens = LENSES[form]
    text = file.read_text()
    assert plain in text
    assert read_demonstration(path, LogOptions(structure_id="tank", **facts)).camera.lens is None
    file.write_text(text.replace(plain, distorted))
    camera = read_demonstration(path, LogOptions(structure_id="tank", **facts)).camera
    assert camera.lens is not None and camera.lens.model == lens.model
    assert camera.lens.coefficients == pytest.approx(lens.coefficients)
    assert camera.lens.middle == pytest.approx(lens.middle)
    corrected = LogOptions(structure_id="tank", camera_distortion=(0.0,), **facts)
    assert read_demonstration(path, corrected).camera.lens is None
    declared = LogOptions(
        structure_id="tank", camera_distortion=(0.1,), camera_distortion_model="fisheye", **facts
    )
    assert read_demonstration(path, declared).camera.lens == Lens("fisheye", (0.1,))


def test_a_lens_of_another_model_is_not_used_and_said(tmp_path: Path) -> None:
    path, facts = WRITERS["colmap text"](tmp_path, spiral())
    path.with_name("cameras.txt").write_text("1 FOV 4000 3000 3200 3200 2000 1500 0.9\n")
    actual = read_demonstration(path, LogOptions(structure_id="tank", **facts))
    assert actual.camera.lens is None and "distortion of the camera is not used" in actual.notes
    assert actual.camera.hfov_deg == pytest.approx(64.0, abs=0.1)


def test_photos_say_their_camera_and_its_shortest_interval(tmp_path: Path) -> None:
    """EXIF: model, longest exposure, aperture; a model that nobody lists takes photos as the flight did."""
    path, facts = photos(tmp_path / "photos", thin(flight(1200, 10.0)))
    camera = (actual := read_demonstration(path, LogOptions(structure_id="tank", **facts))).camera
    assert actual.stills and (camera.model, camera.trigger_s) == ("dji-phantom-4-pro-v2", 2.0)
    assert camera.exposure_s == pytest.approx(1 / 761) and camera.f_number == 5.6
    assert "least time between photos of dji-phantom-4-pro-v2 not verified" in actual.notes
    raw = LogOptions(structure_id="tank", camera_file_format="raw", camera_exposure_s=0.01, **facts)
    assert (read_demonstration(path, raw).camera.trigger_s) == 5.0
    assert read_demonstration(path, raw).camera.exposure_s == 0.01  # who says it knows better
    source, facts = WRITERS["opensfm"](tmp_path, spiral())
    flown = read_demonstration(source, LogOptions(structure_id="tank", **facts))
    assert flown.stills and flown.camera.trigger_s == pytest.approx(np.diff(flown.t_ns).min() * 1e-9)
    with pytest.raises(InputError, match=r"camera_model.*one of dji-zenmuse-p1-35"):
        read_demonstration(path, LogOptions(structure_id="tank", camera_model="kodak"))


def test_a_reconstruction_of_unknown_scale_asks_for_it(tmp_path: Path) -> None:
    path, _ = WRITERS["colmap text"](tmp_path, spiral())
    with pytest.raises(InputError, match="unit_m"):
        read_demonstration(path, LogOptions(structure_id="tank"))
    actual = read_demonstration(path, LogOptions(structure_id="tank", unit_m=2.0))
    assert np.abs(actual.positions - 2 * spiral().positions).max() < 1e-6


def test_a_flight_is_laid_on_its_structure_by_named_points(tmp_path: Path) -> None:
    """A reconstruction, turned, shifted and of another scale, comes back to where it was flown."""
    flown, turn = spiral(), Rotation.from_euler("xyz", [0.3, -1.0, 2.0])
    shift, scale = np.array([4.0, -2.0, 1.0]), 0.37
    moved = Flight(
        flown.t_ns,
        (turn.apply(flown.positions) + shift) * scale,
        (turn * Rotation.from_quat(flown.quat_xyzw)).as_quat(),
    )
    path, _ = WRITERS["colmap text"](tmp_path, moved)
    named = {
        "nose": (8.0, 0.0, 1.0),
        "tail": (-8.0, 1.0, 2.0),
        "left": (0.0, 6.0, 0.0),
        "top": (0.0, 0.0, 5.0),
    }
    structure = replace(member("a320-v1").structure, landmarks=named)
    seen = {name: tuple((turn.apply(place) + shift) * scale) for name, place in named.items()}
    everything = tuple(RULES)

    def read(points: dict[str, tuple[float, ...]]) -> Demonstration:
        options = LogOptions(structure_id="a320-v1", points=tuple(points.items()), allow=everything)
        return read_demonstration(path, options, structures=lambda name: structure)

    actual = read(seen)
    assert np.abs(actual.positions - flown.positions).max() < 1e-6
    assert np.degrees(angle_between(actual.quat_xyzw, flown.quat_xyzw)).max() < 1e-4
    assert "registered by 4 points at a scale of 2.7027" in actual.notes and "nose 0.00 m" in actual.notes
    with pytest.raises(InputError, match=r"misses its points after registration: nose"):
        read(seen | {"nose": (0.0, 0.0, 0.0)})
    with pytest.raises(InputError, match="no landmark wing"):
        read(seen | {"wing": (0.0, 0.0, 0.0)})
    with pytest.raises(InputError, match="2 points"):
        read({name: seen[name] for name in ("nose", "tail")})
    line = {name: (at, 0.0, 0.0) for at, name in enumerate(named)}
    with pytest.raises(InputError, match="on one line"):
        read(line)


def test_every_file_of_a_folder_is_named(tmp_path: Path) -> None:
    for form in ("mcap", "ulog", "ros1", "tum", "captions"):
        WRITERS[form](tmp_path, spiral())
    bag2(tmp_path / "bag", spiral())
    photos(tmp_path / "photos", thin(flight(1200, 10.0)))
    (tmp_path / "flight.toml").write_text("[inspection]\nstructure_id = 'tank'\n")
    (tmp_path / "empty.srt").write_bytes(b"")
    (tmp_path / "notes.md").write_text("fine weather")
    items = {str(one.path.relative_to(tmp_path)): one for one in door.survey([tmp_path])}
    kinds = {name: one.words for name, one in items.items() if one.is_flight}
    assert kinds == {
        "bag/flight_0.db3": "ROS 2 bag", "flight.bag": "ROS 1 bag", "flight.mcap": "MCAP log",
        "flight.srt": "captions of a video", "flight.txt": "poses as text", "flight.ulg": "PX4 log",
        "photos": "40 photos",
    }  # fmt: skip
    assert {name: one.status for name, one in items.items() if not one.is_flight} == {
        "bag/metadata.yaml": "part", "empty.srt": "refused", "notes.md": "other", "flight.toml": "part",
    }  # fmt: skip


@pytest.mark.parametrize("form", WRITERS)
def test_what_is_cut_off_or_damaged_is_an_error_in_words_or_read_in_part(tmp_path: Path, form: str) -> None:
    flown = thin(flight(300, 10.0)) if form == "photos" else spiral()
    path, facts = WRITERS[form](tmp_path / "p" if form in ("photos", "ros2") else tmp_path, flown)
    file = sorted(path.iterdir())[0] if path.is_dir() else path
    whole = file.read_bytes()
    rng = np.random.default_rng(5)
    for damage in range(12):
        cut = whole[: len(whole) * (damage + 1) // 13]
        hurt = bytearray(whole)
        for at in rng.integers(len(hurt), size=20):
            hurt[at] ^= int(rng.integers(1, 256))
        for data in (cut, bytes(hurt)):
            file.write_bytes(data)
            try:
                actual = read_demonstration(path, LogOptions(structure_id="tank", **facts))
                assert np.isfinite(actual.positions).all() and np.isfinite(actual.quat_xyzw).all()
            except InputError as error:
                assert str(tmp_path) in str(error)


@pytest.mark.parametrize("format", ["qgc-plan", "mavlink", "dji-wpml", "litchi", "kml"])
def test_a_mission_that_we_wrote_is_read_as_a_planned_flight(tmp_path: Path, format: str) -> None:
    structure, plan = placed_box(), made_plan()
    files = export(
        plan, structure, format, tmp_path / f"mission{FORMATS[format]}", MissionOptions(drone="m3e")
    )
    (mission,) = files.missions
    place = structure.placement
    facts = {
        "structure_lat_deg": place.lat_deg, "structure_lon_deg": place.lon_deg,
        "structure_alt_m": place.alt_m, "structure_heading_deg": place.heading_deg,
        "structure_datum": place.datum, "takeoff_alt_m": float(mission.home[2]), "geoid_undulation_m": 0.0,
    }  # fmt: skip
    options = LogOptions(structure_id="box", allow=tuple(RULES), **facts)
    actual = read_demonstration(files.paths[0], options, structures=lambda name: structure)
    assert "planned" in [item["rule"] for item in actual.passport["findings"]]
    assert "nobody flew it" in actual.notes
    inspect = np.flatnonzero(mission.inspect)
    far = np.linalg.norm(actual.positions[None] - mission.local[inspect][:, None], axis=2)
    assert far.min(axis=1).max() < 0.1
    if format != "kml":  # which says no attitude
        nearest = far.argmin(axis=1)
        turned = angle_between(actual.quat_xyzw[nearest], mission.quat_xyzw[inspect])
        assert np.degrees(np.median(turned)) < 1.0 and np.degrees(np.percentile(turned, 90)) < 6.0

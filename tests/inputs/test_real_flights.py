"""Real files of other people's flights: each is taken right, or refused with the true reason."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from upplied.errors import InputError
from upplied.inputs.logs import FIELDS, LogOptions, read_demonstration
from upplied.inputs.sources import door
from upplied.inputs.sources.source import Source

# What is taken: how many poses, how long, s, and how far it reaches along each axis, m (units of a
# reconstruction), as measured by other programs or said by the file.
TAKEN = {
    "ardupilot/center_0003.bin": (916, 42.6, (19.0, 25.6, 13.4)),
    "ardupilot/pilot_0004.BIN": (362, 16.7, (2.4, 2.1, 18.0)),
    "ardupilot/pymavlink_test.BIN": (23, 0.9, (0.0, 0.0, 0.0)),
    "colmap/sceaux_txt/images.txt": (11, 20.0, (10.59, 1.33, 6.62)),
    "dji_csv/djiparsetxt_test.csv": (759, 150.1, (57.2, 25.0, 20.6)),
    "euroc/V102.txt": (803, 80.2, (5.16, 6.07, 1.15)),
    "euroc/V102_groundtruth.csv": (4000, 20.0, (3.95, 4.76, 1.09)),
    "kitti/KITTI_00_gt.txt": (1500, 155.4, (375.15, 259.16, 10.81)),
    "mission/qgc_plan/qgroundcontrol_sample.plan": (221, 43.7, (75.8, 56.4, 0.0)),
    "mission/qgc_plan/qgroundcontrol_sample_with_survey.plan": (230, 44.5, (55.2, 25.0, 0.0)),
    "mission/qgc_plan/qgroundcontrol_sample_with_survey_wrong_version.plan": (230, 44.5, (55.2, 25.0, 0.0)),
    "mission/waypoints/cmac-foamy-mission-ccw.txt": (2559, 510.6, (253.8, 509.6, 30.0)),
    "mission/waypoints/cmac-foamy-mission-cw.txt": (2546, 507.9, (190.0, 447.3, 30.0)),
    "mission/wpml/dev_kmz_file.kmz": (12, 1.8, (10.0, 6.1, 3.5)),
    "mission/wpml/waygen_waylines.wpml": (343, 66.2, (50.3, 34.8, 0.0)),
    "opensfm/berlin/reconstruction_example.json": (3, 28.6, (5.79, 8.89, 0.73)),
    "photos/series_brighton_phantom3": (18, 124.0, (84.3, 84.1, 0.4)),
    "photos/series_jwcate_mavicmini": (36, 440.0, (264.4, 121.4, 16.2)),
    "photos/series_torino_p4ms": (32, 118.0, (47.5, 22.3, 0.1)),
    "rosbag/tf_example.bag": (510, 50.9, (1.0, 2.9, 0.0)),
    "rosbag/tf_example/tf_example.db3": (510, 50.9, (1.0, 2.9, 0.0)),
    "sfm_other/VisualSFM_example.nvm": (11, 20.0, (10.47, 1.33, 6.74)),
    "srt/jirache_p4_rtk.SRT": (55, 54.0, (234.8, 618.2, 0.6)),
    "tlog/vtol.tlog": (803, 208.4, (178.1, 449.3, 57.8)),
    "tum/freiburg1_xyz-ORB_kf_mono.txt": (32, 18.6, (0.60, 0.48, 0.14)),
    "tum/freiburg1_xyz-groundtruth.txt": (3000, 30.1, (0.46, 0.70, 0.44)),
    "tum/georeferenced.tum": (993, 1339.3, (178.43, 154.50, 10.34)),
    "ulog/sample_px4_events.ulg": (108, 21.4, (0.1, 0.1, 2.6)),
}
NO_ATTITUDE = "gives positions, but the log holds no attitude of the vehicle"
# What looks like a flight and is none that can be taken: the true reason.
REFUSED = {
    r"csv_exterior/.*\.(csv|geojson)": "orientations of single photos",
    r"dji_csv/Geotag.*": "places without heights",
    r"mission/.*digicam_control.plan": "states 0 waypoints",
    r"mission/.*(structured_scan|missing_items).plan": "QGroundControl computes them",
    r"mission/.*without_mission.plan": "mission None",
    r"mission/.*wrong_(mission|overall)_version.plan": "is a plan of version",
    r"mission/.*template.kml": "states no path",
    r"odm/.*": "no reconstructed photo",
    r"photos/rtk/.*": "times of photos for RTK",
    r"photos/series_seneca_canon": NO_ATTITUDE,
    r"photos/single": "photos of 8 cameras",
    r"rosbag/ROS_example.bag": "2 sources of poses that differ",
    r"sfm_other/open3d_example.json": "Open3D's camera trajectories",
    r"srt/embedder_Avata360_clip.SRT": "2 poses over 0.17 s",
    r"srt/jirache_broken_empty2.SRT": "does not begin as",
    r"srt/jirache_mavic_air.SRT": "none with a place",
    r"srt/jirache_mix_p4rtk_mavic2pro.srt": "captions of two kinds",
    r"srt/jirache_(mavic_2_style|mavic_2pro_new|old_format).SRT": "places without heights",
    r"srt/.*": NO_ATTITUDE,
    r"ulog/.*": "no valid position",  # logs of a table
}
OTHER = (
    r"(MANIFEST|NOTES).*|colmap/sceaux_Example.ply|csv_exterior/.*\.(yaml|prj)|opensfm/berlin/(ground|rig).*"
)
PARTS = r"colmap/.*(cameras|points3D).txt|kitti/.*_times.txt|rosbag/tf_example/metadata.yaml"


@pytest.fixture(scope="module")
def own(real_data: Path) -> Path:
    if not (real_data / "own").is_dir():
        pytest.skip(f"no real flights of others at {real_data / 'own'}")
    return real_data / "own"


def place_of(source: Source) -> dict[str, float | str]:
    """A structure that stands in the middle of a flight, of the datum in which it is told."""
    for table in source.tables:
        lat, lon = table.numbers("lat"), table.numbers("lon")
        if np.isfinite(lat).any():
            middle = {"lat": np.nanmedian(lat), "lon": np.nanmedian(lon), "alt": 0.0, "heading": 90.0}
            place = {f"structure_{name}{'_m' if name == 'alt' else '_deg'}": v for name, v in middle.items()}
            return place | {"takeoff_alt_m": 0.0, "structure_datum": "amsl", "geoid_undulation_m": 0.0}
    return {}


@pytest.mark.slow
def test_every_real_file_is_taken_right_or_refused_with_the_true_reason(own: Path) -> None:
    seen = {}
    for item in door.survey([own]):
        name = str(item.path.relative_to(own))
        seen[name] = item.status
        if item.status == "refused":
            reason = next(reason for pattern, reason in REFUSED.items() if re.fullmatch(pattern, name))
            assert reason in item.words, (name, item.words)
        elif not item.is_flight:
            assert re.fullmatch(PARTS if item.status == "part" else OTHER, name), (name, item.status)
        elif name in TAKEN:
            source = door.read(item.path, FIELDS)
            unit = {"unit_m": 1.0} if "unit_m" in source.defaults else {}
            options = LogOptions(structure_id="x", min_duration_s=0.5, **unit, **place_of(source))
            flown = read_demonstration(item.path, options)
            count, seconds, size = TAKEN[name]
            assert (len(flown), float(flown.t_ns[-1] - flown.t_ns[0]) * 1e-9) == (
                count, pytest.approx(seconds, abs=0.06)
            ), name  # fmt: skip
            assert np.allclose(np.ptp(flown.positions, axis=0), size, atol=0.06), name
            assert ("nobody flew it" in flown.notes) == name.startswith("mission/")
        else:
            reason = next((reason for pattern, reason in REFUSED.items() if re.fullmatch(pattern, name)), "?")
            with pytest.raises(InputError) as error:
                place = place_of(door.read(item.path, FIELDS))
                read_demonstration(item.path, LogOptions(structure_id="x", min_duration_s=0.5, **place))
            assert reason in str(error.value), name
    assert TAKEN.keys() <= seen.keys()
    assert len(seen) == 89


def test_a_yaw_from_the_nose_is_told_from_one_from_north(own: Path) -> None:
    for name, nose in (("series_brighton_phantom3", False), ("series_jwcate_mavicmini", True)):
        source = door.read(own / "photos" / name, FIELDS)
        assert ("aircraft's nose" in "; ".join(source.notes)) == nose

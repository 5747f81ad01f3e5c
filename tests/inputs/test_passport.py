"""What a flight is measured to be, and that each rule is what refuses or names what it is for."""

from __future__ import annotations

from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from made_flights import FAULTS, POSE, Log, flights, log_of, right, zoom_by_another_clock
from made_logs import Topic, header, message, transform, write_log, xyz, xyzw
from scipy.spatial.transform import Rotation

from upplied.errors import InputError, SettingsError
from upplied.geometry.poses import angle_between
from upplied.geometry.scene import scene_of
from upplied.inputs.logs import LogOptions, fingerprint, read_demonstration
from upplied.inputs.passport import fits, measured, rules
from upplied.inputs.passport.measured import Measured
from upplied.inputs.passport.sight import aim_of, inside
from upplied.inputs.rules import CONVENTIONS, PassportSettings, check_allowed, refusals
from upplied.records import Demonstration
from upplied.samples.fleet import member

BREAKS = {  # of each rule, figures that break it
    "fits-otherwise": {"other_fit_pct": 95.0, "fit_pct": 60.0, "other": "ned", "other_words": "north"},
    "below-ground": {"below_ground_pct": 30.0, "lowest_m": -9.0},
    "inside-structure": {"inside_pct": 3.0},
    "touches-structure": {"min_clearance_m": 0.1},
    "looks-away": {"axis_pct": 12.0, "fit_pct": 12.0, "other_fit_pct": 20.0},
    "shows-nothing": {"shown_pct": 20.0},
    "off-centre": {"off_centre_m": (5.0, 0.0), "off_centre_sure": 0.95},
    "frame-name": {"frame": "local_origin_ned"},
    "too-fast": {"speed_p99_mps": 60.0},
    "too-jerky": {"acceleration_p99_mps2": 90.0},
    "turns-too-fast": {"turn_p99_degps": 2000.0},
    "clock-steps": {"clock_steps": 9},
    "mostly-missing": {"recorded_pct": 10.0, "gaps": 9},
    "mostly-unread": {"read_pct": 10.0},
    "rolled": {"roll_deg": 90.0},
    "tilted": {"roll_deg": 25.0},
    "jumps": {"jumps": 2, "jump_m": 1.1},
    "spikes": {"spikes": 8},
    "attitude-unset": {"unset": 90},
    "too-slow": {"speed_p99_mps": 0.02},
    "sparse": {"step_s": 5.0},
    "planned": {"planned": True},
    "undated": {"year": 1970},
    "clock-rate": {"clock_ratio": 3.0},
    "jerky": {"acceleration_p99_mps2": 9.0},
    "turns-fast": {"turn_p99_degps": 150.0},
    "clock-stepped": {"clock_steps": 1},
    "near-structure": {"near_pct": 1.0},
    "looks-aside": {"axis_pct": 60.0},
    "little-off-centre": {"off_centre_m": (1.0, 1.5), "off_centre_sure": 0.95},
    "stand-off": {"stand_off_varies": 0.9, "other_varies": 0.06, "other": "swapped-xy-poses"},
    "horizon": {"rolls_deg": 9.0, "other_rolls_deg": 0.1, "other": "inverse-quaternion"},
    "near-otherwise": {"min_clearance_m": 1.2, "other_clearance_m": 3.0, "other": "mirrored-x-poses"},
    "aim-otherwise": {"aside_deg": 30.0, "other_aside_deg": 3.0, "other": "swapped-xy-poses"},
    "velocity": {"motion_fit_pct": 20.0, "motion_ratio": 3.28},
    "turns-otherwise": {"felt_turn_pct": -98.0},
    "aim-drifts": {"aim_drift_deg": -22.0},
    "aim-off": {"aim_off_deg": 20.0},
    "pitch-otherwise": {"pitch_fit_pct": -80.0},
    "pitch-unset": {"pitch_span_deg": 0.5, "pitch_want_deg": 40.0},
    "pitch-missing": {"pitch_span_deg": 0.0, "pitch_want_deg": 21.0},
    "lens-differs": {"lens_ratio": 0.3},
    "leap-seconds": {"clock_ahead_s": 18.1},
    "fast": {"speed_p99_mps": 14.0},
    "gaps": {"gaps": 2, "long_gaps": 1, "recorded_pct": 97.0},
    "hovering": {"hover_s": 200.0, "cut_hover_s": 170.0},
    "frozen": {"frozen_s": 90.0, "span_s": 100.0},
    "zoom": {"hfov_deg": (75.0, 20.0), "hfov_from_s": (0.0, 40.0)},
    "assumed": {"assumed": ("a camera of 75 x 75 deg",)},
    "salvaged": {"losses": ("the log was not closed",)},
}
UP = np.array([0.0, 0.0, 1.0])
GOOD = replace(
    Measured(), axis_pct=98.0, shown_pct=100.0, fit_pct=99.0, other_fit_pct=100.0, lowest_m=3.0, year=2026
)
ODD = {
    "rolled": "tilted",
    "too-jerky": "jerky",
    "turns-too-fast": "turns-fast",
    "below-ground": "near",
    "looks-away": "looks-aside",
    "too-fast": "fast",
    "clock-steps": "clock-stepped",
    "pitch-missing": "pitch-unset",
}


def taken(log: Log, path: Path, **options) -> Demonstration:
    """The demonstration with its passport."""
    return read_demonstration(log.write(path), LogOptions(**options), structures=lambda name: log.structure)


def test_a_flight_that_breaks_no_rule_is_good() -> None:
    assert rules.judged(GOOD, PassportSettings()) == ()


@pytest.mark.parametrize("rule", rules.CHECKS, ids=lambda rule: rule.name)
def test_each_rule_finds_what_it_is_for_and_nothing_else_does(rule: rules.Rule) -> None:
    spoilt = replace(GOOD, **BREAKS[rule.name])
    severities = {item.rule: item.severity for item in rules.judged(spoilt, PassportSettings())}
    assert severities.pop(rule.name) == rule.severity
    assert set(severities) <= {ODD.get(rule.name), "gaps"}
    allowed = rules.judged(spoilt, PassportSettings(), allow=(rule.name,))
    assert rule.name not in [item.rule for item in refusals(allowed)]
    strict = rules.judged(spoilt, PassportSettings(), strict=True)
    assert refusals(strict) == strict


@pytest.mark.parametrize("rule", rules.CHECKS, ids=lambda rule: rule.name)
def test_the_bounds_of_a_rule_are_settings_that_move_it(rule: rules.Rule) -> None:
    names = {item.name for item in fields(PassportSettings)}
    assert set(rule.bounds) <= names
    if (
        rule.name
        in ("hovering", "gaps", "near-structure", "near-otherwise", "zoom", "undated", "leap-seconds")
        or not rule.bounds
    ):
        return  # their bounds act where time and distance are measured
    loose = {
        name: -1e6 if name.startswith(("least", "odd_axis")) else 1e6
        for name in rule.bounds
        if name != "ground_slack_m"
    }
    spoilt = replace(GOOD, **BREAKS[rule.name])
    bounds = replace(PassportSettings(), **loose)
    assert rule.name not in [item.rule for item in rules.judged(spoilt, bounds)]


def test_rules_and_bounds_are_named_or_refused() -> None:
    check_allowed(("below-ground", "zoom-untimed"), rules.RULES)
    with pytest.raises(SettingsError, match="below-grund"):
        check_allowed(("below-grund",), rules.RULES)
    assert PassportSettings.changed(("max_speed_mps=9",)).max_speed_mps == 9
    for wrong in ("speed=9", "max_speed_mps=fast", "max_speed_mps=nan", "max_speed_mps"):
        with pytest.raises(SettingsError):
            PassportSettings.changed((wrong,))


def test_every_convention_of_a_side_car_is_known() -> None:
    assert tuple(fits.NAMED) == tuple(CONVENTIONS)


def test_inside_is_inside(tmp_path: Path) -> None:
    cube = member("cube-v1").structure
    low, high = cube.vertices.min(axis=0), cube.vertices.max(axis=0)
    rng = np.random.default_rng(0)
    points = rng.uniform(low - 4, high + 4, (400, 3))
    truth = ((points > low) & (points < high)).all(axis=1)
    assert np.array_equal(inside(points, scene_of(cube)), truth)


def test_the_passport_says_what_is_so(tmp_path: Path) -> None:
    structure, flown = flights("box", 0)
    log = log_of(structure, flown, np.random.default_rng(1))
    actual = taken(log, tmp_path / "a.mcap")
    measured = actual.passport["measured"]
    distance = scene_of(structure).distance(actual.positions)
    assert measured["min_clearance_m"] == pytest.approx(distance.min(), abs=2e-3)
    assert measured["lowest_m"] == pytest.approx(actual.positions[:, 2].min(), abs=0.1)
    assert measured["axis_pct"] > 95 and measured["inside_pct"] == 0
    assert measured["frame"] == "map" and actual.passport["structure_sha256"] == structure.sha256


@pytest.mark.parametrize(
    ("fault", "named"),
    [
        ("ned", r"ned\)"),
        ("w_first", "w-first"),
        ("optical", "optical"),
        ("swapped", "swapped-xy"),
        ("feet", "feet"),
        ("mirrored", "mirrored|inverse-quaternion"),
        ("two_vehicles", "several"),
        ("unconnected", "frame-unconnected"),
        ("many_gaps", "mostly-missing"),
        ("yaw_drift", "yaw drift|heading offset|offset"),
    ],
)
def test_a_refusal_names_what_is_wrong_and_what_to_do(tmp_path: Path, fault: str, named: str) -> None:
    rng = np.random.default_rng(3)
    log = FAULTS[fault](log_of(*flights("box", 0), rng), rng)
    with pytest.raises(InputError, match=named):
        taken(log, tmp_path / "a.mcap")


def test_what_a_refusal_names_makes_the_log_right(tmp_path: Path) -> None:
    """NED in the side-car: the poses are those of the log that was right."""
    structure, flown = flights("airliner", 1)
    log = log_of(structure, flown, np.random.default_rng(2))
    plain = taken(log, tmp_path / "plain.mcap")
    wrong = FAULTS["ned"](log, np.random.default_rng(0))
    with pytest.raises(InputError, match='convention = "ned"'):
        taken(wrong, tmp_path / "a.mcap")
    (tmp_path / "a.toml").write_text('[inspection]\nconvention = "ned"\n')
    actual = taken(wrong, tmp_path / "a.mcap")
    assert np.allclose(actual.positions, plain.positions, atol=1e-6)
    assert actual.passport["verdict"] == plain.passport["verdict"]
    assert "converted as requested" in actual.notes


def test_a_rule_is_overruled_by_name_and_that_is_stored(tmp_path: Path) -> None:
    log = log_of(*flights("box", 0), np.random.default_rng(1))
    low = replace(log, positions=log.positions - [0, 0, 12.0])
    with pytest.raises(InputError, match="--allow below-ground"):
        taken(low, tmp_path / "a.mcap")
    rule_names = tuple(rules.RULES)
    actual = taken(low, tmp_path / "a.mcap", allow=rule_names)
    assert actual.passport["verdict"] == "overruled"
    assert "below-ground" in actual.passport["allowed"]


def test_strict_refuses_what_is_odd(tmp_path: Path) -> None:
    log = replace(log_of(*flights("box", 0), np.random.default_rng(1)), hfov_deg=None)
    assert taken(log, tmp_path / "a.mcap").passport["verdict"] == "warned"
    with pytest.raises(InputError, match="assumed"):
        taken(log, tmp_path / "a.mcap", strict=True)


@pytest.mark.parametrize("fault", ["clock_back", "clock_ahead"])
def test_a_step_of_the_clock_splits_the_log_there(tmp_path: Path, fault: str) -> None:
    """Every pose comes in the order in which it was recorded, with a break at the step."""
    structure, flown = flights("box", 0)
    log = log_of(structure, flown, np.random.default_rng(4))
    wrong = FAULTS[fault](log, np.random.default_rng(5))
    step = int(np.argmax(np.abs(np.diff(wrong.t_ns - log.t_ns)))) + 1
    actual = taken(wrong, tmp_path / "a.mcap")
    assert np.array_equal(actual.positions, log.positions)
    assert actual.breaks.tolist() == [step]
    assert (np.diff(actual.t_ns) > 0).all()
    assert abs((actual.t_ns[-1] - actual.t_ns[0]) - (log.t_ns[-1] - log.t_ns[0])) < 1e9


def test_messages_that_are_late_are_sorted_and_no_step(tmp_path: Path) -> None:
    log = log_of(*flights("box", 0), np.random.default_rng(4))
    order = np.arange(len(log))
    order[100:104] = [101, 103, 100, 102]
    order[400:430] = order[400:430][::-1]
    late = replace(log.take(order), log_ns=log.log_ns)
    actual = taken(late, tmp_path / "a.mcap")
    assert np.array_equal(actual.positions, log.positions) and not len(actual.breaks)


def test_a_long_gap_is_flown_as_a_transit(tmp_path: Path) -> None:
    log = log_of(*flights("box", 0), np.random.default_rng(4))
    lasted = float(log.t_ns[-1] - log.t_ns[0]) * 1e-9
    actual = taken(
        FAULTS["long_gap"](log, np.random.default_rng(6)), tmp_path / "a.mcap", allow=("mostly-missing",)
    )
    assert len(actual.breaks) == 1 and len(actual) == len(log)
    assert actual.trajectory.t_s[-1] < lasted + 5
    assert "joined by transits" in actual.notes


@pytest.mark.ci
def test_hovering_is_cut_to_the_cap_that_is_said(tmp_path: Path) -> None:
    log = log_of(*flights("box", 0), np.random.default_rng(4))
    wrong = FAULTS["hovering"](log, np.random.default_rng(6))
    lasted = float(log.t_ns[-1] - log.t_ns[0]) * 1e-9
    for cap in (30.0, 100.0):
        actual = taken(wrong, tmp_path / "a.mcap", passport=PassportSettings(hover_cap_s=cap))
        assert lasted + cap - 10 < actual.trajectory.t_s[-1] < lasted + cap + 20
        assert (np.diff(actual.t_ns) > 0).all()
    assert actual.passport["measured"]["hover_s"] > 1400


def test_a_zoom_is_a_camera_for_each_pose(tmp_path: Path) -> None:
    log = log_of(*flights("box", 0), np.random.default_rng(4))
    half = len(log) // 20 * 10  # the fields of view are written with every tenth pose
    zoomed = replace(log, hfov_deg=np.where(np.arange(len(log)) < half, 75.0, 50.0))
    actual = taken(zoomed, tmp_path / "a.mcap")
    assert np.allclose(actual.fov_deg, zoomed.hfov_deg[:, None], atol=1e-3)
    assert actual.camera.hfov_deg == pytest.approx(50.0, abs=1e-3), "whoever asks for one gets the narrowest"
    assert actual.passport["measured"]["hfov_deg"] == pytest.approx([75.0, 50.0], abs=1e-2)
    assert "zoom" in [item["rule"] for item in actual.passport["findings"]]
    part = taken(zoomed, tmp_path / "a.mcap", stop_s=float(log.t_ns[len(log) // 3] - log.t_ns[0]) * 1e-9)
    assert part.camera.hfov_deg == pytest.approx(75.0, abs=1e-3) and part.fov_deg is None
    passport = taken(zoomed, tmp_path / "a.mcap", camera_hfov_deg=70.0).passport
    assert "from 75.0 to 50.0 deg: 70 deg all the time" in str(passport["measured"]["assumed"])
    still = taken(replace(log, hfov_deg=np.full(len(log), 60.0)), tmp_path / "a.mcap")
    assert still.fov_deg is None and "zoom" not in [item["rule"] for item in still.passport["findings"]]


def test_where_the_clock_stepped_the_recorders_tells_which_pose_had_which_field_of_view(
    tmp_path: Path,
) -> None:
    log = log_of(*flights("box", 0), np.random.default_rng(4))
    half = len(log) // 20 * 10
    zoomed = replace(log, hfov_deg=np.where(np.arange(len(log)) < half, 75.0, 50.0))
    stepped = FAULTS["clock_back"](zoomed, np.random.default_rng(1))
    actual = taken(stepped, tmp_path / "a.mcap")
    assert len(actual.fov_deg) == len(actual) and np.mean(actual.fov_deg[:, 0] > 60) == pytest.approx(
        0.5, abs=0.02
    )


@pytest.mark.parametrize("mirrored", [False, True])
def test_mirrored_poses_turn_against_the_gyroscope(tmp_path: Path, mirrored: bool) -> None:
    """The inertial unit, however it is mounted, felt the flight as it was; the poses have y mirrored."""
    log = log_of(*flights("box", 0), np.random.default_rng(4))
    mount = Rotation.from_rotvec([0.7, -1.1, 2.0])
    turns, seconds = Rotation.from_quat(log.quats), (log.t_ns - log.t_ns[0]) * 1e-9
    spin = (turns[1:] * turns[:-1].inv()).as_rotvec() / np.diff(seconds)[:, None]
    spin = np.vstack([spin, spin[-1:]])
    rng = np.random.default_rng(0)
    felt = [
        (mount * turn.inv()).apply(vector) + rng.normal(0, 0.02, 3)
        for vectors in (spin, np.tile([0, 0, 9.81], (len(log), 1)))
        for turn, vector in zip(turns, vectors, strict=True)
    ]
    gyro, force = np.array(felt).reshape(2, -1, 3)
    messages = []
    for at, t in enumerate(log.t_ns):
        content = {"header": header(int(t), "imu"), "orientation": xyzw([0, 0, 0, 1])}
        content |= {"angular_velocity": xyz(gyro[at]), "linear_acceleration": xyz(force[at])}
        messages.append((int(log.log_ns[at]), content))
    log = replace(log, extra=[Topic("/imu", "sensor_msgs/msg/Imu", messages)])
    if mirrored:
        mirror = np.diag([1.0, -1.0, 1.0])
        matrices = mirror @ turns.as_matrix() @ mirror
        quats = Rotation.from_matrix(matrices).as_quat()
        log = replace(log, positions=log.positions @ mirror, quats=quats)
    passport = taken(log, tmp_path / "a.mcap", allow=tuple(rules.RULES)).passport
    cosine = passport["measured"]["felt_turn_pct"]
    assert (cosine < -90) if mirrored else (cosine > 90)
    assert ("turns-otherwise" in {item["rule"] for item in passport["findings"]}) == mirrored


@pytest.mark.ci
def test_one_of_two_publishers_may_be_named(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    log = replace(log_of(*flights("box", 0), rng), schema="nav_msgs/msg/Odometry", hfov_deg=None)
    both = FAULTS["two_vehicles"](log, np.random.default_rng(0))
    children = ["one" if i % 2 == 0 else "two" for i in range(len(both))]
    both = replace(both, children=children)
    with pytest.raises(InputError, match=r"one .*two|two .*one"):
        taken(both, tmp_path / "a.mcap")
    actual = taken(both, tmp_path / "a.mcap", publisher="one")
    assert np.array_equal(actual.positions, log.positions)


def test_a_stand_off_that_comes_and_goes_names_the_convention_in_which_it_is_kept(tmp_path: Path) -> None:
    """Round a box that is nearly square, with x and y exchanged: all poses still look at it from outside."""
    log = right(21)
    unit = log.quats / np.linalg.norm(log.quats, axis=1, keepdims=True)
    positions, quats = fits.NAMED["swapped-xy-poses"].change(log.positions, unit)
    wrong = replace(log, positions=positions, quats=quats)
    with pytest.raises(InputError, match=r"stand-off: as .* \(swapped-xy-poses\)"):
        taken(wrong, tmp_path / "a.mcap")
    repaired = taken(wrong, tmp_path / "a.mcap", convention="swapped-xy-poses")
    assert np.allclose(repaired.positions, taken(log, tmp_path / "b.mcap").positions, atol=1e-6)
    assert repaired.passport["measured"]["stand_off_varies"] < 0.1
    overruled = taken(wrong, tmp_path / "a.mcap", allow=("stand-off",)).passport
    assert overruled["verdict"] == "overruled"


def test_a_camera_that_rolls_names_the_convention_in_which_it_holds_the_horizon(tmp_path: Path) -> None:
    """Over one side of an airliner, by inverse quaternions: all but few poses still look at it."""
    log = right(50)
    unit = log.quats / np.linalg.norm(log.quats, axis=1, keepdims=True)
    wrong = replace(log, quats=fits.NAMED["inverse-quaternion"].change(log.positions, unit)[1])
    with pytest.raises(InputError, match=r"horizon: as .* \(inverse-quaternion\)"):
        taken(wrong, tmp_path / "a.mcap")
    repaired = taken(wrong, tmp_path / "a.mcap", convention="inverse-quaternion")
    assert repaired.passport["measured"]["rolls_deg"] < 0.1


@pytest.mark.parametrize(
    ("share", "rule", "name"), [(0.9, "fits-otherwise", "ned"), (0.7, "stand-off", "y-up")]
)
def test_the_convention_that_fits_clearly_better_is_named_before_the_steadier_one(
    tmp_path: Path, monkeypatch, share: float, rule: str, name: str
) -> None:
    better, steadier = (fits.Fit(fits.NAMED[each], share) for each in ("ned", "y-up"))
    monkeypatch.setattr(measured.Comparison, "best_fits", lambda *_: (0.6, [better]))
    monkeypatch.setattr(
        measured.Comparison,
        "steadier",
        lambda *_: (np.array([0.9, 0.0, 0.3, 1.0]), np.array([0.1, 0.0, 0.3, 1.0]), [steadier]),
    )
    with pytest.raises(InputError) as error:
        taken(right(0), tmp_path / "a.mcap")
    assert f"{rule}: as" in str(error.value) and f"({name})" in str(error.value)
    assert ("stand-off: " in str(error.value)) is (rule == "stand-off")


@pytest.mark.ci
def test_a_right_log_is_taken(tmp_path: Path) -> None:
    for number in range(6):
        assert taken(right(number), tmp_path / "a.mcap").passport["verdict"] in ("good", "warned")


def test_the_documentation_names_every_rule_bound_and_convention() -> None:
    page = (Path(__file__).parents[2] / "docs" / "checks.md").read_text("utf-8")
    bounds = [item.name for item in fields(PassportSettings)]
    missing = [name for name in (*rules.RULES, *CONVENTIONS, *bounds) if f"`{name}`" not in page]
    assert set(missing) <= {"ned"}
    rows = {line.split("`")[1]: line for line in page.splitlines()[::-1] if line.startswith("| `")}
    for rule in rules.CHECKS:
        parts = [f"| `{rule.name}` | {rule.severity} | {rule.reason} |", rule.remedy, *rule.bounds]
        assert all(each in rows[rule.name] for each in parts), rule.name


@pytest.mark.parametrize("calibrated", [True, False])
@pytest.mark.parametrize("child", ["", "firefly_sbx"])
def test_a_mount_is_found_whatever_its_body_is_called(tmp_path: Path, child: str, calibrated: bool) -> None:
    """Poses of an IMU, a camera that /tf_static hangs on it by names that nobody has agreed on."""
    structure, flown = flights("box", 0)
    log = log_of(structure, flown, np.random.default_rng(1))
    plain = taken(log, tmp_path / "plain.mcap")
    offset = np.array([0.07, -0.02, 0.01])
    mount = Rotation.from_euler("ZYX", [88.0, 4.0, -91.0], degrees=True)  # the optical frame on the IMU
    optical = Rotation.from_quat(log.quats) * fits.OPTICAL_R_CAMERA.inv()
    body = optical * mount.inv()
    start = int(log.log_ns[0])
    static = transform(start, "imu4", "cam0", offset, mount.as_quat())
    tracked = replace(
        log,
        positions=log.positions - body.apply(offset),
        quats=body.as_quat(),
        frames=["world"] * len(log),
        children=[child] * len(log),
        schema="nav_msgs/msg/Odometry" if child else "geometry_msgs/msg/PoseStamped",
        extra=[Topic("/tf_static", "tf2_msgs/msg/TFMessage", [(start, {"transforms": [static]})])],
        facts={"body_frame": ""} | ({"camera_frame_id": "cam0"} if calibrated else {}),
        hfov_deg=None,
    )
    actual = taken(tracked, tmp_path / "a.mcap")
    assert np.allclose(actual.positions, plain.positions, atol=1e-6)
    assert np.abs(angle_between(actual.quat_xyzw, plain.quat_xyzw)).max() < 1e-5
    assert any("imu4 -> cam0" in note for note in actual.passport["measured"]["frames"])


def test_two_channels_of_one_topic_at_one_time_are_two_publishers(tmp_path: Path) -> None:
    """Channels that follow each other are one recording; channels side by side are two bodies."""
    log = replace(log_of(*flights("box", 0), np.random.default_rng(1)), schema=POSE, hfov_deg=None)
    rows = list(zip(log.log_ns, log.t_ns, log.positions, log.quats, strict=True))

    def topic(some: list, away: float = 0.0) -> Topic:
        messages = [(int(at), message(POSE, int(t), p + away * UP, q)) for at, t, p, q in some]
        return Topic("/camera/pose", POSE, messages)

    facts = {"structure_id": log.structure.structure_id, "body_frame": "camera"}
    half = len(rows) // 2
    path = write_log(tmp_path / "a.mcap", [topic(rows[:half]), topic(rows[half:])], facts)
    whole = read_demonstration(path, structures=lambda _: log.structure)
    assert np.array_equal(whole.positions, log.positions)
    path = write_log(tmp_path / "b.mcap", [topic(rows), topic(rows, 4.0)], facts)
    with pytest.raises(InputError, match="2 publishers at the same time: channels #1"):
        read_demonstration(path, structures=lambda _: log.structure)
    second = read_demonstration(path, LogOptions(publisher="#2"), structures=lambda _: log.structure)
    assert np.allclose(second.positions, log.positions + 4.0 * UP)


def spun(log: Log, first_deg: float, last_deg: float) -> Log:
    """Headings that are off by so much at the start and at the end."""
    turn = Rotation.from_rotvec(np.radians(np.linspace(first_deg, last_deg, len(log)))[:, None] * UP)
    return replace(log, quats=(turn * Rotation.from_quat(log.quats)).as_quat())


def test_a_heading_that_drifts_a_little_or_is_a_little_off_is_warned_of(tmp_path: Path) -> None:
    """The structure stays in the picture, so nothing else tells it."""

    def findings_of(log: Log) -> dict[str, str]:
        findings = taken(log, tmp_path / "a.mcap").passport["findings"]
        return {item["rule"]: item["found"] for item in findings}

    log = right(11)
    assert not {"aim-drifts", "aim-off"} & set(findings_of(log))
    assert "deg to the left of" in findings_of(spun(log, -14, 14))["aim-drifts"]
    assert "deg to the right of" in findings_of(spun(log, -24, -24))["aim-off"]
    assert "aim-off" not in findings_of(spun(log, -14, 14))


def test_mild_drifts_and_offsets_of_the_heading_are_told_where_the_flight_tells_of_a_heading() -> None:
    def aim(log: Log) -> tuple[float, float]:
        quats = log.quats / np.linalg.norm(log.quats, axis=1, keepdims=True)
        aim = aim_of(log.positions, quats, scene_of(log.structure))
        return abs(aim.aim_drift_deg), abs(aim.aim_off_deg)

    logs = [right(number) for number in range(0, 40, 2)]
    assert max(max(aim(log)) for log in logs) < 12
    assert sum(aim(spun(log, 0, 30))[0] > 15 for log in logs) >= 15
    assert sum(aim(spun(log, 30, 30))[1] > 15 for log in logs) >= 15


@pytest.mark.parametrize(
    ("rule", "fault"),
    [
        ("several-publishers", "two_vehicles"),
        ("zoom-untimed", "zoom_by_another_clock"),
        ("frame-unconnected", "unconnected"),
    ],
)
def test_rules_that_the_reader_asks_are_what_refuses(tmp_path: Path, rule: str, fault: str) -> None:
    assert set(BREAKS) | {"several-publishers", "zoom-untimed", "frame-unconnected"} == set(rules.RULES)
    log = (FAULTS | {"zoom_by_another_clock": zoom_by_another_clock})[fault](
        right(4), np.random.default_rng(2)
    )
    with pytest.raises(InputError, match=rule):
        taken(log, tmp_path / "a.mcap")
    every = tuple(rules.RULES)
    passport = taken(log, tmp_path / "a.mcap", allow=every).passport
    assert passport["verdict"] == "overruled"
    assert rule in {item["rule"] for item in passport["findings"] if item["overruled"]}
    fine = taken(right(4), tmp_path / "a.mcap", allow=every).passport
    assert rule not in {item["rule"] for item in fine["findings"]}


def with_velocity(log: Log, path: Path, *, world: bool = False, change=lambda log: log) -> Path:
    """Odometry whose twist is that of the poses before they were changed, in the axes of body or world."""
    t_s, turns = (log.t_ns - log.t_ns[0]) * 1e-9, Rotation.from_quat(log.quats)
    linear = np.gradient(log.positions, t_s, axis=0)
    step = (turns[:-1].inv() * turns[1:]).as_rotvec() / np.diff(t_s)[:, None]
    angular = np.concatenate([step, step[-1:]])
    if not world:
        linear = turns.inv().apply(linear)
    noise = np.random.default_rng(3).normal(0, 0.05, linear.shape)
    log = change(log)
    messages = []
    for row, (t, p, q) in enumerate(zip(log.t_ns, log.positions, log.quats, strict=True)):
        content = message("nav_msgs/msg/Odometry", int(t), p, q, "map", "base_link")
        vectors = {"linear": linear[row] + noise[row], "angular": angular[row]}
        content["twist"]["twist"] = {
            name: dict(zip("xyz", map(float, values), strict=True)) for name, values in vectors.items()
        }
        messages.append((int(log.log_ns[row]), content))
    facts = {"structure_id": log.structure.structure_id, "body_frame": "camera"}
    return write_log(path, [Topic("/odom", "nav_msgs/msg/Odometry", messages)], facts)


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ("as it is", ""),
        ("of the world", ""),
        ("mirrored with its headings", "mean cosine"),
        ("in feet", "the poses 3.2"),
        ("twice as fast", "the poses 1.9"),
    ],
)
def test_poses_that_move_otherwise_than_the_velocity_in_the_log_are_warned_of(
    tmp_path: Path, change: str, sentence: str
) -> None:
    """A cube is symmetric: mirrored about its middle, the flight is one that somebody could have flown."""
    structure, flown = flights("box", 0)
    middle = (structure.vertices.max(axis=0) + structure.vertices.min(axis=0)) / 2
    log = log_of(structure, flown, np.random.default_rng(0))

    def changed_log(log: Log) -> Log:
        if change == "mirrored with its headings":
            flip = np.diag([1.0, -1.0, 1.0])
            turns = flip @ Rotation.from_quat(log.quats).as_matrix() @ flip
            positions = (log.positions - middle) @ flip + middle
            return replace(log, positions=positions, quats=Rotation.from_matrix(turns).as_quat())
        if change == "in feet":
            return replace(log, positions=log.positions / 0.3048)
        if change == "twice as fast":
            return replace(log, t_ns=log.t_ns[0] + (log.t_ns - log.t_ns[0]) // 2)
        return log

    path = with_velocity(log, tmp_path / "a.mcap", world=change == "of the world", change=changed_log)
    allow = LogOptions(allow=tuple(rules.RULES))
    passport = read_demonstration(path, allow, structures=lambda _: structure).passport
    findings = {item["rule"]: item["found"] for item in passport["findings"]}
    assert sentence in findings["velocity"] if sentence else "velocity" not in findings
    assert passport["measured"]["motion_fit_pct"] is not None


def test_a_log_is_known_again_unless_what_is_said_changes_what_is_kept_of_it(tmp_path: Path) -> None:
    path = right(0).write(tmp_path / "a.mcap")

    def known_as(*texts: str) -> str:
        return fingerprint(path, LogOptions(passport=PassportSettings.changed(texts)))[1]

    assert known_as() == known_as("odd_speed_mps=0.1") == known_as("hover_cap_s=30")
    assert (
        len({known_as(), known_as("hover_cap_s=1"), known_as("hover_cap_s=2"), known_as("long_gap_s=9")}) == 4
    )
    read = read_demonstration(path, LogOptions(passport=PassportSettings.changed(("hover_cap_s=1",))))
    assert read.sha256 == known_as("hover_cap_s=1")

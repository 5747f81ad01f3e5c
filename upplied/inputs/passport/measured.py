"""What is measured of a flight: against its structure, against what a vehicle can do, and of its log."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from upplied.inputs.flight.clean import UNSET
from upplied.inputs.flight.mounts import NO_MOUNT
from upplied.inputs.flight.pace import Pace
from upplied.inputs.flight.tracks import Track
from upplied.inputs.passport.aim import aim_of
from upplied.inputs.passport.conventions import Fit, best_fits
from upplied.inputs.passport.settings import PassportSettings
from upplied.inputs.passport.sight import Sight, ground_of, sight_of
from upplied.inputs.passport.steadiness import steadiness
from upplied.inputs.passport.velocity import motion_of, turning_of
from upplied.inputs.rules import Verdict
from upplied.inputs.schemas.cameras import NO_CALIBRATION, ZOOM_UNHEARD
from upplied.inputs.sources.source import Source
from upplied.polylines import chosen_evenly, leg_lengths
from upplied.poses import angle_between
from upplied.records import Camera, Floats, Ints, Structure
from upplied.scene import scene_of

_LOOKS = 500  # poses of a flight that are measured against the structure, spread evenly over it
SEEN = 1.2  # of the camera's range: a little beyond is no other convention
_SPAN_S = 0.5  # over which speed is measured: shorter ones are noise of the sensors
_ZOOMS = 20  # that are listed
_TURNING = 0.5  # least share of the directions round the vertical that a closed flight looks in


@dataclass(frozen=True)
class Reading:
    """What the reader knows of a log and its flight, for the passport."""

    source: Source
    logged: Track  # clean, as logged, in its own frame
    flown: Track  # the camera's poses, structure frame, before its time was changed
    kept: Track  # after
    pace: Pace
    camera: Camera
    to_camera: Callable[[Track], Track]
    gap_s: float
    notes: tuple[str, ...] = ()
    overruled: tuple[Verdict, ...] = ()  # rules that the reader asks, broken and overruled
    velocity: tuple[Ints, Floats] | None = (
        None  # when (N,), ns, and (N, 6), m/s and rad/s, as the log says it
    )
    felt: Sequence[tuple[str, Ints, Floats]] = ()  # how fast inertial units turn: topic, when, ns, and rad/s


@dataclass(frozen=True)
class Measured:
    """The figures of a passport; NaN where one could not be measured."""

    poses: int = 0
    ground_declared: bool = False
    lowest_m: float = float("nan")  # over the ground, or over the structure's lowest point
    below_ground_pct: float = 0.0  # deeper than the slack
    inside_pct: float = 0.0
    near_pct: float = 0.0  # of the poses, nearer than `near_m`
    min_clearance_m: float = float("nan")
    axis_pct: float = 0.0  # of the poses, the axis meeting the structure
    shown_pct: float = 0.0  # of the pictures, showing the structure within the camera's range
    range_m: float = float("nan")  # along the axis, median
    fit_pct: float = 0.0  # of the poses that an inspection could hold
    other: str = ""  # convention that fits best besides
    other_words: str = ""
    other_advice: str = ""
    other_fit_pct: float = 0.0
    off_centre_m: tuple[float, float] = (0.0, 0.0)  # as the stand-off tells, horizontally
    off_centre_sure: float = 0.0  # share of the stand-off's variance that it explains
    aim_drift_deg: float = 0.0  # of the camera, to the left of the nearest surface, from end to end
    aim_off_deg: float = 0.0  # in the middle of the flight
    motion_fit_pct: float = float("nan")  # of the poses, with the velocity that the same messages say
    motion_ratio: float = float("nan")  # speed of the poses over that
    felt_turn_pct: float = float("nan")  # correlation of how the poses turn with what inertial units feel
    speed_p99_mps: float = 0.0
    acceleration_p99_mps2: float = 0.0
    turn_p99_degps: float = 0.0
    jumps: int = 0  # to another place, between two poses
    jump_m: float = 0.0  # the largest
    spikes: int = 0  # single poses off the others, dropped or not
    unset: int = 0  # poses without an attitude: dropped
    roll_deg: float = float("nan")  # of the camera, median size
    step_s: float = 0.0  # between poses, usual
    stills: bool = False  # photos: nothing is missing between poses
    planned: bool = False  # a mission, not a flight
    clock_ratio: float = float("nan")  # of the time by the source's clock and by the recorder's
    year: int = 0  # of the first stamp
    clock: str = ""
    clock_steps: int = 0
    span_s: float = 0.0
    recorded_pct: float = 100.0
    gaps: int = 0
    long_gaps: int = 0
    longest_gap_s: float = 0.0
    skipped_m: float = 0.0
    cut_gap_s: float = 0.0
    hover_s: float = 0.0
    cut_hover_s: float = 0.0
    frozen_s: float = 0.0
    hfov_deg: tuple[float, ...] = ()  # in time
    hfov_from_s: tuple[float, ...] = ()
    assumed: tuple[str, ...] = ()
    frame: str = ""  # as logged
    child: str = ""
    frames: tuple[str, ...] = ()  # how they became the structure's and the camera's
    read_pct: float = 100.0
    losses: tuple[str, ...] = field(default=())


def measure(reading: Reading, structure: Structure, settings: PassportSettings) -> Measured:
    """All figures of a flight's passport."""
    flown, pace = reading.flown, reading.pace
    scene = scene_of(structure)
    spread = chosen_evenly(len(flown), _LOOKS)
    places, turns = flown.positions[spread], flown.quat_xyzw[spread]
    sight = sight_of(places, turns, reading.camera, structure, scene)
    declared = structure.surroundings.ground_z_m is not None
    floor = ground_of(structure) - settings.ground_slack_m if declared else -np.inf
    off, sure = _off_centre(sight, turns)
    aim = aim_of(flown.positions, flown.quat_xyzw, scene)
    clearance = _least_clearance(flown, spread, sight, scene.distance)
    doubtful = (
        clearance < settings.least_clearance_m
        or sight.inside.any()
        or (sure > 0.8 and np.hypot(*off) >= settings.off_centre_m)
    )
    given, others = best_fits(
        reading.logged,
        reading.to_camera,
        scene,
        floor,
        SEEN * reading.camera.max_range_m,
        2.0 if doubtful else 1 - settings.fit_gain_pct / 100,  # no other could explain enough more
    )
    motion = motion_of(reading.logged, reading.velocity)
    speed, acceleration, turning = _motion(flown, reading.gap_s)
    zoomed = _zoomed(flown, settings.zoom_pct)
    steady = steadiness(reading.logged, flown, reading.gap_s)
    return Measured(
        poses=len(reading.kept),
        ground_declared=declared,
        lowest_m=float(sight.height_m.min()),
        below_ground_pct=_pct(sight.height_m < -settings.ground_slack_m) if declared else 0.0,
        inside_pct=_pct(sight.inside),
        near_pct=_pct(sight.clearance_m < settings.near_m),
        min_clearance_m=clearance,
        axis_pct=_pct(sight.meets),
        shown_pct=_pct(sight.shown > 0),
        range_m=float(np.median(sight.range_m[sight.meets])) if sight.meets.any() else float("nan"),
        fit_pct=100 * given,
        **_named(others),
        off_centre_m=(round(off[0], 1), round(off[1], 1)),
        off_centre_sure=sure,
        aim_drift_deg=aim.drift_deg,
        aim_off_deg=aim.off_deg,
        motion_fit_pct=motion.fit_pct,
        motion_ratio=motion.ratio,
        felt_turn_pct=100 * turning_of(reading.logged, reading.felt),
        speed_p99_mps=speed,
        acceleration_p99_mps2=acceleration,
        turn_p99_degps=turning,
        **vars(steady),
        unset=flown.dropped.get(UNSET, 0),
        stills=reading.source.stills,
        planned=reading.source.planned,
        year=1970 + int(flown.t_ns[0] / 1e9 / 86_400 / 365.2425),
        clock=flown.clock,
        clock_steps=reading.logged.clock_steps,
        span_s=pace.span_s,
        recorded_pct=100 * pace.recorded_s / pace.span_s if pace.span_s else 100.0,
        **{
            name: getattr(pace, name)
            for name in (
                "gaps", "long_gaps", "longest_gap_s", "skipped_m", "cut_gap_s", "hover_s", "cut_hover_s",
                "frozen_s",
            )
        },
        hfov_deg=tuple(angle for angle, _ in zoomed) or (reading.camera.hfov_deg,),
        hfov_from_s=tuple(at for _, at in zoomed) or (0.0,),
        assumed=_assumed(reading),
        frame=reading.logged.parent,
        child=reading.logged.child,
        frames=tuple(note for note in flown.notes if "frame" in note or "mount" in note or "camera" in note),
        read_pct=reading.source.read_pct,
        losses=tuple(reading.source.losses),
    )  # fmt: skip


def _pct(good: np.ndarray) -> float:
    return float(100 * np.mean(good)) if len(good) else 0.0


def _named(others: Sequence[Fit]) -> dict[str, Any]:
    """The convention that fits best, with that which fits as well: then nothing is claimed."""
    if not others:
        return {}
    best = others[0]
    item, share = best.convention, round(best.share, 2)
    second = [fit.convention for fit in others[1:2] if round(fit.share, 2) == share]
    alike = [each for each in second if each.rare == item.rare]
    words = item.words + "".join(f", or as {each.words} ({each.name})" for each in alike[:1])
    advice = f"which of the two it is cannot be told: {item.advice}" if alike else item.advice
    return {
        "other": item.name,
        "other_words": words,
        "other_advice": advice,
        "other_fit_pct": 100 * best.share,
    }


def _least_clearance(
    flown: Track, spread: np.ndarray, sight: Sight, distance: Callable[[Floats], Floats]
) -> float:
    """The least distance of the whole path: between the poses that were measured, all are near the least."""
    least = float(sight.clearance_m.min())
    reach = leg_lengths(flown.positions[spread])
    lowest = np.minimum(sight.clearance_m[:-1], sight.clearance_m[1:]) - reach
    between = [
        np.arange(spread[at] + 1, spread[at + 1]) for at in np.argsort(lowest)[:40] if lowest[at] < least
    ]
    some = np.concatenate(between) if between else np.empty(0, np.int64)
    return min(least, float(distance(flown.positions[some]).min())) if len(some) else least


def _off_centre(sight: Sight, turns: Floats) -> tuple[tuple[float, float], float]:
    """How far the log seems to lie off its structure, m, and how much of the stand-off that explains.

    A pilot who circles keeps his distance; if it grows steadily from one side to the other, the log lies
    off. Told only of flights that look at the structure from most sides.
    """
    meets = sight.meets & (sight.range_m < 1e4)
    ahead = Rotation.from_quat(turns[meets]).apply([1.0, 0.0, 0.0]) if meets.sum() > 30 else np.empty((0, 3))
    sides = np.unique(np.arctan2(ahead[:, 1], ahead[:, 0]) // (np.pi / 6))
    if len(sides) < 12 * _TURNING:
        return (0.0, 0.0), 0.0
    far = sight.range_m[meets]
    far_enough = far < 4 * np.median(far)  # beside an edge the axis meets what stands behind
    rows = np.column_stack([np.ones(len(far)), ahead[:, :2]])[far_enough]
    found = np.linalg.lstsq(rows, far[far_enough], rcond=None)[0]
    left = far[far_enough] - rows @ found
    variance = float(np.var(far[far_enough]))
    sure = 1 - float(np.var(left)) / variance if variance > 1e-9 else 0.0
    return (-float(found[1]), -float(found[2])), sure


def _motion(track: Track, gap_s: float) -> tuple[float, float, float]:
    """Speed, m/s, acceleration, m/s2, and turn rate, deg/s, that 99 % of the flight keep."""
    if len(track) < 4:
        return 0.0, 0.0, 0.0
    seconds = (track.t_ns - track.t_ns[0]) * 1e-9
    stride = max(1, round(_SPAN_S / max(float(np.median(np.diff(seconds))), 1e-4)))
    at = np.arange(0, len(track), stride)
    if len(at) < 4:
        return 0.0, 0.0, 0.0
    broken = np.cumsum(np.append(0, np.diff(seconds) > gap_s))
    if track.epoch is not None:
        broken = broken + np.cumsum(np.append(0, np.diff(track.epoch) != 0))
    lasted, whole = np.diff(seconds[at]), np.diff(broken[at]) == 0
    if not whole.any():
        return 0.0, 0.0, 0.0
    velocity = np.diff(track.positions[at], axis=0) / lasted[:, None]
    turned = np.degrees(angle_between(track.quat_xyzw[at][1:], track.quat_xyzw[at][:-1])) / lasted
    both = whole[1:] & whole[:-1]
    gained = np.linalg.norm(np.diff(velocity, axis=0), axis=1) / ((lasted[1:] + lasted[:-1]) / 2)
    return (
        float(np.percentile(np.linalg.norm(velocity[whole], axis=1), 99)),
        float(np.percentile(gained[both], 99)) if both.any() else 0.0,
        float(np.percentile(turned[whole], 99)),
    )


def _zoomed(track: Track, change_pct: float) -> list[tuple[float, float]]:
    """The fields of view, deg, each with the time, s, from which on it held; none where it does not zoom."""
    if track.fov_deg is None:
        return []
    found: list[tuple[float, float]] = []
    for angle, at in zip(track.fov_deg[:, 0].tolist(), track.t_ns.tolist(), strict=True):
        if not found or abs(angle / found[-1][0] - 1) > change_pct / 100:
            found.append((angle, (at - int(track.t_ns[0])) * 1e-9))
    return found[:_ZOOMS]


def _assumed(reading: Reading) -> tuple[str, ...]:
    camera = reading.camera
    said = []
    if NO_CALIBRATION in reading.notes:
        said.append(f"a camera of {camera.hfov_deg:g} x {camera.vfov_deg:g} deg")
    said += [note for note in reading.notes if note.startswith(ZOOM_UNHEARD)]
    if NO_MOUNT in reading.flown.notes:
        said.append("a camera that looks along the body's x axis")
    if not (reading.logged.parent or reading.logged.child):
        said.append("a frame with z up (the log names none)")
    return tuple(said)

"""How a flight lies against its structure, where its camera looks, and how its poses move.

A pilot looks a little left and right of the nearest surface; a wrong heading holds or turns the aim aside.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.ndimage import median_filter
from scipy.spatial.transform import Rotation

from upplied.geometry.polylines import chosen_evenly, interpolated
from upplied.geometry.poses import angle_between, from_yaw_pitch, optical_axis
from upplied.geometry.scene import Scene
from upplied.geometry.vectors import unit
from upplied.inputs.flight.tracks import Track
from upplied.records import Bools, Camera, Floats, Ints, Record, Structure

_PICTURE = 5  # rays along each side of a picture
# To the corners of a cube, the middles of its edges and faces, all a little askew: no grid of a mesh is hit.
_AROUND = np.delete(np.stack(np.meshgrid(*[(-1.03, 0.02, 0.97)] * 3), axis=-1).reshape(-1, 3), 13, axis=0)


@dataclass(frozen=True, eq=False, repr=False)
class Sight(Record):
    """What is true of each of M poses."""

    clearance_m: Floats  # (M,) distance from the surface
    inside: Bools  # (M,) surrounded by the structure's surface
    height_m: Floats  # (M,) over the ground, or over the lowest point of the structure where none is declared
    range_m: Floats  # (M,) along the camera's axis to the structure; inf where it meets nothing
    shown: Floats  # (M,) share of the picture that shows the structure within the camera's range

    @property
    def meets(self) -> Bools:
        return np.asarray(np.isfinite(self.range_m))


def sight_of(positions: Floats, quats: Floats, camera: Camera, structure: Structure, scene: Scene) -> Sight:
    """Measure the camera's poses, (M, 3), m, and (M, 4), against the structure of this scene."""
    turns = Rotation.from_quat(quats)
    ahead = turns.apply([1.0, 0.0, 0.0])
    range_m = scene.cast(positions, ahead)[0]
    across, up = (
        np.radians(angle) / 2 * np.linspace(-0.9, 0.9, _PICTURE)
        for angle in (min(camera.hfov_deg, 340.0), min(camera.vfov_deg, 170.0))
    )
    yaw, pitch = (part.ravel() for part in np.meshgrid(across, up))
    rays = optical_axis(from_yaw_pitch(yaw, pitch))
    directions = (turns.as_matrix() @ rays.T).swapaxes(1, 2).reshape(-1, 3)
    depth = scene.cast(np.repeat(positions, len(rays), axis=0), directions)[0].reshape(-1, len(rays))
    height_m, shown = positions[:, 2] - structure.floor_z_m, (depth <= camera.max_range_m).mean(axis=1)
    return Sight(scene.distance(positions), inside(positions, scene), height_m, range_m, shown)


def inside(positions: Floats, scene: Scene) -> Bools:
    """Which positions (M,) the surface surrounds: nearly all rays hit it, most an odd number of times."""
    surrounded = np.zeros(len(positions), bool)
    low, high = scene.box
    maybe = np.flatnonzero(((positions > low) & (positions < high)).all(axis=1))
    if len(maybe):
        starts = np.repeat(positions[maybe], len(_AROUND), axis=0)
        crossed = scene.hits(starts, np.tile(_AROUND, (len(maybe), 1))).reshape(-1, len(_AROUND))
        surrounded[maybe] = ((crossed > 0).mean(axis=1) > 0.9) & ((crossed % 2 == 1).mean(axis=1) > 0.6)
    return surrounded


_POSES = 300  # spread evenly over the flight
_LEVEL = 0.5  # least horizontal part of a direction that has a heading
_LEAST = 60  # poses that have a heading
_CLOSE_DEG = 12.0  # of the line: farther is a look at something else
_SHARE = 0.7  # of the poses that the line must explain
_ROUNDS = 5  # of fitting again, outliers counting less
_WIDTH_DEG = 10.0  # beyond which it counts less
_PITCHES_DEG = 8.0  # standard deviation of pitch and of the surface's elevation that is compared


@dataclass(frozen=True)
class Aim:
    """The straight line through the aim over time, both zero where there is none; and the pitch."""

    aim_drift_deg: float = 0.0  # from end to end, to the left of the nearest surface
    aim_off_deg: float = 0.0  # in the middle
    pitch_fit_pct: float = float("nan")  # correlation of the pitch with the elevation of the nearest surface
    pitch_span_deg: float = float("nan")  # of the pitch, nine tenths of the poses
    pitch_want_deg: float = 0.0  # elevation of the nearest surface, up or down, 75th percentile


def aim_of(positions: Floats, quat_xyzw: Floats, scene: Scene) -> Aim:
    """The camera's heading and pitch beside the nearest surface; poses are (M, 3), m, and (M, 4)."""
    some = chosen_evenly(len(positions), _POSES)
    ahead = optical_axis(quat_xyzw[some])
    near = unit(scene.closest(positions[some])[0] - positions[some])
    pitch, want = (np.degrees(np.arcsin(np.clip(part[:, 2], -1, 1))) for part in (ahead, near))
    fit = float("nan")
    if len(some) >= _LEAST and min(np.std(pitch), np.std(want)) > _PITCHES_DEG:
        fit = 100 * float(np.corrcoef(pitch, want)[0, 1])
    span = float(np.ptp(np.percentile(pitch, [5, 95]))) if len(some) >= _LEAST else float("nan")
    level = np.isfinite(left := left_of(ahead, near))
    line = _line(np.linspace(-0.5, 0.5, len(some))[level], left[level])
    return Aim(*line, fit, span, float(np.percentile(np.abs(want), 75)))


def left_of(ahead: Floats, near: Floats) -> Floats:
    """How far unit vectors (N, 3) point to the left of others, deg; NaN where one of the two is steep."""
    level = (np.hypot(*ahead[:, :2].T) > _LEVEL) & (np.hypot(*near[:, :2].T) > _LEVEL)
    across = near[:, 0] * ahead[:, 1] - near[:, 1] * ahead[:, 0]
    left = np.degrees(np.arctan2(across, (ahead[:, :2] * near[:, :2]).sum(axis=1)))
    return np.where(level, left, np.nan)


def _line(time: Floats, left: Floats) -> tuple[float, float]:
    """Slope and middle of the line that most angles (K,), deg, lie on; zeros where there is none."""
    if len(time) < _LEAST:
        return 0.0, 0.0
    rows, weight = np.column_stack([time, np.ones(len(time))]), np.ones(len(time))
    for _ in range(_ROUNDS):
        line = np.linalg.lstsq(rows * weight[:, None], left * weight, rcond=None)[0]
        weight = 1 / np.sqrt(np.maximum(np.abs(left - rows @ line) / _WIDTH_DEG, 1.0))
    near_line = np.abs(left - rows @ line) < _CLOSE_DEG
    thirds = [near_line[(time >= at) & (time < at + 1 / 3)] for at in (-0.5, -1 / 6, 1 / 6 - 1e-9)]
    if near_line.mean() < _SHARE or any(len(third) < _LEAST // 6 or third.mean() < 0.5 for third in thirds):
        return 0.0, 0.0
    return float(line[0]), float(line[1])


_SPAN_S = 0.5  # over which poses are differenced: shorter is noise
_SLOWEST_MPS, _SLOWEST_RADPS = 0.3, 0.1  # below, a direction is noise
_TURNING_RADPS = 0.03  # about the vertical: above the bias of a gyroscope
_MOMENTS = 30  # moments that are compared
_LONGEST_S = 2.0  # between poses that are differenced


def _strided(track: Track, least: int) -> tuple[Ints, Floats]:
    """Poses about half a second apart, and the times of all, s; none where there are less than `least`."""
    if len(track) < least:
        return np.empty(0, np.int64), np.empty(0)
    seconds = (track.t_ns - track.t_ns[0]) * 1e-9
    stride = max(1, round(_SPAN_S / max(float(np.median(np.diff(seconds))), 1e-4)))
    return np.arange(0, len(track), stride), seconds


def _pace99(track: Track, gap_s: float) -> dict[str, Any]:
    """Speed, acceleration and turn over half a second that 99 % keep within, but for gaps and resets."""
    at, seconds = _strided(track, 4)
    if len(at) < 4:
        return {}
    breaks = np.diff(seconds) > gap_s
    if track.epoch is not None:
        breaks |= np.diff(track.epoch) != 0
    lasted, whole = np.diff(seconds[at]), np.diff(np.append(0, np.cumsum(breaks))[at]) == 0
    if not whole.any():
        return {}
    velocity = np.diff(track.positions[at], axis=0) / lasted[:, None]
    turned = np.degrees(angle_between(track.quat_xyzw[at][1:], track.quat_xyzw[at][:-1])) / lasted
    gained = np.linalg.norm(np.diff(velocity, axis=0), axis=1) / ((lasted[1:] + lasted[:-1]) / 2)
    gained, speed = gained[whole[1:] & whole[:-1]], np.linalg.norm(velocity[whole], axis=1)
    parts = {"speed_p99_mps": speed, "acceleration_p99_mps2": gained, "turn_p99_degps": turned[whole]}
    return {name: float(np.percentile(values, 99)) for name, values in parts.items() if len(values)}


def turning_of(track: Track, gyroscopes: Sequence[tuple[Ints, Floats]]) -> float:
    """How the poses turn about the vertical beside inertial units: the best correlation, -1 to 1, or NaN.

    Mirrored poses turn the other way. Of each unit when (N,), ns, and its turn (N,), rad/s, as `ros.turning`.
    """
    first, last, lasted = _steps(track)
    if len(first) < _MOMENTS:
        return float("nan")
    starts, ends = (Rotation.from_quat(track.quat_xyzw[index]) for index in (first, last))
    turned = (ends * starts.inv()).as_rotvec()[:, 2] / lasted
    middle = (track.t_ns[first] + track.t_ns[last]) // 2
    fits = []
    for t_ns, about in gyroscopes:
        felt = np.interp((middle - t_ns[0]) * 1e-9, (t_ns - t_ns[0]) * 1e-9, about)
        turns = np.maximum(np.abs(turned), np.abs(felt)) > _TURNING_RADPS
        turns &= (middle >= t_ns[0]) & (middle <= t_ns[-1])
        size = float(np.linalg.norm(turned[turns]) * np.linalg.norm(felt[turns]))
        if turns.sum() >= _MOMENTS and size > 0:
            fits.append(float(turned[turns] @ felt[turns]) / size)
    return max(fits, default=float("nan"))


def _steps(track: Track) -> tuple[Ints, Ints, Floats]:
    """First and last pose, and seconds, of steps of about half a second that no gap interrupts."""
    at, seconds = _strided(track, _MOMENTS)
    lasted = np.diff(seconds[at])
    whole = (lasted > 1e-3) & (lasted < _LONGEST_S)
    return at[:-1][whole], at[1:][whole], lasted[whole]


def _motion(track: Track, logged: tuple[Ints, Floats] | None) -> dict[str, Any]:
    """Compare the motion of poses, as logged, with the velocity in their log, of the body or of the world."""
    first, last, lasted = _steps(track)
    if logged is None or min(len(first), len(logged[0])) < _MOMENTS:
        return {}
    order = np.argsort(logged[0], kind="stable")
    middle = (track.t_ns[first] + track.t_ns[last] - 2 * track.t_ns[0]) * 0.5e-9
    velocity = interpolated(middle, (logged[0][order] - track.t_ns[0]) * 1e-9, logged[1][order])
    linear, angular = velocity[:, :3], velocity[:, 3:]
    starts, ends = (Rotation.from_quat(track.quat_xyzw[index]) for index in (first, last))
    moved = (track.positions[last] - track.positions[first]) / lasted[:, None]
    turned = (starts.inv() * ends).as_rotvec() / lasted[:, None]  # in the body's axes
    fit = max(_fit(starts.inv().apply(moved), linear, _SLOWEST_MPS), _fit(moved, linear, _SLOWEST_MPS))
    turn = max(_fit(turned, angular, _SLOWEST_RADPS), _fit(starts.apply(turned), angular, _SLOWEST_RADPS))
    known = [each for each in (fit, turn) if np.isfinite(each)]
    speeds, speeds_logged = np.linalg.norm(moved, axis=1), np.linalg.norm(linear, axis=1)
    both = (speeds > _SLOWEST_MPS / 10) & (speeds_logged > _SLOWEST_MPS)
    ratio = float(np.median(speeds[both] / speeds_logged[both])) if both.sum() >= _MOMENTS else float("nan")
    return {"motion_fit_pct": 100 * min(known) if known else float("nan"), "motion_ratio": ratio}


def _fit(moved: Floats, logged: Floats, least: float) -> float:
    """Mean cosine between vectors that are long enough in both; NaN where there are too few."""
    lengths = np.linalg.norm(moved, axis=1), np.linalg.norm(logged, axis=1)
    if (both := (lengths[0] > least) & (lengths[1] > least)).sum() < _MOMENTS:
        return float("nan")
    return float(np.mean((moved[both] * logged[both]).sum(axis=1) / (lengths[0] * lengths[1])[both]))


_STEPS_AROUND = 7  # steps whose median tells how it moved there
_OFF_M = 0.7  # beside that: no gust moves a vehicle so between two poses
_TIMES = 8.0  # the usual
_LASTS = 3  # poses later, still there: it jumped; back: a spike
_STEEP = 0.94  # of an axis that points up or down, whose roll is that of its yaw
_TELLING = 20  # poses, and s, that tell


@dataclass(frozen=True)
class Steadiness:
    """How a flight moves; NaN where nothing tells."""

    motion_fit_pct: float = float("nan")  # mean cosine with the log's velocity, the worse of two
    motion_ratio: float = float("nan")  # speed of the poses over the speed in the log
    speed_p99_mps: float = 0.0  # what 99 % of the flight keep within
    acceleration_p99_mps2: float = 0.0
    turn_p99_degps: float = 0.0
    jumps: int = 0
    jump_m: float = 0.0  # the largest
    spikes: int = 0
    roll_deg: float = float("nan")  # of the camera, median size
    clock_ratio: float = float("nan")  # of the time by the source's clock and by the recorder's
    clock_ahead_s: float = float("nan")  # of the source's clock before the recorder's, median
    step_s: float = 0.0  # usual


def steadiness(
    logged: Track, flown: Track, gap_s: float, velocity: tuple[Ints, Floats] | None = None, timed: bool = True
) -> Steadiness:
    """The figures of a flight as it was logged, clean, and of its camera, but for silences of `gap_s`.

    Of the velocity in the log when (N,), ns, and (N, 6), m/s and rad/s; without times there is no pace.
    """
    off_m, lasting = _off(flown, gap_s)
    ratio = ahead_s = float("nan")
    spans = [float(np.ptp(clock)) * 1e-9 for clock in (logged.t_ns, logged.log_ns) if len(clock)]
    if min(spans, default=0.0) > _TELLING and not logged.clock_steps:
        ratio, ahead_s = spans[0] / spans[1], float(np.median(logged.t_ns - logged.log_ns)) * 1e-9
    turns = Rotation.from_quat(flown.quat_xyzw).as_matrix()
    turns = turns[np.abs(turns[:, 2, 0]) < _STEEP]
    rolls = np.degrees(np.abs(np.arctan2(turns[:, 2, 1], turns[:, 2, 2])))
    return Steadiness(
        **_motion(logged, velocity),
        **(_pace99(flown, gap_s) if timed else {}),
        jumps=int(lasting.sum()), jump_m=float(off_m[lasting].max(initial=0.0)),
        spikes=int(((off_m > 0) & ~lasting).sum() + 1) // 2 + logged.dropped.get("far off its neighbours", 0),
        roll_deg=float(np.median(rolls)) if len(rolls) >= _TELLING else float("nan"),
        clock_ratio=ratio, clock_ahead_s=ahead_s,
        step_s=float(np.median(np.diff(flown.t_ns))) * 1e-9 if len(flown) > 1 else 0.0,
    )  # fmt: skip


def _off(track: Track, gap_s: float) -> tuple[Floats, Bools]:
    """How far each step (N - 1,) leads off the motion around it, m, where it does; and whether for good."""
    if len(track) < _TELLING:
        return np.zeros(0), np.zeros(0, bool)
    lasted, steps = np.diff(track.t_ns) * 1e-9, np.diff(track.positions, axis=0)
    velocity = median_filter(
        steps / np.maximum(lasted, 1e-9)[:, None], size=(_STEPS_AROUND, 1), mode="nearest"
    )
    beside = steps - velocity * lasted[:, None]
    off_m = np.linalg.norm(beside, axis=1)
    same = lasted < min(gap_s, _LONGEST_S)  # farther apart, nobody knows how it moved
    if track.epoch is not None:
        same &= np.diff(track.epoch) == 0
    off_m[~same | (off_m < max(_OFF_M, _TIMES * float(np.median(off_m))))] = 0.0
    whole = np.cumsum(beside, axis=0)
    later, before = (np.clip(np.arange(len(off_m)) + by, 0, len(off_m) - 1) for by in (_LASTS, -1 - _LASTS))
    moved = np.linalg.norm(whole[later] - whole[before], axis=1)
    return off_m, (off_m > 0) & (moved > 0.6 * off_m)

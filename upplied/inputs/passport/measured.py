"""What is measured of a flight: against its structure, against what a vehicle can do, and of its log."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from upplied.geometry.polylines import chosen_evenly, leg_lengths
from upplied.geometry.poses import optical_axis
from upplied.geometry.scene import scene_of
from upplied.inputs.flight.clean import UNSET, Pace
from upplied.inputs.flight.mounts import NO_MOUNT
from upplied.inputs.flight.tracks import Track
from upplied.inputs.passport.fits import AS_WELL, NEARER, Comparison, Fit
from upplied.inputs.passport.sight import Aim, Sight, Steadiness, aim_of, sight_of, steadiness, turning_of
from upplied.inputs.rules import PassportSettings, Verdict
from upplied.inputs.schemas.cameras import NO_CALIBRATION, UNVERIFIED, ZOOM_UNHEARD
from upplied.inputs.sources.source import Source
from upplied.records import Camera, Floats, Ints, Structure

_LOOKS = 500  # poses of a flight that are measured against the structure, spread evenly over it
SEEN = 1.2  # of the camera's range: a little beyond is no other convention
_ZOOMS = 20  # that are listed
_TURNING = 0.5  # least share of the directions round the vertical that a closed flight looks in


@dataclass(frozen=True)
class Reading:
    """What the reader knows of a log and its flight, for the passport."""

    source: Source
    whole: Track  # clean, as logged, in its own frame
    logged: Track  # of it, the inspection
    flown: Track  # the camera's poses, structure frame, before its time was changed
    shortened: Track  # after
    pace: Pace
    camera: Camera
    to_camera: Callable[[Track], Track]
    gap_s: float
    notes: tuple[str, ...] = ()
    overruled: tuple[Verdict, ...] = ()  # rules of the reader, broken and overruled
    velocity: tuple[Ints, Floats] | None = None  # in the log: when (N,), ns, and (N, 6), m/s and rad/s
    gyroscopes: Sequence[tuple[Ints, Floats]] = ()  # of each unit when, ns, and its turn rate, rad/s
    lens_ratio: float = float("nan")  # declared field of view over that of the log's calibration


@dataclass(frozen=True)
class Measured(Steadiness, Aim, Pace):
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
    other_words: str = ""  # with its name, and what fits as well
    other_advice: str = ""
    other_fit_pct: float = 0.0
    other_rare_pct: float = 0.0  # by how much better it must fit than a mistake that is met more often
    stand_off_varies: float = 0.0  # standard deviation of its logarithm
    other_varies: float = 0.0  # in that convention, where it is the steadier
    rolls_deg: float = 0.0  # of the camera, in nine of ten poses
    other_rolls_deg: float = 0.0
    other_clearance_m: float = 0.0  # in that convention, where it is far more
    aside_deg: float = 0.0  # of the nearest surface, in three of four poses
    other_aside_deg: float = 0.0
    off_centre_m: tuple[float, float] = (0.0, 0.0)  # by the stand-off, horizontally
    off_centre_sure: float = 0.0  # share of the stand-off's variance that it explains
    felt_turn_pct: float = float("nan")  # correlation of how the poses turn with inertial units
    unset: int = 0  # poses without an attitude: dropped
    stills: bool = False  # photos: nothing is missing between poses
    timed: bool = True  # the log holds times
    planned: bool = False  # a mission, not a flight
    year: int = 0  # of the first stamp
    clock: str = ""
    clock_steps: int = 0
    recorded_pct: float = 100.0
    lens_ratio: float = float("nan")  # declared field of view over that of the log's calibration
    hfov_deg: tuple[float, ...] = ()  # in time
    hfov_from_s: tuple[float, ...] = ()
    assumed: tuple[str, ...] = ()
    frame: str = ""  # as logged
    child: str = ""
    frames: tuple[str, ...] = ()  # how they became the structure's and the camera's
    read_pct: float = 100.0
    losses: tuple[str, ...] = ()


def measure(reading: Reading, structure: Structure, settings: PassportSettings) -> Measured:
    """All figures of a flight's passport."""
    flown, logged, pace, camera = reading.flown, reading.logged, reading.pace, reading.camera
    scene = scene_of(structure)
    spread = chosen_evenly(len(flown), _LOOKS)
    places, turns = flown.positions[spread], flown.quat_xyzw[spread]
    sight = sight_of(places, turns, camera, structure, scene)
    declared = structure.surroundings.ground_z_m is not None
    floor = structure.floor_z_m - settings.ground_slack_m if declared else -np.inf
    off, sure = _off_centre(sight, turns)
    clearance = _least_clearance(flown, spread, sight, scene.distance)
    off_m, seen_m = float(np.hypot(*off)) if sure > 0.8 else 0.0, SEEN * camera.max_range_m
    doubtful = clearance < settings.least_clearance_m or sight.inside.any() or off_m >= settings.off_centre_m
    enough = 2.0 if doubtful else 1 - settings.fit_gain_pct / 100  # no other could explain enough more
    around = reading.to_camera, scene, floor, seen_m, reading.source.timed
    share, others = Comparison(reading.whole, *around).best_fits(enough)
    varies, least, steady = Comparison(logged, *around).steadier(settings.steadier_ratio)
    if steady and (not others or others[0].share - share < settings.fit_gain_pct / 100):
        others = steady
    least = least if others is steady else varies
    angles = [camera.hfov_deg] if flown.fov_deg is None else flown.fov_deg[:, 0].tolist()
    views: list[tuple[float, float]] = []
    for angle, at in zip(angles, flown.t_ns.tolist(), strict=False):
        if not views or abs(angle / views[-1][0] - 1) > settings.zoom_pct / 100:
            views.append((angle, (at - int(flown.t_ns[0])) * 1e-9))
    return Measured(
        **vars(pace),
        **vars(steadiness(logged, flown, reading.gap_s, reading.velocity, reading.source.timed)),
        **vars(aim_of(flown.positions, flown.quat_xyzw, scene)),
        **_best(others),
        poses=len(reading.shortened), unset=flown.dropped.get(UNSET, 0),
        ground_declared=declared, lowest_m=float(sight.height_m.min()),
        below_ground_pct=_pct(sight.height_m < -settings.ground_slack_m) if declared else 0.0,
        inside_pct=_pct(sight.inside), near_pct=_pct(sight.clearance_m < settings.near_m),
        min_clearance_m=clearance, axis_pct=_pct(sight.meets), shown_pct=_pct(sight.shown > 0),
        range_m=float(np.median(sight.range_m[sight.meets])) if sight.meets.any() else float("nan"),
        fit_pct=100 * share,
        stand_off_varies=float(varies[0]), other_varies=float(least[0]),
        rolls_deg=float(varies[1]), other_rolls_deg=float(least[1]),
        other_clearance_m=float(1 / least[2]) if NEARER * least[2] <= varies[2] else 0.0,
        aside_deg=float(varies[3]), other_aside_deg=float(least[3]),
        off_centre_m=(round(off[0], 1), round(off[1], 1)), off_centre_sure=sure,
        felt_turn_pct=100 * turning_of(logged, reading.gyroscopes),
        stills=reading.source.stills, timed=reading.source.timed, planned=reading.source.planned,
        year=1970 + int(flown.t_ns[0] / 1e9 / 86_400 / 365.2425),
        clock=flown.clock, clock_steps=logged.clock_steps,
        recorded_pct=100 * pace.recorded_s / pace.span_s if pace.span_s else 100.0,
        lens_ratio=reading.lens_ratio,
        hfov_deg=tuple(angle for angle, _ in views[:_ZOOMS]),
        hfov_from_s=tuple(at for _, at in views[:_ZOOMS]),
        assumed=_assumed(reading), frame=logged.parent, child=logged.child,
        frames=tuple(note for note in flown.notes if "frame" in note or "mount" in note or "camera" in note),
        read_pct=reading.source.read_pct, losses=tuple(reading.source.losses),
    )  # fmt: skip


def _pct(good: np.ndarray) -> float:
    return float(100 * np.mean(good)) if len(good) else 0.0


def _best(others: Sequence[Fit]) -> dict[str, Any]:
    """The convention that fits best, with that which fits as well: then nothing is claimed."""
    if not others:
        return {}
    item, least = others[0].convention, round(others[0].share, 2) - AS_WELL
    alike = [
        each for each in (fit.convention for fit in others[1:] if round(fit.share, 2) >= least - 1e-9)
        if abs(each.rare - item.rare) <= AS_WELL and each.name.split()[0] != item.name.split()[0]
    ][:1]  # fmt: skip
    words = ", or as ".join(f"{each.words} ({each.name})" for each in (item, *alike))
    advice = f"the poses fit both alike: of the first, {item.advice}" if alike else item.advice
    named = {"other": item.name, "other_words": words, "other_advice": advice}
    return named | {"other_fit_pct": 100 * others[0].share, "other_rare_pct": 100 * item.rare}


def _least_clearance(flown: Track, spread: Ints, sight: Sight, distance: Callable[[Floats], Floats]) -> float:
    """The least distance of the whole path: between the poses that were measured, all are near the least."""
    least, reach = float(sight.clearance_m.min()), leg_lengths(flown.positions[spread])
    lowest = np.minimum(sight.clearance_m[:-1], sight.clearance_m[1:]) - reach
    legs = [at for at in np.argsort(lowest)[:40] if lowest[at] < least]
    some = np.concatenate([np.arange(0), *(np.arange(spread[at] + 1, spread[at + 1]) for at in legs)])
    return min(least, float(distance(flown.positions[some]).min())) if len(some) else least


def _off_centre(sight: Sight, turns: Floats) -> tuple[tuple[float, float], float]:
    """How far off a log lies by its stand-off from most sides, m, and what share of it that explains."""
    meets = sight.meets & (sight.range_m < 1e4)
    ahead = optical_axis(turns[meets]) if meets.sum() > 30 else np.empty((0, 3))
    sides = np.unique(np.arctan2(ahead[:, 1], ahead[:, 0]) // (np.pi / 6))
    if len(sides) < 12 * _TURNING:
        return (0.0, 0.0), 0.0
    far = sight.range_m[meets]
    usual = far < 4 * np.median(far)  # beside an edge the axis meets what stands behind
    rows, far = np.column_stack([np.ones(len(far)), ahead[:, :2]])[usual], far[usual]
    weights, variance = np.linalg.lstsq(rows, far, rcond=None)[0], float(np.var(far))
    sure = 1 - float(np.var(far - rows @ weights)) / variance if variance > 1e-9 else 0.0
    return (-float(weights[1]), -float(weights[2])), sure


def _assumed(reading: Reading) -> tuple[str, ...]:
    camera, words = reading.camera, []
    if NO_CALIBRATION in reading.notes:
        words.append(f"a camera of {camera.hfov_deg:g} x {camera.vfov_deg:g} deg")
    words += [note for note in reading.notes if note.startswith(ZOOM_UNHEARD) or note.endswith(UNVERIFIED)]
    if NO_MOUNT in reading.flown.notes:
        words.append("a camera that looks along the body's x axis")
    if not (reading.logged.parent or reading.logged.child):
        words.append("a frame with z up (the log names none)")
    return tuple(words)

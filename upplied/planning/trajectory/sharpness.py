"""How fast a path may be flown, and its camera turned, so that its pictures are sharp.

No term: the path comes first, and its time stamps after. Flying more slowly shows no more surface, but
what is shown while it smears in the picture is not inspected.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numba import njit

from upplied.config import Settings, focal_px
from upplied.geometry.polylines import leg_lengths
from upplied.geometry.poses import angle_between, fov_at, matrices
from upplied.planning.carry.inspected_surface import InspectedSurface
from upplied.planning.demonstration.repetition import USUAL_PCT, Take, breaks_of, look_limits, steady_radps
from upplied.planning.geometry.clouds import weighted_percentile
from upplied.planning.trajectory.retime import Sharp, Timed, retime
from upplied.planning.visibility.line_of_sight import coarseness, visible
from upplied.planning.visibility.observations import moments
from upplied.records import Bools, Floats, Ints, Trajectory, Waypoints

_SAMPLES = 1500  # of the inspected surface, that are asked for
MARGIN = 0.95  # of the limit, for what speeds differ within a leg
# Of what is in view, and of a pixel, where the demonstration was not sharp: the hand trembles within a leg.
_NEARLY_ALL, _STEADY = 0.98, 0.8
_MOSTLY = 0.6  # share of what is in view that stays as sharp as in the expert's pictures
_SLOWEST_MPS = 0.1


def sharply_timed(
    path: Waypoints,
    flight: Trajectory,
    takes: Sequence[Take],
    inspected: InspectedSurface,
    settings: Settings,
) -> Timed:
    """A path with its times (`retime.retime`): sharp, and with slow swings of the camera made steady."""
    sharp = sharp_limits(path, flight, takes, inspected, settings)
    timed = retime(path, flight, settings.retime, breaks_of(takes), sharp)
    steadied = steadied_swings(sharp, path.t_s, timed, steady_radps(takes, settings.inspection))
    return timed if steadied is sharp else retime(path, flight, settings.retime, breaks_of(takes), steadied)


def sharp_limits(
    path: Waypoints,
    flight: Trajectory,
    takes: Sequence[Take],
    inspected: InspectedSurface,
    settings: Settings,
) -> Sharp:
    """How fast a path may be flown, and its camera turned, at each waypoint.

    Where the expert himself swung his camera round faster than it stays sharp he was on the way from one
    thing to the next: nothing there is to be sharp, and the plan swings as fast as he did. The flight and
    what was inspected are those of all takes together (`repetition.joined`).

    Sharp is what moves no faster through the picture than `settings.inspection` says, or than the expert's
    own pictures did, as long as that is no more than a pixel of his camera (`max_motion_px`).
    """
    usual, swung = np.degrees(steady_radps(takes, settings.inspection)), _swung_degps(path.t_s, flight)
    camera, scene, rule = takes[0].inspection.camera, takes[0].pair.target_scene, settings.inspection
    focal = focal_px(camera.width_px or rule.width_px, camera.hfov_deg)
    one_pixel = rule.max_motion_px / ((camera.exposure_s or rule.exposure_s) * focal)
    own, _ = look_limits(takes, rule)
    # Where looks of more than a pixel count as shown, nearly all that is in view has to stay within one.
    limit, share = (own, _MOSTLY) if own <= one_pixel else (_STEADY * one_pixel, _NEARLY_ALL)
    few = np.flatnonzero(inspected.need > 0)[:_SAMPLES]
    part = inspected.cloud.at(few)
    poses, fov_deg = (path.positions, path.quat_xyzw), fov_at(flight, path.t_s)
    seen = visible(*poses, part, camera, settings.visibility, scene, fov_deg=fov_deg).seen
    farthest_m = inspected.standoff_m[few] / rule.least_resolution
    coarse = coarseness(camera, fov_deg)
    coarse = np.ones(len(path)) if coarse is None else coarse
    surface = part.points, part.outward
    angle, stillest, least = moved_in_picture(
        path.positions, matrices(path.quat_xyzw), *surface, seen, coarse, farthest_m, share
    )
    # Most of each picture is sharp, and all of the surface in one of them.
    np.maximum.at(angle, stillest[stillest >= 0], least[stillest >= 0])
    leg = leg_lengths(path.positions)
    with np.errstate(divide="ignore", invalid="ignore"):
        fastest = np.where((angle > 0) & (leg > 1e-6), leg * MARGIN * limit / angle, np.inf)
    fastest = np.maximum(fastest, _SLOWEST_MPS)
    speed = np.minimum(np.append(fastest, np.inf), np.insert(fastest, 0, np.inf))
    return Sharp(np.where(swung > usual, np.inf, speed), np.maximum(swung, MARGIN * usual))


def _swung_degps(t_s: Floats, flight: Trajectory) -> Floats:
    """How fast the expert turned his camera at these times (W,), deg/s."""
    if len(flight) < 2:
        return np.zeros(len(t_s))
    spent = np.maximum(np.diff(flight.t_s), 1e-3)
    rate = np.degrees(angle_between(flight.quat_xyzw[:-1], flight.quat_xyzw[1:])) / spent
    return np.interp(t_s, (flight.t_s[:-1] + flight.t_s[1:]) / 2, rate)


def steadied_swings(sharp: Sharp, path_t_s: Floats, timed: Timed, steady_radps: float) -> Sharp:
    """The limits with slow swings of the camera made steady, so that fast ones stay the exception.

    A swing takes as long on a small structure as on a large one, the rest of the flight does not. The slowest
    swings are flown steadily, as many as leave no more than 5 % of the time for the others. `path_t_s` (W,)
    are the times of the demonstration that the waypoints correspond to, `timed` what `retime` gives for these
    limits, and up to `steady_radps` a camera turns steadily.
    """
    flown, steady_degps = timed.trajectory, np.degrees(steady_radps)
    steps = moments(flown)
    fast = sharp.pan_degps > steady_degps
    first = np.flatnonzero(np.diff(fast, prepend=~fast[:1]))  # of each swing, and of each stretch between two
    swing = np.repeat(np.maximum.reduceat(sharp.pan_degps, first), np.diff(first, append=len(fast)))
    at = np.interp(steps.poses.t_s, flown.t_s, timed.demonstrated_s)
    at = np.interp(at, path_t_s, np.arange(len(fast)))
    is_fast = np.linalg.norm(steps.turn, axis=1) > steady_radps
    swung = np.where(is_fast, swing[np.rint(at).astype(int)], 0.0)
    slow = weighted_percentile(swung, steps.step_s, USUAL_PCT)
    if not slow > 0:
        return sharp
    return replace(sharp, pan_degps=np.where(fast & (swing <= slow), MARGIN * steady_degps, sharp.pan_degps))


@njit(cache=True)
def moved_in_picture(
    positions: Floats,
    axes: Floats,
    points: Floats,
    normals: Floats,
    seen: Bools,
    coarse: Floats,
    farthest_m: Floats,
    share: float,
) -> tuple[Floats, Ints, Floats]:
    """How far what both ends of a leg show moves in the picture.

    Returns the angle (W - 1,), rad, by which a share of it moves at most, and for each sample (N,) the leg
    on which it moves least for its length, of those that show it finely enough, and the angle there; -1
    where there is none.
    """
    angle = np.zeros(len(positions) - 1)
    moved = np.empty(len(points))
    stillest, least, rate = np.full(len(points), -1), np.zeros(len(points)), np.full(len(points), np.inf)
    for leg in range(len(angle)):
        count, squared = 0, 0.0
        for axis in range(3):
            squared += (positions[leg + 1, axis] - positions[leg, axis]) ** 2
        length = max(np.sqrt(squared), 1e-6)
        for index in range(len(points)):
            if not (seen[leg, index] and seen[leg + 1, index]):
                continue
            first, second, across, above, below = 0.0, 0.0, 0.0, 0.0, 0.0
            for axis in range(3):
                first += (points[index, axis] - positions[leg, axis]) ** 2
                second += (points[index, axis] - positions[leg + 1, axis]) ** 2
                above += (positions[leg, axis] - points[index, axis]) * normals[index, axis]
                below += (positions[leg + 1, axis] - points[index, axis]) * normals[index, axis]
            if min(first * coarse[leg] ** 2, second * coarse[leg + 1] ** 2) > farthest_m[index] ** 2:
                continue
            for column in range(3):
                here, there = 0.0, 0.0
                for axis in range(3):
                    here += axes[leg, axis, column] * (points[index, axis] - positions[leg, axis])
                    there += axes[leg + 1, axis, column] * (points[index, axis] - positions[leg + 1, axis])
                across += (here / np.sqrt(first) - there / np.sqrt(second)) ** 2
            moved[count] = np.sqrt(across)
            fine = first * coarse[leg] <= farthest_m[index] * above
            fine &= second * coarse[leg + 1] <= farthest_m[index] * below
            if fine and moved[count] / length < rate[index]:
                stillest[index], least[index], rate[index] = leg, moved[count], moved[count] / length
            count += 1
        if count:
            angle[leg] = np.sort(moved[:count])[min(int(share * count), count - 1)]
    return angle, stillest, least

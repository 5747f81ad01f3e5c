"""How finely, frontally, sharply and long a flight looks at each patch of a surface: one rule for every look.

A look, in steps of half a second, counts where the patch is seen frontally enough and moves slowly enough in
the picture to be sharp. Its ground sample distance is the longer side of what one pixel covers of the patch:
distance times the angle of the picture's middle pixel, over the cosine of the incidence. Towards the edge of
a flat picture pixels cover less; that is not counted, since it would reward looking past a subject.
"""

from dataclasses import dataclass

import numpy as np
from numba import njit

from upplied.geometry.poses import matrices
from upplied.geometry.vectors import sphere
from upplied.planning.visibility.observations import Moments, Views, motion_of, sight_to, stations_at
from upplied.records import Bools, Camera, Cloud, Floats, Ints, Rows

_FLAT_DEG = 120.0  # of a field of view, beyond which a picture's angle grows evenly (`config.focal_px`)
_SIDES = 60  # directions of the sphere, some 26 deg apart, that looks are distinguished by
_NEIGHBOUR = np.cos(np.radians(30.0))


@dataclass(frozen=True, eq=False, repr=False)
class Looks(Rows):
    """The sharp looks at each of N patches, and the finest of them."""

    # (N,) distance of the finest over the cosine of its incidence, of one camera where it zooms: times the
    # angle of a pixel in the picture's middle, what a pixel covers; inf where there is none
    sampled_m: Floats
    carried_m: Floats  # (N,) the same after the lines of sight are carried to another structure
    frontal: Floats  # (N,) cosine of the least incidence; -1 for none
    held_s: Floats  # (N,) how long in all
    time_s: Floats  # (N,) mean moment; NaN for none
    sides: Bools  # (N, 60) directions from which it was looked at
    number: Ints  # (N,) how many are as fine as required
    depth_m: Floats  # (N,) of the finest, along the optical axis; NaN for none
    moved: Floats  # (N,) 1/s, of the finest: times the focal length in pixels, the speed across the picture
    defocus: Floats  # (N,) times the focal length in pixels, the blur of what is out of focus; 0 unknown
    pose: Ints  # (N,) step of the finest; -1


def sharp_looks(
    steps: Moments,
    shown: Views,
    cloud: Cloud,
    camera: Camera,
    sharp_radps: float,
    least_cosine: float,
    carry: Floats | None = None,
    coarsest_m: Floats | None = None,
) -> Looks:
    """The sharp looks of a flight at each sample of a surface.

    Parameters
    ----------
    shown : Views
        What the flight truly sees of the N samples, in the same time.
    sharp_radps, least_cosine : float
        Largest motion in the picture, rad/s, and least cosine of the incidence.
    carry : array, shape (3, 3), optional
        How a line of sight is carried to the structure that `sides` are compared on.
    coarsest_m : array, shape (N,), optional
        The largest `sampled_m` of a look that is as fine as required; any, where not given.
    """
    station = stations_at(shown, steps)
    positions, points = (np.ascontiguousarray(of) for of in (steps.poses.positions, cloud.points))
    axes = np.ascontiguousarray(matrices(steps.poses.quat_xyzw)[:, :, 0])
    seen = np.ascontiguousarray(shown.seen[station])
    number = len(points)
    none, nothing, zero = np.full(number, np.inf), np.full(number, np.nan), np.zeros(number)
    looks = Looks(
        sampled_m=none,
        carried_m=none.copy(),
        frontal=-np.ones(number),
        held_s=zero,
        time_s=zero.copy(),
        sides=np.zeros((number, _SIDES), bool),
        number=np.zeros(number, np.int64),
        depth_m=nothing,
        moved=nothing.copy(),
        defocus=zero.copy(),
        pose=np.full(number, -1),
    )
    moving = (np.ascontiguousarray(of) for of in (steps.velocity, steps.turn, shown.coarseness[station]))
    coarsest = np.full(number, np.inf) if coarsest_m is None else np.ascontiguousarray(coarsest_m)
    _looked(
        (positions, axes, *moving, steps.poses.t_s, steps.step_s),
        seen,
        (points, np.ascontiguousarray(cloud.outward), coarsest),
        (sharp_radps, max(least_cosine, 1e-6), camera.hfov_deg <= _FLAT_DEG),
        (np.ascontiguousarray(np.eye(3) if carry is None else carry), sphere(_SIDES)),
        (looks.sampled_m, looks.carried_m, looks.frontal, looks.held_s, looks.time_s, looks.sides),
        (looks.number, looks.depth_m, looks.moved, looks.pose),
    )
    looks.defocus[:] = _defocus(camera, positions, axes, seen, points, looks.depth_m, looks.pose)
    with np.errstate(invalid="ignore", divide="ignore"):
        looks.time_s[:] = looks.time_s / looks.held_s
    return looks


def _defocus(
    camera: Camera, positions: Floats, axes: Floats, seen: Bools, points: Floats, depth: Floats, pose: Ints
) -> Floats:
    """Diameter of the blur, over the focal length, of what lies off the distance that is in focus (N,)."""
    # A camera is taken to focus on the median depth of what it sees. Thin lens: f |z - s| / (N z (s - f)).
    if not (camera.focal_mm and camera.f_number):
        return np.zeros(len(points))
    focal_m = camera.focal_mm * 1e-3
    focus = np.full(len(positions), np.nan)
    for at in np.unique(pose[pose >= 0]):
        focus[at] = np.median((points[seen[at]] - positions[at]) @ axes[at])
    focus = np.maximum(focus, max(camera.focus_m, 2 * focal_m))[np.maximum(pose, 0)]
    blur = focal_m * np.abs(depth - focus) / (camera.f_number * depth * (focus - focal_m))
    return np.where(pose >= 0, blur, np.nan)


def sampled_m(distance: Floats, cosine: Floats) -> Floats:
    """`Looks.sampled_m` of looks from a distance, m, by the cosine of the incidence; inf from behind."""
    return np.where(cosine > 1e-6, distance / np.maximum(cosine, 1e-6), np.inf)


def widened(sides: Bools) -> Bools:
    """The same sides and their neighbours on the sphere, within 30 deg."""
    direction = sphere(_SIDES)
    near = (direction @ direction.T >= _NEIGHBOUR).astype(np.float32)
    return np.asarray(sides.astype(np.float32) @ near > 0, bool)


@njit(cache=True)
def _looked(
    flight: tuple[Floats, ...],
    seen: Bools,
    surface: tuple[Floats, Floats, Floats],
    limits: tuple[float, float, bool],
    compared: tuple[Floats, Floats],
    every: tuple[Floats, Floats, Floats, Floats, Floats, Bools],
    fine: tuple[Ints, Floats, Floats, Ints],
) -> None:  # pragma: no cover - compiled
    """Fill in what is known of `every` look, and of the `fine` ones."""
    positions, axes, velocity, turn, coarse, t_s, step_s = flight
    points, normals, coarsest = surface
    sharp, least_cosine, flat = limits
    carry, directions = compared
    sampled, reached, frontal, dwell, time, sides = every
    looks, depth, moved, finest = fine
    ray, carried, swept = np.empty(3), np.empty(3), np.empty(3)
    for pose in range(len(positions)):
        axis, v, w = axes[pose], velocity[pose], turn[pose]
        for index in range(len(points)):
            if not seen[pose, index]:
                continue
            distance, cosine = sight_to(positions[pose], points[index], normals[index], ray)
            if cosine < least_cosine:
                continue
            speed = motion_of(ray, distance, v, w)
            if speed > sharp:
                continue
            frontal[index] = max(frontal[index], cosine)
            dwell[index] += step_s[pose]
            time[index] += step_s[pose] * t_s[pose]
            squared = 0.0
            for row in range(3):
                carried[row] = carry[row, 0] * ray[0] + carry[row, 1] * ray[1] + carry[row, 2] * ray[2]
                squared += carried[row] * carried[row]
            reached[index] = min(reached[index], np.sqrt(squared) / cosine * coarse[pose])
            best, side = -np.inf, 0
            for way in range(len(directions)):
                toward = directions[way]
                along = -(toward[0] * carried[0] + toward[1] * carried[1] + toward[2] * carried[2])
                if along > best:
                    best, side = along, way
            sides[index, side] = True
            reach = distance / cosine * coarse[pose]
            looks[index] += reach <= coarsest[index]
            if not reach < sampled[index]:
                continue
            sampled[index], depth[index], finest[index] = reach, distance, pose
            along = (ray[0] * axis[0] + ray[1] * axis[1] + ray[2] * axis[2]) / distance
            if flat and along > 1e-3:
                deep = distance * along
                swept[0] = -(v[0] + w[1] * ray[2] - w[2] * ray[1])
                swept[1] = -(v[1] + w[2] * ray[0] - w[0] * ray[2])
                swept[2] = -(v[2] + w[0] * ray[1] - w[1] * ray[0])
                away = swept[0] * axis[0] + swept[1] * axis[1] + swept[2] * axis[2]
                square = 0.0
                for row in range(3):
                    square += (swept[row] - ray[row] / deep * away) ** 2
                speed, depth[index] = np.sqrt(square) / deep, deep
            moved[index] = speed / coarse[pose]

"""The path and the aim of a pilot for each inspection (paper, Sec. IV-B).

A route is coarse: the simulated hand (`upplied.samples.pilot`) rounds it and adds clearance.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.ndimage import gaussian_filter1d, maximum_filter1d
from scipy.spatial import cKDTree

from upplied.errors import RefusedError
from upplied.geometry.scene import Scene, scene_of
from upplied.records import Floats, Structure
from upplied.samples.airframe import airframe, left_nacelle, offset_outline, points_on, tower_of, two_piers


class Route(NamedTuple):
    """Positions of the camera and the places it looks at, both (N, 3), m, structure frame."""

    positions: Floats
    look: Floats


Inspection = Callable[[Structure, Scene, float], Route]  # of a structure, its scene and the ground's height


def route_of(structure: Structure, inspection: str, scene: Scene, ground_z: float) -> Route:
    """The route of an inspection round a structure.

    Raises RefusedError if the inspection is unknown, or the structure lacks the inspected part.
    """
    if inspection not in INSPECTIONS:
        known = ", ".join(sorted(INSPECTIONS))
        raise RefusedError(f"inspection {inspection!r}", "is unknown", f"one of {known}")
    return INSPECTIONS[inspection](structure, scene, ground_z)


def _about_the_middle(inspect: Inspection) -> Inspection:
    """The inspection of an airplane whose plane of symmetry may lie beside y = 0."""

    def route(structure: Structure, scene: Scene, ground_z: float) -> Route:
        low, high = structure.vertices[:, 1].min(), structure.vertices[:, 1].max()
        aside = np.array([0.0, (low + high) / 2, 0.0])
        if abs(aside[1]) < 0.002 * (high - low):
            return inspect(structure, scene, ground_z)
        centred = replace(structure, vertices=structure.vertices - aside)
        flown = inspect(centred, scene_of(centred), ground_z)
        return Route(flown.positions + aside, flown.look + aside)

    return route


def _fuselage(structure: Structure, scene: Scene, ground_z: float) -> Route:
    """Aft along the left side, round the tail, and forward along the right side."""
    frame = airframe(structure, scene)
    width, off = frame.half_width, float(np.clip(2.6 * frame.half_width, 6.0, 9.0))
    body = np.array([[x, y] for x in (frame.tail_x, frame.nose_x) for y in (-width, width)])
    loop = offset_outline(body, off)
    turn = np.argmin(np.hypot(loop[:, 0] - frame.nose_x - off, loop[:, 1]))
    plan = np.roll(loop, -int(turn), axis=0)  # anticlockwise: the left side comes first
    over = frame.height_near(plan[:, 0], plan[:, 1], 3.0) + 3.0
    high = np.maximum(frame.axis_z + 0.5 * frame.half_height, over)
    height = _eased(np.maximum(high, ground_z + 2.5), reach=12)
    aim = np.clip(plan[:, 0], frame.tail_x + 0.12 * (frame.nose_x - frame.tail_x), frame.nose_x - 1.0)
    look = np.column_stack([aim, np.zeros(len(plan)), np.full(len(plan), frame.axis_z)])
    return Route(np.column_stack([plan, height]), look)


def _wings(structure: Structure, scene: Scene, ground_z: float) -> Route:
    """From the far end of the left wing to the centre, then along the right wing."""
    frame = airframe(structure, scene)
    above = float(np.clip(0.17 * frame.semi_span, 4.5, 8.0))
    y = np.arange(frame.semi_span, -frame.semi_span, -0.5)
    out = np.clip(np.abs(y), frame.wing_y[0], frame.wing_y[-1])
    leading, trailing = (np.interp(out, frame.wing_y, edge) for edge in (frame.leading_x, frame.trailing_x))
    wing_z = np.interp(out, frame.wing_y, frame.wing_z)
    x = leading + 2.0
    height = np.maximum(wing_z + above, frame.height_near(x, y, 3.0) + 3.5)
    look = np.column_stack([0.55 * leading + 0.45 * trailing, y, wing_z])
    return Route(np.column_stack([x, y, _eased(height, reach=10)]), look)


def _engine_left(structure: Structure, scene: Scene, ground_z: float) -> Route:
    """A sweep round the front of the left engine at its height, and back a little higher."""
    frame = airframe(structure, scene)
    engine = left_nacelle(structure, frame, scene)
    middle = np.array(engine.centre)
    off = engine.radius_m + float(np.clip(3.2 * engine.radius_m, 5.0, 8.0))
    passes: list[Floats] = []
    for lift in (0.0, 0.45 * off):
        height = max(engine.centre[2] + lift, ground_z + 2)
        if (arc := _open_arc(scene, middle, off + engine.length_m / 3, height)) is not None:
            passes.append(arc[::-1] if passes else arc)
    if not passes:
        raise RefusedError(structure.structure_id, "there is no room to fly round the left engine")
    positions = np.concatenate(passes)
    return Route(positions, np.broadcast_to(middle, positions.shape).copy())


def _open_arc(scene: Scene, middle: Floats, radius: float, height: float) -> Floats | None:
    """The arc round the engine, from ahead to both sides, at 3.5 m; None if too short."""
    azimuth = np.radians(np.arange(-100.0, 150.0, 3.0))
    ring = np.column_stack([np.cos(azimuth), np.sin(azimuth), np.zeros(len(azimuth))]) * radius
    ring += (middle[0], middle[1], height)
    free = scene.distance(ring) > 3.5
    ahead = int(np.argmin(np.abs(azimuth - np.radians(20))))
    if not free[ahead]:
        return None
    first = ahead - int(np.argmin(np.append(free[ahead::-1], False))) + 1
    last = ahead + int(np.argmin(np.append(free[ahead:], False)))
    return ring[first:last] if last - first > 10 else None


def _tower(structure: Structure, scene: Scene, ground_z: float) -> Route:
    """A spiral up the tower, from its foot to below the nacelle."""
    tower = tower_of(structure)
    off = float(np.clip(0.09 * (tower.top_z - tower.foot_z), 6.0, 10.0))
    radius = tower.radius_m + off
    start, stop = max(tower.foot_z, ground_z) + 3.0, tower.top_z - 2.0
    turns = max(2.0, round((stop - start) / (1.35 * off)))
    angle = np.linspace(0, 2 * np.pi * turns, int(turns * 90))
    height = start + (stop - start) * angle / angle[-1]
    x, y = tower.axis_xy
    positions = np.column_stack([x + radius * np.cos(angle), y + radius * np.sin(angle), height])
    # Blades may hang in front of the upper tower: there the spiral ends.
    free = scene.distance(positions) > 3.0
    end = len(free) if free.all() else int(np.argmin(free))
    if end < 90:
        raise RefusedError(structure.structure_id, "there is no room for a spiral round the tower")
    look = np.column_stack([np.full(end, x), np.full(end, y), height[:end]])
    return Route(positions[:end], look)


def _hull(structure: Structure, scene: Scene, ground_z: float) -> Route:
    """Once round the ship at the height of its side, as the paper's flights almost in a plane."""
    points = points_on(structure)
    tall = float(np.ptp(points[:, 2]))
    height = ground_z + float(np.clip(0.2 * tall, 2.5, 9.0))
    side = points[points[:, 2] < ground_z + 0.35 * tall]
    off = float(np.clip(0.06 * np.ptp(points[:, 0]), 5.0, 12.0))
    loop = offset_outline(side[:, :2], off)
    return Route(_level(loop, height), _level(_nearest(side, loop), ground_z + 0.12 * tall))


def _sides(structure: Structure, scene: Scene, ground_z: float) -> Route:
    """A U: along the left side, across the front, and back along the right side."""
    points = points_on(structure)
    tall = float(points[:, 2].max()) - ground_z
    off = float(np.clip(0.55 * tall, 5.0, 14.0))
    loop = offset_outline(points[:, :2], off)
    # The loop begins behind the building on the axis and goes round by the right, so the U is one piece.
    plan = loop[loop[:, 0] > points[:, 0].min() + 0.5][::-1]
    height = ground_z + 0.5 * tall
    return Route(_level(plan, max(height, ground_z + 2.5)), _level(_nearest(points, plan), height))


def _piers(structure: Structure, scene: Scene, ground_z: float) -> Route:
    """A figure 8 round two neighbouring piers."""
    one, two, low, high = two_piers(structure, scene)
    apart = two.centre[0] - one.centre[0]
    room = min(high - low, 0.6 * float(np.ptp(structure.vertices[:, 2])))
    loops = [_figure(*pier, side, apart) for pier, side in ((one, 1.0), (two, -1.0))]
    plan = np.concatenate(loops)
    best, at = -np.inf, 0.0
    for share in (0.45, 0.38, 0.55, 0.3, 0.65, 0.75):
        height = max(low + share * room, ground_z + 2.5)
        clear = float(scene.distance(_level(plan, height)).min())
        if clear > best + 0.5:
            best, at = clear, height
    if best < 2.5:
        finding = f"a figure 8 round the piers comes within {best:.1f} m"
        raise RefusedError(structure.structure_id, finding, "2.5 m free")
    nearer = np.repeat([one.centre, two.centre], [len(loop) for loop in loops], axis=0)
    return Route(_level(plan, at), _level(nearer, at))


def _figure(middle: Sequence[float], size: Sequence[float], side: float, apart: float) -> Floats:
    """One loop of the 8, from the crossing round a pier and back; `side` is 1 for the pier at smaller x."""
    half, centre = np.array(size), np.array(middle)
    radius = half + float(np.clip(0.5 * apart - half[0] - 2.0, 3.0, 6.0))
    angle = np.linspace(-0.72 * np.pi, 0.72 * np.pi, 80)
    ring = centre + np.column_stack([-side * np.cos(angle), -np.sin(angle)]) * radius
    crossing = centre + np.array([side * apart / 2, 0.0])
    share = np.linspace(0, 1, 20)[:-1, None]
    entry = crossing + share * (ring[0] - crossing)
    leave = ring[-1] + (share + 1 / 19) * (crossing - ring[-1])
    return np.concatenate([entry, ring, leave])


def _eased(height: Floats, reach: int) -> Floats:
    """Heights that rise early enough, without steps."""
    highest = maximum_filter1d(height, 2 * reach + 1, mode="nearest")
    return np.asarray(gaussian_filter1d(highest, reach / 2, mode="nearest"))


def _level(plan: Floats, height: float) -> Floats:
    return np.column_stack([plan, np.full(len(plan), height)])


def _nearest(surface: Floats, points: Floats) -> Floats:
    """The nearest places of a surface's outline."""
    outline = offset_outline(surface[:, :2], 0.0, step_m=0.25)
    return np.asarray(outline[cKDTree(outline).query(points)[1]])


INSPECTIONS: dict[str, Inspection] = {
    "fuselage": _about_the_middle(_fuselage),
    "wings": _about_the_middle(_wings),
    "engine_left": _about_the_middle(_engine_left),
    "tower": _tower,
    "hull": _hull,
    "sides": _sides,
    "piers": _piers,
}

"""The frame that a plan is computed in: it turns and moves with the structure.

Voxel grids, bounding boxes, spreads along axes and the directions that are tried all depend on the
axes. A plan must not: the same structure, flight and target in other axes get the same plan, turned.
So everything is brought to axes that follow from the structure alone, planned there, and carried back.
"""

from collections.abc import Callable
from dataclasses import fields, replace
from typing import Any, TypeVar

import numpy as np
from scipy.spatial.transform import Rotation

from upplied.config import Settings
from upplied.geometry.poses import normalised, wrapped
from upplied.geometry.vectors import area_vectors, triangle_areas
from upplied.planning.surface.lattice import centre
from upplied.records import Demonstration, Floats, Frame, Registration, Structure, StructureInFrame

_ROUND = 0.02  # below it walls face all ways alike, or surface reaches as far, and no heading follows
_SQUARE = 4.0  # weight of walls that mostly face one way and its opposite beside those of four ways
_NORMAL_DEG = 2.0  # a declared heading this near to the walls' own, or a right angle from it, is meant
_GRID_M = 2.0**-20  # what coordinates are rounded to, so that a turn forth and back leaves no trace
_GRID_QUAT = 2.0**-30
_OFF = 0.3  # rad, so that no structure drawn along its axes lies where two quarters meet


DECLARED = Frame()
R = TypeVar("R", bound=Any)


def frames_for(source: Structure, target: Structure, settings: Settings) -> tuple[Frame, Frame]:
    """The frames to plan in, of the source and of the target.

    What is published works along the declared axes, and keeps them; only where the walls of the source
    stand askew to these are both structures turned. `recommended` plans in each structure's own frame.
    """
    if plans_in_own_frame(settings):
        return own_frame(source), own_frame(target)
    askew = _wall_heading(source)
    if askew is None or abs(askew) <= np.radians(_NORMAL_DEG):
        return DECLARED, DECLARED
    return Frame(askew), Frame(askew)


def plans_in_own_frame(settings: Settings) -> bool:
    """Whether no step that these settings ask for works along the declared axes."""
    return (
        settings.visibility.occlusion
        and settings.correspondence.method == "parts"
        and settings.transfer.method == "counterparts"
        and settings.refine.method == "view"
    )


def own_frame(structure: Structure) -> Frame:
    """The frame that follows from a structure, however it is turned about the vertical or moved.

    Its axes are those that walls face. Which of the four headings counts as +X follows from where the
    surface reaches farther out, and of structures alike to all sides from the order of the vertices: it is
    of no consequence, but must turn with the structure. A round structure, whose walls tell no heading, has
    one from these alone.
    """

    def own() -> Frame:
        middle = centre(structure) * [1.0, 1.0, 0.0]
        walls, order = _wall_heading(structure), _leaning(structure)
        if walls is None:
            return Frame(order, middle)
        heading = walls + np.round((order - walls - _OFF) / (np.pi / 2)) * np.pi / 2
        return Frame(float(wrapped(np.asarray(heading))), middle)

    return structure.derived("own frame", own)


def _wall_heading(structure: Structure) -> float | None:
    """Heading that walls face, modulo a right angle: -45 to 45 deg, rad; None where they face all ways."""
    # The mean of the fourth powers of the horizontal normals, as complex numbers, weighted with the area seen
    # from the side, and of the squared mean of their squares.
    if len(structure.triangles):
        normal = area_vectors(structure.vertices[structure.triangles])
    elif structure.normals is not None:
        normal = structure.normals
    else:  # as long as the area; of points that have none, their offsets
        normal = structure.vertices - structure.vertices.mean(axis=0)
    facing = normal[:, 0] + 1j * normal[:, 1]
    size = np.abs(facing)
    if not size.sum() > 0:
        return None
    unit = np.where(size > 0, facing / np.where(size > 0, size, 1.0), 0.0)
    squares, fourths = ((size * unit**power).sum() / size.sum() for power in (2, 4))
    mean = fourths + _SQUARE * squares**2
    return float(np.angle(mean) / 4) if abs(mean) > _ROUND else None


def _leaning(structure: Structure) -> float:
    """A direction (rad) in which the surface reaches farther out, however its triangles are divided."""
    # Else one that the numbering of the vertices gives: a sum of offsets with uneven weights.
    if len(structure.triangles):
        middles, size = structure.vertices[structure.triangles].mean(axis=1), triangle_areas(structure)
        offset = middles - centre(structure)
        out = offset[:, 0] + 1j * offset[:, 1]
        cubes = size * np.abs(out) ** 3
        towards = (size * np.abs(out) ** 2 * out).sum()
        if abs(towards) > _ROUND * cubes.sum():
            return float(np.angle(towards))
    offset = structure.vertices[:, :2] - structure.vertices[:, :2].mean(axis=0)
    weight = (np.arange(len(offset)) * (np.sqrt(5) - 1) / 2) % 1 - 0.5
    along = weight @ offset
    return float(np.arctan2(along[1], along[0]))


def structure_in(frame: Frame, structure: Structure) -> Structure:
    """The structure in another frame, as long as it lives the same object."""
    if frame is DECLARED:
        return structure
    where = (frame.heading_rad, *frame.origin_m.tolist())
    return structure.derived(f"in frame {where}", lambda: _turned(frame, structure))


def _turned(frame: Frame, structure: Structure) -> Structure:
    values = {item.name: getattr(structure, item.name) for item in fields(Structure)}
    return replace(
        StructureInFrame(**values, frame=frame),
        vertices=_on_grid(frame.from_declared(structure.vertices)),
        normals=None if structure.normals is None else structure.normals @ frame.turn,
        landmarks={
            name: tuple(frame.from_declared(np.array(place, float)).tolist())
            for name, place in structure.landmarks.items()
        },
        sha256=_named(structure.sha256, frame),
    )


def demonstration_in(frame: Frame, demonstration: Demonstration) -> Demonstration:
    """The flight in another frame of its structure."""
    if frame is DECLARED:
        return demonstration
    moved = in_frame(frame, demonstration)
    return replace(
        moved,
        positions=_on_grid(moved.positions),
        quat_xyzw=np.round(moved.quat_xyzw / _GRID_QUAT) * _GRID_QUAT,
        sha256=_named(demonstration.sha256, frame),
    )


def in_frame(frame: Frame, record: R) -> R:
    """A record of the declared frame, such as a trajectory or a surface, in another one."""
    if frame is DECLARED:
        return record
    return _moved(record, frame.from_declared, frame.turn, -frame.heading_rad)


def in_declared(frame: Frame, record: R | None) -> R | None:
    """A record of another frame in the declared one."""
    if record is None or frame is DECLARED:
        return record
    return _moved(record, frame.to_declared, frame.turn.T, frame.heading_rad)


def _moved(record: R, place: Callable[[Floats], Floats], turn: Floats, heading_rad: float) -> R:
    """A record with its points, its directions (by `turn` from the right) and its orientations moved."""
    about = Rotation.from_euler("z", heading_rad)
    moves = {
        "points": place,
        "positions": place,
        "normals": lambda directions: directions @ turn,
        "corner": lambda directions: directions @ turn,
        "quat_xyzw": lambda quats: normalised((about * Rotation.from_quat(quats)).as_quat()),
    }
    values = {item.name: getattr(record, item.name) for item in fields(record) if item.name in moves}
    moved = {name: moves[name](value) for name, value in values.items() if value is not None}
    return replace(record, **moved)


def registration_from(here: Frame, there: Frame, registration: Registration | None) -> Registration | None:
    """A registration of two structures in other frames, `here` of the source, as one of the declared ones."""
    if registration is None or here is there is DECLARED:
        return registration
    words, origin = named_axes(here), there.turn.T @ there.origin_m
    return replace(
        registration,
        scale=np.abs(words) @ registration.scale,
        rotation=here.turn @ registration.rotation @ words.T,
        turn=words @ registration.turn @ there.turn.T,
        translation=here.to_declared(registration.translation - registration.matrix @ origin),
    )


def named_axes(frame: Frame) -> Floats:
    """Quarter turns (3, 3) from a frame to the axes that words mean: +X front, +Y left, as declared."""
    return np.round(Frame(np.round(frame.heading_rad / (np.pi / 2)) * np.pi / 2).turn)


def _on_grid(points: Floats) -> Floats:
    return np.asarray(np.round(points / _GRID_M) * _GRID_M, float)


def _named(sha256: str, frame: Frame) -> str:
    x, y, _ = frame.origin_m
    return sha256 and f"{sha256}-turned-{frame.heading_rad:.12f}-about-{x:.6f}-{y:.6f}"

"""Structures, flights and plans turned, moved, scaled and mirrored, for the laws of planning."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from upplied.geometry.poses import from_yaw_pitch, moved, yaw_pitch
from upplied.planning.geometry.frechet import frechet
from upplied.records import Demonstration, Floats, Plan, Structure

#: A refused plan has no path that could be compared: laws ask for the path, and that the verdict is the same.
ANY = {"enforce": False}
UNTURNED, NOWHERE = np.eye(3), np.zeros(3)


def about_z(degrees: float) -> Floats:
    return Rotation.from_euler("z", degrees, degrees=True).as_matrix()


def moved_structure(
    structure: Structure, turn: Floats = UNTURNED, shift: Floats = NOWHERE, scale: float = 1.0
) -> Structure:
    """The structure after ``p' = scale * turn @ p + shift``, with its ground and its landmarks."""
    ground = structure.surroundings.ground_z_m
    around = replace(structure.surroundings, ground_z_m=None if ground is None else scale * ground + shift[2])
    marks = {name: tuple(scale * turn @ np.array(at) + shift) for name, at in structure.landmarks.items()}
    vertices = scale * structure.vertices @ turn.T + shift
    return replace(structure, vertices=vertices, landmarks=marks, surroundings=around, sha256="")


def moved_flight(
    flight: Demonstration, turn: Floats = UNTURNED, shift: Floats = NOWHERE, scale: float = 1.0
) -> Demonstration:
    there = moved(replace(flight.trajectory, positions=scale * flight.positions), turn, shift)
    return replace(flight, positions=there.positions, quat_xyzw=there.quat_xyzw, sha256="")


def mirrored_structure(structure: Structure) -> Structure:
    """Left for right about y = 0; the triangles turned round, so that their outside stays outside."""
    flip = np.array([1.0, -1.0, 1.0])
    marks = {name: tuple(flip * np.array(at)) for name, at in structure.landmarks.items()}
    return replace(
        structure,
        vertices=structure.vertices * flip,
        triangles=np.ascontiguousarray(structure.triangles[:, ::-1]),
        landmarks=marks,
        sha256="",
    )


def mirrored_flight(flight: Demonstration) -> Demonstration:
    yaw, pitch = yaw_pitch(flight.quat_xyzw)
    return replace(
        flight,
        positions=flight.positions * [1.0, -1.0, 1.0],
        quat_xyzw=from_yaw_pitch(-yaw, pitch),
        sha256="",
    )


def strays_m(plan: Plan, other: Plan, turn: Floats = UNTURNED, shift: Floats = NOWHERE) -> float:
    """Frechet distance, m, of a plan that was turned and moved from the plan that it should be."""
    assert plan.trajectory is not None and other.trajectory is not None, (plan.reason, other.reason)
    return frechet((plan.trajectory.positions - shift) @ turn, other.trajectory.positions)

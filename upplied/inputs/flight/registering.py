"""A flight laid on its structure by named points: landmarks of the structure, seen in the log's frame.

The turn, shift and, for a reconstruction that knows no unit, the scale of least squares (Umeyama, 1991).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from upplied.errors import InputError
from upplied.inputs.flight.tracks import Track
from upplied.inputs.schemas.geodetic import STRUCTURE
from upplied.inputs.sidecar import LogOptions
from upplied.records import Floats, Structure

_LEAST = 3
_FLAT = 0.02  # second over first spread of the points: nearer to one line they hold no turn


def registered(
    facts: LogOptions, track: Track, structure: Structure | None, what: str
) -> tuple[LogOptions, str]:
    """The facts with the pose of the structure in the log's frame, and the residuals in words.

    Raises
    ------
    InputError
        If there are too few points, a name is no landmark, they lie on a line, or miss theirs by more than
        `register_m`.
    """
    if not facts.points or structure is None:
        return facts, ""
    if track.parent == STRUCTURE:
        rule = "points in a frame of the log's own"
        raise InputError(what, "gives places on the Earth", rule, "correct the structure's placement instead")
    names = [name for name, _ in facts.points]
    unknown = [name for name in names if name not in structure.landmarks]
    if unknown or len(names) < _LEAST:
        found = f"no landmark {', '.join(unknown)}" if unknown else f"{len(names)} points"
        known = ", ".join(sorted(structure.landmarks)) or "it has none"
        rule = f"at least {_LEAST} landmarks of the structure: {known}"
        raise InputError(what, f"registers by {found}", rule)
    logged = np.array([place for _, place in facts.points], float)
    wanted = np.array([structure.landmarks[name] for name in names], float)
    spread = np.linalg.svd(logged - logged.mean(axis=0), compute_uv=False)
    if spread[1] < _FLAT * max(spread[0], 1e-9):
        rule = "points that span a plane"
        raise InputError(what, "registers by points on one line", rule, "add one beside the line")
    free = facts.unit_m is not None and not facts.unit_m > 0
    scale, turn, shift = _similarity(
        logged * (1.0 if free or facts.unit_m is None else facts.unit_m), wanted, free
    )
    unit = scale if free else facts.unit_m
    off_m = np.linalg.norm((unit or 1.0) * logged @ turn.T + shift - wanted, axis=1)
    listed = ", ".join(f"{name} {off:.2f} m" for name, off in zip(names, off_m, strict=True))
    if off_m.max() > facts.passport.register_m:
        rule = f"at most {facts.passport.register_m:g} m"
        found = f"misses its points after registration: {listed}"
        raise InputError(what, found, rule, "correct the points, or raise register_m")
    quat = Rotation.from_matrix(turn.T).as_quat()
    placed = replace(
        facts, unit_m=unit, structure_position_m=tuple((-turn.T @ shift).tolist()),
        structure_quat_xyzw=tuple(quat.tolist()), frame_id=""
    )  # fmt: skip
    return placed, f"registered by {len(names)} points at a scale of {unit or 1.0:.6g}: off by {listed}"


def _similarity(points: Floats, goals: Floats, scaled: bool) -> tuple[float, Floats, Floats]:
    """Scale, turn (3, 3) and shift (3,) that bring points (N, 3) nearest to goals (N, 3)."""
    middle, goal = points.mean(axis=0), goals.mean(axis=0)
    left, size, right = np.linalg.svd((goals - goal).T @ (points - middle))
    sign = np.array([1.0, 1.0, np.sign(np.linalg.det(left) * np.linalg.det(right))])
    turn = left @ np.diag(sign) @ right
    scale = float((size * sign).sum() / ((points - middle) ** 2).sum()) if scaled else 1.0
    return scale, turn, goal - scale * turn @ middle

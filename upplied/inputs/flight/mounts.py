"""From poses of a body in the log's frame to poses of the camera in the structure's frame."""

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from upplied.errors import InputError
from upplied.inputs.flight.tracks import OPTICAL_R_CAMERA, Track
from upplied.inputs.schemas.geodetic import STRUCTURE, structure_R_enu
from upplied.inputs.schemas.px4 import Gimbal, turned
from upplied.inputs.schemas.tf import Tree
from upplied.inputs.sidecar import LogOptions
from upplied.records import Floats, Structure

_NOWHERE = np.zeros(3)
NO_MOUNT = "no camera mount in the log: the camera is taken to look along the body's x axis"


def camera_poses(track: Track, facts: LogOptions, tree: Tree, camera: str, gimbal: Gimbal | None) -> Track:
    """Poses of the camera (x forward, y left, z up) from those of what `facts.body_frame` says is tracked.

    On a body the camera is placed by the first of these: the attitude of a gimbal, a mount in the facts, the
    transforms from the body to its optical frame, and at last the body itself, looking ahead.
    """
    seen = "optical" in track.child or (track.child and track.child == camera)
    is_mounted = facts.body_T_camera_position_m is not None or facts.body_T_camera_quat_xyzw is not None
    frame = facts.body_frame or ("optical" if seen and not is_mounted else "body")
    if frame == "camera":
        return track
    if frame == "optical":
        return mounted(track, _NOWHERE, OPTICAL_R_CAMERA)
    offset = np.array(facts.body_T_camera_position_m or _NOWHERE)
    turn = Rotation.from_quat(facts.body_T_camera_quat_xyzw or (0.0, 0.0, 0.0, 1.0))
    if gimbal is not None:
        return _on_gimbal(track, gimbal, offset, turn, facts)
    if is_mounted:
        return mounted(track, offset, turn)
    camera_frame = camera or tree.camera()
    body = ""  # the tracked frame if it carries the camera, else the top of its rigid parts
    if camera_frame:
        carries = track.child and tree.path(camera_frame, track.child)
        above = [track.child] if carries else tree.rigid(camera_frame)[::-1]
        body = next((frame for frame in above if frame not in (track.parent, camera_frame)), "")
    if body:
        return _on_tree(track, tree, body, camera_frame, facts)
    return track.noted(NO_MOUNT)


def in_frame(track: Track, facts: LogOptions, tree: Tree, what: str) -> Track:
    """Poses in the frame in which the structure is placed; InputError if no transforms lead there."""
    if not (frame := facts.frame_id.lstrip("/")) or track.parent in ("", frame, STRUCTURE):
        return track
    if not tree.path(track.parent, frame):
        if "frame-unconnected" in facts.allow:
            return track.noted(f"no transform from {track.parent} to {frame}: allowed")
        finding = f"gives poses in the frame {track.parent!r}, the structure is placed in {frame!r}"
        rule = "frame-unconnected: one frame, or transforms between them"
        raise InputError(what, finding, rule, "place the structure in the frame of the poses")
    positions, turn, known = tree.at(track.parent, frame, track.t_ns, facts.gap_s)
    moved = replace(track.turned(turn, positions + turn.apply(track.positions)), parent=frame)
    return moved.during(known, f"transform to {frame}")


def in_structure_frame(track: Track, facts: LogOptions) -> Track:
    """Poses in the frame of the structure, from its pose in the log's frame."""
    placed = facts.structure_position_m is not None or facts.structure_quat_xyzw is not None
    if track.parent == STRUCTURE or not placed:
        return track
    position = np.array(facts.structure_position_m or _NOWHERE)
    turn = Rotation.from_quat(facts.structure_quat_xyzw or (0.0, 0.0, 0.0, 1.0)).inv()
    return track.turned(turn, turn.apply(track.positions - position))


def mounted(track: Track, position: Floats, rotation: Rotation) -> Track:
    """Poses of something at `position` (m) and `rotation` on the tracked body; (3,) or (N, 3)."""
    positions = track.positions + (body := Rotation.from_quat(track.quat_xyzw)).apply(position)
    return replace(track, positions=positions, quat_xyzw=(body * rotation).as_quat())


def _on_gimbal(track: Track, gimbal: Gimbal, offset: Floats, turn: Rotation, facts: LogOptions) -> Track:
    quats = gimbal.orientations(track, facts.gap_s)
    if gimbal.from_north and track.parent == STRUCTURE:  # positions on the Earth were turned already
        quats = turned(structure_R_enu(facts), quats, Rotation.identity())
    known = np.isfinite(quats[:, 0])
    positions = mounted(track, offset, turn).positions
    quats[~known] = (0.0, 0.0, 0.0, 1.0)
    track = replace(track, positions=positions, quat_xyzw=(Rotation.from_quat(quats) * turn).as_quat())
    return track.during(known, "gimbal attitude").noted(f"camera on the gimbal of {gimbal.topic}")


def _on_tree(track: Track, tree: Tree, body: str, camera_frame: str, facts: LogOptions) -> Track:
    note = f"camera mounted as the transforms {body} -> {camera_frame} say"
    if track.child not in ("", body):
        note += f", {body} taken for {track.child}"
    sensor = Rotation.identity() if camera_frame.endswith("_link") else OPTICAL_R_CAMERA  # REP-103
    positions, turn, known = tree.at(camera_frame, body, track.t_ns, facts.gap_s)
    moving = mounted(track, positions, turn * sensor)
    return moving.during(known, "transform to the camera").noted(note)


_LEAST = 3
_FLAT = 0.02  # second over first spread of the points: nearer to one line they hold no turn


def registered(
    facts: LogOptions, track: Track, structure: Structure | None, what: str
) -> tuple[LogOptions, str]:
    """The facts with the structure's pose in the log's frame (least squares, Umeyama 1991), and residuals.

    Raises InputError if the points are few, no landmarks or on a line, or miss theirs by over `register_m`.
    """
    if not facts.points or structure is None:
        return facts, ""
    if track.parent == STRUCTURE:
        rule = "points in a frame of the log's own"
        raise InputError(what, "gives places on the Earth", rule, "correct the structure's placement instead")
    names = [name for name, _ in facts.points]
    unknown = [name for name in names if name not in structure.landmarks]
    if unknown or len(names) < _LEAST:
        finding = f"no landmark {', '.join(unknown)}" if unknown else f"{len(names)} points"
        known = ", ".join(sorted(structure.landmarks)) or "it has none"
        rule = f"at least {_LEAST} landmarks of the structure: {known}"
        raise InputError(what, f"registers by {finding}", rule)
    logged = np.array([place for _, place in facts.points], float)
    places = np.array([structure.landmarks[name] for name in names], float)
    spread = np.linalg.svd(logged - logged.mean(axis=0), compute_uv=False)
    if spread[1] < _FLAT * max(spread[0], 1e-9):
        rule = "points that span a plane"
        raise InputError(what, "registers by points on one line", rule, "add one beside the line")
    free = facts.unit_m is not None and not facts.unit_m > 0
    unit_m = 1.0 if free or facts.unit_m is None else facts.unit_m
    middle, goal = unit_m * logged.mean(axis=0), places.mean(axis=0)
    around = unit_m * logged - middle
    turn = Rotation.align_vectors(places - goal, around)[0].as_matrix()
    scale = float(((places - goal) * (around @ turn.T)).sum() / (around**2).sum()) if free else 1.0
    shift = goal - scale * turn @ middle
    unit = scale if free else facts.unit_m
    off_m = np.linalg.norm((unit or 1.0) * logged @ turn.T + shift - places, axis=1)
    listed = ", ".join(f"{name} {off:.2f} m" for name, off in zip(names, off_m, strict=True))
    if off_m.max() > facts.passport.register_m:
        rule = f"at most {facts.passport.register_m:g} m"
        finding = f"misses its points after registration: {listed}"
        raise InputError(what, finding, rule, "correct the points, or raise register_m")
    place, quat = (-turn.T @ shift).tolist(), Rotation.from_matrix(turn.T).as_quat().tolist()
    placed = replace(facts, unit_m=unit, structure_position_m=tuple(place), structure_quat_xyzw=tuple(quat))
    placed = replace(placed, frame_id="")
    return placed, f"registered by {len(names)} points at a scale of {unit or 1.0:.6g}: off by {listed}"

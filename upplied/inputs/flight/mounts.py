"""From poses of a body in the log's frame to poses of the camera in the structure's frame."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from upplied.inputs.flight.tracks import Track
from upplied.inputs.schemas.tf import Tree
from upplied.inputs.sidecar import LogOptions

# Optical frames (ROS, REP-103) are z forward, x right, y down; ours is x forward, y left, z up.
OPTICAL_R_CAMERA = Rotation.from_matrix([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])


def camera_poses(track: Track, facts: LogOptions, tree: Tree, camera_frame: str) -> Track:
    """Poses of the camera (x forward, y left, z up) from poses of whatever the log tracks.

    What the poses are of is told by `facts.body_frame`; where nothing is told: a mount from the
    facts, else the static transforms from the tracked frame to the camera's optical frame, else
    the name of the tracked frame, and at last the body itself with the camera looking ahead.
    """
    tracked, frame = track.child, facts.body_frame
    given = facts.body_T_camera_position_m is not None or facts.body_T_camera_quat_xyzw is not None
    if not frame and not given and camera_frame and tracked == camera_frame:
        frame = "optical"
    if frame == "camera":
        return track
    if frame == "optical":
        return moved(track, np.zeros(3), OPTICAL_R_CAMERA)
    if given:
        position = np.array(facts.body_T_camera_position_m or (0.0, 0.0, 0.0))
        return moved(
            track, position, Rotation.from_quat(facts.body_T_camera_quat_xyzw or (0.0, 0.0, 0.0, 1.0))
        )
    for body in (tracked, "base_link", "imu") if camera_frame else ():
        mount = tree.fixed(camera_frame, body) if body else None
        if mount is not None:
            note = f"camera mounted as the static transform {body} -> {camera_frame} says"
            return _noted(moved(track, mount[0], mount[1] * OPTICAL_R_CAMERA), note)
        if tracked:
            break
    if not frame and "optical" in tracked:
        return moved(track, np.zeros(3), OPTICAL_R_CAMERA)
    return _noted(track, "no camera mount in the log: the camera is taken to look along the body's x axis")


def in_structure_frame(track: Track, facts: LogOptions) -> Track:
    """Poses in the frame of the structure, from its pose in the log's frame."""
    position = np.array(facts.structure_position_m or (0.0, 0.0, 0.0))
    turn = Rotation.from_quat(facts.structure_quat_xyzw or (0.0, 0.0, 0.0, 1.0)).inv()
    return replace(
        track,
        positions=turn.apply(track.positions - position),
        quat_xyzw=(turn * Rotation.from_quat(track.quat_xyzw)).as_quat(),
    )


def moved(track: Track, position: np.ndarray, rotation: Rotation) -> Track:
    """Poses of something mounted on the tracked body at `position` (m) and `rotation`."""
    body = Rotation.from_quat(track.quat_xyzw)
    return replace(
        track, positions=track.positions + body.apply(position), quat_xyzw=(body * rotation).as_quat()
    )


def _noted(track: Track, note: str) -> Track:
    return replace(track, notes=(*track.notes, note))

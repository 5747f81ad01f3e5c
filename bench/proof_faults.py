"""What is injected into flights and their logs for bench/proof.py."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from upplied.geometry.poses import from_yaw_pitch, yaw_pitch
from upplied.records import Floats, Trajectory

PHOTO_EVERY_S = 1.0


@dataclass(frozen=True)
class Case:
    """What was flown, and what the log says of it; the clocks of both begin with the plan."""

    truth: Trajectory
    photo_s: Floats
    log: Trajectory
    log_photo_s: Floats
    clock_s: float = 0.0  # the log's time at which the plan begins


def plain(truth: Trajectory) -> Case:
    """A flight without any fault."""
    photos = np.arange(truth.t_s[0], truth.t_s[-1], PHOTO_EVERY_S)
    return Case(truth, photos, truth, photos)


def part(path: Trajectory, first_s: float, last_s: float) -> Trajectory:
    """A stretch of a path, with its times."""
    inside = (path.t_s >= first_s) & (path.t_s <= last_s)
    return Trajectory(path.t_s[inside], path.positions[inside], path.quat_xyzw[inside])


def aborted(truth: Trajectory) -> Case:
    """Broken off at 60 % of its time."""
    return plain(part(truth, 0.0, 0.6 * truth.t_s[-1]))


def photos_lost(truth: Trajectory) -> Case:
    """Every tenth photo lost."""
    case = plain(truth)
    photographed = np.arange(len(case.photo_s)) % 10 != 9
    return replace(case, photo_s=case.photo_s[photographed], log_photo_s=case.log_photo_s[photographed])


def gimbal_stuck(truth: Trajectory) -> Case:
    """The camera stands for 20 s, which the log tells."""
    start = 0.4 * truth.t_s[-1]
    stuck = (truth.t_s >= start) & (truth.t_s < start + 20.0)
    quats = truth.quat_xyzw.copy()
    quats[stuck] = quats[stuck.argmax()]
    return plain(Trajectory(truth.t_s, truth.positions, quats))


def gnss_jump(truth: Trajectory) -> Case:
    """The logged position is 1 m off after half of the flight."""
    off = np.where(truth.t_s > truth.t_s[-1] / 2, 1.0, 0.0)[:, None] * np.array([0.6, -0.8, 0.0])
    case = plain(truth)
    return replace(case, log=Trajectory(truth.t_s, truth.positions + off, truth.quat_xyzw))


def heading_off(truth: Trajectory) -> Case:
    """The logged heading of the camera is 2 degrees off."""
    yaw, pitch = yaw_pitch(truth.quat_xyzw)
    case = plain(truth)
    return replace(
        case, log=Trajectory(truth.t_s, truth.positions, from_yaw_pitch(yaw + np.radians(2), pitch))
    )


def frame_off(truth: Trajectory) -> Case:
    """The log's frame is moved by half a metre and turned by 1 degree about its middle."""
    cos, sin, middle = np.cos(np.radians(1)), np.sin(np.radians(1)), truth.positions.mean(axis=0)
    turn = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    positions = (truth.positions - middle) @ turn.T + middle + np.array([0.4, 0.3, 0.0])
    yaw, pitch = yaw_pitch(truth.quat_xyzw)
    case = plain(truth)
    return replace(case, log=Trajectory(truth.t_s, positions, from_yaw_pitch(yaw + np.radians(1), pitch)))


def log_cut(truth: Trajectory) -> Case:
    """The log lacks the last fifth: what was seen then nobody can know, so it is no gap of the truth's."""
    end = 0.8 * truth.t_s[-1]
    case = plain(part(truth, 0.0, end))
    return replace(case, log_photo_s=case.log_photo_s[case.log_photo_s <= end])


def clock_shifted(truth: Trajectory) -> Case:
    """The log's clock is 3 s late."""
    case = plain(truth)
    log = Trajectory(truth.t_s + 3.0, truth.positions, truth.quat_xyzw)
    return replace(case, log=log, log_photo_s=case.log_photo_s + 3.0, clock_s=3.0)


FAULTS = {
    "none": plain,
    "aborted at 60 %": aborted,
    "every tenth photo lost": photos_lost,
    "gimbal stuck for 20 s": gimbal_stuck,
    "position off by 1 m after half": gnss_jump,
    "heading off by 2 deg": heading_off,
    "frame off by 0.5 m and 1 deg": frame_off,
    "log cut at 80 %": log_cut,
    "clock shifted by 3 s": clock_shifted,
}


#: Those of a list that the program is held to; the others are told beside them.
PROMISED = (
    "aborted at 60 %", "every tenth photo lost", "gimbal stuck for 20 s", "position off by 1 m after half",
    "heading off by 2 deg", "log cut at 80 %", "clock shifted by 3 s",
)  # fmt: skip

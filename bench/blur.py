"""Blur by motion: pictures integrated over their exposure against the closed form, on planned flights.

    python bench/blur.py [--only WORD] [--real]

A dot is put on each of some hundred patches that a plan shows, where its finest sharp look has it. A small
renderer of its own moves the camera through the exposure in 41 steps, by the plan's own poses before and
after (no velocity and no turning rate of ours), and adds up the dot's light in pixels. The length of the
streak that it leaves is compared with the closed form of `planning.visibility.looks`.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation, Slerp
from transfers import Transfer, transfers

from upplied.config import focal_px, settings_for
from upplied.geometry.scene import scene_of
from upplied.planning.plan import plan_transfer
from upplied.planning.visibility.looks import sharp_looks
from upplied.planning.visibility.observations import TRULY, moments, views
from upplied.records import SURFACE_STATES, Camera, Cloud, Floats, Plan, Trajectory

_STEPS, _DOTS, _SIZE = 41, 300, 256


def streak_px(path: Trajectory, time_s: float, point: Floats, camera: Camera, exposure_s: float) -> float:
    """Length of the streak of a dot, px, by what light falls on each pixel of a small picture round it."""
    focal = focal_px(camera.width_px or 4000, camera.hfov_deg)
    times = np.clip(time_s + np.linspace(-0.5, 0.5, _STEPS) * exposure_s, path.t_s[0], path.t_s[-1])
    turns = Slerp(path.t_s, Rotation.from_quat(path.quat_xyzw))(times)
    at = np.column_stack([np.interp(times, path.t_s, axis) for axis in path.positions.T])
    local = turns.inv().apply(point - at)
    pixel = focal * local[:, 1:] / local[:, :1]
    light = np.zeros((_SIZE, _SIZE))
    fine = 64  # of a pixel: so that a cell adds less than a hundredth of one to the spread
    cells = np.floor((pixel - pixel.mean(axis=0)) * fine).astype(int) + _SIZE // 2
    inside = ((cells >= 0) & (cells < _SIZE)).all(axis=1)
    if not inside.all():
        return float(np.linalg.norm(pixel[-1] - pixel[0]))
    np.add.at(light, (cells[:, 0], cells[:, 1]), 1.0 / _STEPS)
    rows, columns = np.nonzero(light)
    spread = np.sqrt(
        np.maximum(np.cov(np.column_stack([rows, columns]).T, aweights=light[rows, columns], ddof=0), 0)
    )
    return float(np.hypot(spread[0, 0], spread[1, 1]) * np.sqrt(12) / fine)  # of an even streak


@dataclass(frozen=True)
class Blur:
    """Of some patches that a plan shows, the motion during the exposure in their finest sharp look, px."""

    drawn: Floats  # by the renderer
    closed: Floats


def blur_of(plan: Plan, transfer: Transfer) -> Blur:
    """The blur of a plan's patches, drawn and in closed form."""
    assert plan.trajectory is not None and plan.surface is not None and plan.surface.normals is not None
    rule = settings_for("recommended").inspection
    camera, path = transfer.demonstration.camera, plan.trajectory
    shown = np.flatnonzero(plan.surface.state == SURFACE_STATES.index("shown"))
    shown = shown[np.linspace(0, len(shown) - 1, min(_DOTS, len(shown))).astype(int)]
    cloud = Cloud(plan.surface.points[shown], plan.surface.normals[shown])
    seen, steps = views(path, cloud, camera, TRULY, scene_of(transfer.target)), moments(path)
    exposure = camera.exposure_s or rule.exposure_s
    limit = rule.sharp_radps(camera.hfov_deg, camera.width_px, camera.exposure_s)
    looks = sharp_looks(steps, seen, cloud, camera, limit, np.cos(np.radians(rule.max_incidence_deg)))
    known = np.flatnonzero(looks.pose >= 0)
    times = steps.poses.t_s[looks.pose[known]]
    drawn = [streak_px(path, t, p, camera, exposure) for t, p in zip(times, cloud.points[known], strict=True)]
    closed = looks.moved[known] * focal_px(camera.width_px or 4000, camera.hfov_deg) * exposure
    return Blur(np.array(drawn), closed)


def main() -> None:
    """Print a row a transfer: dots below a pixel by the renderer, and how far the closed form is off."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--only", default="turbine")
    parser.add_argument("--real", action="store_true")
    options = parser.parse_args()
    print(f"{'transfer':36}{'dots':>6}{'< 1 px, %':>11}{'p99 px':>8}{'closed p99':>12}{'off, p95 px':>13}")
    for row in transfers(options.real, options.only):
        plan = plan_transfer(row.demonstration, row.source, row.target, settings_for("recommended"))
        if plan.trajectory is None:
            print(f"{row.published.title:36}{plan.reason[:70]}")
            continue
        blur = blur_of(plan, row)
        cells = f"{100 * np.mean(blur.drawn < 1):11.2f}{np.percentile(blur.drawn, 99):8.3f}"
        cells += f"{np.percentile(blur.closed, 99):12.3f}"
        cells += f"{np.percentile(np.abs(blur.drawn - blur.closed), 95):13.3f}"
        print(f"{row.published.title:36}{len(blur.drawn):6d}{cells}", flush=True)


if __name__ == "__main__":
    main()

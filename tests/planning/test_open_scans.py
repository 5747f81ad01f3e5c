"""A plan for a scan that lacks a stretch: said, counted as not shown, and kept clear of as the whole body."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from made_scans import body, cut

from upplied.config import settings_for
from upplied.geometry.poses import from_yaw_pitch
from upplied.geometry.scene import scene_of
from upplied.planning.airspace.rules import path_clearance
from upplied.planning.plan import plan_transfer
from upplied.records import Demonstration, Structure

SIZE = np.array([1.4, 1.1, 1.2])  # of the target, in sources


def larger(structure: Structure) -> Structure:
    return replace(structure, structure_id="larger", vertices=structure.vertices * SIZE)


def ring(near: float) -> Demonstration:
    """Once round the body, 6 m before its walls and 2.5 m before a place along them, looking at them."""
    turn = np.linspace(0, 2 * np.pi, 240)
    out = np.column_stack([np.cos(turn), np.sin(turn)])
    walls = np.clip(out * 30, [-7, -2], [7, 2])
    off = 6 - 3.5 * np.exp(-((walls[:, :1] - near) ** 2) / 2)
    at = np.column_stack([walls + off * out, np.full(240, 2.0)])
    yaw = np.arctan2(-out[:, 1], -out[:, 0])
    quats = from_yaw_pitch(yaw, np.zeros(240))
    return Demonstration("ring", "body", (np.arange(240) * 5e8).astype(np.int64), at, quats)


@pytest.mark.ci
@pytest.mark.parametrize("first", [-1.0, pytest.param(1.0, marks=pytest.mark.slow)])
def test_what_was_never_scanned_is_said_not_shown_and_kept_clear_of(first: float) -> None:
    whole, scan = larger(body()), larger(cut(body(), first, first + 4))
    settings = settings_for("recommended", verdict={"enforce": False})
    plan, full = (plan_transfer(ring(first + 2), body(), target, settings) for target in (scan, whole))
    assert plan.trajectory is not None and full.trajectory is not None
    assert full.measures.never_scanned_m2 == 0 and full.counterparts[0].never_scanned_pct == 0
    assert not any("never scanned" in warning for warning in full.warnings)
    lacks = _area(whole) - _area(scan)
    assert plan.measures.never_scanned_m2 == pytest.approx(lacks, rel=0.3)
    one = plan.counterparts[0]
    assert 10 < one.never_scanned_pct < 60
    assert any(one.part in warning and "was never scanned" in warning for warning in plan.warnings)
    assert plan.measures.coverage_inspected_pct < full.measures.coverage_inspected_pct - 8
    # On the whole body, of which the plan was told a part, it keeps what it promises.
    clearance_m = path_clearance(scene_of(whole), plan.trajectory.positions).distance_m
    assert clearance_m >= plan.measures.min_clearance_m - 0.02 and clearance_m > 1.9


def _area(structure: Structure) -> float:
    corners = structure.vertices[structure.triangles]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return float(np.linalg.norm(cross, axis=1).sum() / 2)

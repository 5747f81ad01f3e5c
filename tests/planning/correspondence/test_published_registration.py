"""The registration as published, step by step, and what is said of registrations that are refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from made_clouds import box, boxes
from moved_scenes import about_z

from upplied.config import settings_for
from upplied.planning.correspondence.misfit import misfit_of
from upplied.planning.correspondence.registration import box_on_box, fitted, published, register
from upplied.planning.geometry.clouds import icp, in_source_frame
from upplied.records import Cloud

PAPER = settings_for("paper").registration
JUDGED = settings_for("recommended").registration


def cloud(seed: int, number: int = 300) -> Cloud:
    """A cuboid of voxels, in another place."""
    return Cloud(box([1, 2, 3], [9, 5, 3], number, np.random.default_rng(seed))[0], leaf_m=0.8)


@pytest.mark.parametrize("degrees", [0.0, 90.0])
def test_boxes_are_matched_and_icp_turns_the_target(degrees: float) -> None:
    source, turn = cloud(0), about_z(degrees)
    target = Cloud((cloud(1).points * [2, 1, 3] + [5, 5, 5]) @ turn)
    registration = published(source, target, PAPER, turn)
    straight = target.points @ turn.T
    scale = np.ptp(source.points, axis=0) / np.ptp(straight, axis=0)
    boxed = scale * (straight - straight.min(axis=0)) + source.points.min(axis=0)
    rotation, translation = icp(source.points, boxed, PAPER.iterations)
    aligned = (boxed - translation) @ rotation
    assert registration.to_demo(target.points) == pytest.approx(aligned)
    assert registration.scale == pytest.approx(scale)
    nearest = np.linalg.norm(source.points[:, None] - aligned, axis=2).min(axis=1)
    assert registration.score_m2 == pytest.approx(np.mean(nearest**2))
    assert np.array_equal(registration.turn, turn)


def test_the_gate_is_gamma_times_the_squared_spacing() -> None:
    source, target = cloud(0), cloud(1)
    score = published(source, target, PAPER).score_m2
    leaf = np.sqrt(score / PAPER.gamma)
    fine, coarse = (replace(source, leaf_m=float(leaf * share)) for share in (0.999, 1.001))
    refused = published(fine, target, PAPER)
    assert not refused.accepted and published(coarse, target, PAPER).accepted
    gate = PAPER.gamma * fine.leaf_m**2
    assert f"distance {score:.3g} m^2, gate {gate:.3g} m^2 (gamma {PAPER.gamma:g} times" in refused.reason
    assert published(coarse, target, PAPER).reason == ""
    at_the_gate = replace(PAPER, gamma=score)
    assert not published(replace(source, leaf_m=1.0), target, at_the_gate).accepted


def test_boxes_on_boxes_make_boxes_equal() -> None:
    source, target, turn = cloud(0), Cloud(cloud(1).points @ about_z(30.0) * [1, 4, 2]), about_z(-30.0)
    laid = box_on_box(source, target, turn).to_demo(target.points)
    for of in (np.min, np.max):
        assert of(laid, axis=0) == pytest.approx(of(source.points, axis=0))
    plain = box_on_box(source, target)
    assert np.array_equal(plain.turn, np.eye(3)) and np.isnan(plain.score_m2) and not plain.accepted


SHIP = boxes(([0, -4, 0], [60, 8, 6]), ([40, -3, 6], [12, 6, 10]))
LIKE = boxes(([0, -4, 0], [60, 8, 6]), ([40, -3, 6], [12, 6, 10]), seed=1)
OTHER = boxes(([0, -4, 0], [60, 8, 6]), ([2, -3, 6], [12, 6, 10]), seed=1)


def test_what_is_alike_is_accepted_and_what_is_not_is_told() -> None:
    same = register(SHIP, LIKE, JUDGED)
    assert same.accepted and same.reason == "" and same.acceptance < 0.4
    assert same.evidence.startswith("orientation as declared; ") and np.isnan(same.runner_up_gap)
    nearest = np.linalg.norm(SHIP.points[:, None] - in_source_frame(LIKE, same).points, axis=2).min(axis=1)
    assert same.score_m2 == pytest.approx(np.mean(nearest**2))
    strange = boxes(([0, -30, 0], [60, 60, 1]), ([40, -3, 0], [2, 6, 40]), seed=2)
    refused = register(SHIP, strange, JUDGED)
    assert not refused.accepted and refused.acceptance > 1
    assert refused.reason.startswith(
        f"the structures do not correspond: misfit {refused.acceptance:.2f}, gate 1 ("
    )
    registration = fitted(SHIP, LIKE, 1.0)
    assert registration.acceptance == pytest.approx(same.acceptance) and np.isnan(registration.score_m2)
    assert not fitted(SHIP, LIKE, same.acceptance).accepted


def test_a_heading_that_would_fit_better_is_mentioned() -> None:
    turned = Cloud(LIKE.points @ about_z(180.0), LIKE.normals @ about_z(180.0), LIKE.area_m2, LIKE.part)  # type: ignore[operator]
    registration = register(SHIP, turned, JUDGED)
    assert (
        "; turned by " in registration.evidence and "check its declared forward axis" in registration.evidence
    )
    assert "180 deg about the vertical" in registration.evidence or "-180 deg" in registration.evidence
    assert "check its declared" not in register(SHIP, LIKE, JUDGED).evidence
    searched = register(SHIP, turned, replace(JUDGED, search="heading"))
    assert searched.accepted and searched.runner_up_gap > 0.15
    assert searched.evidence.startswith("36 orientations tried; turned by 180 deg")
    assert searched.acceptance < registration.acceptance


def test_misfit_is_overlap_gap_and_stretch() -> None:
    scale = np.array([1.0, 1.3, 1.0])
    wide = Cloud(LIKE.points / scale, LIKE.normals, LIKE.area_m2, LIKE.part)
    misfit = misfit_of(SHIP, wide, box_on_box(SHIP, wide))
    assert misfit.stretch == pytest.approx(np.log(1.3), abs=0.01)
    assert misfit.value == pytest.approx((1 - misfit.overlap) / 0.45 + misfit.gap / 0.09 + misfit.stretch / 6)
    same = misfit_of(SHIP, LIKE, box_on_box(SHIP, LIKE))
    assert same.overlap > 0.99 and same.gap < 0.004 and same.where == ""
    far = misfit_of(SHIP, OTHER, box_on_box(SHIP, OTHER))
    assert 0.01 < far.gap < 0.2 and far.overlap < same.overlap
    assert "high section of the" in far.where and "has no counterpart: up to " in far.where
    away = float(far.where.split("up to ")[1].split(" m away")[0])
    assert away < 60
    half_turn = np.diag([-1.0, -1.0, 1.0])
    words = misfit_of(SHIP, OTHER, box_on_box(SHIP, OTHER), half_turn).where
    assert ("front" in words) == ("rear" in far.where)


def test_the_gap_is_the_mean_beyond_the_spacing() -> None:
    """Two plates apart: each sample is as far from the other one as they are, less the spacing."""
    grid = np.array([[x, y, 0.0] for x in range(21) for y in range(21)], float)
    top = np.tile([0.0, 0, 1], (441, 1))
    corner, up = np.array([[0.0, 0, 10]]), np.array([[0.0, 0, 1]])
    area = np.ones(442)
    low = Cloud(np.vstack([grid, corner]), np.vstack([top, up]), area, np.zeros(442, int))
    high = Cloud(
        np.vstack([grid + np.array([0, 0, 4]), [[0, 0, 0.0]]]), np.vstack([top, up]), area, np.zeros(442, int)
    )
    fit = box_on_box(low, low)
    misfit = misfit_of(low, high, fit)
    diagonal = np.sqrt(400 + 400 + 100)
    assert misfit.gap == pytest.approx(3 / diagonal, rel=0.02)

"""Resolution in millimetres a pixel: of the demonstration itself, and from farther off."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from remembered import study_pair

from upplied.config import focal_px, settings_for
from upplied.planning.carry.inspected_surface import inspected_by
from upplied.planning.demonstration.repetition import Take, takes_of
from upplied.planning.measures.fidelity import Compared, resolution
from upplied.planning.visibility.observations import TRULY, views
from upplied.records import Trajectory
from upplied.samples.pilot import fly
from upplied.samples.surfaces import box

SETTINGS = settings_for("recommended", clouds={"surface_samples": 400})


@pytest.fixture(scope="module")
def own() -> Take:
    """A flight along three sides of a cube, to the cube itself."""
    cube = box((12.0, 12.0, 12.0), "cube").structure
    flight = fly(cube, "sides", seed=3)
    return takes_of(flight, study_pair(cube, cube, SETTINGS), SETTINGS)[0]


def measured(take: Take, path: Trajectory) -> dict[str, float]:
    camera = take.inspection.camera
    planned = views(path, take.pair.surface.target, camera, TRULY, take.pair.target_scene)
    return resolution(Compared.of(path, planned, inspected_by(take, SETTINGS), [take], SETTINGS))


def farther(path: Trajectory, times: float) -> Trajectory:
    """The same directions, every pose so many times as far from the middle."""
    middle = np.array([0.0, 0, 6.0])
    return replace(path, positions=(path.positions - middle) * times + middle)


def test_the_demonstration_itself_is_as_fine_as_it_was(own: Take) -> None:
    measures = measured(own, own.inspection.logged)
    assert measures["gsd_within_pct"] > 99.5
    for percent in (50, 95):
        was = measures[f"gsd_demonstrated_mm_p{percent}"]
        assert measures[f"gsd_mm_p{percent}"] == pytest.approx(was, rel=0.01)
    camera = own.inspection.camera
    away = np.median(own.pair.source_scene.distance(own.inspection.logged.positions))
    nearest = 1e3 * away / focal_px(camera.width_px, camera.hfov_deg)
    assert nearest * 0.9 < measures["gsd_mm_p50"] < nearest * 1.4  # never finer than straight on


def test_from_farther_off_it_is_coarser_and_not_within(own: Take) -> None:
    near, far = (measured(own, farther(own.inspection.logged, times)) for times in (1.0, 1.5))
    assert far["gsd_demonstrated_mm_p50"] == near["gsd_demonstrated_mm_p50"]
    assert far["gsd_mm_p50"] > 1.2 * near["gsd_mm_p50"]
    assert far["gsd_within_pct"] < 5


def test_what_no_safe_camera_shows_as_finely_does_not_count(own: Take) -> None:
    """A fence keeps every camera away from one side: only the others are asked about."""
    path = farther(own.inspection.logged, 1.5)
    fence = np.array([[-40.0, -40.0], [9.0, -40.0], [9.0, 40.0], [-40.0, 40.0]])
    target = own.pair.target
    fenced = replace(target, surroundings=replace(target.surroundings, geofence_m=fence))
    fenced_take = replace(own, pair=replace(own.pair, target=fenced))
    free, beside = measured(own, path), measured(fenced_take, path)
    assert free["gsd_within_pct"] < 5
    assert beside["gsd_within_pct"] >= free["gsd_within_pct"]
    nowhere = replace(target, surroundings=replace(target.surroundings, ceiling_z_m=-50.0))
    none = measured(replace(own, pair=replace(own.pair, target=nowhere)), path)
    assert none["gsd_within_pct"] == 100  # of what is as fine all the same


def test_blur_goes_with_speed_and_exposure(own: Take) -> None:
    path = own.inspection.logged
    slow = measured(own, path)
    fast = measured(own, replace(path, t_s=path.t_s / 2))
    assert fast["blur_px_p50"] == pytest.approx(2 * slow["blur_px_p50"], rel=0.1)
    camera = replace(own.inspection.camera, exposure_s=1 / 50)
    longer = replace(own, inspection=replace(own.inspection, camera=camera))
    assert measured(longer, path)["blur_px_p50"] == pytest.approx(10 * slow["blur_px_p50"], rel=0.05)
    assert 0 < slow["blur_px_p99"] < 1 and "defocus_px_p95" not in slow
    sharp = replace(own.inspection.camera, focal_mm=9.0, f_number=2.8)
    assert (
        measured(replace(own, inspection=replace(own.inspection, camera=sharp)), path)["defocus_px_p95"] > 0
    )

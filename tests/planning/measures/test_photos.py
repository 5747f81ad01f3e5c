"""A demonstration of photos becomes a plan of photos, timed for its camera; what each of them shows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from made_missions import PLACE

from upplied.catalog import Catalog
from upplied.catalog.verbs.verification import verify
from upplied.config import settings_for
from upplied.geometry.polylines import accelerations
from upplied.geometry.poses import interpolate
from upplied.geometry.scene import scene_of
from upplied.outputs.missions import MissionOptions, missions_of
from upplied.overlap import Frames
from upplied.photographed import photographed
from upplied.planning.plan import plan_transfer
from upplied.records import Camera, Cloud, Plan, Structure
from upplied.samples.pilot import fly
from upplied.samples.surfaces import box

SETTINGS = settings_for("recommended", clouds={"surface_samples": 600})
CAMERA = Camera(75.0, 60.0, 2.0, 50.0, 4000, 3200, trigger_s=4.0, exposure_s=1 / 800)


@pytest.fixture(scope="module")
def plans() -> tuple[Plan, Plan, Structure]:
    """The same flight round a cube as photos and as a film, planned for a cuboid."""
    source, target = box((12.0, 12.0, 12.0), "cube").structure, box((16.0, 12.0, 9.0), "cuboid").structure
    film = replace(fly(source, "sides", seed=3), camera=CAMERA)
    return *(
        plan_transfer(replace(film, stills=stills), source, target, SETTINGS) for stills in (True, False)
    ), target


@pytest.mark.ci
def test_a_flight_of_photos_becomes_one_and_a_film_stays_a_film(plans) -> None:
    photos, film, target = plans
    assert photos.status == film.status == "ok" and film.photos is None
    path, flags, taken = photos.trajectory, photos.is_viewpoint, photos.photos
    assert 5 < len(taken) == flags.sum() < film.is_viewpoint.sum()
    assert np.array_equal(taken.positions, path.positions[flags]) and np.array_equal(
        taken.t_s, path.t_s[flags]
    )
    assert np.diff(taken.t_s).min() >= 4.0
    assert photos.measures.coverage_inspected_pct > film.measures.coverage_inspected_pct - 1
    frames = Frames(path.take(flags), CAMERA, scene_of(target))
    known = [100 * frames.overlap(at - 1, at) for at in range(1, len(taken))]
    assert np.isnan(taken.overlap_pct[0]) and taken.overlap_pct[1:] == pytest.approx(known, abs=1.5)
    shows = taken.patches > 0
    assert shows.mean() > 0.8 and (taken.blur_px[shows] < 1).all()
    assert np.median(taken.gsd_mm[shows]) == pytest.approx(photos.measures.gsd_mm_p50, rel=0.3)


@pytest.mark.ci
def test_a_flight_waits_for_its_camera_on_the_planned_legs_and_brakes_no_harder(plans) -> None:
    _, film, target = plans
    path, surface = film.trajectory, Cloud(film.surface.points, film.surface.normals)
    for interval_s in (2.0, 6.0):
        taken = photographed(path, CAMERA, scene_of(target), surface, interval_s, 2.0, complete=True)
        there = interpolate(path, taken.planned_s)
        np.testing.assert_allclose(taken.path.positions, there.positions, atol=1e-9)
        assert np.diff(taken.path.t_s[taken.photo]).min() >= interval_s and taken.slower_s >= 0
        hardest = [accelerations(each.t_s, each.positions).max() for each in (path, taken.path)]
        assert hardest[1] <= max(hardest[0], 2.0) * (1 + 1e-6)
    assert taken.slower_s > 1.0  # the second camera is too slow for this flight


@pytest.mark.ci
def test_missions_take_the_photos_of_the_plan_where_the_camera_takes_them_in_time(plans) -> None:
    photos, _, target = plans
    placed = replace(target, placement=PLACE)
    (mission,) = missions_of(photos, placed, MissionOptions(home_m=(40.0, 0.0, 0.0)), camera=CAMERA)
    assert np.allclose(mission.local[mission.photo], photos.photos.positions)
    assert any("photos of the plan" in note for note in mission.notes)
    slower = MissionOptions(home_m=(40.0, 0.0, 0.0), trigger_s=9.0)
    (mission,) = missions_of(photos, placed, slower, camera=CAMERA)
    assert not any("photos of the plan" in note for note in mission.notes)
    assert np.diff(mission.arrival_s[mission.photo]).min() >= 9.0


def test_photos_are_kept_checked_and_given_to_pandas(plans, tmp_path) -> None:
    photos, film, _ = plans
    catalog = Catalog(tmp_path / "catalog").create()
    catalog.add_plans([("a" * 64, photos, {}), ("b" * 64, film, {})])
    table = catalog.photos("a" * 20)
    assert len(table) == len(photos.photos) and np.allclose(
        table["gsd_mm"], photos.photos.gsd_mm, equal_nan=True
    )
    assert list(catalog.photos("b" * 20).columns) == list(table.columns) and catalog.photos("b" * 20).empty
    (file,) = (tmp_path / "catalog" / "photos").glob("*.parquet")
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 1
    file.write_bytes(content)
    assert any("photos/" in finding.what for finding in verify(catalog))

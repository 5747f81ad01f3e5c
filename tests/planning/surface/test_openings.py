"""Where the inside of a surface shows: on scans that lack an end, and nowhere on whole ones."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from cases import slow_after
from made_scans import as_cloud, body, cut

from upplied.config import settings_for
from upplied.geometry.scene import scene_of
from upplied.planning.surface.samples import surface_samples
from upplied.records import Cloud, Structure
from upplied.samples.fleet import member

CLOUDS = settings_for("recommended").clouds


def samples(structure: Structure) -> Cloud:
    return surface_samples(structure, scene_of(structure), CLOUDS)


def rough(structure: Structure, noise_m: float) -> Structure:
    noise = np.random.default_rng(3).normal(0, noise_m, structure.vertices.shape)
    return replace(structure, vertices=structure.vertices + noise)


def share(cloud: Cloud) -> float:
    assert cloud.open is not None
    return float(cloud.areas[cloud.open].sum() / cloud.areas.sum())


@pytest.mark.ci
@pytest.mark.parametrize(("noise_m", "least"), slow_after(1, [(0.0, 0.3), (0.01, 0.1), (0.02, 0.015)]))
def test_a_noisy_cloud_shows_its_inside_where_its_end_is_missing_and_not_where_it_is_whole(
    noise_m: float, least: float
) -> None:
    whole, scan = (samples(rough(as_cloud(of), noise_m)) for of in (body(), cut(body())))
    assert share(whole) < 0.002 and share(scan) > least
    assert scan.open is not None and scan.points[scan.open, 0].max() > 3


@pytest.mark.ci
def test_what_is_no_scan_is_not_asked_however_open_it_is() -> None:
    assert samples(member("a320-v1").structure).open is None
    hull = replace(cut(body()), surface="drawn")
    for drawn in (hull, replace(hull, surface=None)):
        assert samples(drawn).open is None
    assert share(samples(cut(body()))) > 0.3
    assert share(samples(replace(body(), surface="scanned"))) == 0

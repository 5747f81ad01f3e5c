"""A target of which something is missing is laid on the source as the whole one would be."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from upplied.config import settings_for
from upplied.geometry.scene import scene_of
from upplied.planning.correspondence.misfit import misfit_of
from upplied.planning.correspondence.partial import as_likely, is_open, registered_partly
from upplied.planning.correspondence.registration import box_on_box, fitted, register
from upplied.planning.geometry.clouds import diagonal_of
from upplied.planning.surface.samples import surface_samples
from upplied.records import Cloud, Registration
from upplied.samples.fleet import member


@pytest.fixture(scope="module")
def clouds() -> dict[str, Cloud]:
    clouds = {}
    for name in ("a320-v1", "b777-v1", "bridge-1-v1", "bridge-2-v1"):
        of = member(name).structure
        clouds[name] = surface_samples(of, scene_of(of), settings_for("recommended").clouds)
    return clouds


def without(cloud: Cloud, gone: np.ndarray) -> Cloud:
    assert cloud.normals is not None and cloud.area_m2 is not None
    return Cloud(cloud.points[~gone], cloud.normals[~gone], cloud.area_m2[~gone])


def off(registration: Registration, right: Registration, cloud: Cloud, source: Cloud) -> float:
    """Mean distance of where two registrations lay a cloud, over the source's diagonal."""
    apart = np.linalg.norm(registration.to_demo(cloud.points) - right.to_demo(cloud.points), axis=1)
    return float(apart.mean() / diagonal_of(source.points))


@pytest.mark.parametrize(
    ("source", "target", "axis", "share"),
    [
        ("a320-v1", "b777-v1", 1, 0.3),  # a wing
        ("a320-v1", "b777-v1", 0, 0.2),  # the tail
        ("bridge-1-v1", "bridge-2-v1", 0, 0.35),
        ("a320-v1", "a320-v1", 0, 0.3),
    ],
)
@pytest.mark.parametrize("end", [-1, 1])
def test_where_an_end_is_missing_the_rest_is_not_stretched(
    clouds: dict[str, Cloud], source: str, target: str, axis: int, share: float, end: int
) -> None:
    here, whole = clouds[source], clouds[target]
    along = end * whole.points[:, axis]
    cut = without(whole, along > along.max() - share * np.ptp(along))
    right = box_on_box(here, whole)
    registration = fitted(here, cut, 1.0)
    assert off(box_on_box(here, cut), right, whole, here) > 0.06
    assert off(registration, right, whole, here) < 0.04
    assert "what is on both" in registration.evidence


@pytest.mark.parametrize("target", ["b777-v1", "a320-v1"])
def test_a_whole_target_lies_as_its_box_says(clouds: dict[str, Cloud], target: str) -> None:
    here, whole = clouds["a320-v1"], clouds[target]
    assert registered_partly(here, whole, box_on_box(here, whole)) is None


def test_units_and_place_of_the_target_do_not_matter(clouds: dict[str, Cloud]) -> None:
    here, whole = clouds["a320-v1"], clouds["b777-v1"]
    cut = without(whole, whole.points[:, 1] > 8)
    moved = replace(cut, points=1000 * cut.points + 5e4)
    one = registered_partly(here, cut, box_on_box(here, cut))
    other = registered_partly(here, moved, box_on_box(here, moved))
    assert one is not None and other is not None
    np.testing.assert_allclose(one.to_demo(cut.points), other.to_demo(moved.points), atol=1e-6)


def test_what_was_never_scanned_counts_for_the_wholes_and_not_for_what_was(clouds: dict[str, Cloud]) -> None:
    here, whole = clouds["a320-v1"], clouds["b777-v1"]
    lay = box_on_box(here, whole)
    cut = without(whole, whole.points[:, 1] > 8)
    full, part = misfit_of(here, whole, lay), misfit_of(here, cut, lay)
    assert part.value > 2 * full.value and part.common < full.common - 0.05
    assert part.scanned < full.scanned + 0.03
    astray = replace(lay, translation=lay.translation + 0.1 * diagonal_of(here.points) * np.eye(3)[0])
    assert misfit_of(here, cut, astray).scanned > part.scanned + 0.3


@pytest.mark.parametrize("share", [0.35, 0.4, 0.45])
def test_what_the_box_would_refuse_is_laid_where_what_was_scanned_fits(
    clouds: dict[str, Cloud], share: float
) -> None:
    here, whole = clouds["a320-v1"], clouds["b777-v1"]
    cut = without(whole, whole.points[:, 0] < whole.points[:, 0].min() + share * np.ptp(whole.points[:, 0]))
    assert misfit_of(here, cut, box_on_box(here, cut)).value > 1
    registration = fitted(here, cut, 1.0)
    assert registration.accepted and registration.scanned < 0.2 and "what is on both" in registration.evidence
    assert off(registration, box_on_box(here, whole), cut, here) < 0.05


@pytest.mark.parametrize("name", ["a320-v1", "b777-v1"])
@pytest.mark.parametrize("end", [-1, 1])
def test_another_kind_is_not_laid_by_what_would_be_on_both(
    clouds: dict[str, Cloud], name: str, end: int
) -> None:
    far = end * clouds[name].points[:, 0]
    stranger = without(clouds[name], far > far.max() - 0.3 * np.ptp(far))
    other = fitted(clouds["bridge-1-v1"], stranger, 1.0)
    assert not other.accepted and "what is on both" not in other.evidence


def cut_open(cloud: Cloud, axis: int, share: float, end: int) -> Cloud:
    """What is left of a cloud where a share along an axis was never scanned, with its open rim."""
    along = end * cloud.points[:, axis]
    gone = along > along.max() - share * np.ptp(along)
    left = along[~gone]
    return replace(without(cloud, gone), open=left > left.max() - 0.03 * np.ptp(along))


@pytest.mark.parametrize(
    ("source", "target", "end"), [("bridge-1-v1", "bridge-2-v1", -1), ("bridge-2-v1", "bridge-1-v1", 1)]
)
def test_where_the_scan_is_open_the_rest_is_not_stretched_to_the_whole(
    clouds: dict[str, Cloud], source: str, target: str, end: int
) -> None:
    here, whole = clouds[source], clouds[target]
    right, scan = box_on_box(here, whole), cut_open(whole, 0, 0.3, end)
    assert off(box_on_box(here, scan), right, whole, here) > 0.15  # box on box, as if it were whole
    registration = fitted(here, scan, 1.0)
    assert off(registration, right, whole, here) < 0.02 and "by what was scanned" in registration.evidence
    assert registration.accepted and register(here, scan, settings_for("recommended").registration).accepted


def plain(length: float, left: float = 1.0) -> Cloud:
    """Samples of a pipe of 8 m, tapered by a fifth, of which a share is left, open where it was cut."""
    rng = np.random.default_rng(5)
    along, angle = rng.uniform(0, length, 8000), rng.uniform(0, 2 * np.pi, 8000)
    round_ = np.column_stack([np.zeros(8000), np.cos(angle), np.sin(angle)])
    points = np.column_stack([along, np.zeros((8000, 2))]) + (4 - 0.8 * along / length)[:, None] * round_
    scanned = along < left * length
    rim = along[scanned] > left * length - 2
    return Cloud(points[scanned], round_[scanned], np.full(scanned.sum(), 0.2), open=rim & (left < 1))


def test_where_samples_cannot_tell_how_far_a_target_goes_on_it_may_go_on() -> None:
    here, scan = plain(50), plain(50, 0.8)
    stretched = box_on_box(here, scan)  # as if it were all there
    others = as_likely(here, scan, stretched)
    assert min(off(other, box_on_box(here, here), here, here) for other, _ in others) < 0.03
    ends = [float(other.to_target(here.points)[:, 0].max()) for other, _ in others]
    assert min(ends) > 41 and max(ends) < 80
    for other, past in others:
        at = other.to_target(here.points)[:, 0]
        assert abs(float(at.min())) < 0.5 and past.any()
        assert at[past].min() > 39.5 and (at[~past] < 41.5).all()


def test_a_target_that_lies_as_what_is_left_of_it_may_go_on_farther_past_its_own_end() -> None:
    here, scan = plain(50), plain(50, 0.8)
    others = as_likely(here, scan, box_on_box(here, here))  # as it is: four fifths of the whole
    assert others
    for other, past in others:
        at = other.to_target(here.points)[:, 0]
        assert abs(float(at.min())) < 0.5 and at.max() > 52
        assert at[past].min() > 39.5 and (at[~past] < 41.5).all()
    assert not as_likely(here, plain(50), box_on_box(here, here))  # nothing of it is open


def test_little_that_shows_its_inside_is_no_open_end() -> None:
    scan = plain(50, 0.6)
    assert is_open(scan) and not is_open(plain(50)) and not is_open(replace(scan, open=None))
    assert scan.open is not None
    few = scan.open & (np.cumsum(scan.open) <= 0.005 * len(scan))
    assert few.any() and not is_open(replace(scan, open=few))

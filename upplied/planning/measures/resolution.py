"""How finely a plan pictures what was inspected, in millimetres a pixel, and how sharply, beside the expert.

Nothing here is relative to size: a crack is as long on a large structure as on a small one.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from upplied.config import Settings, focal_px
from upplied.planning.airspace.rules import Airspace
from upplied.planning.carry.inspected_surface import InspectedSurface
from upplied.planning.demonstration.repetition import Take, look_limits
from upplied.planning.geometry.clouds import weighted_percentile
from upplied.planning.measures.attainable import attainable_beside
from upplied.planning.visibility.moments import moments
from upplied.planning.visibility.observations import Views
from upplied.planning.visibility.pictures import Pictures, pictures
from upplied.records import Floats, Ints, Trajectory

AS_FINE = 1.1  # times the demonstrated ground sample distance: no coarser is as fine


def resolution(
    trajectory: Trajectory,
    planned: Views,
    inspected: InspectedSurface,
    takes: Sequence[Take],
    airspace: Airspace,
    settings: Settings,
) -> dict[str, float]:
    """Ground sample distances, blur and defocus of `Measures`, of the finest sharp look at each patch.

    Parameters
    ----------
    trajectory : Trajectory
        The plan's.
    planned : Views
        What it truly sees of the target's samples.
    inspected : InspectedSurface
        Of all takes together.
    takes : sequence of Take
    airspace : Airspace
        Of the target: what no allowed camera could picture as finely does not count.
    settings : Settings
    """
    rule, camera = settings.inspection, takes[0].inspection.camera
    limits = look_limits(takes, rule)
    cloud = inspected.cloud
    mine = pictures(moments(trajectory), planned, cloud, camera, *limits)
    parts = [_demonstrated(take, limits) for take in takes]
    weight, target = (np.concatenate([part[at] for part in parts]) for at in (0, 1))
    theirs = np.concatenate([part[2] for part in parts])
    shown = np.isfinite(theirs)
    weight, target, theirs = weight[shown], target[shown], theirs[shown]
    if not len(weight):
        return {}
    now = mine.rows(target)
    focal = focal_px(camera.width_px or rule.width_px, camera.hfov_deg)
    exposure = camera.exposure_s or rule.exposure_s
    pixel_mm = 1e3 / focal
    return {
        **_percentiles("gsd_demonstrated_mm", theirs * pixel_mm, weight, (50, 95)),
        **_percentiles("gsd_mm", now.sampled_m * pixel_mm, weight, (50, 95)),
        "gsd_within_pct": _within(mine, AS_FINE * theirs, target, weight, inspected, airspace, takes),
        **_percentiles("blur_px", now.moved * focal * exposure, weight, (50, 99)),
        **(_percentiles("defocus_px", now.defocus * focal, weight, (95,)) if camera.f_number else {}),
    }


def _demonstrated(take: Take, limits: tuple[float, float]) -> tuple[Floats, Ints, Floats]:
    """Weight, target sample and finest sample distance, m, of each inspected patch with a counterpart."""
    inspection, fit = take.inspection, take.pair.surface
    weight = inspection.attention.weight * fit.source.areas
    chosen = np.flatnonzero((weight > 0) & (fit.correspondences.target_index >= 0))
    flown = moments(inspection.logged, inspection.logged_breaks)
    seen = pictures(flown, inspection.truly, fit.source, inspection.camera, *limits)
    return weight[chosen], fit.correspondences.target_index[chosen], seen.sampled_m[chosen]


def _within(
    mine: Pictures,
    asked_m: Floats,
    target: Ints,
    weight: Floats,
    inspected: InspectedSurface,
    airspace: Airspace,
    takes: Sequence[Take],
) -> float:
    """Share, in percent, of patches as fine as asked, of those that some allowed camera shows so."""
    fine = mine.sampled_m[target] <= asked_m
    coarsest = np.zeros(len(inspected.cloud))  # of each sample, what the least demanding of its patches asks
    np.maximum.at(coarsest, target, asked_m)
    missed = np.unique(target[~fine])
    camera = takes[0].inspection.camera
    possible = np.ones(len(inspected.cloud), bool)
    possible[missed] = attainable_beside(missed, inspected.cloud, airspace, camera, coarsest)
    counted = fine | possible[target]
    whole = float(weight[counted].sum())
    return 100 * (1 - float(weight[counted & ~fine].sum()) / whole) if whole > 0 else float("nan")


def _percentiles(name: str, values: Floats, weight: Floats, percents: tuple[int, ...]) -> dict[str, float]:
    known = np.isfinite(values)
    return {f"{name}_p{p}": weighted_percentile(values[known], weight[known], p) for p in percents}

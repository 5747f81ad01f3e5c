"""How finely a plan pictures what was inspected, in millimetres a pixel, and how sharply, beside the expert.

Nothing here is relative to size: a crack is as long on a large structure as on a small one.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from upplied.config import Settings, focal_px
from upplied.planning.airspace.rules import Airspace
from upplied.planning.carry.inspected_surface import InspectedSurface
from upplied.planning.demonstration.repetition import Take
from upplied.planning.geometry.clouds import weighted_percentile
from upplied.planning.measures.attainable import attainable_beside
from upplied.planning.measures.fidelity import Patches
from upplied.planning.visibility.looks import Looks
from upplied.records import Floats, Ints

AS_FINE = 1.1  # times the demonstrated ground sample distance: no coarser is as fine


def resolution(
    looks: Looks,
    patches: Patches,
    inspected: InspectedSurface,
    takes: Sequence[Take],
    airspace: Airspace,
    settings: Settings,
) -> dict[str, float]:
    """Ground sample distances, blur and defocus of `Measures`, of the finest sharp look at each patch.

    Parameters
    ----------
    looks : Looks
        Of the plan, at the target's samples.
    patches : Patches
    inspected : InspectedSurface
        Of all takes together.
    takes : sequence of Take
    airspace : Airspace
        Of the target: what no allowed camera could picture as finely does not count.
    settings : Settings
    """
    rule, camera = settings.inspection, takes[0].inspection.camera
    weight, target, theirs = patches.weight, patches.target, patches.shown.sampled_m
    shown = np.isfinite(theirs)
    weight, target, theirs = weight[shown], target[shown], theirs[shown]
    if not len(weight):
        return {}
    now = looks.rows(target)
    focal = focal_px(camera.width_px or rule.width_px, camera.hfov_deg)
    exposure = camera.exposure_s or rule.exposure_s
    pixel_mm = 1e3 / focal
    return {
        **_percentiles("gsd_demonstrated_mm", theirs * pixel_mm, weight, (50, 95)),
        **_percentiles("gsd_mm", now.sampled_m * pixel_mm, weight, (50, 95)),
        "gsd_within_pct": _within(looks, AS_FINE * theirs, target, weight, inspected, airspace, takes),
        **_percentiles("blur_px", now.moved * focal * exposure, weight, (50, 99)),
        **(_percentiles("defocus_px", now.defocus * focal, weight, (95,)) if camera.f_number else {}),
    }


def _within(
    looks: Looks,
    wanted_m: Floats,
    target: Ints,
    weight: Floats,
    inspected: InspectedSurface,
    airspace: Airspace,
    takes: Sequence[Take],
) -> float:
    """Share, in percent, of patches as fine as asked, of those that some allowed camera shows so."""
    fine = looks.sampled_m[target] <= wanted_m
    coarsest = np.zeros(len(inspected.cloud))  # of each sample, what the least demanding of its patches asks
    np.maximum.at(coarsest, target, wanted_m)
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

"""What of the inspected surface a plan shows at least as well as the expert did, and what of the rest."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from upplied.config import Settings
from upplied.planning.airspace.at_target import airspace_of
from upplied.planning.carry.inspected_surface import (
    InspectedSurface,
    coverage,
    inspected_by,
    inspected_surface,
    target_attention,
)
from upplied.planning.demonstration.repetition import Take
from upplied.planning.demonstration.sharp_looks import look_limits
from upplied.planning.measures.attainable import attainable_beside
from upplied.planning.visibility.moments import moments, rates
from upplied.planning.visibility.path_views import Views
from upplied.planning.visibility.pictures import pictures
from upplied.planning.visibility.view_quality import shown_well
from upplied.records import Bools, Cloud, Floats, Record, SurfaceStates


@dataclass(frozen=True, eq=False, repr=False)
class Shown(Record):
    """The inspected surface on the target, and what became of it."""

    inspected: InspectedSurface
    as_well: Bools  # (N,) of the target's samples: shown at least as well as is asked
    never: Bools  # (N,) asked for, and no allowed camera could
    attention: Floats  # (N,) attention, 0 to 1, of what each target sample corresponds to, asked for or not


def shown_of(planned: Views, takes: Sequence[Take], settings: Settings) -> Shown:
    """What a plan shows at least as well as the demonstration, in one look each.

    A look does where it is near enough, frontal enough, and slow enough to be sharp. Target surface that
    corresponds to inspected surface without being anybody's nearest counterpart is judged like its neighbour.

    Parameters
    ----------
    planned : Views
        What the plan truly sees of the target's surface samples.
    takes : sequence of Take
    settings : Settings
    """
    pair, rule = takes[0].pair, settings.inspection
    inspected = InspectedSurface.together([inspected_by(take, settings) for take in takes])
    cloud, farthest = inspected.cloud, inspected.farthest_m(rule)
    attention, like = target_attention(takes, cloud)
    farthest = np.where(np.isfinite(farthest), farthest, farthest[like])
    camera, limits = takes[0].inspection.camera, look_limits(takes, rule)
    if inspected.projected:
        as_well = pictures(moments(planned.stations), planned, cloud, camera, *limits, farthest).looks > 0
    else:
        as_well = _shown_well(planned, cloud, farthest, *limits)
    missed = np.flatnonzero((inspected.need > 0) & ~as_well)
    never = np.zeros(len(cloud), bool)
    airspace = airspace_of(pair, settings)
    never[missed] = ~attainable_beside(missed, cloud, airspace, camera, farthest)
    return Shown(inspected, as_well, never, attention)


def scaled_coverage(planned: Views, takes: Sequence[Take], settings: Settings) -> float:
    """Coverage, in percent, of what was inspected, from as near as the scale of the structures asks."""
    rule, scaled = settings.inspection, relative_to_size(settings)
    inspected = InspectedSurface.together([inspected_by(take, scaled) for take in takes])
    asked = planned, inspected.cloud, inspected.farthest_m(rule), *look_limits(takes, rule)
    return coverage(inspected, _shown_well(*asked), whole=True)


def relative_to_size(settings: Settings) -> Settings:
    """The same settings, with stand-offs that scale with the structure."""
    return replace(settings, transfer=replace(settings.transfer, standoff="scaled", gsd_m=None))


def in_millimetres(settings: Settings) -> Settings:
    """The same settings, with the ground sample distance that is asked for, or else the demonstrated one."""
    return replace(settings, transfer=replace(settings.transfer, standoff="kept"))


def _shown_well(
    planned: Views, cloud: Cloud, farthest_m: Floats, sharp_radps: float, least_cosine: float
) -> Bools:
    moving = (planned.stations.positions, *rates(planned.stations))
    return np.asarray(
        shown_well(
            *(np.ascontiguousarray(of) for of in (*moving, cloud.points, cloud.outward)),
            planned.seen,
            np.ascontiguousarray(planned.coarseness),
            farthest_m,
            least_cosine,
            sharp_radps,
        ),
        bool,
    )


def inspected_measures(found: Shown, planned: Views, takes: Sequence[Take]) -> dict[str, float]:
    """The coverages of the inspected surface, there and back, and of what else was seen."""
    inspected, cloud = found.inspected, found.inspected.cloud
    area = cloud.areas
    attended = area * found.attention
    whole = float(attended.sum())
    rest = [
        inspected_surface(
            take.pair.surface.source,
            take.pair.surface.target,
            take.pair.surface.correspondences,
            take.inspection.truly,
            weight=1 - take.inspection.attention.weight,
        )
        for take in takes
    ]
    nan = float("nan")
    return {
        "coverage_inspected_pct": coverage(inspected, found.as_well, whole=True),
        "inspected_without_counterpart_pct": inspected.without_pct,
        "inspected_unattainable_pct": (
            100 * float(inspected.need[found.never].sum()) / inspected.whole if inspected.whole > 0 else nan
        ),
        "coverage_of_target_pct": (100 * float(attended[found.as_well].sum()) / whole if whole > 0 else nan),
        "coverage_context_pct": coverage(InspectedSurface.together(rest), planned.total),
    }


def surface_states(found: Shown) -> SurfaceStates:
    """What became of each sample of the target: other, shown, missed or unattainable."""
    wanted = (found.inspected.need > 0) | (found.attention > 0.5)
    state = np.where(wanted, 2, 0)
    state[found.never] = 3
    state[wanted & found.as_well] = 1
    cloud = found.inspected.cloud
    return SurfaceStates(cloud.points, state, cloud.normals)

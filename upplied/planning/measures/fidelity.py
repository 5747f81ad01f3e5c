"""What a plan shows of what was inspected, how finely, and how like the demonstration, and how steadily."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from upplied.config import Settings, focal_px
from upplied.geometry.polylines import arc_length, interpolated
from upplied.geometry.poses import angle_between
from upplied.planning.airspace.detours import airspace_of
from upplied.planning.carry.inspected_surface import (
    InspectedSurface,
    coverage,
    demonstrated_looks,
    inspected_by,
    inspected_surface,
)
from upplied.planning.demonstration.repetition import Take, begins_of, look_limits, steady_radps
from upplied.planning.geometry.clouds import weighted_percentile
from upplied.planning.measures.attainable import attainable_beside
from upplied.planning.visibility.looks import Looks, sharp_looks, widened
from upplied.planning.visibility.observations import Moments, Views, moments
from upplied.records import Bools, Floats, Ints, Record, Rows, SurfaceStates, Trajectory

_ORDERED = 2000  # patches, at most, whose order is compared
_STEADY_RAD = np.radians(3.0)  # turns below this are jitter of the hand
_BEND_RAD = np.radians(8.0)  # and of the path
_LEAST_RAD = np.radians(30.0)  # that a demonstration's turning counts as, when a plan's is divided by it
_LEG = 0.1  # of the stand-off: legs between which a path's bends are counted
_LEAST_LEG_M = 1.0
_AHEAD = 8  # poses at a time
AS_FINE = 1.1  # times the demonstrated ground sample distance: no coarser is as fine


@dataclass(frozen=True, eq=False, repr=False)
class Patches(Rows):
    """What was inspected and has a counterpart, patch by patch, and how it was shown."""

    weight: Floats  # (K,) m^2 times attention
    target: Ints  # (K,) sample of the target
    shown: Looks  # of K patches of the source, its times from the start of the joined flights


@dataclass(frozen=True, eq=False, repr=False)
class Compared(Record):
    """A plan beside the demonstration, as both showed what was inspected."""

    steps: Moments  # of the plan
    views: Views  # of the plan, at N samples of the target
    looks: Looks  # of the plan, at these samples
    patches: Patches
    inspected: InspectedSurface  # of all takes together, by these samples
    takes: Sequence[Take]
    settings: Settings

    @classmethod
    def of(
        cls,
        plan: Trajectory,
        seen: Views,
        inspected: InspectedSurface,
        takes: Sequence[Take],
        settings: Settings,
    ) -> "Compared":
        """A plan that truly has these views."""
        limits, steps = look_limits(takes, settings.inspection), moments(plan)
        looks = sharp_looks(steps, seen, inspected.cloud, takes[0].inspection.camera, *limits)
        begins = begins_of([take.inspection.logged for take in takes])
        patches = []
        for take, begin_s in zip(takes, begins, strict=True):
            fit, target = take.pair.surface, take.pair.surface.correspondences.target_index
            weight = take.inspection.attention.weight * fit.source.areas
            chosen = np.flatnonzero((weight > 0) & (target >= 0))
            shown = demonstrated_looks(take, limits).rows(chosen)
            shown = replace(shown, time_s=shown.time_s + begin_s)
            patches.append(Patches(weight[chosen], target[chosen], shown))
        return cls(steps, seen, looks, Patches.stacked(patches), inspected, takes, settings)


def fidelity(of: Compared) -> dict[str, float]:
    """The measures of `records.Measures` that compare looks, turns and pictures with the demonstration's."""
    flown = [take.inspection.steps for take in of.takes]
    figures = _smoothness(of.steps, flown, of.inspected, steady_radps(of.takes, of.settings.inspection))
    return figures | _compared(of.patches, of.looks, of.inspected) if len(of.patches.weight) else figures


def _compared(patches: Patches, looks: Looks, inspected: InspectedSurface) -> dict[str, float]:
    weight, at, shown = patches.weight, patches.target, patches.shown
    near, frontal, dwell = looks.sampled_m[at], looks.frontal[at], looks.held_s[at]
    ratio = inspected.standoff_m[at] / near  # 0 where the plan has no look
    # The least incidence, deg; 90 where there is no look.
    before, after = (np.degrees(np.arccos(np.clip(of, 0.0, 1.0))) for of in (shown.frontal, frontal))
    mine = shown.sides & widened(looks.sides)[at]
    possible = float(weight @ shown.sides.sum(axis=1))
    lasted = shown.held_s > 0
    held_share = np.minimum(dwell[lasted] / shown.held_s[lasted], 1.0)
    both = lasted & (dwell > 0)
    return {
        "fidelity_resolution_p50": weighted_percentile(ratio, weight, 50),
        "fidelity_resolution_p05": weighted_percentile(ratio, weight, 5),
        "fidelity_incidence_deg_p95": weighted_percentile(after - before, weight, 95),
        "fidelity_looks_kept_pct": _share(float(weight @ mine.sum(axis=1)), possible),
        "fidelity_dwell_kept_pct": _share(float(weight[lasted] @ held_share), float(weight[lasted].sum())),
        "fidelity_order": order_kept(shown.time_s[both], looks.time_s[at][both]),
    }


def order_kept(before_s: Floats, after_s: Floats) -> float:
    """Kendall's tau of the moments at which patches were and are looked at; NaN for fewer than two."""
    if len(before_s) < 2:
        return float("nan")
    from scipy.stats import kendalltau  # a quarter of a second, which no page waits for

    chosen = np.linspace(0, len(before_s) - 1, min(_ORDERED, len(before_s))).astype(np.int64)
    return float(kendalltau(before_s[chosen], after_s[chosen]).statistic)


def _share(part: float, whole: float) -> float:
    return min(100 * part / whole, 100.0) if whole > 0 else float("nan")


def _smoothness(
    steps: Moments, flown: Sequence[Moments], inspected: InspectedSurface, limit_radps: float
) -> dict[str, float]:
    """How much the camera and the path turn, over what the demonstration turned."""
    near = inspected.standoff_m[inspected.need > 0]
    leg_m = max(_LEAST_LEG_M, _LEG * float(np.median(near))) if len(near) else _LEAST_LEG_M
    turned = sum(turned_rad(part.poses.quat_xyzw) for part in flown)
    bent = sum(bent_rad(part.poses.positions, leg_m) for part in flown)
    return {
        "camera_turn_ratio": turned_rad(steps.poses.quat_xyzw) / max(turned, _LEAST_RAD),
        "path_turn_ratio": bent_rad(steps.poses.positions, leg_m) / max(bent, _LEAST_RAD),
        "pan_fast_pct": _share(
            float(steps.step_s[np.linalg.norm(steps.turn, axis=1) > limit_radps].sum()),
            float(steps.step_s.sum()),
        ),
    }


def turned_rad(quat_xyzw: Floats) -> float:
    """How far a camera turns in all, rad, followed in steps of at least 3 degrees: without jitter."""
    at, first, total = 0, 1, 0.0
    while first < len(quat_xyzw):
        turn = angle_between(quat_xyzw[at : at + 1], quat_xyzw[first : first + _AHEAD])
        far = np.flatnonzero(turn >= _STEADY_RAD)
        if len(far):
            at, total = first + int(far[0]), total + float(turn[far[0]])
        first = at + 1 if len(far) else first + _AHEAD
    return total


def bent_rad(positions: Floats, leg_m: float) -> float:
    """How far a path's direction turns in all, rad, on legs of this length, without bends below 8 degrees."""
    along = arc_length(positions)
    number = int(along[-1] / leg_m)
    if number < 2:
        return 0.0
    even = interpolated(np.linspace(0, along[-1], number + 1), along, positions)
    ways = np.diff(even, axis=0)
    ways /= np.maximum(np.linalg.norm(ways, axis=1, keepdims=True), 1e-9)
    way, total = ways[0], 0.0
    for other in ways[1:]:
        turn = float(np.arccos(np.clip(way @ other, -1.0, 1.0)))
        if turn >= _BEND_RAD:
            way, total = other, total + turn
    return total


def resolution(of: Compared) -> dict[str, float]:
    """Ground sample distances, blur and defocus of `Measures`, of the finest sharp look at each patch.

    Nothing here is relative to size: a crack is as long on a large structure as on a small one. What no
    allowed camera could picture as finely does not count.
    """
    rule, camera = of.settings.inspection, of.takes[0].inspection.camera
    patches = of.patches.rows(np.isfinite(of.patches.shown.sampled_m))
    weight, theirs = patches.weight, patches.shown.sampled_m
    if not len(weight):
        return {}
    now = of.looks.rows(patches.target)
    focal = focal_px(camera.width_px or rule.width_px, camera.hfov_deg)
    exposure = camera.exposure_s or rule.exposure_s
    pixel_mm = 1e3 / focal
    # As fine as demonstrated, of those that some allowed camera shows so.
    cloud, target, wanted_m = of.inspected.cloud, patches.target, AS_FINE * theirs
    fine = now.sampled_m <= wanted_m
    coarsest = np.zeros(len(cloud))  # of each sample, what the least demanding of its patches asks
    np.maximum.at(coarsest, target, wanted_m)
    missed = np.unique(target[~fine])
    airspace, possible = airspace_of(of.takes[0].pair, of.settings), np.ones(len(cloud), bool)
    possible[missed] = attainable_beside(missed, cloud, airspace, camera, coarsest)
    counted = fine | possible[target]
    whole = float(weight[counted].sum())
    within = 100 * (1 - float(weight[counted & ~fine].sum()) / whole) if whole > 0 else float("nan")
    return {
        **_percentiles("gsd_demonstrated_mm", theirs * pixel_mm, weight, (50, 95)),
        **_percentiles("gsd_mm", now.sampled_m * pixel_mm, weight, (50, 95)),
        "gsd_within_pct": within,
        **_percentiles("blur_px", now.moved * focal * exposure, weight, (50, 99)),
        **(_percentiles("defocus_px", now.defocus * focal, weight, (95,)) if camera.f_number else {}),
    }


def _percentiles(name: str, values: Floats, weight: Floats, percents: tuple[int, ...]) -> dict[str, float]:
    known = np.isfinite(values)
    return {f"{name}_p{p}": weighted_percentile(values[known], weight[known], p) for p in percents}


@dataclass(frozen=True, eq=False, repr=False)
class Shown(Record):
    """The inspected surface on the target, and what became of it."""

    inspected: InspectedSurface
    as_well: Bools  # (N,) of the target's samples: shown at least as well as is asked
    never: Bools  # (N,) asked for, and no allowed camera could


def shown_of(planned: Views, takes: Sequence[Take], settings: Settings) -> Shown:
    """What a plan shows at least as well as the demonstration, in one look each.

    A look does where it is near enough, frontal enough, and slow enough to be sharp. `planned` is what the
    plan truly sees of the target's surface samples.
    """
    pair, rule = takes[0].pair, settings.inspection
    inspected = InspectedSurface.together([inspected_by(take, settings) for take in takes])
    cloud = inspected.cloud
    farthest = inspected.standoff_m / rule.least_resolution
    as_well = planned.shown_well(cloud, farthest, *look_limits(takes, rule))
    missed = np.flatnonzero((inspected.need > 0) & ~as_well)
    never = np.zeros(len(cloud), bool)
    camera, airspace = takes[0].inspection.camera, airspace_of(pair, settings)
    never[missed] = ~attainable_beside(missed, cloud, airspace, camera, farthest)
    return Shown(inspected, as_well, never)


def inspected_measures(shown: Shown, planned: Views, takes: Sequence[Take]) -> dict[str, float]:
    """The coverages of the inspected surface, there and back, and of what else was seen."""
    inspected = shown.inspected
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
        "coverage_inspected_pct": coverage(inspected, shown.as_well, whole=True),
        "inspected_without_counterpart_pct": inspected.without_pct,
        "inspected_unattainable_pct": (
            100 * float(inspected.need[shown.never].sum()) / inspected.whole if inspected.whole > 0 else nan
        ),
        "coverage_of_target_pct": coverage(inspected, shown.as_well),
        "coverage_context_pct": coverage(InspectedSurface.together(rest), planned.total),
    }


def surface_states(shown: Shown) -> SurfaceStates:
    """What became of each sample of the target: other, shown, missed or unattainable.

    Of what is missed as much area counts as the share of the need that is missed, the densest need first:
    a rim that hardly matters to the coverage does not look like a hole in it.
    """
    need, cloud = shown.inspected.need, shown.inspected.cloud
    well = shown.as_well & (need > 0)
    lost = np.flatnonzero((need > 0) & ~shown.as_well)
    lost = lost[np.argsort(-need[lost] / cloud.areas[lost], kind="stable")]
    painted = np.cumsum(cloud.areas[lost])
    missed = lost[painted * need[well].sum() <= need[lost].sum() * cloud.areas[well].sum()]
    state = np.zeros(len(need), np.int64)
    state[well] = 1
    state[missed] = np.where(shown.never[missed], 3, 2)
    return SurfaceStates(cloud.points, state, cloud.normals)

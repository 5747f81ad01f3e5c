"""The measures of one plan, asked of the demonstration and the plan in the same manner."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from upplied.config import Settings
from upplied.planning.airspace import Airspace
from upplied.planning.attainable import attainable
from upplied.planning.measure import (
    BY_FRUSTUM,
    TRULY,
    Sought,
    Views,
    measure,
    sought,
    surface_states,
    together,
    views,
)
from upplied.planning.pair import Fit, Memo, Pair, content_key, no_memo, remembering
from upplied.planning.repeat import Take
from upplied.planning.transfer import box_map, registered_map
from upplied.records import Bools, Camera, Floats, Measures, SurfaceStates, Trajectory, Visibility


def judge(
    trajectory: Trajectory, takes: Sequence[Take], settings: Settings, memo: Memo = no_memo
) -> tuple[Measures, SurfaceStates | None, tuple[str, ...]]:
    """All measures of a planned trajectory, what becomes of the target's surface, and warnings in words.

    What a repeated demonstration should see is what all its takes should see together.
    """
    pair, camera = takes[0].pair, takes[0].inspection.camera
    carried = np.concatenate([demonstrated_on_target(take) for take in takes])
    paper = (
        together([_sought(take, take.pair.voxels, take.inspection.by_frustum) for take in takes]),
        views(trajectory, pair.voxels.target, camera, BY_FRUSTUM),
    )
    if not pair.surface.registration.accepted:
        warning = f"what is really seen was not measured: {pair.surface.registration.reason}"
        return measure(trajectory, carried, pair.target_scene, paper), None, (warning,)
    true = (
        together([_sought(take, take.pair.surface, take.inspection.truly) for take in takes]),
        views(trajectory, pair.surface.target, camera, TRULY, pair.target_scene),
    )
    possible = attainable_samples(pair, camera, settings, memo)
    states = surface_states(true[0], true[1].total, possible)
    found = measure(trajectory, carried, pair.target_scene, paper, true, possible)
    return found, states, _warnings(found, true[0].without_pct, settings)


def _sought(take: Take, fit: Fit, demonstrated: Views) -> Sought:
    carry = registered_map(take.pair.surface.registration).matrix
    return sought(fit.source, fit.target, fit.correspondences, demonstrated, carry=carry)


def _warnings(found: Measures, without_pct: float, settings: Settings) -> tuple[str, ...]:
    """What a person should know before this plan is flown, in words."""
    said = []
    if without_pct >= 1:
        said.append(f"{without_pct:.0f} % of what the demonstration saw has no counterpart on the target")
    short = found.coverage_attainable_pct - found.coverage_seen_pct
    if short > 5:
        said.append(f"{short:.0f} % of what could be seen is missed")
    if found.min_clearance_m < settings.route.clearance_m:
        said.append(
            f"comes within {found.min_clearance_m:.2f} m of the structure; "
            f"{settings.route.clearance_m:g} m are asked for"
        )
    return tuple(said)


def attainable_samples(pair: Pair, camera: Camera, settings: Settings, memo: Memo = no_memo) -> Bools:
    """Which surface samples of the target some allowed pose could see, (N,), remembered by content."""
    memo = remembering(memo, pair.target.sha256)
    airspace = airspace_of(pair, settings)
    facts = (pair.target.sha256, settings.clouds, camera, settings.route)
    found = memo(
        "attainable",
        Visibility,
        content_key("attainable", *facts),
        lambda: Visibility(attainable(pair.surface.target, airspace, camera, TRULY)[None]),
    )
    return found.total


def airspace_of(pair: Pair, settings: Settings) -> Airspace:
    """Where the vehicle may be at the target."""
    route = settings.route
    return Airspace(pair.target_scene, route.clearance_m, pair.target.surroundings, route.ground_clearance_m)


def demonstrated_on_target(take: Take) -> Floats:
    """The demonstrated positions after the box transform, turned as the structures are to each other."""
    pair, flown = take.pair, take.inspection.by_frustum.stations.positions
    turned = pair.surface.registration.rotation @ pair.surface.registration.turn
    heading = np.arctan2(turned[1, 0], turned[0, 0])
    if abs(heading) > np.radians(30):
        return registered_map(pair.surface.registration).points(flown)
    return box_map(pair.voxels.source, pair.voxels.target).points(flown)

"""Where the vehicle may be at the target of a pair."""

from __future__ import annotations

from upplied.config import Settings
from upplied.planning.airspace.rules import Airspace
from upplied.planning.correspondence.pair import Pair


def airspace_of(pair: Pair, settings: Settings) -> Airspace:
    """Where the vehicle may be at the target."""
    route, target = settings.route, pair.target
    return Airspace(
        pair.target_scene, route.clearance_m, target.surroundings, route.ground_clearance_m, target.frame
    )

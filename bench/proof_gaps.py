"""The flights that close gaps: how long beside their bound, and what photos at their viewpoints inspect.

    python bench/proof_gaps.py [--only WORDS]

Flights of the second simulator (`proof_flights`) leave something of each sample inspection out. The flight
that closes it keeps the clearance of its plan. As planned: by another ruler (`proof_truth`): corners of
pixels cast from each viewpoint, with rays that meet every triangle, and the motion between its neighbours.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator

import numpy as np
from proof_flights import Manner, flown
from proof_second import Place, places

from upplied.config import settings_for
from upplied.planning.airspace.roadmap import roadmap
from upplied.planning.airspace.rules import Airspace, path_clearance
from upplied.proof.align import align
from upplied.proof.as_flown import as_flown
from upplied.proof.gap import gap_flight

LEFT_OUT = {
    "broken off": Manner(ends=0.6),
    "photos lost": Manner(lost_photos=0.3),
    "camera stuck": Manner(stuck=(0.4, 0.73)),
    "trigger dead": Manner(trigger_dead=(0.3, 0.6)),
    "too fast": Manner(pace=1.25),
}
_WITHIN_M, _PLACES = 0.05, 300  # of the plan's clearance; places of the plan that the ways may lead by


def closed(place: Place) -> Iterator[tuple[str, float, float, float]]:
    """Of each gap its name, the length over the bound, % inspected as planned, and m nearer than the plan."""
    plan, nearest = place.plan, path_clearance(place.scene, place.plan.positions).distance_m
    airspace = Airspace(place.scene, nearest - _WITHIN_M, place.structure.surroundings)
    graph = roadmap(airspace, place.surface, plan.positions[:: max(1, len(plan) // _PLACES)])
    for name, manner in LEFT_OUT.items():
        flight = flown(plan, manner, 0)
        arguments = place.viewpoint_s, align(plan, flight.log), flight.log, place.surface, place.camera
        inspected = as_flown(plan, *arguments, place.scene, flight.photo_s).looks.inspected
        assert inspected is not None
        limits = settings_for("recommended").retime
        gap = gap_flight(plan, place.surface, ~inspected, place.camera, graph, limits)
        path = gap.trajectory
        truly = place.inspected(path, path.t_s[gap.is_viewpoint], 0)[~inspected]
        nearer = nearest - path_clearance(place.scene, path.positions).distance_m
        yield name, gap.length_m / max(gap.bound_m, 1.0), 100 * float(truly.mean()), nearer


def main() -> None:
    """Print a line for each gap."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--only", default="", help="paths whose name contains this")
    options = parser.parse_args()
    rows = []
    for place in places(options.only):
        for name, length, as_planned, nearer in closed(place):
            rows.append((length, as_planned, nearer))
            print(
                f"{place.name:22}{name:14}length over its bound {length:5.2f}  inspected as planned "
                f"{as_planned:6.2f} %  nearer than the plan by {nearer:+5.2f} m",
                flush=True,
            )
    if not rows:
        raise SystemExit(f"no path has {options.only!r} in its name")
    length, as_planned, nearer = np.array(rows).T
    print(
        f"{len(rows)} gaps: length {length.mean():.2f} times the bound, most {length.max():.2f}; "
        f"inspected as planned {as_planned.mean():.1f} %, least {as_planned.min():.1f} %; "
        f"nearer by {nearer.max():+.2f} m"
    )


if __name__ == "__main__":
    main()

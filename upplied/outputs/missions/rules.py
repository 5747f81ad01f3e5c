"""The rules of the gate: what every mission satisfies, why, and what to do where one does not."""

from __future__ import annotations

from typing import NamedTuple


class Rule(NamedTuple):
    """Something that every mission keeps."""

    name: str
    why: str
    remedy: str


RULES = {
    rule.name: rule
    for rule in (
        Rule("preset", "only `recommended` is made to be flown; others are for comparison", "plan with it"),
        Rule("verdict", "the plan reaches what it must to be flown", "plan it again, or another one"),
        Rule("released", "only a released plan is flown", "release it: upplied release ID --by NAME"),
        Rule("foreign", "what is flown was judged here", "plan it here, or import it again with --verify"),
        Rule("altered", "what is flown is what was released", "take the catalog from a backup; see: "
             "upplied catalog verify"),
        Rule("rejected", "a rejected plan is not flown", "export the plan in force"),
        Rule("recalled", "the plan is safe at the structure as it now is", "release a newer plan"),
        Rule("superseded", "another plan of this pair takes its place", "export that one"),
        Rule("finite", "every waypoint is a finite place at a rising time", "plan again"),
        Rule("clearance", "every leg keeps its distance from the structure", "plan with more --clearance"),
        Rule("keep-out", "no leg enters a keep-out box", "plan again with these surroundings"),
        Rule("geofence", "no leg leaves the fence", "plan again with these surroundings"),
        Rule("ceiling", "no leg rises above the ceiling", "plan again with these surroundings"),
        Rule("ground", "no leg but take-off and landing goes below the ground", "plan again"),
        Rule("height", "no leg is higher above ground than allowed", "raise --max-height-m where you may"),
        Rule("speed", "no leg is faster than the vehicle flies", "plan with the limits of the vehicle"),
        Rule("acceleration", "no turn exceeds what the vehicle can do", "plan with its limits"),
        Rule("zoom", "what flies the mission can zoom as the plan does", "export in a format that can: csv, "
             "geojson, dji-wpml, or qgc-plan and mavlink for PX4"),
        Rule("photos", "photos are triggered no faster than the camera takes them", "export with fewer "
             "photos, or set the interval of the camera: --trigger-s, --camera"),
        Rule("overlap", "photos of neighbouring passes overlap as required", "plan with nearer passes, "
             "or require less: --overlap"),
        Rule("coverage", "the mission shows what the plan shows", "export with less tolerance"),
    )
}  # fmt: skip

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
        Rule("preset", "only plans of `recommended` are flown; others are for comparison", "plan with it"),
        Rule("verdict", "a plan reaches the limits of the verdict", "plan again, or choose another plan"),
        Rule("released", "only a released plan is flown", "release it: upplied release ID --by NAME"),
        Rule("foreign", "a plan is measured in this catalog before it is flown", "plan it here, or import it "
             "again with --verify"),
        Rule("altered", "a plan is flown as it was released", "restore the catalog from a backup; see: "
             "upplied catalog verify"),
        Rule("rejected", "a rejected plan is not flown", "export the plan in force"),
        Rule("recalled", "a plan is safe at the structure as it is now", "release a newer plan"),
        Rule("superseded", "another plan of this pair replaced it", "export that one"),
        Rule("finite", "every waypoint is finite and times increase", "plan again"),
        Rule("clearance", "every leg keeps its distance from the structure", "plan with more --clearance"),
        Rule("keep-out", "no leg enters a keep-out box", "plan again with these surroundings"),
        Rule("geofence", "no leg leaves the fence", "plan again with these surroundings"),
        Rule("ceiling", "no leg rises above the ceiling", "plan again with these surroundings"),
        Rule("ground", "no leg but take-off and landing goes below the ground", "plan again"),
        Rule("height", "no leg is higher above ground than allowed", "raise --max-height-m where you may"),
        Rule("speed", "no leg is faster than the vehicle flies", "plan with the limits of the vehicle"),
        Rule("acceleration", "no turn exceeds what the vehicle can do", "plan with its limits"),
        Rule("zoom", "the format and the autopilot can zoom as the plan does", "export in a format that can: "
             "csv, geojson, dji-wpml, or qgc-plan and mavlink for PX4"),
        Rule("photos", "photos keep the trigger interval of the camera", "export with fewer "
             "photos, or set the interval of the camera: --trigger-s, --camera"),
        Rule("overlap", "photos of neighbouring passes overlap as required", "plan with nearer passes, "
             "or require less: --overlap"),
        Rule("coverage", "the mission shows what the plan shows", "export with less tolerance"),
    )
}  # fmt: skip

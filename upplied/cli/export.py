"""`upplied export`: a plan as a mission file for an autopilot or a map."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import App, Parameter

from upplied.cli.terminal import CatalogOption, beside, errors, hint, opened, say

app = App(name="export", help="Write a plan as a mission file for an autopilot or a map.")

Format = Literal["qgc-plan", "mavlink", "dji-wpml", "litchi", "kml", "geojson", "mcap", "csv"]
#: What a person looks at a mission of each format with, before it is flown.
OPENED_IN = {
    "qgc-plan": "QGroundControl",
    "mavlink": "QGroundControl or Mission Planner",
    "dji-wpml": "DJI Pilot 2",
    "litchi": "Litchi's mission hub",
    "kml": "Google Earth",
    "geojson": "QGIS",
    "mcap": "Foxglove",
    "csv": "any table or plot",
}


@Parameter(name="*")
@dataclass(frozen=True)
class Flags:
    """The fields of `MissionOptions`, a test says so; that class would cost the help half a second.

    Parameters
    ----------
    altitude : str
        Reference of altitudes.
    home_m : tuple of float
        Take-off point, x y z in the structure's frame, m; by default on the ground beside the structure.
    clearance_m : float
        Minimum distance every leg keeps from the structure, m.
    max_height_m : float
        Maximum height of a leg above ground, m; by default 120, or the height of the plan.
    tolerance_m : float
        Largest deviation of the path when waypoints are removed, m.
    tolerance_deg : float
        Largest deviation of the camera when waypoints are removed, deg.
    corner_m : float
        Largest distance from a waypoint when passing it without a stop, m.
    photos : str
        Trigger of the photos: where overlap and coverage need them, by distance, none, or a video instead.
    photo_distance_m : float
        Distance between photos, m.
    overlap : str
        Overlap of photos along and across the path, percent, as 80/70.
    trigger_s : float
        Minimum time between two photos, s; by default that of the camera if known, else 2.
    camera : str
        Name of the camera in cameras.toml; by default that of the demonstration.
    file_format : str
        File format of the photos; raw files take longer.
    endurance_s : float
        Endurance of one battery, s; longer missions are split into several flights.
    reserve_pct : float
        Battery reserve, percent of endurance.
    max_waypoints : int
        Maximum number of waypoints in a file; by default that of the format.
    transit_mps : float
        Speed of transit legs, m/s.
    firmware : str
        Firmware of the autopilot.
    gimbal : str
        MAVLink gimbal protocol, or the older mount command.
    drone : str
        DJI model, for instance m30t.
    payload : int
        DJI payload number, if the model has no own one.
    least_seen_pct : float
        Share of the planned surface that the mission must show, percent.
    force : tuple of str
        Safety rule to overrule, by name; the mission records it. Repeatable.
    draft : bool
        Write a plan that is not released; the mission is marked as a draft.
    """

    altitude: Literal["relative", "amsl", "ellipsoid"] = "relative"
    home_m: tuple[float, float, float] | None = None
    clearance_m: float = 2.0
    max_height_m: float | None = None
    tolerance_m: float = 0.1
    tolerance_deg: float = 3.0
    corner_m: float = 0.5
    photos: Literal["viewpoints", "distance", "video", "none"] = "viewpoints"
    photo_distance_m: float = 2.0
    overlap: str = ""
    trigger_s: float | None = None
    camera: str = ""
    file_format: Literal["jpeg", "raw"] = "jpeg"
    endurance_s: float | None = None
    reserve_pct: float = 20.0
    max_waypoints: int | None = None
    transit_mps: float = 5.0
    firmware: Literal["px4", "ardupilot"] = "px4"
    gimbal: Literal["v2", "mount"] = "v2"
    drone: str = ""
    payload: int | None = None
    least_seen_pct: float = 95.0
    force: tuple[str, ...] = ()
    draft: Annotated[bool, Parameter(negative="")] = False


@app.default
def export(
    transfer: str,
    /,
    *,
    to: Annotated[Format, Parameter(help="Format of the mission.")],
    output: Annotated[
        Path, Parameter(name=("--output", "-o"), help="File to write; several flights are numbered.")
    ],
    flags: Flags | None = None,
    catalog: CatalogOption = "catalog",
) -> int:
    """Write a plan as a mission file, or as one for each flight, with its assumptions as notes.

    Vehicle and clearance come from the parameters of the plan (`upplied settings`) unless an option
    overrides them.

    Parameters
    ----------
    transfer : str
        ID of the plan, or its beginning.
    """
    from upplied.outputs.missions import MissionOptions
    from upplied.outputs.render import export_transfer

    options = MissionOptions(**asdict(flags or Flags()))
    store = opened(catalog)
    with errors.status("writing the mission"):
        written = export_transfer(store, store.find_transfer(transfer), to, beside(output), options)
    for path in written.paths:
        say(path)
    for note in written.notes:
        say(f"note: {note}")
    hint(f"Next: read the notes, then look at it in {OPENED_IN[to]}")
    return 0

"""`upplied export`: a plan as a mission file for an autopilot or a map."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import App, Parameter

from upplied.cli.terminal import CatalogOption, beside, hint, opened, say

app = App(name="export", help="Write a plan as a mission for an autopilot, or for a map.")

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
        What heights are counted from.
    home_m : tuple of float
        Take-off, x y z in the structure's frame, m; none: on the ground beside the structure.
    clearance_m : float
        That every leg keeps from take-off to landing, m.
    max_height_m : float
        No leg is higher above ground, m; none: 120, and higher only where the plan itself is.
    tolerance_m : float
        Waypoints are left out where the path strays less than this, m.
    tolerance_deg : float
        And where the camera turns less than this.
    corner_m : float
        How far a vehicle that passes a waypoint without a stop may stray from it, m.
    photos : str
        Where photos are taken: where overlap and coverage need them, by distance, none, or a film instead.
    photo_distance_m : float
        Between photos by distance, m.
    overlap : str
        Of photos along and across, %, as 80/70.
    trigger_s : float
        Least time between two photos, s; none: what is known of the camera, else 2.
    camera : str
        That flies, by its name in cameras.toml; none: that of the demonstration.
    file_format : str
        Of the photos: raw ones take longer.
    endurance_s : float
        Of one battery, s: longer missions are split into sorties.
    reserve_pct : float
        Of the endurance that is not planned with.
    max_waypoints : int
        Of one file; none: what the format takes.
    transit_mps : float
        Speed to and from the inspection, m/s.
    firmware : str
        Of the autopilot.
    gimbal : str
        MAVLink's gimbal protocol, or the older mount command.
    drone : str
        DJI's model, for instance m30t.
    payload : int
        DJI's payload number where the model has none of its own.
    least_seen_pct : float
        Of what the plan sees, that the mission must see as it is flown.
    force : tuple of str
        A rule of the gate that is overruled, by name; the mission says so. May be given several times.
    draft : bool
        Write a plan that nobody released; the mission says so, where its format has room for words.
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
    output: Annotated[Path, Parameter(name=("--output", "-o"), help="File; several sorties are numbered.")],
    flags: Flags | None = None,
    catalog: CatalogOption = "catalog",
) -> int:
    """Write a plan as a mission file, or one for each sortie, and say what was assumed.

    What the settings of the plan say of its vehicle and clearance (`upplied settings`) holds where no
    option says otherwise.

    Parameters
    ----------
    transfer : str
        Its id, as `upplied transfer` prints it, or how that begins.
    """
    from upplied.outputs.missions import MissionOptions
    from upplied.outputs.render import export_transfer

    options = MissionOptions(**asdict(flags or Flags()))
    store = opened(catalog)
    written = export_transfer(store, store.find_transfer(transfer), to, beside(output), options)
    for path in written.paths:
        say(path)
    for note in written.notes:
        say(f"note: {note}")
    hint(f"Next: read the notes, then look at it in {OPENED_IN[to]}")
    return 0

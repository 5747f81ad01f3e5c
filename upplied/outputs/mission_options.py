"""The pilot's options of a mission."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from upplied.errors import SettingsError

#: Rules about unreleased plans, which can only be exported as drafts.
DRAFTS = ("released", "foreign", "altered")
Altitude = Literal["relative", "amsl", "ellipsoid"]


@dataclass(frozen=True)
class MissionOptions:
    """Options of all formats; a format refuses options that it cannot express.

    Parameters
    ----------
    altitude : str
        Reference of altitudes.
    home_m : tuple of float
        Take-off point: x y z in metres, structure frame; by default on the ground beside the structure.
    clearance_m : float
        Minimum distance of every leg from the structure, in metres.
    max_height_m : float
        Maximum height of a leg above ground, in metres; by default 120, or the height of the plan.
    tolerance_m : float
        Largest deviation of the path, in metres, when waypoints are removed.
    tolerance_deg : float
        Largest deviation of the camera, in degrees, when waypoints are removed.
    corner_m : float
        Largest distance from a waypoint, in metres, when passing it without a stop.
    photos : str
        Trigger of the photos: where overlap and coverage need them, by distance, none, or a video instead.
    photo_distance_m : float
        Distance between photos, in metres.
    overlap : str
        Overlap of photos along and across the path in percent, such as 80/70.
    trigger_s : float
        Minimum time between two photos, in seconds; by default that of the camera if known, else 2.
    camera : str
        Name of the camera in cameras.toml; by default that of the demonstration.
    file_format : str
        File format of the photos; raw files take longer.
    endurance_s : float
        Endurance of one battery, in seconds; longer missions are split into several flights.
    reserve_pct : float
        Battery reserve, in percent of the endurance.
    max_waypoints : int
        Maximum number of waypoints in a file; by default that of the format.
    transit_mps : float
        Speed of transit legs, in m/s.
    firmware : str
        Firmware of the autopilot.
    gimbal : str
        MAVLink gimbal protocol, or the older mount command.
    drone : str
        DJI model, for instance m30t.
    payload : int
        DJI payload number, for models without a built-in payload.
    least_seen_pct : float
        Share of the planned surface that the mission must show, in percent.
    force : tuple of str
        Safety rule to overrule, by name; the mission records it. Repeatable.
    draft : bool
        Write a plan that is not released; the mission is marked as a draft.
    """

    altitude: Altitude = "relative"
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
    draft: bool = False

    @property
    def overruled(self) -> tuple[str, ...]:
        """Rules that are overruled; for a draft with those about unreleased plans."""
        return (*self.force, *DRAFTS) if self.draft else self.force

    @property
    def overlaps(self) -> tuple[float, float] | None:
        """Required overlap along and across, 0 to 1."""
        if not self.overlap:
            return None
        try:
            along, across = (float(part) / 100 for part in self.overlap.split("/"))
        except ValueError:
            along, across = -1.0, -1.0
        if not (0 < along < 0.99 and 0 <= across < 0.99):
            rule = "along and across in percent, such as 80/70"
            raise SettingsError("mission option overlap", f"is {self.overlap[:40]!r}", rule)
        return along, across

    def __post_init__(self) -> None:
        self.overlaps  # noqa: B018 - a wrong value is refused here
        if self.camera:
            from upplied.cameras import known_camera

            known_camera(self.camera, self.file_format)
        for rule in {*DRAFTS} & {*self.force}:
            raise SettingsError(f"rule {rule!r}", "is not overruled by name", "", "use --draft")
        for names, valid, rule in _RULES:
            for name in names.split():
                if (value := getattr(self, name)) is not None and not valid(value):
                    raise SettingsError(f"mission option {name}", f"is {value}", rule)


#: Options, their condition, and the condition in words.
_RULES: tuple[tuple[str, Callable[[float], bool], str], ...] = (
    ("clearance_m corner_m photo_distance_m transit_mps", lambda value: value > 0, "above 0"),
    ("trigger_s max_height_m endurance_s", lambda value: value > 0, "above 0"),
    ("tolerance_m tolerance_deg", lambda value: value >= 0, "0 or more"),
    ("reserve_pct", lambda value: 0 <= value < 100, "0 to below 100"),
    ("least_seen_pct", lambda value: 0 <= value <= 100, "0 to 100"),
    ("max_waypoints", lambda value: value >= 8, "8 or more"),
)

"""What the person who flies decides about a mission."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from upplied.cameras import known_camera
from upplied.errors import SettingsError

#: Rules of what nobody released as it is: it leaves as a draft alone.
DRAFTS = ("released", "foreign", "altered")
Altitude = Literal["relative", "amsl", "ellipsoid"]


@dataclass(frozen=True)
class MissionOptions:
    """Choices for every format; a format refuses what it cannot say."""

    altitude: Altitude = (
        "relative"  # of what is written: above take-off, above mean sea level, above the ellipsoid
    )
    home_m: tuple[float, float, float] | None = (
        None  # take-off, structure frame; None: on the ground, outside the box
    )
    clearance_m: float = 2.0  # that every leg keeps, from take-off to landing
    max_height_m: float | None = (
        None  # above ground, no leg higher; None: 120 m, and higher only where the plan is
    )
    tolerance_m: float = 0.1  # waypoints are left out where the path strays less than this
    tolerance_deg: float = 3.0  # and the camera turns less than this
    corner_m: float = 0.5  # how far a vehicle that passes a waypoint without a stop may stray from it
    # Where they suffice for overlap and coverage, by distance, none, or a film instead.
    photos: Literal["viewpoints", "distance", "video", "none"] = "viewpoints"
    photo_distance_m: float = 2.0  # between photos by distance
    overlap: str = ""  # of photos along and across, %, as 80/70; empty: what the interval leaves of 60 along
    trigger_s: float | None = None  # least time between two photos; None: what is known of the camera
    camera: str = ""  # that flies, by its name in `cameras.toml`; empty: that of the demonstration
    file_format: Literal["jpeg", "raw"] = "jpeg"  # of its photos
    endurance_s: float | None = None  # of one battery; None: the mission is not split for it
    reserve_pct: float = 20.0  # of the endurance that is not planned with
    max_waypoints: int | None = None  # of one file; None: what the format takes
    transit_mps: float = 5.0  # speed to, from and between inspections
    firmware: Literal["px4", "ardupilot"] = "px4"
    gimbal: Literal["v2", "mount"] = "v2"  # MAVLink's gimbal protocol, or the older mount command
    drone: str = ""  # DJI's model, for instance "m30t"; see `dji_wpml.DRONES`
    payload: int | None = None  # DJI's payload number where the model has none of its own
    least_seen_pct: float = 95.0  # of what the plan sees, that the mission must see as it is flown
    force: tuple[str, ...] = ()  # rules of the gate that are overruled, by name
    draft: bool = False  # a plan that nobody released, as it is or at all, may leave, and says so

    @property
    def overruled(self) -> tuple[str, ...]:
        """Rules that are overruled; a draft leaves by its own word alone."""
        return (*self.force, *DRAFTS) if self.draft else self.force

    @property
    def overlaps(self) -> tuple[float, float] | None:
        """Overlap that is asked for along and across, 0 to 1."""
        if not self.overlap:
            return None
        try:
            along, across = (float(part) / 100 for part in self.overlap.split("/"))
        except ValueError:
            along, across = -1.0, -1.0
        if not (0 < along < 0.99 and 0 <= across < 0.99):
            rule = "along and across in percent, as 80/70"
            raise SettingsError("mission option overlap", f"is {self.overlap[:40]!r}", rule)
        return along, across

    def __post_init__(self) -> None:
        self.overlaps  # noqa: B018 - asked early, so that it is refused early
        if self.camera:
            known_camera(self.camera, self.file_format)
        if self.trigger_s is not None and not self.trigger_s > 0:
            raise SettingsError("mission option trigger_s", f"is {self.trigger_s}", "above 0")
        for rule in {*DRAFTS} & {*self.force}:
            raise SettingsError(f"rule {rule!r}", "is not overruled by name", "", "say --draft")
        positive = ("clearance_m", "corner_m", "photo_distance_m", "transit_mps")
        for name in positive:
            if not getattr(self, name) > 0:
                raise SettingsError(f"mission option {name}", f"is {getattr(self, name)}", "above 0")
        if not 0 <= self.reserve_pct < 100:
            raise SettingsError("mission option reserve_pct", f"is {self.reserve_pct}", "0 to below 100")
        if min(self.tolerance_m, self.tolerance_deg) < 0:
            raise SettingsError("mission tolerances", "are negative", "0 or more")
        if self.max_height_m is not None and not self.max_height_m > 0:
            raise SettingsError("mission option max_height_m", f"is {self.max_height_m}", "above 0")
        if not 0 <= self.least_seen_pct <= 100:
            raise SettingsError("mission option least_seen_pct", f"is {self.least_seen_pct}", "0 to 100")
        if self.max_waypoints is not None and self.max_waypoints < 8:
            raise SettingsError("mission option max_waypoints", f"is {self.max_waypoints}", "8 or more")
        if self.endurance_s is not None and not self.endurance_s > 0:
            raise SettingsError("mission option endurance_s", f"is {self.endurance_s}", "above 0")

"""What the person who flies decides about a mission."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from upplied.errors import SettingsError

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
    clearance_m: float = 2.0  # that the legs to and from the inspection keep
    tolerance_m: float = 0.1  # waypoints are left out where the path strays less than this
    tolerance_deg: float = 3.0  # and the camera turns less than this
    photos: Literal["viewpoints", "distance", "none"] = "viewpoints"
    photo_distance_m: float = 2.0  # between photos by distance
    endurance_s: float | None = None  # of one battery; None: the mission is not split for it
    reserve_pct: float = 20.0  # of the endurance that is not planned with
    max_waypoints: int | None = None  # of one file; None: what the format takes
    transit_mps: float = 5.0  # speed to, from and between inspections
    firmware: Literal["px4", "ardupilot"] = "px4"
    gimbal: Literal["v2", "mount"] = "v2"  # MAVLink's gimbal protocol, or the older mount command
    drone: str = ""  # DJI's model, for instance "m30t"; see `dji_wpml.DRONES`
    payload: int | None = None  # DJI's payload number where the model has none of its own

    def __post_init__(self) -> None:
        positive = ("clearance_m", "photo_distance_m", "transit_mps")
        for name in positive:
            if not getattr(self, name) > 0:
                raise SettingsError(f"mission option {name}", f"is {getattr(self, name)}", "above 0")
        if not 0 <= self.reserve_pct < 100:
            raise SettingsError("mission option reserve_pct", f"is {self.reserve_pct}", "0 to below 100")
        if min(self.tolerance_m, self.tolerance_deg) < 0:
            raise SettingsError("mission tolerances", "are negative", "0 or more")
        if self.max_waypoints is not None and self.max_waypoints < 8:
            raise SettingsError("mission option max_waypoints", f"is {self.max_waypoints}", "8 or more")
        if self.endurance_s is not None and not self.endurance_s > 0:
            raise SettingsError("mission option endurance_s", f"is {self.endurance_s}", "above 0")

"""A camera, a trajectory and a demonstration."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from upplied.records.base import Bools, Floats, Ints, Record


@dataclass(frozen=True)
class Lens(Record):
    """Distortion of a lens, by the models of OpenCV."""

    model: str = "brown"  # or "fisheye", with even angles from the axis except for the coefficients
    coefficients: tuple[float, ...] = ()  # k1 k2 p1 p2 k3 k4 k5 k6; of a fisheye k1 k2 k3 k4
    middle: tuple[float, float] = (0.5, 0.5)  # principal point, shares of width and height


@dataclass(frozen=True, eq=False, repr=False)
class Camera(Record):
    """Field of view and useful range of the camera (paper, Sec. IV-A: 75 x 75 deg, 2 to 50 m)."""

    hfov_deg: float = 75.0  # full horizontal angle, up to 360
    vfov_deg: float = 75.0  # full vertical angle, up to 180
    min_range_m: float = 2.0
    max_range_m: float = 50.0
    width_px: int = 0  # 0 if unknown, here and below
    height_px: int = 0
    model: str = field(default="", metadata={"later": True})  # in `cameras.toml`; empty: unknown
    exposure_s: float = field(default=0.0, metadata={"later": True})  # of one picture
    trigger_s: float = field(default=0.0, metadata={"later": True})  # least time between two photos
    focus_m: float = field(default=0.0, metadata={"later": True})  # nearest distance that is in focus
    focal_mm: float = field(default=0.0, metadata={"later": True})
    f_number: float = field(default=0.0, metadata={"later": True})
    # Distortion; None: a pinhole. Plans ignore it.
    lens: Lens | None = field(default=None, metadata={"later": True})

    def zoomed(self, fov_deg: Floats) -> "list[Camera]":
        """The camera at each field of view (N, 2), horizontal and vertical, through which it zooms."""
        return [replace(self, hfov_deg=float(across), vfov_deg=float(up)) for across, up in fov_deg]


@dataclass(frozen=True, eq=False, repr=False)
class Trajectory(Record):
    """Timed camera poses in the frame of one structure."""

    t_s: Floats  # (N,) s, strictly increasing, first is 0
    positions: Floats  # (N, 3) m, structure frame
    quat_xyzw: Floats  # (N, 4) unit, camera to structure
    # (N, 2) horizontal and vertical, deg, if the camera zooms; None: constant
    fov_deg: Floats | None = field(default=None, metadata={"later": True})

    def __len__(self) -> int:
        return len(self.t_s)

    def take(self, index: Ints | Bools | slice) -> "Trajectory":
        """The poses of this index."""
        fov_deg = None if self.fov_deg is None else self.fov_deg[index]
        return Trajectory(self.t_s[index], self.positions[index], self.quat_xyzw[index], fov_deg)


@dataclass(frozen=True)
class LoggedWind:
    """The wind while a flight was logged, as its autopilot estimated it."""

    topic: str
    mean_mps: float
    most_mps: float
    towards_deg: float | None  # direction, counter-clockwise from +X; None: unknown heading


@dataclass(frozen=True, eq=False, repr=False)
class Demonstration(Record):
    """A flight of an expert round one structure, as logged."""

    demonstration_id: str
    structure_id: str
    t_ns: Ints  # (N,) ns, strictly increasing, source clock
    positions: Floats  # (N, 3) m, frame of the structure
    quat_xyzw: Floats  # (N, 4) unit, camera to structure
    camera: Camera = field(default_factory=Camera)
    operator: str = ""
    site: str = ""
    sha256: str = ""  # of the bytes of the log, with its side-car and options
    breaks: Ints = field(default_factory=lambda: np.empty(0, np.int64))  # first index after each gap
    degraded: bool = False  # salvaged; `notes` list the lost parts
    dropped: Mapping[str, int] = field(default_factory=dict)  # samples dropped, by reason
    clock: str = ""  # source of the time stamps: "header", "publish", "log"
    topic: str = ""
    notes: str = ""
    about: str = ""  # inspected surface by the user (`planning.demonstration.inspection`); empty: inferred
    passport: Mapping[str, object] = field(default_factory=dict)  # figures and findings, plain values
    # (N, 2) of each pose, deg, if the camera zooms; `camera` then has the narrowest
    fov_deg: Floats | None = field(default=None, metadata={"later": True})
    wind: LoggedWind | None = field(default=None, metadata={"later": True})  # None: not logged
    stills: bool = field(default=False, metadata={"later": True})  # photos with one pose each, no film
    accuracy_m: float | None = field(default=None, metadata={"later": True})  # of a flight, if stated

    def __len__(self) -> int:
        return len(self.t_ns)

    @property
    def trajectory(self) -> Trajectory:
        """The poses with time from zero, s."""
        return Trajectory((self.t_ns - self.t_ns[0]) * 1e-9, self.positions, self.quat_xyzw, self.fov_deg)

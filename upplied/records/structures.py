"""A structure, its place on the Earth, its surroundings, and its frame."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from upplied.records.base import Bools, Floats, Ints, Record

BURIED_M = 0.1  # under the declared ground or water, from where on surface counts as hidden: files are rough


@dataclass(frozen=True, eq=False, repr=False)
class Placement(Record):
    """The place of a structure on the Earth: the origin of its frame and the bearing of +X."""

    lat_deg: float
    lon_deg: float
    alt_m: float
    heading_deg: float  # of +X, clockwise from true north
    datum: str = "ellipsoid"  # of alt_m: "ellipsoid" (WGS 84) or "amsl"


@dataclass(frozen=True, eq=False, repr=False)
class Surroundings(Record):
    """Limits of a flight besides the structure itself, in the structure frame, m."""

    ground_z_m: float | None = None  # height of level ground or water, None if unknown
    keep_out_m: Floats = field(default_factory=lambda: np.empty((0, 2, 3)))  # (K, 2, 3) boxes, min and max
    geofence_m: Floats = field(default_factory=lambda: np.empty((0, 2)))  # (G, 2) polygon in x y, empty: none
    ceiling_z_m: float | None = None  # highest allowed z
    #: (R, 3) landing points other than home
    rally_m: Floats = field(default_factory=lambda: np.empty((0, 3)), metadata={"later": True})


@dataclass(frozen=True, eq=False, repr=False)
class Frame(Record):
    """A frame that is turned about the vertical and shifted from the declared one of a structure.

    ``p_declared = turn @ p + origin_m``; heights are the same in both.
    """

    heading_rad: float = 0.0  # of its +X, counter-clockwise from the declared +X
    origin_m: Floats = field(default_factory=lambda: np.zeros(3))  # (3,) m, declared frame; z is 0

    @property
    def turn(self) -> Floats:
        """(3, 3) directions of this frame to the declared one."""
        cos, sin = np.cos(self.heading_rad), np.sin(self.heading_rad)
        return np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])

    @property
    def is_declared(self) -> bool:
        """Whether it is the declared frame itself."""
        return self.heading_rad == 0 and not self.origin_m.any()

    def to_declared(self, points: Floats) -> Floats:
        """Points (..., 3), m, in the declared frame."""
        return points if self.is_declared else points @ self.turn.T + self.origin_m

    def from_declared(self, points: Floats) -> Floats:
        """Points (..., 3), m, of the declared frame in this one."""
        return points if self.is_declared else (points - self.origin_m) @ self.turn


@dataclass(frozen=True, eq=False, repr=False)
class Structure(Record):
    """One structure: a triangle mesh, or a point cloud if there are no triangles."""

    structure_id: str
    kind: str
    vertices: Floats  # (V, 3) m, structure frame
    triangles: Ints  # (T, 3) vertex indices; (0, 3) for a structure given as a point cloud
    normals: Floats | None = None  # (V, 3) outward unit normals, for point clouds only
    site: str = ""
    sha256: str = ""  # of the bytes of the file and of its entry in the manifest
    placement: Placement | None = None
    surroundings: Surroundings = field(default_factory=Surroundings)
    landmarks: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)  # name -> x y z, m
    symmetric: bool = False  # declared: the shape does not reveal the heading
    notes: str = ""
    # The rules that it broke at its import, and which of them were overruled.
    verdicts_json: str = field(default="", metadata={"later": True})
    # Declared: "drawn" or "scanned"; None: undeclared.
    surface: str | None = field(default=None, metadata={"later": True})
    # Declared error of its surface, m; None: inferred.
    surface_error_m: float | None = field(default=None, metadata={"later": True})
    # Whether its pieces are parts, unlike those of a scan; None: not determined at its import.
    tells_parts: bool | None = field(default=None, metadata={"later": True})

    @property
    def is_scan(self) -> bool:
        """Whether it was scanned: always for a point cloud, for a mesh if declared."""
        return self.surface == "scanned" or not len(self.triangles)

    @property
    def diagonal_m(self) -> float:
        """Length of the diagonal of the bounding box, m."""
        return self.derived("diagonal", lambda: float(np.linalg.norm(np.ptp(self.vertices, axis=0))))

    @property
    def floor_z_m(self) -> float:
        """Height of the ground, m: as declared, else of the lowest point."""
        ground = self.surroundings.ground_z_m
        return float(self.vertices[:, 2].min()) if ground is None else float(ground)

    def buried(self, points: Floats) -> Bools:
        """Which places (N, 3) lie under the declared ground or water, where no camera shows them."""
        ground = self.surroundings.ground_z_m
        return np.asarray(points[:, 2] < (-np.inf if ground is None else ground - BURIED_M), bool)

    @property
    def frame(self) -> Frame:
        """The declared frame, in which it is given."""
        return Frame()


@dataclass(frozen=True, eq=False, repr=False)
class StructureInFrame(Structure):
    """A structure in another frame than the declared one, during planning only; it is never stored.

    Vertices, normals and landmarks are in that frame; the surroundings stay in the declared one.
    """

    frame: Frame = Frame()

"""The nouns of the method: frozen records of arrays, with shape, unit and frame at each field.

Frames. Everything is in metres in the *structure frame*: Z up, +X forward (nose, bow, rotor hub,
long axis). A camera pose is a position and a quaternion ``x y z w`` that turns the camera frame
(x forward along the optical axis, y left, z up) into the structure frame. See CONVENTIONS.md.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]


class Record:
    """Base of the records: a repr that shows shapes, not numbers."""

    def __repr__(self) -> str:
        parts = []
        for item in fields(self):  # type: ignore[arg-type]
            value = getattr(self, item.name)
            shown = f"{value.dtype}{value.shape}" if isinstance(value, np.ndarray) else repr(value)
            parts.append(f"{item.name}={shown}")
        return f"{type(self).__name__}({', '.join(parts)})"


@dataclass(frozen=True, eq=False, repr=False)
class Placement(Record):
    """Where a structure stands on the Earth; the origin of its frame and the bearing of +X."""

    lat_deg: float
    lon_deg: float
    alt_m: float
    heading_deg: float  # of +X, clockwise from true north
    datum: str = "ellipsoid"  # of alt_m: "ellipsoid" (WGS 84) or "amsl"


@dataclass(frozen=True, eq=False, repr=False)
class Surroundings(Record):
    """What limits a flight besides the structure itself, in the structure frame, m."""

    ground_z_m: float | None = None  # height of level ground, None where it is not known
    keep_out_m: Floats = field(default_factory=lambda: np.empty((0, 2, 3)))  # (K, 2, 3) boxes, min and max
    geofence_m: Floats = field(default_factory=lambda: np.empty((0, 2)))  # (G, 2) polygon in x y, empty: none
    ceiling_z_m: float | None = None  # highest allowed z


@dataclass(frozen=True, eq=False, repr=False)
class Frame(Record):
    """A frame that is turned about the vertical and moved against the declared one of a structure.

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
    """One structure: a triangle mesh, or a point cloud where there are no triangles."""

    structure_id: str
    kind: str
    vertices: Floats  # (V, 3) m, structure frame
    triangles: Ints  # (T, 3) vertex indices; (0, 3) for a structure given as a point cloud
    normals: Floats | None = None  # (V, 3) outward unit normals, for point clouds only
    site: str = ""
    sha256: str = ""  # of the bytes of the file and of what the manifest says of it
    placement: Placement | None = None
    surroundings: Surroundings = field(default_factory=Surroundings)
    landmarks: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)  # name -> x y z, m
    symmetric: bool = False  # declared: no heading can be told from the shape
    notes: str = ""
    # The rules that it broke when it was taken in, and what was overruled.
    verdicts_json: str = field(default="", metadata={"later": True})

    @property
    def diagonal_m(self) -> float:
        """Length of the diagonal of the bounding box, m."""
        return float(np.linalg.norm(np.ptp(self.vertices, axis=0)))

    @property
    def frame(self) -> Frame:
        """Where it stands in the declared frame: it is given in it."""
        return Frame()


@dataclass(frozen=True, eq=False, repr=False)
class StructureInFrame(Structure):
    """A structure in another frame than the declared one, while it is planned; it is never stored.

    Vertices, normals and landmarks are in that frame; the surroundings keep to the declared one.
    """

    frame: Frame = Frame()


@dataclass(frozen=True, eq=False, repr=False)
class Camera(Record):
    """Field of view and useful range of the camera (paper, Sec. IV-A: 75 x 75 deg, 2 to 50 m)."""

    hfov_deg: float = 75.0  # full horizontal angle, up to 360
    vfov_deg: float = 75.0  # full vertical angle, up to 180
    min_range_m: float = 2.0
    max_range_m: float = 50.0
    width_px: int = 0  # 0 where not known
    height_px: int = 0


@dataclass(frozen=True, eq=False, repr=False)
class Trajectory(Record):
    """Timed camera poses in the frame of one structure."""

    t_s: Floats  # (N,) s, strictly increasing, first is 0
    positions: Floats  # (N, 3) m, structure frame
    quat_xyzw: Floats  # (N, 4) unit, camera to structure

    def __len__(self) -> int:
        return len(self.t_s)


@dataclass(frozen=True, eq=False, repr=False)
class Demonstration(Record):
    """What an expert flew around one structure, as logged."""

    demonstration_id: str
    structure_id: str
    t_ns: Ints  # (N,) ns, strictly increasing, source clock
    positions: Floats  # (N, 3) m, frame of the structure
    quat_xyzw: Floats  # (N, 4) unit, camera to structure
    camera: Camera = field(default_factory=Camera)
    operator: str = ""
    site: str = ""
    sha256: str = ""  # of the bytes of the log and of what the side-car and options say of it
    breaks: Ints = field(default_factory=lambda: np.empty(0, np.int64))  # first index after each gap
    degraded: bool = False  # salvaged; `notes` say what was lost
    dropped: Mapping[str, int] = field(default_factory=dict)  # samples dropped, by reason
    clock: str = ""  # which stamp was used: "header", "publish", "log"
    topic: str = ""
    notes: str = ""
    about: str = ""  # what the user says it inspected (`planning.demonstration.about`); empty: inferred
    passport: Mapping[str, object] = field(default_factory=dict)  # figures and findings, plain values

    def __len__(self) -> int:
        return len(self.t_ns)

    @property
    def trajectory(self) -> Trajectory:
        """The poses with time from zero, s."""
        return Trajectory((self.t_ns - self.t_ns[0]) * 1e-9, self.positions, self.quat_xyzw)


@dataclass(frozen=True, eq=False, repr=False)
class Cloud(Record):
    """Points that stand for a surface.

    From the paper's voxel filter: `points` alone. Surface samples carry normals and areas as well.
    """

    points: Floats  # (N, 3) m, structure frame
    normals: Floats | None = None  # (N, 3) unit, outward
    area_m2: Floats | None = None  # (N,) surface each sample stands for
    part: Ints | None = None  # (N,) which part of the structure (0 ..) the sample lies on
    leaf_m: float = 0.0  # edge of the voxels, 0 for surface samples

    def __len__(self) -> int:
        return len(self.points)


@dataclass(frozen=True, eq=False, repr=False)
class Registration(Record):
    """How a target lies on the demonstration structure.

    ``p_demo = rotation @ (scale * (turn @ p_target)) + translation`` (paper, Alg. 1, lines 3 to 8, which
    assumes equal orientation: ``rotation @ turn`` is the identity unless another one was declared or found).
    """

    scale: Floats  # (3,) along the axes of the turned target
    rotation: Floats  # (3, 3) proper
    translation: Floats  # (3,) m
    score_m2: float  # PCL's getFitnessScore: mean squared nearest-neighbour distance, demonstration to target
    accepted: bool
    reason: str = ""  # why not, in words, where it is refused
    acceptance: float = float("nan")  # free of density and scale, lower is better; NaN where not computed
    runner_up_gap: float = float("nan")  # relative gap to the next best orientation; NaN where not searched
    evidence: str = ""  # what was tried and found, in words
    turn: Floats = field(default_factory=lambda: np.eye(3))  # (3, 3) proper, of the target before its scaling

    @property
    def matrix(self) -> Floats:
        """(3, 3) linear part: ``p_demo = matrix @ p_target + translation``."""
        return np.asarray((self.rotation * self.scale) @ self.turn, float)

    def to_demo(self, points: Floats) -> Floats:
        """Target frame (..., 3) to demonstration frame, m."""
        return points @ self.matrix.T + self.translation

    def to_target(self, points: Floats) -> Floats:
        """Demonstration frame (..., 3) to target frame, m."""
        return (((points - self.translation) @ self.rotation) / self.scale) @ self.turn


@dataclass(frozen=True, eq=False, repr=False)
class Correspondences(Record):
    """For every point of the demonstration's cloud its counterpart on the target."""

    target_index: Ints  # (N_demo,) index into the target's cloud, -1 where there is no counterpart
    distance_m: Floats  # (N_demo,) between the partners after alignment; NaN where there is none
    target_points: Floats  # (N_demo, 3) m, target frame: where each point is carried, NaN where nowhere
    summary: str = ""  # parts matched and parts left without a counterpart, in words
    source_class: Ints | None = None  # (K,) of each part of the demonstration's cloud, -1: in none
    target_class: Ints | None = None  # (L,) of each part of the target's: parts of one class were matched

    def parts_answering(self, part: int) -> Ints:
        """The target's parts that were matched with a part of the source; none where it was not."""
        if self.source_class is None or self.target_class is None or self.source_class[part] < 0:
            return np.empty(0, np.int64)
        return np.flatnonzero(self.target_class == self.source_class[part])


@dataclass(frozen=True, eq=False, repr=False)
class Visibility(Record):
    """Which points of a cloud each pose sees."""

    seen: Bools  # (P, N) pose by point

    @property
    def total(self) -> Bools:
        """(N,) seen by any pose: the paper's V_D."""
        return np.asarray(self.seen.any(axis=0), bool)


@dataclass(frozen=True, eq=False, repr=False)
class Viewpoints(Record):
    """One viewpoint per segment of a trajectory (paper, Alg. 2, lines 5 to 13)."""

    positions: Floats  # (K, 3) m, structure frame
    quat_xyzw: Floats  # (K, 4) unit, camera to structure
    seen: Bools  # (K, N) union over the segment
    start: Ints  # (K,) first pose of the segment
    stop: Ints  # (K,) one past its last pose
    t_s: Floats  # (K,) s, time of the segment's middle

    def __len__(self) -> int:
        return len(self.positions)

    @property
    def middle(self) -> Ints:
        """(K,) pose in the middle of each segment."""
        return np.asarray((self.start + self.stop - 1) // 2, np.int64)


@dataclass(frozen=True, eq=False, repr=False)
class Waypoints(Record):
    """Camera poses in the order of flight, before they have times of their own."""

    positions: Floats  # (W, 3) m, structure frame
    quat_xyzw: Floats  # (W, 4) unit, camera to structure
    t_s: Floats  # (W,) s, time of the demonstration that each answers to; never decreases
    is_viewpoint: Bools  # (W,)

    def __len__(self) -> int:
        return len(self.positions)

    def __getitem__(self, part: slice) -> Waypoints:
        """The waypoints of a slice."""
        return Waypoints(self.positions[part], self.quat_xyzw[part], self.t_s[part], self.is_viewpoint[part])


@dataclass(frozen=True, eq=False, repr=False)
class Measures(Record):
    """What a plan is judged by; NaN where a measure was not computed (algorithm.md, section 8)."""

    acceptance_probability: float = float("nan")
    counterpart_probability: float = float("nan")
    coverage_inspected_pct: float = float("nan")
    inspected_without_counterpart_pct: float = float("nan")
    inspected_unattainable_pct: float = float("nan")
    coverage_of_target_pct: float = float("nan")
    coverage_context_pct: float = float("nan")
    fidelity_resolution_p50: float = float("nan")
    fidelity_resolution_p05: float = float("nan")
    fidelity_incidence_deg_p95: float = float("nan")
    fidelity_looks_kept_pct: float = float("nan")
    fidelity_dwell_kept_pct: float = float("nan")
    fidelity_order: float = float("nan")
    camera_turn_ratio: float = float("nan")
    pan_fast_pct: float = float("nan")
    path_turn_ratio: float = float("nan")
    gsd_mm_p50: float = float("nan")
    gsd_mm_p95: float = float("nan")
    gsd_demonstrated_mm_p50: float = float("nan")
    gsd_demonstrated_mm_p95: float = float("nan")
    coverage_paper_pct: float = float("nan")
    coverage_seen_pct: float = float("nan")
    coverage_attainable_pct: float = float("nan")
    frechet_z: float = float("nan")
    frechet_floored: float = float("nan")
    frechet_m: float = float("nan")
    min_clearance_m: float = float("nan")
    path_length_m: float = float("nan")
    duration_s: float = float("nan")
    standoff_ratio_p50: float = float("nan")
    standoff_kept_pct: float = float("nan")
    incidence_p95_deg: float = float("nan")
    peak_speed_mps: float = float("nan")
    peak_acceleration_mps2: float = float("nan")


#: What became of a piece of a structure's surface; `SurfaceStates.state` indexes this.
SURFACE_STATES = (
    "other",
    "shown",
    "missed",
    "unattainable",
    "no counterpart",
    "hardly inspected",
    "partly inspected",
    "inspected",
)


@dataclass(frozen=True, eq=False, repr=False)
class SurfaceStates(Record):
    """What became of each piece of a target's surface, or what of a source's was inspected, for reports.

    `other` was not inspected by the demonstration, and `no counterpart` has no partner on the other one.
    """

    points: Floats  # (N, 3) m, target frame
    state: Ints  # (N,) index into SURFACE_STATES
    normals: Floats | None = None  # (N, 3) unit, outward


@dataclass(frozen=True, repr=False)
class Counterpart(Record):
    """What answers on the target to one part that was inspected."""

    part: str  # of the source, with its place: ``part_3 (left low)``
    inspected_pct: float  # share of what was inspected that lies on it
    twins: int  # other parts of the source of its shape and size
    found: int  # parts of the target of its shape and size
    flown: tuple[str, ...] = ()  # parts of the target that the plan flies to
    left_out: tuple[str, ...] = ()  # those of its shape that it does not, each with the reason
    probability: float | None = None  # least of the flown ones, to be the right part; None: not told apart
    doubt: str = ""  # why it is not certain which part of the target answers to it; empty where it is


@dataclass(frozen=True, eq=False, repr=False)
class Plan(Record):
    """What came of transferring one demonstration to one target: a trajectory, or a reason why not."""

    demonstration_id: str
    source_id: str
    target_id: str
    kind: str
    preset: str  # "paper", "recommended" or "baseline"
    status: str  # "ok", "refused" or "failed"
    reason: str = ""
    trajectory: Trajectory | None = None
    is_viewpoint: Bools | None = None  # (N,) of the trajectory
    registration: Registration | None = None
    measures: Measures = field(default_factory=Measures)
    counterpart_summary: str = ""
    counterparts: tuple[Counterpart, ...] = ()  # of each inspected part, the most inspected first
    acceptance_evidence: str = ""  # what speaks for and against the transfer, in words
    warnings: tuple[str, ...] = ()
    surface: SurfaceStates | None = None  # what the plan sees of the target, where it was computed
    inspected: SurfaceStates | None = None  # what of the source the demonstration was about
    flyable: bool = False  # whether it may be flown as it is
    not_flyable: str = ""  # why not, in words
    surface_sha256: str = ""  # of `surface`, where that was stored already and is left out here
    inspected_sha256: str = ""  # of `inspected`, likewise

    @property
    def n_viewpoints(self) -> int:
        """How many waypoints are viewpoints."""
        return 0 if self.is_viewpoint is None else int(self.is_viewpoint.sum())

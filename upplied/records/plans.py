"""A plan, its measures, the surface that it shows, and the surface that it is required to show."""

from dataclasses import dataclass, field

from upplied.records.base import Bools, Floats, Ints, Record, Rows
from upplied.records.flights import Trajectory
from upplied.records.planning import Registration


@dataclass(frozen=True, eq=False, repr=False)
class Measures(Record):
    """The measures of a plan; NaN if not computed."""

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
    gsd_within_pct: float = float("nan")
    blur_px_p50: float = float("nan")
    blur_px_p99: float = float("nan")
    defocus_px_p95: float = float("nan")
    picture_score: float = float("nan")
    coverage_paper_pct: float = float("nan")
    coverage_seen_pct: float = float("nan")
    coverage_attainable_pct: float = float("nan")
    frechet_z: float = float("nan")
    frechet_floored: float = float("nan")
    frechet_m: float = float("nan")
    frechet_demonstrated_m: float = float("nan")
    min_clearance_m: float = float("nan")
    surface_error_m: float = float("nan")
    never_scanned_m2: float = float("nan")
    path_length_m: float = float("nan")
    duration_s: float = float("nan")
    standoff_ratio_p50: float = float("nan")
    standoff_kept_pct: float = float("nan")
    incidence_p95_deg: float = float("nan")
    peak_speed_mps: float = float("nan")
    peak_acceleration_mps2: float = float("nan")


#: States of a piece of a structure's surface; `SurfaceStates.state` indexes them.
SURFACE_STATES = (
    "other",
    "shown",
    "missed",
    "unattainable",
    "no counterpart",
    "hardly inspected",
    "partly inspected",
    "inspected",
    "seen if corrected",
    "in view only",
    "inspected if corrected",
)


@dataclass(frozen=True, eq=False, repr=False)
class SurfaceStates(Record):
    """The state of each piece of a target's surface, or of a source's inspected surface, for reports.

    `other` was not inspected by the demonstration; `no counterpart` has none on the other structure. For a
    flight, `seen if corrected` and `inspected if corrected` hold only if the correction of its log is right,
    and `in view only` was shown less finely or sharply than planned.
    """

    points: Floats  # (N, 3) m, target frame
    state: Ints  # (N,) index into SURFACE_STATES
    normals: Floats | None = None  # (N, 3) unit, outward


@dataclass(frozen=True, eq=False, repr=False)
class SupposedSurface(Record):
    """Unscanned surface of a target, inferred from the source: a disc for each of its samples.

    A path keeps clear of all of it; only likely surface occludes.
    """

    points: Floats  # (K, 3) m, target frame
    normals: Floats  # (K, 3) unit, outward
    corner: Floats  # (K, 3) unit, perpendicular to each normal: to the first of a disc's six corners
    radius_m: Floats  # (K,) of the discs
    likely: Bools  # (K,) False: doubtful, where the target may continue past an open end
    error_m: float  # position error of the surface


@dataclass(frozen=True, eq=False, repr=False)
class Photos(Rows):
    """The photos of a plan, if its demonstration consists of photos, in the order of flight."""

    t_s: Floats  # (K,) from the start of the plan
    positions: Floats  # (K, 3) m, target frame
    quat_xyzw: Floats  # (K, 4) unit, camera to structure
    patches: Ints  # (K,) samples of the target's surface that each shows sharply
    gsd_mm: Floats  # (K,) ground sample distance, median over these; NaN if there are none
    blur_px: Floats  # (K,) motion during the exposure, likewise
    overlap_pct: Floats  # (K,) share of its patches that the previous photo shows too; NaN for the first


@dataclass(frozen=True, repr=False)
class Counterpart(Record):
    """The counterpart on the target of one inspected part."""

    part: str  # of the source, with its place: ``part_3 (left low)``
    inspected_pct: float  # share of the inspected surface that lies on it
    twins: int  # other parts of the source of its shape and size; of one piece, those that were not inspected
    found: int  # parts of the target of its shape and size
    flown: tuple[str, ...] = ()  # parts of the target that the plan flies to
    left_out: tuple[str, ...] = ()  # similar parts that it does not fly to, each with the reason
    probability: float | None = None  # that the flown part is the right one, the least; None: unknown
    doubt: str = ""  # reason why the matching is uncertain; empty if it is certain
    never_scanned_pct: float = 0.0  # share of its inspected surface that was never scanned on the target
    open: tuple[str, ...] = ()  # flown parts of the target on which the scan ends


@dataclass(frozen=True, eq=False, repr=False)
class Plan(Record):
    """The transfer of one demonstration to one target: a trajectory, or the reason why there is none."""

    demonstration_id: str
    source_id: str
    target_id: str
    kind: str
    preset: str  # "paper", "recommended" or "baseline"
    status: str  # "ok", "refused" or "failed"
    reason: str = ""
    trajectory: Trajectory | None = None
    is_viewpoint: Bools | None = None  # (N,) of the trajectory
    added: Bools | None = None  # (N,) on passes added to the demonstrated ones, or on transits to them
    registration: Registration | None = None
    measures: Measures = field(default_factory=Measures)
    counterpart_summary: str = ""
    counterparts: tuple[Counterpart, ...] = ()  # of each inspected part, the most inspected first
    parts_told_by: str = ""  # reference model that labelled the parts of a scan; empty: none
    acceptance_evidence: str = ""  # evidence for and against the transfer, in words
    warnings: tuple[str, ...] = ()
    surface: SurfaceStates | None = None  # of the target, if computed
    inspected: SurfaceStates | None = None  # of the source
    supposed: SupposedSurface | None = None  # of the target, never scanned; the path keeps clear of it
    flyable: bool = False  # whether it may be flown
    not_flyable: str = ""  # the reason, in words
    surface_sha256: str = ""  # of `surface`, if that is stored already and omitted here
    inspected_sha256: str = ""  # of `inspected`, likewise
    supposed_sha256: str = ""  # of `supposed`, likewise
    photos: Photos | None = None  # at its viewpoints, if the demonstration consists of photos
    photos_sha256: str = ""  # of `photos`, likewise

    @property
    def n_viewpoints(self) -> int:
        """Number of waypoints that are viewpoints."""
        return 0 if self.is_viewpoint is None else int(self.is_viewpoint.sum())


@dataclass(frozen=True, eq=False, repr=False)
class RequiredSurface(Record):
    """Samples of the whole surface of a structure, with the requirements of those in a zone."""

    points: Floats  # (S, 3) m, declared frame of the structure
    normals: Floats  # (S, 3) unit, outward
    zone: Bools  # (S,) whether it must be seen; other samples define the boundary of the zone
    gsd_m: Floats  # (S,) maximum ground sample distance; infinite without a requirement
    incidence_deg: Floats  # (S,) maximum angle from the normal; 90 without a requirement

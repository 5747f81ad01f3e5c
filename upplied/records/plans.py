"""A plan, its measures and what it sees of its target."""

from __future__ import annotations

from dataclasses import dataclass, field

from upplied.records.base import Bools, Floats, Ints, Record, Rows
from upplied.records.flights import Trajectory
from upplied.records.planning import Registration


@dataclass(frozen=True, eq=False, repr=False)
class Measures(Record):
    """What a plan is judged by; NaN where a measure was not computed."""

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
    "seen if corrected",
    "in view only",
    "inspected if corrected",
)


@dataclass(frozen=True, eq=False, repr=False)
class SurfaceStates(Record):
    """What became of each piece of a target's surface, or what of a source's was inspected, for reports.

    `other` was not inspected by the demonstration, and `no counterpart` has no partner on the other one. A
    flight showed what is `seen if corrected` or `inspected if corrected` only if its log was rightly moved
    onto its plan, and what is `in view only` less finely or sharply than its plan asks.
    """

    points: Floats  # (N, 3) m, target frame
    state: Ints  # (N,) index into SURFACE_STATES
    normals: Floats | None = None  # (N, 3) unit, outward


@dataclass(frozen=True, eq=False, repr=False)
class SupposedSurface(Record):
    """Surface of a target that nobody scanned, where the source has it: a disc for each of its samples.

    What is likely to be there hides what lies behind it; of what may be there a path keeps clear alone.
    """

    points: Floats  # (K, 3) m, target frame
    normals: Floats  # (K, 3) unit, outward
    corner: Floats  # (K, 3) unit, across each normal: to the first of the six corners that a disc is drawn by
    radius_m: Floats  # (K,) of the discs
    likely: Bools  # (K,) or doubtful: where the target may go on past an open end
    error_m: float  # how far the surface may be from there


@dataclass(frozen=True, eq=False, repr=False)
class Photos(Rows):
    """The photos of a plan whose demonstration was one of photos, in the order of flight."""

    t_s: Floats  # (K,) from the start of the plan
    positions: Floats  # (K, 3) m, target frame
    quat_xyzw: Floats  # (K, 4) unit, camera to structure
    patches: Ints  # (K,) samples of the target's surface that each shows sharply
    gsd_mm: Floats  # (K,) ground sample distance, median over these; NaN where there are none
    blur_px: Floats  # (K,) motion during the exposure, likewise
    overlap_pct: Floats  # (K,) of what it shows, the share that the one before shows too; NaN for the first


@dataclass(frozen=True, repr=False)
class Counterpart(Record):
    """What on the target corresponds to one part that was inspected."""

    part: str  # of the source, with its place: ``part_3 (left low)``
    inspected_pct: float  # share of what was inspected that lies on it
    twins: int  # other parts of the source of its shape and size
    found: int  # parts of the target of its shape and size
    flown: tuple[str, ...] = ()  # parts of the target that the plan flies to
    left_out: tuple[str, ...] = ()  # those of its shape that it does not, each with the reason
    probability: float | None = None  # least of the flown ones, to be the right part; None: not told apart
    doubt: str = ""  # why it is not certain which part of the target corresponds to it; empty where it is
    never_scanned_pct: float = 0.0  # share of what was inspected of it, that was never scanned on the target
    open: tuple[str, ...] = ()  # parts of the target, flown to, whose scan ends on them: their inside shows


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
    added: Bools | None = None  # (N,) on passes added to the demonstrated ones, or on transits to them
    registration: Registration | None = None
    measures: Measures = field(default_factory=Measures)
    counterpart_summary: str = ""
    counterparts: tuple[Counterpart, ...] = ()  # of each inspected part, the most inspected first
    parts_told_by: str = ""  # the sibling that told the parts of a scan; empty where none did
    acceptance_evidence: str = ""  # what speaks for and against the transfer, in words
    warnings: tuple[str, ...] = ()
    surface: SurfaceStates | None = None  # what the plan sees of the target, where it was computed
    inspected: SurfaceStates | None = None  # what of the source the demonstration was about
    supposed: SupposedSurface | None = None  # of the target, never scanned; the path keeps clear of it
    flyable: bool = False  # whether it may be flown as it is
    not_flyable: str = ""  # why not, in words
    surface_sha256: str = ""  # of `surface`, where that was stored already and is left out here
    inspected_sha256: str = ""  # of `inspected`, likewise
    supposed_sha256: str = ""  # of `supposed`, likewise
    photos: Photos | None = None  # at its viewpoints, where the demonstration was one of photos
    photos_sha256: str = ""  # of `photos`, likewise

    @property
    def n_viewpoints(self) -> int:
        """How many waypoints are viewpoints."""
        return 0 if self.is_viewpoint is None else int(self.is_viewpoint.sum())

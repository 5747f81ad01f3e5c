"""Settings: one frozen class for each stage, each default in one place, with its reason."""

import math
from dataclasses import dataclass
from typing import Annotated, Literal, NamedTuple


class Range(NamedTuple):
    low: float
    high: float


Count = Annotated[int, Range(1, 1000)]
Incidence = Annotated[float, Range(1, 90)]
Metres = Annotated[float, Range(0, 1000)]
Motion = Annotated[float, Range(0.01, 100)]  # m/s or m/s2
Pitch = Annotated[float, Range(-90, 90)]
Positive = Annotated[float, Range(0, math.inf)]
Ratio = Annotated[float, Range(1, 1e6)]
Share = Annotated[float, Range(0, 1)]
TurnRate = Annotated[float, Range(0.1, 1000)]
Weight = Annotated[float, Range(0, 1000)]
Drone = Literal[
    "", "m300", "m350", "m30", "m30t", "m3e", "m3t", "m3m", "m3d", "m3td", "m4e", "m4t", "m4d", "m4td", "m400"
]


@dataclass(frozen=True)
class CloudSettings:
    """Voxel clouds (paper, Sec. III-A) and surface samples."""

    # The leaf size is chosen so that about this many points remain; the paper's clouds have 693 and 1120.
    voxel_points: Annotated[int, Range(50, 100_000)] = 1000
    # Area-uniform points on the mesh that the voxel filter reads (the paper's Psi).
    raw_points: Annotated[int, Range(1000, 10_000_000)] = 60_000
    surface_samples: Annotated[int, Range(100, 200_000)] = 4000  # with normals, on the outside surface
    seed: int = 0  # of the points drawn on the surfaces


@dataclass(frozen=True)
class RegistrationSettings:
    """Convergence check (paper, Sec. III-A)."""

    iterations: Count = 30  # fixed number, as in the paper
    # Limit of the score in units of the squared spacing of the demonstration's cloud (its leaf), because the
    # score in m^2 grows with both. Of 1424 ordered pairs of real structures in clouds of 1000 points, 1.9
    # refuses 3 % of the pairs of one form (airliners 0.2 to 1.3, turbines up to 1.2, hulls up to 2.1) and
    # accepts 9 % of the pairs of different kinds: no gamma separates them, `acceptance` does.
    gamma: Positive = 1.9
    # Search for the heading or the full orientation of a target; the paper assumes equal orientation.
    search: Literal["none", "heading", "orientation"] = "none"
    # Limit of the misfit (`planning.acceptance`), free of density and scale; None: gamma only, as published.
    # At 1.0, of all pairs of 40 real structures, 95.5 % of one form and 0.6 % of different kinds are
    # accepted, 96.5 and 0.3 % with the samples (bench/acceptance.py, which also calibrates on halves).
    acceptance: Positive | None = None
    # Least probability that most of the inspected surface can be shown (`planning.carry.forecast`); it
    # replaces the limits above; None: they decide. Calibrated by bench/forecast.py. Of 71 real pairs of
    # one kind that can show at least 90 % three have less than 0.75: 0.67, and 0.58 and 0.61, whose parts are
    # doubtful, too. Of 162 pairs of different kinds four have more than 0.5: 0.52, twice 0.60, and
    # 0.87 (a river cruise ship that is as much a box as an office block).
    least_probability: Share | None = None


@dataclass(frozen=True)
class CorrespondenceSettings:
    """The point of the target that corresponds to each point of the demonstration's cloud (Sec. III-B)."""

    method: Literal["nearest", "parts"] = "nearest"  # the nearest point, as published, or part to part
    counterparts: tuple[tuple[str, str], ...] = ()  # landmark pairs: (on the source, on the target)
    repeat: Literal["", "each", "mirror"] = ""  # fly each similar part, or the mirrored part too
    # Number of similar parts that the target must have; a plan for any other number is refused.
    expect: Count | None = None
    # Least probability that an inspected part's counterpart is the right one (`correspondence.fit`).
    # Below it a plan is refused if the part was named or similar parts exist; otherwise it gets a warning.
    least_probability: Share = 0.0
    # Number of reference models for the parts of a scan: structures of the kind, modelled in pieces, with the
    # most similar proportions (`correspondence.siblings`); 0: none.
    siblings: Annotated[int, Range(0, 20)] = 0


@dataclass(frozen=True)
class VisibilitySettings:
    """Visibility of surface from a pose (Sec. III-C): the frustum only, or with occlusion and incidence."""

    occlusion: bool = False  # whether occluded surface counts as unseen
    max_incidence_deg: Incidence = 90.0  # between the surface normal and the ray back to the camera


@dataclass(frozen=True)
class ViewpointSettings:
    """The views of a flight that are carried to the target: segments (paper, Alg. 2), or every pose."""

    method: Literal["segments", "poses"] = "segments"  # a view of each segment, as published, or every pose
    # lambda: a segment ends where less than this share of its first view is still seen; the paper gives no
    # value. At 0.5 a flight round an airliner, seen by frustum from 10 m, has only 3 viewpoints and the
    # shape is lost (Frechet distance 2.4 on the demonstrated structure itself). On the fifteen sample rows
    # 0.97 covers 98.3 % by frustum at a mean Frechet z of 1.63; 0.9 covers 96.9 % at 2.06.
    shared: Share = 0.97
    most_poses: Annotated[int, Range(2, 100_000)] = 1500  # a longer flight is thinned evenly


@dataclass(frozen=True)
class TransferSettings:
    """The mapping of viewpoints to the target (Eqs. 1 and 2, the baseline's box ratio, or counterparts)."""

    # zscore: mean and spread of the clouds, as published; box: ratio of the boxes; counterparts: by surface.
    method: Literal["zscore", "box", "counterparts"] = "zscore"
    standoff: Literal["scaled", "kept"] = "scaled"  # demonstrated distance: times the scale, or in metres
    # Ground sampling distance, m per pixel, instead of the demonstrated stand-off.
    gsd_m: Annotated[float, Range(1e-5, 10)] | None = None
    plane: bool = False  # a demonstration in a plane stays in its plane


@dataclass(frozen=True)
class RefineSettings:
    """Optimisation of the viewpoints (Eq. 3, or of the whole path with occlusion)."""

    # `view` optimises the whole path for the inspected surface (`OptimiseSettings`).
    method: Literal["none", "gauss-newton", "view"] = "gauss-newton"
    iterations: Annotated[int, Range(0, 1000)] = 20  # maximum
    # Trade-off between the demonstrated shape and coverage, chosen by the user (`FIDELITIES`).
    fidelity: Literal["strict", "balanced", "coverage"] = "balanced"
    # Limit of the Frechet distance, z-scored; None: a warning only.
    deviation: Annotated[float, Range(0.01, 10)] | None = None
    # Least share of the inspected surface with a counterpart on the target.
    least_counterpart: Share = 0.5
    # Maximum number of passes added on each side of a demonstrated one to keep its mm/px; 0: none.
    added_passes: Annotated[int, Range(0, 3)] = 2
    # Flight time over the demonstration's, scaled by the ratio of the areas, beyond which each percent has to
    # show a percent more.
    longer: Annotated[float, Range(0, 10)] = 1.25


@dataclass(frozen=True)
class RouteSettings:
    """Safety of the whole path; the paper states only the 2 m of its experiments (Sec. IV-A)."""

    enforce: bool = False  # whether a path that breaks the limits below is corrected, or else refused
    clearance_m: Metres = 2.0  # least distance of the whole path from the structure
    ground_clearance_m: Metres = 1.0  # least height above known ground


@dataclass(frozen=True)
class RetimeSettings:
    """Time stamps: the demonstrated speed (Sec. III-C), or that speed under the limits of the vehicle."""

    limits: bool = False  # whether the vehicle's limits below hold
    max_speed_mps: Motion = 8.0  # the demonstrated speed counts if it is less
    # Speed without a demonstration, between passes and across gaps of a log, unless the expert flew faster
    # somewhere: braking at 2 m/s^2, a vehicle stops within half of the safety distance.
    transit_speed_mps: Motion = 2.0
    max_climb_mps: Motion = 5.0  # upwards; both as for common camera drones (DJI Phantom 4: 5 and 3 m/s)
    max_descent_mps: Motion = 3.0  # downwards: through its own downwash a rotor loses lift
    max_acceleration_mps2: Motion = 2.0  # of the vehicle, braking too
    max_yaw_rate_degps: TurnRate = 60.0  # of the heading
    # Of the heading: half a second to its full rate.
    max_yaw_acceleration_degps2: Annotated[float, Range(0.1, 10_000)] = 120.0
    max_gimbal_rate_degps: TurnRate = 60.0  # of its pitch
    # Hovering of the expert for at least so long is repeated.
    least_stop_s: Annotated[float, Range(0, 3600)] = 3.0
    min_gimbal_pitch_deg: Pitch = -90.0  # straight down
    max_gimbal_pitch_deg: Pitch = 30.0  # 0 is level


@dataclass(frozen=True)
class InspectionSettings:
    """Limits within which a plan shows a patch as well as the expert did: the same for every preset."""

    least_resolution: Share = 0.8  # share of the resolution that the stand-off mode requires for the patch
    # The same for planning where the demonstrated mm/px is kept: at most 1.1 times as coarse.
    planned_resolution: Share = 1 / 1.1
    max_incidence_deg: Incidence = 75.0  # from the normal, of the view that shows the patch
    # Of the picture during one exposure, unless the expert's own was more.
    max_motion_px: Annotated[float, Range(0.01, 1000)] = 1.0
    exposure_s: Annotated[float, Range(1e-6, 1)] = 1 / 500  # of one picture, if that of the camera is unknown
    # Width of the pictures for motion in pixels, or that of the camera if larger.
    width_px: Annotated[int, Range(16, 100_000)] = 4000
    about: str = ""  # inspected surface: landmarks, part_3, box X Y Z X Y Z; empty: inferred

    def sharp_radps(self, hfov_deg: float, width_px: int = 0, exposure_s: float = 0.0) -> float:
        """Maximum speed of a sharp point near the middle of a camera's picture, rad/s.

        `width_px` and `exposure_s` are those of the camera, 0 if unknown.
        """
        focal = focal_px(max(self.width_px, width_px), hfov_deg)
        return self.max_motion_px / ((exposure_s or self.exposure_s) * focal)


@dataclass(frozen=True)
class VerdictSettings:
    """Limits of a plan that may be flown; with `enforce` others are refused, else they have the verdict."""

    enforce: bool = False  # whether a plan beyond a limit is refused, or only marked as not flyable
    # Shown at least as well; less is no repetition of the inspection.
    least_inspected_pct: Annotated[float, Range(0, 100)] = 60.0
    # Times the demonstration's, carried to the target's size.
    longest_path: Annotated[float, Range(1, 1000)] = 3.0
    # The same; the demonstrated speed is an upper bound, turns cost time.
    longest_time: Annotated[float, Range(1, 1000)] = 4.0
    # Ratio of the diagonals, target to source or back: a wrong unit shows in it. Inches for metres are 39
    # times; the paper's own pairs reach 7.9 (cruise ship to yacht), real ones that can be shown 11.
    most_size_ratio: Ratio = 20.0  # beyond it a plan is refused
    odd_size_ratio: Ratio = 3.0  # beyond it a plan gets a warning


@dataclass(frozen=True)
class RequiredSettings:
    """Required zones (`upplied require`), which a plan shows first if its flight passes near them."""

    zones: str = ""  # hash of the requirements, as part of the plan's identity; empty: none


@dataclass(frozen=True)
class VehicleSettings:
    """The aircraft for which missions are written; its limits of motion are in stage `retime`."""

    drone: Drone = ""  # DJI's model; empty: another
    # DJI's payload number for models without a built-in payload.
    payload: Annotated[int, Range(0, 65_535)] | None = None
    firmware: Literal["px4", "ardupilot"] = "px4"  # of other aircraft
    # Of one battery: longer missions are split into sorties.
    endurance_s: Annotated[float, Range(1, 1e6)] | None = None
    reserve_pct: Annotated[float, Range(0, 99)] = 20.0  # battery reserve, share of the endurance


@dataclass(frozen=True)
class Fidelity:
    """Required similarity of a path to the demonstrated shape."""

    deviation: float  # Frechet distance, z-scored, beyond which the plan gets a warning
    shape: float  # weight: gain in shown surface that justifies a deviation by the spread of the path


FIDELITIES = {"strict": Fidelity(0.25, 1.2), "balanced": Fidelity(0.58, 0.1), "coverage": Fidelity(1.2, 0.05)}


@dataclass(frozen=True)
class OptimiseSettings:
    """Weights of the path optimisation, as shares of the surface to show that one unit is worth."""

    standoff: Weight = 0.3  # of one stand-off too near or too far, beyond the tolerance, mean square
    standoff_tolerance: Share = 0.08  # share of the required stand-off
    # Of a missing metre of the safety distance, and of a metre nearer than the carried path anywhere.
    clearance: Weight = 5.0
    axis: Weight = 1.0  # of a radian more past the inspected surface than the expert, mean square
    turning: Weight = 0.005  # of twice the camera rotation of the demonstration
    leaving: Weight = 0.05  # of one stand-off of distance from the carried flight, mean square
    # Of control points: stand-offs flown plus radians turned.
    spacing: Annotated[float, Range(0.05, 10)] = 0.6
    rounds: Annotated[int, Range(1, 20)] = 6  # of ray casting, at most: one that gains no point is the last
    iterations: Count = 40  # of the solver in each round, at most
    # Weight of required surface relative to inspected surface of the same area.
    required: Weight = 5.0
    # That represent the surface, two thirds of them on inspected surface.
    samples: Annotated[int, Range(50, 100_000)] = 2400


def focal_px(width_px: int, hfov_deg: float) -> float:
    """Pixels per radian in the middle of a picture; above 120 deg for a fisheye with even angles."""
    angle = math.radians(hfov_deg)
    return width_px / (2 * math.tan(angle / 2)) if hfov_deg <= 120 else width_px / angle

"""Settings: one frozen class for each stage, each default in one place, with its reason."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

Drone = Literal[
    "", "m300", "m350", "m30", "m30t", "m3e", "m3t", "m3m", "m3d", "m3td", "m4e", "m4t", "m4d", "m4td", "m400"
]


@dataclass(frozen=True)
class CloudSettings:
    """Voxel clouds (paper, Sec. III-A) and surface samples."""

    # The leaf is chosen so that about this many remain; the paper's clouds hold 693 and 1120.
    voxel_points: int = 1000
    raw_points: int = 60_000  # area-uniform points on the mesh that the voxel filter reads (the paper's Psi)
    surface_samples: int = 4000  # with normals, on the outside surface
    seed: int = 0  # of the points drawn on the surfaces


@dataclass(frozen=True)
class RegistrationSettings:
    """Convergence check (paper, Sec. III-A)."""

    iterations: int = 30  # fixed, as the paper says
    # Gate on the score in units of the squared spacing of the demonstration's cloud (its leaf), since the
    # score in m^2 grows with both. Over 1424 ordered pairs of real structures in clouds of 1000 points,
    # 1.9 refuses 3 % of those of one form (airliners 0.2 to 1.3, turbines up to 1.2, hulls up to 2.1) and
    # lets 9 % of the cross-kind ones through: no gamma parts them, `acceptance` does.
    gamma: float = 1.9
    # How a target is turned is looked for about the vertical, or altogether; the paper assumes no turn.
    search: Literal["none", "heading", "orientation"] = "none"
    # Gate on the misfit (`planning.acceptance`), free of density and scale; None: gamma alone, as published.
    # At 1.0, of all pairs of 40 real structures 95.5 % of those of one form and 0.6 % of the cross-kind ones
    # are accepted, 96.5 and 0.3 % with the samples (bench/acceptance.py, which also calibrates on halves).
    acceptance: float | None = None
    # Least probability that most of what was inspected can be shown (`planning.carry.forecast`), which then
    # decides in place of the gates above; None: they do. Calibrated by bench/forecast.py. Of 58 real pairs of
    # like kind one lies between 0.5 and 0.6, which shows 92 %, and of 69 of other kinds none.
    least_probability: float | None = None


@dataclass(frozen=True)
class CorrespondenceSettings:
    """Which point of the target corresponds to each point of the demonstration's cloud (Sec. III-B)."""

    method: Literal["nearest", "parts"] = "nearest"  # the nearest point, as published, or part to part
    counterparts: tuple[tuple[str, str], ...] = ()  # landmark pairs: (on the source, on the target)
    repeat: Literal["", "each", "mirror"] = ""  # fly each part of the kind, or its mirror image too
    # How many parts like the inspected one the target must have; with another number the plan is refused.
    expect: int | None = None
    # Least probability that an inspected part's counterpart is the right one (`correspondence.certainty`).
    # Below it a plan is refused where the part was named or has others like it, and warned of otherwise.
    least_probability: float = 0.0
    # How many structures of the kind, modelled in pieces and nearest in proportions, are asked for the parts
    # of a scan (`correspondence.siblings`); 0: none.
    siblings: int = 0


@dataclass(frozen=True)
class VisibilitySettings:
    """What a pose sees (Sec. III-C): the frustum alone, or what is really seen."""

    occlusion: bool = False  # whether what stands behind something counts as unseen
    max_incidence_deg: float = 90.0  # between the surface normal and the ray back to the camera


@dataclass(frozen=True)
class ViewpointSettings:
    """What of a flight is carried to the target: segments (paper, Alg. 2, lines 5 to 13), or all of it."""

    method: Literal["segments", "poses"] = "segments"  # a view of each segment, as published, or every pose
    # lambda: a segment ends where less than this share of its first view is still seen; the paper gives no
    # value. At 0.5 a flight round an airliner, seen by frustum from 10 m, falls into 3 viewpoints and the
    # shape is lost (Frechet distance 2.4 on the demonstrated structure itself). On the fifteen sample rows
    # 0.97 instead of 0.9 covers 98.3 % by frustum instead of 96.9 %, at a mean Frechet z of 1.63, not 2.06.
    shared: float = 0.97
    most_poses: int = 1500  # a longer flight is thinned evenly


@dataclass(frozen=True)
class TransferSettings:
    """How viewpoints come to the target (Eqs. 1 and 2, or the baseline's box ratio, or the warp)."""

    # zscore: mean and spread of the clouds, as published; box: the boxes' ratio; counterparts: of surfaces.
    method: Literal["zscore", "box", "counterparts"] = "zscore"
    standoff: Literal["scaled", "kept"] = "scaled"  # demonstrated distance: times the scale, or in metres
    gsd_m: float | None = None  # ground sampling distance, m per pixel, instead of the demonstrated stand-off
    plane: bool = False  # a demonstration in a plane stays in its plane


@dataclass(frozen=True)
class RefineSettings:
    """Optimisation of the viewpoints (Eq. 3, or the search for what is really seen)."""

    # `view` optimises the whole path for what the expert inspected (`OptimiseSettings`).
    method: Literal["none", "gauss-newton", "view"] = "gauss-newton"
    iterations: int = 20  # at most
    # How much of the demonstrated shape may go for what it shows: the user's trade (`FIDELITIES`).
    fidelity: Literal["strict", "balanced", "coverage"] = "balanced"
    deviation: float | None = None  # bound on the Frechet distance, z-scored; None: a warning alone
    # Of what the flight was about, the share that the target must have at all.
    least_counterpart: float = 0.5
    # Passes added to each side of a demonstrated one, at most, where the demonstrated mm/px is kept; 0: none.
    added_passes: int = 3
    longer: float = 1.25  # the path's time, at most, over the demonstration's times the ratio of the areas


@dataclass(frozen=True)
class RouteSettings:
    """Safety of the whole path; the paper states only the 2 m of its experiments (Sec. IV-A)."""

    enforce: bool = False  # whether a path that breaks the limits below is mended, or else refused
    clearance_m: float = 2.0  # least distance of the whole path from the structure
    ground_clearance_m: float = 1.0  # least height above known ground


@dataclass(frozen=True)
class RetimeSettings:
    """Time stamps: the demonstrated speed (Sec. III-C), or that speed under the limits of the vehicle."""

    limits: bool = False  # whether the vehicle's limits below hold
    max_speed_mps: float = 8.0  # the demonstrated speed counts where it is less
    # Where nothing was demonstrated, between takes and across gaps of a log, unless the expert flew faster
    # somewhere: braking at 2 m/s^2, a vehicle stops within half of the safety distance.
    transit_speed_mps: float = 2.0
    max_climb_mps: float = 5.0  # upwards; both as of common camera drones (DJI Phantom 4: 5 and 3 m/s)
    max_descent_mps: float = 3.0  # downwards: through its own downwash a rotor loses lift
    max_acceleration_mps2: float = 2.0  # of the vehicle, braking too
    max_yaw_rate_degps: float = 60.0  # of the heading
    max_yaw_acceleration_degps2: float = 120.0  # of the heading: half a second to its full rate
    max_gimbal_rate_degps: float = 60.0  # of its pitch
    least_stop_s: float = 3.0  # the expert's hovering for at least so long is meant, and kept
    min_gimbal_pitch_deg: float = -90.0  # straight down
    max_gimbal_pitch_deg: float = 30.0  # 0 is level


@dataclass(frozen=True)
class InspectionSettings:
    """When a plan shows a patch at least as well as the expert did: the same for every preset."""

    least_resolution: float = 0.8  # of what the stand-off mode asks for that patch
    # The same, that a plan is made for where the demonstrated mm/px is kept: 1.1 times as coarse, no coarser.
    planned_resolution: float = 1 / 1.1
    max_incidence_deg: float = 75.0  # from the normal, of the look that shows it
    max_motion_px: float = 1.0  # of the picture during one exposure, unless the expert's own was more
    exposure_s: float = 1 / 500  # of one picture, where the camera's own is not known
    width_px: int = 4000  # of the pictures that the motion is counted in, or the camera's where it is more
    about: str = ""  # what the flight was about: landmarks, part_3, box X Y Z X Y Z; empty: as inferred

    def sharp_radps(self, hfov_deg: float, width_px: int = 0, exposure_s: float = 0.0) -> float:
        """How fast a point may move near the middle of a camera's picture and still be sharp, rad/s.

        Width and exposure are those of the camera, 0 where they are not known.
        """
        focal = focal_px(max(self.width_px, width_px), hfov_deg)
        return self.max_motion_px / ((exposure_s or self.exposure_s) * focal)


@dataclass(frozen=True)
class VerdictSettings:
    """What a plan must reach to be flown; `enforce` refuses what does not, others carry it as a verdict."""

    enforce: bool = False  # whether what falls short is refused, or only says so
    least_inspected_pct: float = 60.0  # shown at least as well: fewer are no repetition of the inspection
    longest_path: float = 3.0  # times the demonstration's, carried to the target's size
    longest_time: float = 4.0  # the same; the demonstrated speed is an upper bound, turns cost time
    # Of the diagonals, target to source or back: a unit that was mistaken looks so. Inches for metres are 39
    # times; the paper's own pairs reach 7.9 (cruise ship to yacht), real ones that can be shown 11.
    most_size_ratio: float = 20.0  # refused beyond
    odd_size_ratio: float = 3.0  # warned of beyond


@dataclass(frozen=True)
class RequiredSettings:
    """Zones that must be seen (`upplied require`), which a plan shows first where its flight comes by."""

    zones: str = ""  # hash of what is asked for, so that it is part of what names a plan; empty: nothing


@dataclass(frozen=True)
class VehicleSettings:
    """What flies the plans, and is written into missions; its limits of motion are in stage `retime`."""

    drone: Drone = ""  # DJI's model; empty: another
    payload: int | None = None  # DJI's payload number where the model has none of its own
    firmware: Literal["px4", "ardupilot"] = "px4"  # of others
    endurance_s: float | None = None  # of one battery: longer missions are split into sorties
    reserve_pct: float = 20.0  # of the endurance that is not planned with


@dataclass(frozen=True)
class Fidelity:
    """How like the demonstrated shape a path is to be."""

    deviation: float  # Frechet distance, z-scored, beyond which a warning tells of it
    shape: float  # weight: share of the surface that a path strayed by its own spread must show more


FIDELITIES = {
    "strict": Fidelity(0.25, 1.2),
    "balanced": Fidelity(0.58, 0.1),
    "coverage": Fidelity(1.2, 0.05),
}


@dataclass(frozen=True)
class OptimiseSettings:
    """The optimisation of a path: each weight is the share of what is to be shown that a unit is worth."""

    context: float = 0.0  # share of all that is to be shown which goes to what was seen beside the inspected
    standoff: float = 1.0  # of being a stand-off too near or too far, beyond the tolerance, mean square
    standoff_tolerance: float = 0.08  # of the wanted stand-off
    # Of lacking a metre of the safety distance, and of coming a metre nearer than the carried path anywhere.
    clearance: float = 5.0
    axis: float = 1.0  # of looking a radian farther past what was inspected than the expert did, mean square
    turning: float = 0.005  # of turning the camera by as much again as the demonstration
    leaving: float = 0.2  # of lying a stand-off from the carried flight, mean square
    spacing: float = 0.6  # of control points: stand-offs flown plus radians turned
    starts: int = 2  # that are optimised, of those that are tried
    rounds: int = 3  # of casting rays
    iterations: int = 25  # of the solver in each round
    # Times what was inspected counts surface that must be seen, by area: so much of that may go for it.
    required: float = 10.0
    samples: int = 2400  # of the surface that stand for all, two thirds of them inspected ones


def focal_px(width_px: int, hfov_deg: float) -> float:
    """Pixels per radian in the middle of a picture; above 120 deg, of one whose angle grows evenly."""
    angle = math.radians(hfov_deg)
    return width_px / (2 * math.tan(angle / 2)) if hfov_deg <= 120 else width_px / angle

"""Results of the steps of planning: clouds, registration, correspondences, views, viewpoints."""

from dataclasses import dataclass, field

import numpy as np

from upplied.records.base import Bools, Floats, Ints, Record, Rows


@dataclass(frozen=True, eq=False, repr=False)
class Cloud(Record):
    """Points that stand for a surface, from the paper's voxel filter; samples have normals and areas too."""

    points: Floats  # (N, 3) m, structure frame
    normals: Floats | None = None  # (N, 3) unit, outward
    area_m2: Floats | None = None  # (N,) surface each sample stands for
    part: Ints | None = None  # (N,) part of the structure (0 ..) on which the sample lies
    leaf_m: float = 0.0  # edge of the voxels, 0 for surface samples
    open: Bools | None = None  # (N,) of a scan: whether the inside of its surface is visible there

    def __len__(self) -> int:
        return len(self.points)

    @property
    def areas(self) -> Floats:
        """(N,) m^2; 1 for each if unknown."""
        return np.ones(len(self)) if self.area_m2 is None else self.area_m2

    @property
    def outward(self) -> Floats:
        """(N, 3) the normals, of surface samples; other clouds have none.

        Raises
        ------
        ValueError
        """
        if self.normals is None:
            raise ValueError("a cloud without normals: surface samples are required")
        return self.normals

    def at(self, chosen: Bools | Ints) -> "Cloud":
        """Some of the points, with their normals and areas."""
        normals, area_m2 = (None if of is None else of[chosen] for of in (self.normals, self.area_m2))
        return Cloud(self.points[chosen], normals, area_m2)


@dataclass(frozen=True, eq=False, repr=False)
class Registration(Record):
    """Registration of a target on the demonstrated structure.

    ``p_demo = rotation @ (scale * (turn @ p_target)) + translation`` (paper, Alg. 1, lines 3 to 8, which
    assumes equal orientation: ``rotation @ turn`` is the identity unless another one was declared or found).
    """

    scale: Floats  # (3,) along the axes of the turned target
    rotation: Floats  # (3, 3) proper
    translation: Floats  # (3,) m
    score_m2: float  # PCL's getFitnessScore: mean squared nearest-neighbour distance, demonstration to target
    accepted: bool
    reason: str = ""  # of a refusal, in words
    acceptance: float = float("nan")  # free of density and scale, lower is better; NaN where not computed
    # The same by the target's surface alone, unaffected by surface that was never scanned.
    scanned: float = float("nan")
    runner_up_gap: float = float("nan")  # relative gap to the next best orientation; NaN where not searched
    evidence: str = ""  # attempts and results, in words
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
class Displacement(Record):
    """The mapping of matched parts of a source to the registered target: affine maps and a smooth field.

    Classes are those of `Correspondences.source_class`; the last row is for no class, without a map.
    """

    matrix: Floats  # (C + 1, 3, 3) of each class: the part aligned with its counterpart
    offset_m: Floats  # (C + 1, 3)
    smooth: Floats  # (C + 1,) share of the smooth field that is added, 0 to 1
    control_points: Floats  # (M, 3) m, source frame, after the maps
    control_class: Ints  # (M,) -1 where in none
    weights: Floats  # (M, 3) m
    reach_m: float  # radius of influence of a control point
    step_m: Floats  # (2,) spacing of the samples that it was computed from, source first


@dataclass(frozen=True, eq=False, repr=False)
class Correspondences(Record):
    """The counterpart on the target of every point of the demonstration's cloud."""

    target_index: Ints  # (N_demo,) index into the target's cloud, -1 without a counterpart
    distance_m: Floats  # (N_demo,) to the counterpart after alignment; NaN without one
    target_points: Floats  # (N_demo, 3) m, target frame: carried position of each point, NaN if none
    summary: str = ""  # matched parts and parts without a counterpart, in words
    source_class: Ints | None = None  # (K,) of each part of the demonstration's cloud, -1: in none
    target_class: Ints | None = None  # (L,) of each part of the target's; parts of one class are matched
    displacement: Displacement | None = None  # that carries parts; None: nearest points

    def target_parts(self, part: int) -> Ints:
        """The target's parts that were matched with a part of the source; empty if none were."""
        if self.source_class is None or self.target_class is None or self.source_class[part] < 0:
            return np.empty(0, np.int64)
        return np.flatnonzero(self.target_class == self.source_class[part])


@dataclass(frozen=True, eq=False, repr=False)
class Visibility(Record):
    """The points of a cloud that each pose sees."""

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
class Waypoints(Rows):
    """Camera poses in the order of flight, before they have times of their own."""

    positions: Floats  # (W, 3) m, structure frame
    quat_xyzw: Floats  # (W, 4) unit, camera to structure
    t_s: Floats  # (W,) s, time of the demonstration that each corresponds to; never decreases
    is_viewpoint: Bools  # (W,)
    # (W,) on added passes and on the transits to and from them; by default none
    added: Bools = field(default_factory=lambda: np.zeros(0, bool))

    def __post_init__(self) -> None:
        if len(self.added) != len(self.positions):
            object.__setattr__(self, "added", np.zeros(len(self.positions), bool))

"""What is handed from step to step of planning: clouds, registration, correspondences, views, viewpoints."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from upplied.records.base import Bools, Floats, Ints, Record, Rows


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
    open: Bools | None = None  # (N,) of a scan: whether the inside of its surface shows there

    def __len__(self) -> int:
        return len(self.points)

    @property
    def areas(self) -> Floats:
        """(N,) m^2; 1 for each where they are not known."""
        return np.ones(len(self)) if self.area_m2 is None else self.area_m2

    @property
    def outward(self) -> Floats:
        """(N, 3) the normals, of surface samples; other clouds have none.

        Raises
        ------
        ValueError
        """
        if self.normals is None:
            raise ValueError("a cloud without normals: surface samples are asked for")
        return self.normals

    def at(self, chosen: Bools | Ints) -> Cloud:
        """Some of the points, with their normals and areas."""
        normals, area_m2 = (None if of is None else of[chosen] for of in (self.normals, self.area_m2))
        return Cloud(self.points[chosen], normals, area_m2)


@dataclass(frozen=True, eq=False, repr=False)
class Registration(Record):
    """How a target is registered on the demonstration structure.

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
    # The same of the target's surface alone, which what was never scanned does not raise.
    scanned: float = float("nan")
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
class Displacement(Record):
    """Where matched parts of a source lie on the registered target: an affine map each, and a smooth field.

    The classes are those of `Correspondences.source_class`; what is in none has the last row, and no map.
    """

    matrix: Floats  # (C + 1, 3, 3) of each class: the part aligned with its counterpart
    offset_m: Floats  # (C + 1, 3)
    smooth: Floats  # (C + 1,) how much of the smooth field is added, 0 to 1
    control_points: Floats  # (M, 3) m, source frame, after the maps
    control_class: Ints  # (M,) -1 where in none
    weights: Floats  # (M, 3) m
    reach_m: float  # how far a control point is felt
    step_m: Floats  # (2,) spacing of the samples of both by which it was found, source first


@dataclass(frozen=True, eq=False, repr=False)
class Correspondences(Record):
    """For every point of the demonstration's cloud its counterpart on the target."""

    target_index: Ints  # (N_demo,) index into the target's cloud, -1 where there is no counterpart
    distance_m: Floats  # (N_demo,) between the partners after alignment; NaN where there is none
    target_points: Floats  # (N_demo, 3) m, target frame: where each point is carried, NaN where nowhere
    summary: str = ""  # parts matched and parts left without a counterpart, in words
    source_class: Ints | None = None  # (K,) of each part of the demonstration's cloud, -1: in none
    target_class: Ints | None = None  # (L,) of each part of the target's: parts of one class were matched
    displacement: Displacement | None = None  # by which parts were carried; None: nearest points

    def target_parts(self, part: int) -> Ints:
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
class Waypoints(Rows):
    """Camera poses in the order of flight, before they have times of their own."""

    positions: Floats  # (W, 3) m, structure frame
    quat_xyzw: Floats  # (W, 4) unit, camera to structure
    t_s: Floats  # (W,) s, time of the demonstration that each corresponds to; never decreases
    is_viewpoint: Bools  # (W,)
    # (W,) on passes beside the demonstrated ones, and on the ways to them and back; none where not given
    added: Bools = field(default_factory=lambda: np.zeros(0, bool))

    def __post_init__(self) -> None:
        if len(self.added) != len(self.positions):
            object.__setattr__(self, "added", np.zeros(len(self.positions), bool))

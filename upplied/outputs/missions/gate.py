"""The gate: a mission that breaks a rule is refused, unless a person overrules that rule by its name.

It judges the path that is read again from the bytes of the file, from take-off to landing. Overruled rules
are recorded in the notes of the mission, and in its file if the format has room for text.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field

import numpy as np

from upplied.errors import RefusedError, SettingsError
from upplied.geometry.polylines import accelerations, leg_lengths
from upplied.geometry.scene import Scene
from upplied.geometry.supposed_scene import scene_for
from upplied.outputs.labels import table
from upplied.outputs.mission_options import DRAFTS, MissionOptions
from upplied.planning.airspace.rules import Airspace, crosses_box, legs_below, path_clearance
from upplied.records import Floats, Plan, Record, Structure, SupposedSurface, Surroundings, Trajectory

#: The rules of every mission by name: the rule in words, and the remedy.
RULES: dict[str, list[str]] = table("missions/rules.toml")
DRAFT = "DRAFT, NOT RELEASED:"  # first words of the note of an unreleased mission
CUSTODY = "custody"  # first word of the note with the heads of the catalog
ZONE = "zone"  # first word of the note about a required zone
_EXACT_M = 0.02  # accuracy of a clearance, and of a place in a file
_ROUNDING = 1.02  # of speeds: files round them
_SOON_S = 1e-3
_OVERLAP = 0.02  # accuracy of an overlap


@dataclass(frozen=True, eq=False, repr=False)
class Reading(Record):
    """The path of one file, m, structure frame."""

    positions: Floats  # (N, 3) in the order of flight, with take-off, transit and return where it has them
    speed_mps: Floats  # (N,) of the leg that ends at each; NaN where the file does not say
    t_s: Floats = field(default_factory=lambda: np.empty(0))  # (N,) where the file is timed, else (0,)
    fan_start: Floats = field(default_factory=lambda: np.empty((0, 3)))  # (L, 3) lines over the corners that
    fan_end: Floats = field(default_factory=lambda: np.empty((0, 3)))  # (L, 3) are passed without a stop
    photo_m: Floats = field(default_factory=lambda: np.empty((0, 3)))  # (K, 3) places of photos
    photo_s: Floats = field(default_factory=lambda: np.empty(0))  # (K,) their times, where speeds are stated
    every_s: float = np.inf  # least time between photos by distance


def planned(positions: Floats, t_s: Floats) -> Reading:
    """A path with time stamps, without take-off and return."""
    with np.errstate(divide="ignore", invalid="ignore"):
        speeds = leg_lengths(positions) / np.diff(t_s)
    return Reading(positions, np.concatenate([[0.0], speeds]), t_s)


@dataclass(frozen=True)
class Limits:
    """The limits of a mission, from the plan's settings, the structure and the options."""

    clearance_m: float = 2.0
    max_speed_mps: float = 15.0  # multirotors that inspect
    max_acceleration_mps2: float = 4.0  # 22 degrees of tilt, twice what `recommended` plans with
    max_height_m: float | None = None
    least_seen_pct: float = 95.0
    trigger_s: float = 0.0  # least time between two photos; 0: no limit


@dataclass(frozen=True)
class Breach:
    """A broken rule: the fault, the limit, and the place."""

    rule: str
    fault: str
    allowed: str = ""
    place_m: tuple[float, ...] = ()

    def __str__(self) -> str:
        where = f" at {[round(float(value), 1) for value in self.place_m]} m" if self.place_m else ""
        return ", ".join(filter(None, [f"{self.rule}: {self.fault}{where}", self.allowed]))


def broken_by(plan: Plan, structure: Structure, clearance_m: float) -> list[Breach]:
    """Every rule that a stored plan breaks, its steps judged again with this required distance; or none."""
    path = plan.trajectory
    if path is None:
        return []
    steps, limits = planned(path.positions, path.t_s), Limits(clearance_m=clearance_m)
    return [*plan_breaches(plan), *breaches(steps, structure, limits, plan.supposed)]


def limits_of(options: MissionOptions, trigger_s: float = 0.0) -> Limits:
    """The limits of the options, and the least time between two photos."""
    own = {name: getattr(options, name) for name in ("clearance_m", "max_height_m", "least_seen_pct")}
    return Limits(trigger_s=trigger_s, **own)


def breaches(
    reading: Reading, structure: Structure, limits: Limits, supposed: SupposedSurface | None
) -> list[Breach]:
    """Every rule that a path breaks at the structure it is flown at; `supposed` is `Plan.supposed`."""
    if not np.isfinite(reading.positions).all() or not (np.diff(reading.t_s) > 0).all():
        return [Breach("finite", "a waypoint is not finite, or times do not increase")]
    around = _around(reading, structure, limits, scene_for(structure, supposed))
    return [*around, *_moving(reading, limits), *_photographing(reading, limits)]


def plan_breaches(plan: Plan) -> list[Breach]:
    """Rules that a plan breaks by its preset and verdict."""
    usual = plan.preset == "recommended"
    broken = [] if usual else [Breach("preset", f"the plan is of preset {plan.preset}")]
    return [*broken, Breach("verdict", plan.not_flyable)] if plan.not_flyable else broken


def zoom_breaches(path: Trajectory, zooms: bool) -> list[Breach]:
    """The breach if the plan zooms and the format or the autopilot cannot."""
    if path.fov_deg is None or zooms:
        return []
    widest, narrowest = path.fov_deg[:, 0].max(), path.fov_deg[:, 0].min()
    reason = f"the plan zooms from {widest:.1f} to {narrowest:.1f} deg, which this format cannot express"
    return [Breach("zoom", reason, "the mission uses the narrowest field of view")]


def coverage_breaches(share: float, limits: Limits) -> list[Breach]:
    """The breach if the mission shows too little of the planned view; `share` is NaN if unknown."""
    if not 100 * share < limits.least_seen_pct:
        return []
    allowed = f"limit {limits.least_seen_pct:g} % (least_seen_pct)"
    return [Breach("coverage", f"{100 * share:.1f} % of the planned view is retained", allowed)]


def overlap_breaches(across: float, required: tuple[float, float] | None) -> list[Breach]:
    """Whether photos of neighbouring passes overlap too little; along a pass the flight is slowed for it."""
    if required is None or not across < required[1] - _OVERLAP:
        return []
    allowed = f"limit {100 * required[1]:g} % (overlap)"
    return [Breach("overlap", f"the median overlap across is {100 * across:.0f} %", allowed)]


def pass_or_refuse(what: str, objections: Iterable[Breach], force: tuple[str, ...]) -> tuple[Breach, ...]:
    """The breaches that were overruled; refuses where others are left, or a rule to overrule is unknown."""
    if unknown := sorted(set(force) - set(RULES)):
        raise SettingsError(f"rule {unknown[0]!r}", "is unknown", f"one of {', '.join(RULES)}")
    objections = list(objections)
    left = [breach for breach in objections if breach.rule not in force]
    if left:
        others = sorted({breach.rule for breach in left[1:]} - {left[0].rule})
        more = f"; also broken: {', '.join(others)}" if others else ""
        flags = dict.fromkeys("--draft" if one.rule in DRAFTS else f"--force {one.rule}" for one in left)
        why, remedy = RULES[left[0].rule]
        raise RefusedError(what, f"{left[0]}{more}", why, f"{remedy}, or use {' '.join(flags)}")
    return tuple(objections)


def notes_of(overruled: Iterable[Breach]) -> list[str]:
    """Breaches that were overruled, as notes of a mission."""
    return [f"{DRAFT} {one.fault}" if one.rule in DRAFTS else f"OVERRULED {one}" for one in overruled]


def written(notes: Iterable[str]) -> list[str]:
    """The notes for files with little room for words: draft, traces of custody, and required zones."""
    return [note for note in notes if note.startswith((DRAFT, CUSTODY, ZONE))]


def _around(reading: Reading, structure: Structure, limits: Limits, scene: Scene) -> Iterator[Breach]:
    path, around = reading.positions, structure.surroundings
    limit_m = limits.clearance_m - _EXACT_M
    nearest = path_clearance(scene, path)
    if nearest.distance_m < limit_m:
        limit = f"limit {limits.clearance_m:g} m"
        what = _of_supposed(scene, nearest.position, " from")
        yield Breach("clearance", f"{nearest.distance_m:.2f} m{what}", limit, tuple(nearest.position))
    elif (near := legs_below(scene, reading.fan_start, reading.fan_end, limit_m - _EXACT_M)).any():
        what = _of_supposed(scene, reading.fan_start[near.argmax()], " to")
        yield Breach("clearance", f"too near{what} in a turn without a stop")
    start = np.concatenate([path[:-1], reading.fan_start])
    end = np.concatenate([path[1:], reading.fan_end])
    for low, high in around.keep_out_m:
        inside = crosses_box(start, end, low + _EXACT_M, high - _EXACT_M)
        if inside.any():
            box = f"the box from {low.tolist()} to {high.tolist()} m"
            yield Breach("keep-out", "a leg enters", box, tuple(start[inside.argmax()]))
    fence = Airspace(scene, 0.0, Surroundings(geofence_m=around.geofence_m))
    if (outside := fence.broken_legs(start, end)).any():
        yield Breach("geofence", "a leg leaves the fence", "", tuple(start[outside.argmax()]))
    highest = path[path[:, 2].argmax()]
    if around.ceiling_z_m is not None and highest[2] > around.ceiling_z_m + _EXACT_M:
        yield Breach("ceiling", f"z {highest[2]:.2f} m", f"{around.ceiling_z_m:g} m at most", tuple(highest))
    # The person chooses take-off and landing; the legs in between stay above the ground.
    flown = path if len(reading.t_s) else path[1:-1]
    lowest = flown[flown[:, 2].argmin()]
    if around.ground_z_m is not None and lowest[2] < around.ground_z_m - _EXACT_M:
        ground = f"the ground is at {around.ground_z_m:g} m"
        yield Breach("ground", f"z {lowest[2]:.2f} m", ground, tuple(lowest))
    over = highest[2] - structure.floor_z_m
    if limits.max_height_m is not None and over > limits.max_height_m + _EXACT_M:
        limit = f"{limits.max_height_m:g} m are allowed (max_height_m)"
        yield Breach("height", f"{over:.1f} m above ground", limit, tuple(highest))


def _of_supposed(scene: Scene, place: Floats, word: str) -> str:
    """Words for inferred surface that is nearer to a place than scanned surface; else nothing."""
    return f"{word} unscanned surface" if scene.nearer_supposed(place[None])[0] else ""


def _moving(reading: Reading, limits: Limits) -> Iterator[Breach]:
    speed = np.nan_to_num(reading.speed_mps, nan=0.0)
    fastest = int(speed.argmax())
    if speed[fastest] > limits.max_speed_mps * _ROUNDING:
        allowed = f"{limits.max_speed_mps:g} m/s at most"
        yield Breach("speed", f"{speed[fastest]:.1f} m/s", allowed, tuple(reading.positions[fastest]))
    if len(reading.t_s) > 2:
        felt = accelerations(reading.t_s, reading.positions)
        most = int(felt.argmax())
        if felt[most] > limits.max_acceleration_mps2 * _ROUNDING:
            allowed = f"{limits.max_acceleration_mps2:g} m/s2 at most"
            place = tuple(reading.positions[most + 1])
            yield Breach("acceleration", f"{felt[most]:.1f} m/s2", allowed, place)


def _photographing(reading: Reading, limits: Limits) -> Iterator[Breach]:
    if not limits.trigger_s:
        return
    allowed = f"the camera needs {limits.trigger_s:g} s"
    apart = np.diff(reading.photo_s)
    if len(apart) and apart.min() < limits.trigger_s - _SOON_S:
        place = tuple(reading.photo_m[int(apart.argmin()) + 1])
        yield Breach("photos", f"a photo {apart.min():.2f} s after the previous one", allowed, place)
    if reading.every_s < limits.trigger_s - _SOON_S:
        yield Breach("photos", f"photos triggered by distance are {reading.every_s:.2f} s apart", allowed)

"""The part of a log that is the inspection.

In this order: start and stop from options, side-car or metadata; the log's own `foxglove.Event` of the phase
``inspection`` (or the only event that lasts); else ground, climb and transit at either end are left out. Such
an end is cut only where the log begins, or ends, on the ground: standing still at its lowest. A log that was
started in the air is taken whole, whatever its camera sees.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from upplied.errors import InputError
from upplied.geometry.scene import Scene
from upplied.inputs.flight.tracks import Track, stamps
from upplied.inputs.sidecar import LogOptions
from upplied.inputs.tables import Table
from upplied.records import Bools, Floats

_EVENT = "foxglove.Event"
_NAMES = ("metadata", "event_type.name")
Span = tuple[int, int]
_STEP_S = 0.5  # of the stations that are looked at
_STILL_M, _STILL_S = 0.5, 4.0  # on the ground: no farther, no shorter
_LIFT_M = 1.0  # above the place of take-off, in the air
_ASIDE_M = 3.0  # from where it climbed: the transit has begun
_FAR = 1.6  # times the distance of the inspection: still in transit
_LASTS_S, _SHARE = 6.0, 0.6  # of looking at the structure, at the beginning of the inspection
_ASIDE = np.tan(np.radians(8.0))
_MIDDLE = np.array([[1.0, y * _ASIDE, z * _ASIDE] for y, z in ((0, 0), (1, 0), (-1, 0), (0, 1), (0, -1))])
_LEAST_S, _LEAST_SHARE = 10.0, 0.2  # of what must be left, of the log


def inspected(
    track: Track, tables: Sequence[Table], facts: LogOptions, what: str
) -> tuple[Track, list[str], bool]:
    """The samples of the inspection, in words how they were cut out, and whether start or stop were given.

    Raises InputError if nothing was flown in the time that is given.
    """
    first = int(track.t_ns.min()) if len(track) else 0
    given = (facts.start_s, facts.stop_s, facts.start_ns, facts.end_ns)
    if any(value is not None for value in given):
        start = facts.start_ns if facts.start_s is None else first + int(facts.start_s * 1e9)
        stop = facts.end_ns if facts.stop_s is None else first + int(facts.stop_s * 1e9)
        spans = [(-(2**63) if start is None else start, 2**63 - 1 if stop is None else stop)]
        words = "start and stop as given"
    elif spans := _events(tables):
        words = f"{len(spans)} events in the log"
    else:
        return track, [], False
    inside = _inside(track, spans)
    if not inside.any():
        seconds = f"0 to {(int(track.t_ns.max()) - first) * 1e-9:.1f} s" if len(track) else "none"
        rule = f"times within {seconds}"
        raise InputError(what, f"has no pose within {words}", rule, "correct start and stop")
    if inside.all():
        return track, [], True
    return track.take(inside), [f"cut to {words}: {int(inside.sum())} of {len(track)} samples"], True


def _inside(track: Track, spans: list[Span]) -> Bools:
    """By the clock of the poses, or by the recorder's where the times are of its domain."""
    for clock in (track.t_ns, track.log_ns):
        inside = np.any([(clock >= start) & (clock <= stop) for start, stop in spans], axis=0)
        if inside.any():
            break
    return np.asarray(inside)


def _events(tables: Sequence[Table]) -> list[Span]:
    spans: dict[bool, list[Span]] = {True: [], False: []}  # by whether they are named for the inspection
    for table in tables:
        start = stamps(table, "start_time" if "start_time.sec" in table else "timestamp")
        stop, lasts = stamps(table, "end_time"), stamps(table, "duration")
        if start is not None and stop is None and lasts is not None:
            stop = start + lasts
        if table.schema != _EVENT or start is None or stop is None:
            continue
        names = (f"{first} {second}".lower() for first, second in zip(*map(table.texts, _NAMES), strict=True))
        for begin, end, name in zip(start.tolist(), stop.tolist(), names, strict=True):
            if end > begin:
                spans["inspection" in name].append((begin, end))
    return spans[True] or (spans[False] if len(spans[False]) == 1 else [])


@dataclass(frozen=True)
class Phases:
    """When the parts of a log begin, s from its first pose; the inspection from `start_s` to `stop_s`."""

    climb_s: float
    transit_s: float
    start_s: float
    stop_s: float
    landing_s: float
    end_s: float

    def __str__(self) -> str:
        parts = [("ground", 0.0, self.climb_s), ("climb", self.climb_s, self.transit_s),
                 ("transit", self.transit_s, self.start_s), ("inspection", self.start_s, self.stop_s),
                 ("return", self.stop_s, self.landing_s), ("ground", self.landing_s, self.end_s)]  # fmt: skip
        shown = [(name, start, stop) for name, start, stop in parts if stop - start > 0.5]
        return ", ".join(f"{name} {start:.0f} to {stop:.0f} s" for name, start, stop in shown)


def phases(flown: Track, scene: Scene, reach_m: float) -> Phases | None:
    """The parts of a log; None where it does not begin or end on the ground, or nothing of it inspects.

    The track is of the camera, clean, in the structure frame; the camera sees as far as `reach_m`.
    """
    seconds = (flown.t_ns - flown.t_ns[0]) * 1e-9
    some = np.unique(np.searchsorted(seconds, np.arange(0, seconds[-1], _STEP_S)).clip(0, len(seconds) - 1))
    at, places, turns = seconds[some], flown.positions[some], flown.quat_xyzw[some]
    if len(some) < 4 * _STILL_S / _STEP_S:
        return None
    ends = [_in_air(at, places), _in_air(at[-1] - at[::-1], places[::-1])]
    if ends == [None, None]:
        return None
    looks, distance = met_in_the_middle(places, turns, scene, reach_m).any(axis=1), scene.distance(places)
    flying = np.ones(len(some), bool)
    flying[: ends[0][1] if ends[0] else 0] = False
    flying[::-1][: ends[1][1] if ends[1] else 0] = False
    usual = float(np.median(distance[looks & flying])) if (looks & flying).any() else 0.0
    good = looks & flying & (distance <= _FAR * usual)
    first = _begins(at, good) if ends[0] else 0
    last = len(at) - 1 - _begins(at[-1] - at[::-1], good[::-1]) if ends[1] else len(at) - 1
    flown_s = seconds[-1] - sum(end[2] for end in ends if end)
    if at[last] - at[first] < max(_LEAST_S, _LEAST_SHARE * flown_s):
        return None
    end_s = float(seconds[-1])
    climb, transit = (float(at[end]) for end in ends[0][:2]) if ends[0] else (0.0, 0.0)
    stop, landing = (
        (float(at[last]), end_s - float(at[-1] - at[::-1][ends[1][0]])) if ends[1] else (end_s, end_s)
    )
    return Phases(climb, transit, float(at[first]), stop, landing, end_s)


def _in_air(at: Floats, places: Floats) -> tuple[int, int, float] | None:
    """Stations at which the climb begins and ends, and the time on the ground; None where it flies."""
    start = places[0]
    moved = np.linalg.norm(places - start, axis=1) > _STILL_M
    lifted = int(np.argmax(moved)) if moved.any() else len(moved)
    if lifted >= len(at) or at[lifted] < _STILL_S or start[2] > places[:, 2].min() + _LIFT_M:
        return None
    aside = np.hypot(*(places[:, :2] - start[:2]).T) > _ASIDE_M
    aside &= places[:, 2] > start[2] + _LIFT_M
    return lifted, int(np.argmax(aside)) if aside.any() else lifted, float(at[lifted])


def met_in_the_middle(places: Floats, turns: Floats, scene: Scene, reach_m: float) -> Bools:
    """Which rays (N, 5) meet the structure within reach: along the camera's axis, and beside it all round."""
    rays = (Rotation.from_quat(turns).as_matrix() @ _MIDDLE.T).swapaxes(1, 2).reshape(-1, 3)
    range_m = scene.cast(np.repeat(places, len(_MIDDLE), axis=0), rays)[0]
    return np.asarray(range_m.reshape(-1, len(_MIDDLE)) <= reach_m)


def _begins(at: Floats, good: Bools) -> int:
    """The first good station from which on most are good for a while."""
    for first in np.flatnonzero(good):
        if good[(at >= at[first]) & (at < at[first] + _LASTS_S)].mean() >= _SHARE:
            return int(first)
    return 0

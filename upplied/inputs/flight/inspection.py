"""The inspection within a log: as given, by the log's `foxglove.Event`, or between stays on the ground.

Ground, climb, transit and return are left out only where the log begins or ends standing still at its lowest.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from upplied.errors import InputError
from upplied.geometry.scene import Scene
from upplied.inputs.flight.tracks import Track, stamps
from upplied.inputs.sidecar import LogOptions
from upplied.inputs.tables import Table
from upplied.records import Bools, Floats, Ints

_EVENT = "foxglove.Event"
_NAMES = ("metadata", "event_type.name")
Span = tuple[int, int]
_STEP_S = 0.5  # of the stations that are looked at
_STILL_M, _STILL_S = 0.5, 4.0  # on the ground: no farther, no shorter
_LANDED_S = 10.0  # on the ground between two flights of a log
_LIFT_M = 1.0  # above the place of take-off, in the air
_ASIDE_M = 3.0  # from where it climbed: the transit has begun
_FAR = 1.6  # times the distance of the inspection: still in transit
_LASTS_S, _SHARE = 6.0, 0.6  # of looking at the structure, at the beginning of the inspection
_ASIDE = np.tan(np.radians(8.0))
_MIDDLE = np.array([[1.0, y * _ASIDE, z * _ASIDE] for y, z in ((0, 0), (1, 0), (-1, 0), (0, 1), (0, -1))])
_LEAST_S, _LEAST_SHARE = 10.0, 0.2  # of what must be left, of the time in the air
_GROUND, _INSPECTION = "ground", "inspection"


def inspected(
    track: Track, tables: Sequence[Table], facts: LogOptions, what: str
) -> tuple[Track, list[str], bool]:
    """The samples of the inspection (InputError: none), how they were cut, and whether times were given."""
    first = int(track.t_ns.min()) if len(track) else 0
    bounds = (facts.start_s, facts.stop_s, facts.start_ns, facts.end_ns)
    if any(value is not None for value in bounds):
        start = facts.start_ns if facts.start_s is None else first + int(facts.start_s * 1e9)
        stop = facts.end_ns if facts.stop_s is None else first + int(facts.stop_s * 1e9)
        spans = [(-(2**63) if start is None else start, 2**63 - 1 if stop is None else stop)]
        words = "start and stop as given"
    elif spans := _events(tables):
        words = f"{len(spans)} events in the log"
    else:
        return track, [], False
    for clock in (track.t_ns, track.log_ns):  # the recorder's where the times are of its domain
        inside = np.any([(clock >= start) & (clock <= stop) for start, stop in spans], axis=0)
        if inside.any():
            break
    if not inside.any():
        seconds = f"0 to {(int(track.t_ns.max()) - first) * 1e-9:.1f} s" if len(track) else "none"
        finding, rule = f"has no pose within {words}", f"times within {seconds}"
        raise InputError(what, finding, rule, "correct start and stop")
    if inside.all():
        return track, [], True
    return track.take(inside), [f"cut to {words}: {int(inside.sum())} of {len(track)} samples"], True


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


class Phases(NamedTuple):
    """What a log holds: parts with their names, each from when to when, s from its first pose."""

    parts: tuple[tuple[str, float, float], ...]

    def __str__(self) -> str:
        shown = [part for part in self.parts if part[2] - part[1] > 0.5]
        return ", ".join(f"{name} {start:.0f} to {stop:.0f} s" for name, start, stop in shown)

    def inspected(self, since_s: Floats) -> Bools:
        """Which times (N,), s, lie in an inspection; each flight that looks at the structure has one."""
        spans = [part[1:] for part in self.parts if part[0] == _INSPECTION]
        return np.asarray(np.any([(since_s >= start) & (since_s <= stop) for start, stop in spans], axis=0))

    def lasting_s(self, name: str) -> float:
        """How long the parts of a name last together, s."""
        return sum(stop - start for each, start, stop in self.parts if each == name)

    @property
    def share(self) -> float:
        aloft_s = self.parts[-1][2] - self.lasting_s(_GROUND)
        return self.lasting_s(_INSPECTION) / max(aloft_s, 1e-9)

    @property
    def between_s(self) -> float:
        """The time between the first inspection and the last that belongs to none, s."""
        spans = [part for part in self.parts if part[0] == _INSPECTION]
        return spans[-1][2] - spans[0][1] - self.lasting_s(_INSPECTION)


def phases(flown: Track, scene: Scene, reach_m: float) -> Phases | None:
    """The parts of a log; None where it does not begin or end on the ground, or nothing of it inspects.

    The track is of the camera, clean, in the structure frame; the camera sees as far as `reach_m`.
    """
    seconds = (flown.t_ns - flown.t_ns[0]) * 1e-9
    some = np.unique(np.searchsorted(seconds, np.arange(0, seconds[-1], _STEP_S)).clip(0, len(seconds) - 1))
    if len(some) < 4 * _STILL_S / _STEP_S:
        return None
    some = np.union1d(some, [len(seconds) - 1])
    met = met_in_the_middle(flown.positions[some], flown.quat_xyzw[some], scene, reach_m)
    return phases_of(seconds[some], flown.positions[some], np.asarray(met.any(axis=1)), scene)


def phases_of(at: Floats, places: Floats, looks: Bools, scene: Scene) -> Phases | None:
    """The same by stations: (K,), s, (K, 3), m, and which of them look at the structure."""
    if not (ground := _on_ground(at, places)).any():
        return None
    flights = _runs(~ground)
    outs, flying = [], np.zeros(len(at), bool)  # stations at which climbs end; between climb and descent
    for first, stop in flights:
        outs.append(first + _aside(places[first - 1], places[first:stop]) if first else first)
        back = stop - _aside(places[stop], places[first:stop][::-1]) if stop < len(at) else stop
        flying[outs[-1] : back] = True
    distance = scene.distance(places)
    usual = float(np.median(distance[looks & flying])) if (looks & flying).any() else 0.0
    good = looks & flying & (distance <= _FAR * usual)
    parts, landed_s = list[tuple[str, float, float]](), 0.0
    for (first, stop), out in zip(flights, outs, strict=True):
        seconds, inspects = at[first:stop], good[first:stop]
        begin = first + _begins(seconds, inspects) if first else first
        end = stop - 1 - _begins(-seconds[::-1], inspects[::-1]) if stop < len(at) else stop - 1
        takes_off_s, lands_s = float(at[first]), float(at[stop - 1])
        parts.append((_GROUND, landed_s, takes_off_s))
        if inspects.any() and begin < end:
            names = "climb", "transit", _INSPECTION, "return"
            edges = [takes_off_s, *(float(at[each]) for each in (out, begin, end)), lands_s]
            parts += zip(names, edges, edges[1:], strict=False)
        else:
            parts.append(("another flight", takes_off_s, lands_s))
        landed_s = lands_s
    log = Phases((*parts, (_GROUND, landed_s, float(at[-1]))))
    return log if log.lasting_s(_INSPECTION) >= _LEAST_S and log.share >= _LEAST_SHARE else None


def _on_ground(at: Floats, places: Floats) -> Bools:
    """At which stations (K,) it stands on the ground; at none where the log neither begins nor ends so."""
    low = places[:, 2] <= places[:, 2].min() + _LIFT_M
    later = np.searchsorted(at, at + _STILL_S).clip(max=len(at) - 1)
    still = low & (np.linalg.norm(places[later] - places, axis=1) <= _STILL_M)
    still &= at[later] - at >= _STILL_S - _STEP_S
    ground = np.zeros(len(at), bool)
    for first in np.flatnonzero(still):
        ground[first : later[first] + 1] = True
    if not (ground[0] or ground[-1]):
        return np.zeros(len(at), bool)
    for first, stop in _runs(~ground):  # a wobble on the ground is no flight
        ground[first:stop] |= bool(low[first:stop].all()) and first > 0 and stop < len(at)
    for first, stop in _runs(ground):  # low flight is no landing
        if first > 0 and stop < len(at) and at[stop - 1] - at[first] < _LANDED_S:
            ground[first:stop] = False
    return ground


def _runs(good: Bools) -> Ints:
    """First, and behind the last, of each run (R, 2) of stations that are good."""
    return np.flatnonzero(np.diff(np.concatenate([[False], good, [False]]))).reshape(-1, 2)


def _aside(home: Floats, places: Floats) -> int:
    """The first station that lies aside of and above the place of take-off; 0 where none does."""
    aside = np.hypot(*(places[:, :2] - home[:2]).T) > _ASIDE_M
    return int(np.argmax(aside & (places[:, 2] > home[2] + _LIFT_M)))


def met_in_the_middle(places: Floats, turns: Floats, scene: Scene, reach_m: float) -> Bools:
    """Which rays (N, 5) meet the structure within reach: along the camera's axis, and beside it all round."""
    rays = (Rotation.from_quat(turns).as_matrix() @ _MIDDLE.T).swapaxes(1, 2).reshape(-1, 3)
    range_m = scene.cast(np.repeat(places, len(_MIDDLE), axis=0), rays)[0]
    return np.asarray(range_m.reshape(-1, len(_MIDDLE)) <= reach_m)


def _begins(at: Floats, good: Bools) -> int:
    """The first good station from which on most are good for a while; behind all where there is none."""
    for first in np.flatnonzero(good):
        if good[(at >= at[first]) & (at < at[first] + _LASTS_S)].mean() >= _SHARE:
            return int(first)
    return len(at)

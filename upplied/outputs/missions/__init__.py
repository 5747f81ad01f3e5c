"""Mission files for autopilots and maps: a module per format, read back by others' software in the tests."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from upplied.errors import SettingsError
from upplied.outputs.files import replace_file
from upplied.outputs.mission_options import MissionOptions
from upplied.outputs.missions import dji_wpml, gate, kml, litchi, mavlink
from upplied.outputs.missions.csv import csv_text
from upplied.outputs.missions.fences import fence_text, fenced, rally_text
from upplied.outputs.missions.flying import Flying
from upplied.outputs.missions.geojson import geojson_text
from upplied.outputs.missions.mcap import mcap_bytes
from upplied.outputs.missions.mission import ANYTHING, missions_of
from upplied.outputs.missions.photos import interval_of
from upplied.outputs.missions.qgc_plan import qgc_plan_text
from upplied.outputs.missions.read_back import read_mcap, read_mission
from upplied.outputs.missions.records import SHORTEST_HOLD_S, Mission
from upplied.records import Camera, Plan, Structure, Trajectory

__all__ = ["FORMATS", "Exported", "Mission", "MissionOptions", "export", "missions_of"]

#: Format -> usual ending, what flies it, writer.
_WRITERS: dict[str, tuple[str, Flying, Callable[[Mission, MissionOptions], bytes | str]]] = {
    "qgc-plan": (".plan", mavlink.FLYING, qgc_plan_text),
    "mavlink": (".waypoints", mavlink.FLYING, mavlink.mavlink_text),
    "dji-wpml": (".kmz", dji_wpml.FLYING, dji_wpml.dji_kmz),
    "litchi": (".csv", litchi.FLYING, lambda mission, _: litchi.litchi_text(mission)),
    "kml": (".kml", kml.FLYING, lambda mission, _: kml.kml_text(mission)),
    "geojson": (".geojson", ANYTHING, lambda mission, _: geojson_text(mission)),
    "csv": (".csv", ANYTHING, lambda mission, _: csv_text(mission)),
}
#: Format -> usual ending of its files.
FORMATS: dict[str, str] = {name: ending for name, (ending, _, _) in _WRITERS.items()} | {"mcap": ".mcap"}


@dataclass(frozen=True)
class Exported:
    """What was written."""

    paths: tuple[Path, ...]  # one a sortie
    missions: tuple[Mission, ...]  # none for MCAP, which holds the plan itself
    notes: tuple[str, ...]  # what was assumed and checked, in words
    overruled: tuple[gate.Breach, ...] = ()  # rules of the gate, by `force`


def export(
    plan: Plan | Trajectory,
    structure: Structure,
    format: str,
    path: str | Path,
    options: MissionOptions | None = None,
    camera: Camera | None = None,
    objections: Sequence[gate.Breach] = (),
    keep: Callable[[Sequence[gate.Breach]], object] = lambda _: None,
    zones: Callable[[Sequence[Mission]], Sequence[str]] = lambda _: (),
) -> Exported:
    """Write a plan as a mission file, or as one for each sortie.

    Parameters
    ----------
    plan : Plan or Trajectory
        A plan must be ok.
    structure : Structure
        The one the plan is for; every format but MCAP needs its place on the Earth.
    format : {"qgc-plan", "mavlink", "dji-wpml", "litchi", "kml", "geojson", "mcap", "csv"}
    path : path
        Where to; several sorties become ``name-1of3.ext`` and so on.
    options : MissionOptions, optional
    camera : Camera, optional
        Of the demonstration, to check that thinning loses no view.
    objections : sequence of Breach, optional
        Rules that the plan is known to break already, for instance that it is superseded.
    keep : callable, optional
        Receives the rules that were overruled, before the first file is written.
    zones : callable, optional
        Results of the required zones, as notes; of the plan itself where there are no sorties.

    Raises
    ------
    RefusedError
        If the plan is not ok, the place is unknown, no safe mission follows from it, or the bytes that
        would be written break a rule of the gate that is not overruled.
    SettingsError
        If the format or an option is not known.
    """
    options = options or MissionOptions()
    goal = Path(path)
    limits = gate.limits_of(options, interval_of(options, camera)[0])
    named = [*gate.plan_breaches(plan), *objections]
    supposed = plan.supposed if isinstance(plan, Plan) else None
    if format == "mcap":
        content = mcap_bytes(plan, structure, camera)
        named += gate.breaches(read_mcap(content), structure, limits, supposed)
        overruled = gate.pass_or_refuse(structure.structure_id, named, options.overruled)
        notes = (*gate.notes_of(overruled), *zones(()))
        if notes:
            content = mcap_bytes(plan, structure, camera, notes)
        keep(overruled)
        written = replace_file(goal, content)
        return Exported((written,), (), ("in the structure frame, metres", *notes), overruled)
    if format not in _WRITERS:
        raise SettingsError(f"mission format {format!r}", "is unknown", f"one of {', '.join(FORMATS)}")
    write = _WRITERS[format][2]
    missions = fenced(missions_for(format, plan, structure, options, camera, objections), structure, supposed)
    overruled_breaches: dict[str, gate.Breach] = {}  # of what was overruled, by its words
    for mission in missions:  # all, before the first is written
        reading = read_mission(format, encoded(write(mission, options)), mission)
        passed = gate.pass_or_refuse(
            mission.name, gate.breaches(reading, structure, limits, supposed), options.overruled
        )
        overruled_breaches |= {str(breach): breach for breach in passed}
    more = tuple(breach for breach in overruled_breaches.values() if breach not in missions[0].overruled)
    notes = (*gate.notes_of(more), *zones(missions))
    missions = [
        replace(one, notes=(*notes, *one.notes), overruled=(*one.overruled, *more)) for one in missions
    ]
    keep(missions[0].overruled)
    paths = [replace_file(_numbered(goal, mission), encoded(write(mission, options))) for mission in missions]
    if format == "mavlink":  # files of their own there, for all sorties
        beside = {
            "fence": fence_text(missions[0]) if missions[0].fences else "",
            "rally": rally_text(missions[0]) if len(missions[0].rally) else "",
        }
        paths += [
            replace_file(goal.with_name(f"{goal.stem}.{name}{goal.suffix}"), text.encode())
            for name, text in beside.items()
            if text
        ]
    return Exported(tuple(paths), tuple(missions), missions[0].notes, missions[0].overruled)


def missions_for(
    format: str,
    plan: Plan | Trajectory,
    structure: Structure,
    options: MissionOptions,
    camera: Camera | None = None,
    objections: Sequence[gate.Breach] = (),
) -> list[Mission]:
    """The sorties of a plan as the software behind a format flies them; parameters as of `export`."""
    flying = ANYTHING if format == "mcap" else _WRITERS[format][1]
    if format in ("qgc-plan", "mavlink"):
        flying = replace(flying, note=mavlink.NOTES[options.firmware])
    missions = missions_of(plan, structure, options, flying, camera, (*gate.plan_breaches(plan), *objections))
    if format == "mcap":
        return missions
    interval_s = interval_of(options, camera)[0]
    return [_waiting(format, mission, options, interval_s) for mission in missions]


def _waiting(format: str, mission: Mission, options: MissionOptions, interval_s: float) -> Mission:
    """The mission, hovering before each photo that its file, with rounded figures, triggers too early."""
    if mission.photo.sum() < 2:
        return mission
    reading = read_mission(format, encoded(_WRITERS[format][2](mission, options)), mission)
    missing_s = interval_s - np.diff(reading.photo_s)
    extra_s = np.where(missing_s > 0, missing_s + SHORTEST_HOLD_S, 0.0)
    hold_s = mission.hold_s.copy()
    hold_s[np.flatnonzero(mission.photo)[1:]] += extra_s
    return replace(mission, hold_s=hold_s, duration_s=mission.duration_s + float(extra_s.sum()))


def encoded(content: bytes | str) -> bytes:
    """What is written to the file."""
    return content if isinstance(content, bytes) else content.encode("utf-8")


def _numbered(goal: Path, mission: Mission) -> Path:
    if mission.count == 1:
        return goal
    return goal.with_name(f"{goal.stem}-{mission.number}of{mission.count}{goal.suffix}")

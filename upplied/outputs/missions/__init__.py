"""Mission files for autopilots and maps; a module per format."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from upplied.errors import SettingsError
from upplied.files import replace_file
from upplied.outputs.mission_options import MissionOptions
from upplied.outputs.missions import gate, maps, mavlink
from upplied.outputs.missions.dji_wpml import dji_kmz
from upplied.outputs.missions.flying import FORMATS, Flying
from upplied.outputs.missions.mcap import mcap_bytes
from upplied.outputs.missions.mission import fenced, missions_of
from upplied.outputs.missions.photos import interval_of
from upplied.outputs.missions.read_back import read_mcap, read_mission
from upplied.outputs.missions.records import SHORTEST_HOLD_S, Mission
from upplied.records import Camera, Plan, Structure

__all__ = ["FORMATS", "Exported", "Mission", "MissionOptions", "export", "missions_of"]

#: Writers of all formats but MCAP, which contains the plan itself.
_WRITERS: dict[str, Callable[[Mission, MissionOptions], bytes | str]] = {
    "qgc-plan": mavlink.qgc_plan_text,
    "mavlink": mavlink.mavlink_text,
    "dji-wpml": dji_kmz,
    "litchi": lambda mission, _: maps.litchi_text(mission),
    "kml": lambda mission, _: maps.kml_text(mission),
    "geojson": lambda mission, _: maps.geojson_text(mission),
    "csv": lambda mission, _: maps.csv_text(mission),
}


@dataclass(frozen=True)
class Exported:
    """The result of an export."""

    paths: tuple[Path, ...]  # one per sortie
    missions: tuple[Mission, ...]  # none for MCAP, which contains the plan itself
    notes: tuple[str, ...]  # assumptions and checks, in words
    overruled: tuple[gate.Breach, ...] = ()  # rules of the gate, by `force`


def export(
    plan: Plan,
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
    plan, structure : Plan, Structure
        The plan must be ok; every format but MCAP needs the target's place on the Earth.
    format : {"qgc-plan", "mavlink", "dji-wpml", "litchi", "kml", "geojson", "mcap", "csv"}
    path : path
        Output file; several sorties become ``name-1of3.ext`` and so on.
    camera : Camera, optional
        Of the demonstration, to check that thinning loses no view.
    objections : sequence of Breach, optional
        Known breaches of rules, for instance that the plan is superseded.
    keep, zones : callable, optional
        The first receives the rules that were overruled, before the first file is written; the second gives
        the results of the required zones, as notes; those of the plan itself without sorties.

    Raises RefusedError if the plan is not ok, the place is unknown, no safe mission follows from it, or the
    bytes that would be written break a rule of the gate that is not overruled; SettingsError if the format
    or an option is not known.
    """
    options = options or MissionOptions()
    goal, limits = Path(path), gate.limits_of(options, interval_of(options, camera)[0])
    named = [*gate.plan_breaches(plan), *objections]
    if format == "mcap":
        content = mcap_bytes(plan, structure, camera)
        named += gate.breaches(read_mcap(content), structure, limits, plan.supposed)
        overruled = gate.pass_or_refuse(structure.structure_id, named, options.overruled)
        notes = (*gate.notes_of(overruled), *zones(()))
        content = mcap_bytes(plan, structure, camera, notes) if notes else content
        keep(overruled)
        notes = ("coordinates in metres, structure frame", *notes)
        return Exported((replace_file(goal, content),), (), notes, overruled)
    if format not in _WRITERS:
        raise SettingsError(f"mission format {format!r}", "is unknown", f"one of {', '.join(FORMATS)}")
    sorties = missions_for(format, plan, structure, options, camera, objections)
    missions = fenced(sorties, structure, plan.supposed)
    by_words: dict[str, gate.Breach] = {}  # overruled breaches
    for mission in missions:  # all, before the first is written
        reading = read_mission(format, _written(format, mission, options), mission)
        broken = gate.breaches(reading, structure, limits, plan.supposed)
        by_words |= {str(one): one for one in gate.pass_or_refuse(mission.name, broken, options.overruled)}
    more = tuple(breach for breach in by_words.values() if breach not in missions[0].overruled)
    notes = (*gate.notes_of(more), *zones(missions))
    missions = [replace(m, notes=(*notes, *m.notes), overruled=(*m.overruled, *more)) for m in missions]
    keep(missions[0].overruled)
    paths, first = [], missions[0]
    for one in missions:
        numbered = goal.with_name(f"{goal.stem}-{one.number}of{one.count}{goal.suffix}")
        paths.append(replace_file(goal if one.count == 1 else numbered, _written(format, one, options)))
    if format == "mavlink":  # separate files, for all sorties
        for name, text in (("fence", mavlink.fence_text(first)), ("rally", mavlink.rally_text(first))):
            if text:
                paths.append(replace_file(goal.with_name(f"{goal.stem}.{name}{goal.suffix}"), text))
    return Exported(tuple(paths), tuple(missions), first.notes, first.overruled)


def missions_for(
    format: str,
    plan: Plan,
    structure: Structure,
    options: MissionOptions,
    camera: Camera | None = None,
    objections: Sequence[gate.Breach] = (),
) -> list[Mission]:
    """The sorties of a plan as the software of a format flies them; parameters of `export`."""
    flying = Flying.of(format, options.firmware)
    missions = missions_of(plan, structure, options, flying, camera, (*gate.plan_breaches(plan), *objections))
    if format == "mcap":
        return missions
    interval_s = interval_of(options, camera)[0]
    return [_waiting(format, mission, options, interval_s) for mission in missions]


def _waiting(format: str, mission: Mission, options: MissionOptions, interval_s: float) -> Mission:
    """The mission, hovering before each photo that its file, with rounded figures, triggers too early."""
    if mission.photo.sum() < 2:
        return mission
    reading = read_mission(format, _written(format, mission, options), mission)
    missing_s = interval_s - np.diff(reading.photo_s)
    extra_s = np.where(missing_s > 0, missing_s + SHORTEST_HOLD_S, 0.0)
    hold_s = mission.hold_s.copy()
    hold_s[np.flatnonzero(mission.photo)[1:]] += extra_s
    return replace(mission, hold_s=hold_s, duration_s=mission.duration_s + float(extra_s.sum()))


def _written(format: str, mission: Mission, options: MissionOptions) -> bytes:
    content = _WRITERS[format](mission, options)
    return content if isinstance(content, bytes) else content.encode()

"""Mission files for autopilots and maps: a module per format, read back by others' software in the tests."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from upplied.errors import SettingsError
from upplied.outputs.files import replace_file
from upplied.outputs.missions import dji_wpml, litchi
from upplied.outputs.missions.csv import csv_text
from upplied.outputs.missions.geojson import geojson_text
from upplied.outputs.missions.kml import kml_text
from upplied.outputs.missions.mavlink import mavlink_text
from upplied.outputs.missions.mcap import mcap_bytes
from upplied.outputs.missions.mission import Mission, missions_of
from upplied.outputs.missions.options import MissionOptions
from upplied.outputs.missions.qgc_plan import qgc_plan_text
from upplied.records import Camera, Plan, Structure, Trajectory

__all__ = ["FORMATS", "Exported", "Mission", "MissionOptions", "export", "missions_of"]

#: Format -> usual ending, most waypoints of one file (None: as many as there are), writer.
_WRITERS: dict[str, tuple[str, int | None, Callable[[Mission, MissionOptions], bytes | str]]] = {
    "qgc-plan": (".plan", None, qgc_plan_text),
    "mavlink": (".waypoints", None, mavlink_text),
    "dji-wpml": (".kmz", dji_wpml.MAX_WAYPOINTS, dji_wpml.dji_kmz),
    "litchi": (".csv", litchi.MAX_WAYPOINTS, lambda mission, _: litchi.litchi_text(mission)),
    "kml": (".kml", None, lambda mission, _: kml_text(mission)),
    "geojson": (".geojson", None, lambda mission, _: geojson_text(mission)),
    "csv": (".csv", None, lambda mission, _: csv_text(mission)),
}
#: Format -> usual ending of its files.
FORMATS: dict[str, str] = {name: ending for name, (ending, _, _) in _WRITERS.items()} | {"mcap": ".mcap"}


@dataclass(frozen=True)
class Exported:
    """What was written."""

    paths: tuple[Path, ...]  # one a sortie
    missions: tuple[Mission, ...]  # none for MCAP, which holds the plan itself
    notes: tuple[str, ...]  # what was assumed and checked, in words


def export(
    plan: Plan | Trajectory,
    structure: Structure,
    format: str,
    path: str | Path,
    options: MissionOptions | None = None,
    camera: Camera | None = None,
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

    Raises
    ------
    RefusedError
        If the plan is not ok, the place is unknown, or no safe mission follows from it.
    SettingsError
        If the format or an option is not known.
    """
    options = options or MissionOptions()
    goal = Path(path)
    if format == "mcap":
        written = replace_file(goal, mcap_bytes(plan, structure, camera))
        return Exported((written,), (), ("in the structure frame, metres",))
    if format not in _WRITERS:
        raise SettingsError(f"mission format {format!r}", "is unknown", f"one of {', '.join(FORMATS)}")
    _, cap, write = _WRITERS[format]
    missions = missions_of(plan, structure, options, cap, camera)
    contents = [write(mission, options) for mission in missions]  # all of them, before the first is written
    paths = [
        replace_file(_numbered(goal, mission), content)
        for mission, content in zip(missions, contents, strict=True)
    ]
    return Exported(tuple(paths), tuple(missions), missions[0].notes)


def _numbered(goal: Path, mission: Mission) -> Path:
    if mission.count == 1:
        return goal
    return goal.with_name(f"{goal.stem}-{mission.number}of{mission.count}{goal.suffix}")

"""The pilot's brief, on paper, and the pilot's part of a plan's page: the mission, drawn and in figures."""

import html
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from typing import Any

import numpy as np

from upplied.catalog.verbs.recipes import settings_of
from upplied.errors import UppliedError
from upplied.geometry.polylines import leg_lengths
from upplied.outputs import pages
from upplied.outputs.labels import LABELS
from upplied.outputs.mission_drawing import MissionDrawing
from upplied.outputs.missions import Mission, MissionOptions, missions_for
from upplied.outputs.missions.gate import DRAFT
from upplied.outputs.pairs import number
from upplied.outputs.verdicts import headline
from upplied.records import Camera, Plan, Structure

_MB_OF_A_MEGAPIXEL = 0.4  # of a JPEG as inspection cameras write it
_USUAL_MEGAPIXELS = 20.0  # if the log does not state the size of the picture


def brief_html(
    row: Mapping[str, Any],
    missions: Sequence[Mission],
    structure: Structure,
    camera: Camera,
    options: MissionOptions,
    warnings: Sequence[str],
    zones: Sequence[str] = (),
    photos: Sequence[tuple[str, bytes]] = (),
    custody: Sequence[str] = (),
) -> str:
    """One self-contained page, A4 when printed.

    The row is the plan's of `transfers`; the missions are its sorties, which passed the gate, or their notes
    list the overruled rules. `zones` are the result for each required zone, `photos` captions and PNGs of
    findings to inspect again, `custody` the note with the heads of the catalog's tables.
    """
    notes = [*missions[0].notes, *custody]
    overruled = [note for note in notes if note.startswith(("OVERRULED", DRAFT))]
    title = f"{row['demonstration_id']} on {row['target_id']}"
    drawing = MissionDrawing.of_missions(missions, structure, camera)
    north = "Map, north up. H: take-off; dots: photos; yellow: their footprints; grey: transit legs."
    heights = _figure(drawing.heights(), "Heights above take-off, by distance flown.")
    body = [
        f"<h1>{_text(title)}</h1>",
        f"<p>Plan {_text(row['transfer_id'])}, preset {_text(row['preset'])}, "
        f"method {_text(row['method_version'])}, planned {_text(row['planned_at'])[:16]} UTC</p>",
        _verdict(overruled),
        f"<p>{_text(headline(row, options.clearance_m))}</p>",
        f'<div class="maps">{_figure(drawing.map(), north)}{heights}</div>',
        '<div class="columns"><div>',
        _heights(missions, structure, options),
        "</div><div>",
        _measures(row, missions[0].shown_pct),
        "</div></div>",
        _sorties(missions),
        _photos(photos),
        _listed("Required zones", zones),
        _listed("Warnings", warnings),
        _listed("Assumptions and checks", [note for note in notes if note not in overruled]),
    ]
    return pages.paper_page(title, "brief.css", "\n".join(body))


def _verdict(overruled: Sequence[str]) -> str:
    if not overruled:
        return '<p class="verdict go">All safety checks passed, take-off to landing.</p>'
    draft = all(note.startswith(DRAFT) for note in overruled)
    words = "This plan is a draft and is not released" if draft else "Safety rules were overruled"
    return f'<div class="verdict stop">{words}:{_items(overruled)}</div>'


def _photos(photos: Sequence[tuple[str, bytes]]) -> str:
    figures = "".join(
        _figure(pages.image_address(png), text) if png else f"<p>{_text(text)}</p>" for text, png in photos
    )
    return f'<h2>Reference photos</h2><div class="photos">{figures}</div>' if photos else ""


def _figure(source: str, text: str) -> str:
    return f'<figure><img alt="{_text(text)}" src="{source}"><figcaption>{_text(text)}</figcaption></figure>'


def _heights(missions: Sequence[Mission], structure: Structure, options: MissionOptions) -> str:
    first = missions[0]
    home, ground = float(first.home_local[2]), structure.floor_z_m
    every = np.concatenate([mission.local[:, 2] for mission in missions])
    transit_z = np.concatenate([mission.local[~mission.inspect, 2] for mission in missions])
    ceiling = structure.surroundings.ceiling_z_m
    lat, lon, _ = first.home
    rows = [
        ("take-off", f"{lat:.6f}, {lon:.6f}"),
        ("take-off above ground", f"{home - ground:.1f} m"),
        ("highest point above take-off", f"{every.max() - home:.1f} m"),
        ("highest point above ground", f"{every.max() - ground:.1f} m"),
        ("lowest point above ground", f"{every.min() - ground:.1f} m"),
        ("transit legs above take-off", f"{(transit_z if len(transit_z) else every).max() - home:.1f} m"),
        ("return-to-home altitude above take-off", f"at least {first.return_height_m:.1f} m"),
        ("ceiling", "none declared" if ceiling is None else f"{ceiling - home:.1f} m above take-off"),
        ("clearance limit of every leg", f"{options.clearance_m:g} m"),
    ]
    return _table("Heights", rows)


def _measures(row: Mapping[str, Any], by_photos_pct: float) -> str:
    scaled, rows = row.get("standoff_mode") == "scaled", []
    for name, (words, form) in LABELS["brief"].items():
        if (value := number(row, name)) is not None:
            size = ", relative to size" if scaled and name == "coverage_inspected_pct" else ""
            rows.append((words + size, form.format(value)))
    if by_photos_pct == by_photos_pct:
        rows.insert(1, ("inspected surface shown by the photos", f"{by_photos_pct:.1f} %"))
    return _table("Plan", rows)


def _sorties(missions: Sequence[Mission]) -> str:
    start = "first waypoint (latitude, longitude, height in m)"
    head = ("flight", "waypoints", "photos", "length (m)", "time (s)", start)
    cells = []
    for mission in missions:
        every = mission.photo_distance_m
        photos = f"every {every:g} m" if every else str(int(mission.photo.sum()))
        (lat, lon, _), length = mission.geodetic[0], float(leg_lengths(mission.local).sum())
        first = f"{lat:.6f}, {lon:.6f}, {mission.height_m[0]:.1f}"
        name, figures = f"{mission.number} of {mission.count}", (f"{length:.0f}", f"{mission.duration_s:.0f}")
        cells.append((name, int(mission.inspect.sum()), photos, *figures, first))
    return _table("Flights", cells, head)


def _table(title: str, rows: Sequence[Sequence[object]], head: Sequence[str] = ()) -> str:
    every = [("th", head)] * bool(head) + [("td", row) for row in rows]
    cells = ("".join(f"<{tag}>{_text(each)}</{tag}>" for each in row) for tag, row in every)
    return f"<h2>{_text(title)}</h2><table>{''.join(f'<tr>{row}</tr>' for row in cells)}</table>"


def _listed(title: str, texts: Sequence[str]) -> str:
    return f"<h2>{_text(title)}</h2>{_items(texts)}" if texts else ""


def _items(texts: Sequence[str]) -> str:
    return f"<ul>{''.join(f'<li>{_text(text)}</li>' for text in texts)}</ul>"


def _text(value: object) -> str:
    return html.escape(str(value))


def fly_data(row: Any, plan: Plan, structure: Structure, camera: Camera) -> dict[str, Any]:
    """The mission of a plan with the usual options; ``refused`` is the reason why there is none.

    A draft is drawn as a draft: its file leaves by a release alone.
    """
    if plan.status != "ok":
        return path_drawn(plan, structure, camera, plan.reason or "The plan has no path.")
    options = as_settled(row, MissionOptions(draft=True))
    try:
        missions = missions_for("qgc-plan", plan, structure, options, camera)
    except UppliedError as error:
        return path_drawn(plan, structure, camera, str(error))
    return _mission_data(missions, structure, options, camera)


def path_drawn(plan: Plan, structure: Structure, camera: Camera, refused: str = "") -> dict[str, Any]:
    """The path of a plan alone, as `fly_data` shows a mission; `refused` says why there is none."""
    if plan.trajectory is None or plan.is_viewpoint is None:
        return {"refused": refused}
    return {"refused": refused, **_drawings(MissionDrawing.of_plan(plan, structure, camera))}


def as_settled(row: Any, options: MissionOptions) -> MissionOptions:
    """The options with the vehicle, and at least the clearance, of the plan's settings where none was set."""
    try:
        settings = settings_of(str(row.get("settings_json") or "{}"))
    except (ValueError, KeyError, UppliedError):  # of a program that knew other settings
        return options
    usual, vehicle = MissionOptions(), asdict(settings.vehicle)
    more = {name: value for name, value in vehicle.items() if getattr(options, name) == getattr(usual, name)}
    if settings.route.enforce and options.clearance_m == usual.clearance_m:
        more["clearance_m"] = max(usual.clearance_m, settings.route.clearance_m)
    return replace(options, **more)


def _mission_data(
    missions: Sequence[Mission], structure: Structure, options: MissionOptions, camera: Camera
) -> dict[str, Any]:
    """Drawings, flights, heights, photos and battery of a mission as a page shows them."""
    first, home = missions[0], missions[0].home_local
    photos = sum(map(_count_photos, missions))
    usable_s = None if options.endurance_s is None else options.endurance_s * (1 - options.reserve_pct / 100)
    megapixels = camera.width_px * camera.height_px / 1e6 or _USUAL_MEGAPIXELS
    legs = np.concatenate([mission.local[~mission.inspect, 2] for mission in missions])
    data = {"refused": "", **_drawings(MissionDrawing.of_missions(missions, structure, camera))}
    data |= {"home_deg": first.home[:2].tolist(), "return_m": first.return_height_m}
    data["transit_m"] = float(legs.max() - home[2]) if len(legs) else None
    data["highest_m"] = float(max(mission.height_m.max() for mission in missions))
    data |= {"endurance_s": options.endurance_s, "usable_s": usable_s, "photos": photos}
    data["shown_pct"] = None if np.isnan(first.shown_pct) else first.shown_pct
    data |= {"interval_s": _interval_s(missions), "storage_mb": photos * (megapixels * _MB_OF_A_MEGAPIXEL)}
    data["assumed_camera"] = not camera.width_px
    return data | {"flights_s": [mission.duration_s for mission in missions]}


def _drawings(drawing: MissionDrawing) -> dict[str, Any]:
    return {"map": drawing.map(), "heights": drawing.heights(), "legend": drawing.legend()}


def _count_photos(mission: Mission) -> int:
    if not mission.photo_distance_m:
        return int(mission.photo.sum())
    return 1 + int(leg_lengths(mission.local[mission.inspect]).sum() / mission.photo_distance_m)


def _interval_s(missions: Sequence[Mission]) -> float | None:
    """The shortest time between two photos, s; the camera must store one within it."""
    shortest = []
    for mission in missions:
        if mission.photo_distance_m:
            fastest = float(mission.speed_mps[mission.inspect].max())
            shortest.append(mission.photo_distance_m / max(fastest, 0.1))
        else:
            shortest += np.diff(mission.arrival_s[mission.photo]).tolist()
    return min(shortest, default=None)

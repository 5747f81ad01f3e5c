"""What the expert looked at, and the viewpoints of the flight (paper, Alg. 2, lines 1 to 13)."""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial

import numpy as np
from scipy.spatial import cKDTree

from upplied.config import Settings
from upplied.errors import SettingsError
from upplied.geometry.polylines import chosen_evenly
from upplied.geometry.scene import scene_of
from upplied.planning.correspondence.memo import Memo, content_key, no_memo, remembering
from upplied.planning.correspondence.pair import Pair
from upplied.planning.demonstration.attention import Attention, attention
from upplied.planning.demonstration.denoise import Smoothed, smoothed
from upplied.planning.demonstration.stations import find_viewpoints
from upplied.planning.surface.parts import labels_of
from upplied.planning.surface.skin import Skin, middle_of
from upplied.planning.visibility.line_of_sight import visible
from upplied.planning.visibility.observations import BY_FRUSTUM, TRULY, Moments, Views, moments, views
from upplied.records import (
    Bools,
    Camera,
    Cloud,
    Demonstration,
    Floats,
    Ints,
    Record,
    Structure,
    Trajectory,
    Viewpoints,
    Visibility,
)

_NEIGHBOURS = 25  # samples nearest to a landmark, that say which part of the skin it lies in
_RULE = (
    "landmarks, part_0, part_1, ..., 'box X Y Z X Y Z' (two corners, m), 'ball X Y Z R' (m) or labels of "
    "faces, separated by commas"
)
#: Which faces (T,) of a structure have a label, by the hash of the labels and the label.
Faces = Callable[[Structure, str, str], Bools]
_FOOTPRINT = 0.5  # of the picture's smaller side on the surface: how far stations are apart, at most
_POSES = 200  # that tell how far from the surface the flight is


def zone_of(
    about: str, structure: Structure, cloud: Cloud, skin: Ints, faces: Faces | None = None
) -> Bools | None:
    """Which surface samples (N,) a text names; None where it names none.

    Parameters
    ----------
    about : str
        Landmarks of the structure (the part of the skin there), ``part_3`` of a summary, or
        ``box 10 2 1 14 6 4``: two corners in the structure's declared frame, m, or ``ball 10 2 1 0.5``:
        the surface that near to a place, on the side that is nearest to it. Separated by commas.
    structure, cloud
        In whatever frame it is planned in, and its N surface samples.
    skin : array of int, shape (N,)
        The part of the skin that each lies on.
    faces : callable, optional
        What ``labels HASH LABEL`` asks for the faces of a label.

    Raises
    ------
    SettingsError
        If a name is unknown, a box or ball has not its numbers, or nothing of the surface is named.
    """
    names = [word.strip() for word in about.split(",") if word.strip()]
    if not names:
        return None
    zone = np.zeros(len(cloud), bool)
    for word in names:
        zone |= _zone(word, structure, cloud, skin, faces)
    if not zone.any():
        raise SettingsError(f"about {about[:80]!r}", "names no surface of the structure", _RULE)
    return zone


def _zone(word: str, structure: Structure, cloud: Cloud, skin: Ints, faces: Faces | None) -> Bools:
    if word.lower().startswith("box "):
        corners = _numbers(word, 6, "a box").reshape(2, 3)
        low, high = corners.min(axis=0), corners.max(axis=0)
        points = structure.frame.to_declared(cloud.points)
        return np.asarray(((points >= low) & (points <= high)).all(axis=1), bool)
    if word.lower().startswith("ball "):
        *place, radius = _numbers(word, 4, "a ball")
        points = structure.frame.to_declared(cloud.points)
        off = np.linalg.norm(points - place, axis=1)
        same_side = np.ones(len(cloud), bool)
        if cloud.normals is not None:  # of a thin plate one side is meant
            same_side = cloud.normals @ cloud.normals[int(off.argmin())] > 0
        return np.asarray((off <= radius) & same_side, bool)
    if word.startswith("labels ") and faces is not None and len(structure.triangles):
        named = word.split()
        if len(named) != 3:
            raise SettingsError(f"about {word[:60]!r}", "cannot be read as labels", _RULE)
        nearest = scene_of(structure).closest(cloud.points)[1]
        return np.asarray(faces(structure, *named[1:])[nearest], bool)
    if word in structure.landmarks:
        count = min(_NEIGHBOURS, len(cloud))
        near = cKDTree(cloud.points).query(np.array(structure.landmarks[word]), k=count)[1]
        return np.asarray(skin == np.bincount(skin[np.atleast_1d(near)]).argmax(), bool)
    label = labels_of(cloud)
    number = word.removeprefix("part_")
    if word.startswith("part_") and number.isdecimal() and int(number) <= int(label.max()):
        return np.asarray(label == int(number), bool)
    known = ", ".join(sorted(structure.landmarks)) or "none"
    reason = f"is unknown; landmarks of {structure.structure_id}: {known}"
    raise SettingsError(f"about {word[:60]!r}", reason, _RULE)


def _numbers(word: str, count: int, what: str) -> Floats:
    try:
        numbers = np.array([float(part) for part in word.split()[1:]])
    except ValueError:
        numbers = np.empty(0)
    if len(numbers) != count or not np.isfinite(numbers).all():
        raise SettingsError(f"about {word[:60]!r}", f"cannot be read as {what}", _RULE)
    return numbers


@dataclass(frozen=True, eq=False, repr=False)
class Inspection(Record):
    """A demonstration as the planner sees it."""

    flight: Trajectory  # M poses
    camera: Camera
    visibility: Visibility  # (M, N) of the cloud that the preset plans on
    viewpoints: Viewpoints
    by_frustum: Views  # of the voxel cloud: what the paper's coverage counts
    truly: Views  # of the surface samples
    attention: Attention  # how much the flight was about each surface sample
    logged: Trajectory  # the flight as logged
    logged_breaks: Ints  # its first pose after each gap
    breaks: Ints = field(default_factory=lambda: np.empty(0, np.int64))  # that of `flight`

    @property
    def steps(self) -> Moments:
        """The flight as logged, in even steps of time."""
        return self.derived("steps", lambda: moments(self.logged, self.logged_breaks))


def inspect_demonstration(
    demonstration: Demonstration, pair: Pair, skin: Skin, settings: Settings, memo: Memo, grain: str
) -> Inspection:
    """Visibility along the flight, and its viewpoints, remembered by content.

    `skin` is the source's; `grain` names the samples of the source, where they are not its even ones.
    """
    memo = remembering(memo, demonstration.sha256, pair.source.sha256)
    camera = demonstration.camera
    # Stations are so far apart that what one shows and the next overlap well.
    every = max(1, len(demonstration) // _POSES)
    away = float(np.median(pair.source_scene.distance(demonstration.positions[::every])))
    away = float(np.clip(away, camera.min_range_m, camera.max_range_m))
    half = np.radians(min(camera.hfov_deg, camera.vfov_deg, 120.0)) / 2
    spacing_m = float(max(_FOOTPRINT * 2 * away * np.tan(half), 0.1))
    flight, breaks = prepared(demonstration, settings, memo, spacing_m)
    facts, rule = (demonstration.sha256, pair.source.sha256, settings.clouds), settings.viewpoints
    key = content_key(
        "visibility", *facts, grain, settings.visibility, rule.most_poses, settings.refine.method
    )
    sight = pair.fit_for(settings).source, camera, settings.visibility, pair.source_scene, flight.fov_deg
    along_flight = partial(visible, flight.positions, flight.quat_xyzw, *sight)
    seen = memo("visibility", Visibility, key, along_flight)
    segments = partial(find_viewpoints, flight, seen, rule, breaks)
    in_frustum = partial(views, demonstration.trajectory, pair.voxels.source, camera, BY_FRUSTUM)
    truly, attended = attended_by(demonstration, pair, skin, settings, memo, grain)
    return Inspection(
        flight=flight,
        camera=camera,
        visibility=seen,
        viewpoints=memo("viewpoints", Viewpoints, content_key("viewpoints", key, rule), segments),
        by_frustum=memo("views", Views, content_key("frustum", *facts), in_frustum),
        truly=truly,
        attention=attended,
        logged=demonstration.trajectory,
        logged_breaks=demonstration.breaks,
        breaks=breaks,
    )


def attended_by(
    demonstration: Demonstration,
    pair: Pair,
    skin: Skin,
    settings: Settings,
    memo: Memo = no_memo,
    grain: str = "even",
) -> tuple[Views, Attention]:
    """What a flight truly sees of the source's samples, and how much it was about each."""
    memo = remembering(memo, demonstration.sha256, pair.source.sha256)
    flown, camera, cloud = demonstration.trajectory, demonstration.camera, pair.surface.source
    facts = (demonstration.sha256, pair.source.sha256, settings.clouds, grain)
    in_sight = partial(views, flown, cloud, camera, TRULY, pair.source_scene)
    truly = memo("views", Views, content_key("truly", *facts), in_sight)

    def about() -> Attention:
        stretch, rule = skin.of(cloud), settings.inspection
        zone = zone_of(rule.about or demonstration.about, pair.source, cloud, middle_of(stretch))
        return attention(flown, demonstration.breaks, camera, cloud, truly, stretch, rule, zone)

    key = content_key("attention", *facts, settings.inspection, demonstration.about)
    return truly, memo("attention", Attention, key, about)


def prepared(
    demonstration: Demonstration, settings: Settings, memo: Memo = no_memo, spacing_m: float = np.inf
) -> tuple[Trajectory, Ints]:
    """The flight to plan on, and the poses that start a new part after a gap.

    The paper assumes a demonstration free of noise, so its preset takes the poses as they are; a
    flight of more than `most_poses` is thinned evenly. `recommended` plans on the flight as the
    pilot meant it, without the jitter of hand and sensors, at stations at most `spacing_m` apart.
    """
    flight = demonstration.trajectory
    if settings.refine.method == "view":
        key = content_key("flight", demonstration.sha256, spacing_m)
        steady = memo("flight", Smoothed, key, lambda: smoothed(flight, spacing_m, demonstration.breaks))
        return steady.flight, steady.breaks
    keep = chosen_evenly(len(flight), settings.viewpoints.most_poses)
    starts = np.unique(np.searchsorted(keep, demonstration.breaks))
    return flight.take(keep), starts[(starts > 0) & (starts < len(keep))]


def nothing_shown(inspection: Inspection, pair: Pair, settings: Settings) -> str:
    """Why there is nothing to plan for, in words; empty where the demonstration shows something."""
    match, seen = pair.fit_for(settings).correspondences, inspection.visibility.total
    if not seen.any():
        return (
            f"the demonstration shows nothing of {pair.source.structure_id}: no pose has any of its surface "
            "in view; check where the structure stands in the log's frame, and how the camera is mounted"
        )
    if not (seen & (match.target_index >= 0)).any():
        return f"nothing of what the demonstration shows has a counterpart on {pair.target.structure_id}"
    return ""

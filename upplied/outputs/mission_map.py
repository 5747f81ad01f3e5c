"""The map and the side view of a mission, as the pilot's brief shows them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from upplied.outputs.colours import rgb
from upplied.outputs.draw import tubes
from upplied.outputs.draw.canvas import picture, solid
from upplied.outputs.draw.sheet import Panel, sheet_png
from upplied.outputs.draw.views import View, fitted
from upplied.records import Floats, Structure

_SIZE = 900, 560  # px
_TRANSIT, _RULE, _HOME = "#7a7a7a", "#b3261e", "#000000"
_SORTIES = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00")  # Okabe and Ito


@dataclass(frozen=True)
class Line:
    """One sortie on a map, structure frame, m."""

    way_in: Floats  # (A, 3) from take-off
    inspection: Floats  # (B, 3)
    way_out: Floats  # (C, 3) to landing


def map_png(structure: Structure, lines: Sequence[Line], north_deg: float) -> bytes:
    """The structure from above with every sortie, north up.

    Parameters
    ----------
    structure : Structure
        Its keep-out boxes and fence are drawn too.
    lines : sequence of Line
    north_deg : float
        Bearing of the structure's +X, clockwise from true north.
    """
    around = structure.surroundings
    tops = (((x, y), (u, y), (u, v), (x, v), z) for (x, y, _), (u, v, z) in around.keep_out_m)
    rules = [np.array([[*corner, z] for corner in corners]) for *corners, z in tops]
    if len(around.geofence_m):
        rules.append(np.column_stack([around.geofence_m, np.zeros(len(around.geofence_m))]))
    return _drawn(structure, lines, View(north_deg + 180.0, 90.0), rules, "Map, north up")


def side_png(structure: Structure, lines: Sequence[Line]) -> bytes:
    """The structure from the side that shows most of the flight, with heights."""
    path = np.concatenate([line.inspection for line in lines])
    along = np.linalg.svd(path[:, :2] - path[:, :2].mean(axis=0), full_matrices=False)[2][0]
    along = along * (1 if along[np.abs(along).argmax()] > 0 else -1)
    heights = np.concatenate([structure.vertices[:, 2], path[:, 2]])
    title = f"Side view, z from {heights.min():.1f} to {heights.max():.1f} m"
    azimuth = float(np.degrees(np.arctan2(-along[0], along[1])))
    return _drawn(structure, lines, View(azimuth, 0.0), [], title)


def _drawn(
    structure: Structure, lines: Sequence[Line], view: View, rules: Sequence[Floats], title: str
) -> bytes:
    paths = [(np.concatenate([rule, rule[:1]]), _RULE) for rule in rules]
    legend = [("keep-out or geofence", _RULE, "line")] if rules else []
    for at, line in enumerate(lines):
        colour = _SORTIES[at % len(_SORTIES)]
        paths += [(line.way_in, _TRANSIT), (line.way_out, _TRANSIT), (line.inspection, colour)]
        legend.append((f"flight {at + 1}", colour, "line"))
    legend += [("transit", _TRANSIT, "line"), ("take-off", _HOME, "patch")]
    everything = np.concatenate([structure.vertices, *(positions for positions, _ in paths)])
    frame = fitted(view, everything, *_SIZE)
    radius_m = 1.5 / frame.metre_px
    drawn = [tubes.path(positions, radius_m, rgb(colour)) for positions, colour in paths]
    starts = [(line.inspection[:1], _SORTIES[at % len(_SORTIES)]) for at, line in enumerate(lines)]
    for place, colour in [*starts, (lines[0].way_in[:1], _HOME)]:
        drawn.append(tubes.path(place, 4 * radius_m, rgb(colour)))
    image = picture(solid(structure), tubes.joined(drawn), frame)
    return sheet_png([Panel(image, 0, 0, "", frame)], legend, title)

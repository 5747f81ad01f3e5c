"""Sketches of a mission on paper: a map with north up, and a view from the side with the heights."""

from __future__ import annotations

import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from upplied.extras import extra
from upplied.records import Floats, Ints, Structure

with extra("export"):
    from PIL import Image, ImageDraw, ImageFont

_SIZE = (900, 620)
_MARGIN = 46
_SKIN, _EDGE, _WAY, _RULE = "#c9cfd6", "#8a939d", "#7a7a7a", "#b3261e"
_SORTIES = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00")  # Okabe and Ito
_SCALES_M = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000)


@dataclass(frozen=True)
class Line:
    """One sortie on a sketch, structure frame, m."""

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
    bearing = np.radians(north_deg)
    turn = np.array([[np.sin(bearing), -np.cos(bearing)], [np.cos(bearing), np.sin(bearing)]])

    def flat(points: Floats) -> Floats:
        return np.asarray(points)[:, :2] @ turn.T

    around = structure.surroundings
    rules = [_corners(low, high) for low, high in around.keep_out_m]
    if len(around.geofence_m):
        rules.append(around.geofence_m)
    return _drawn(structure, lines, flat, [flat(rule) for rule in rules], north=True)


def side_png(structure: Structure, lines: Sequence[Line]) -> bytes:
    """The structure from the side that shows most of the flight, with heights."""
    path = np.concatenate([line.inspection for line in lines])
    spread = np.linalg.svd(path[:, :2] - path[:, :2].mean(axis=0), full_matrices=False)[2][0]
    spread = spread * (1 if spread[np.abs(spread).argmax()] > 0 else -1)

    def flat(points: Floats) -> Floats:
        return np.stack([points[:, :2] @ spread, points[:, 2]], axis=1)

    return _drawn(structure, lines, flat, [], north=False)


def _drawn(
    structure: Structure,
    lines: Sequence[Line],
    flat: Callable[[Floats], Floats],
    rules: Sequence[Floats],
    north: bool,
) -> bytes:
    skin = flat(structure.vertices)
    paths = [[flat(part) for part in (line.way_in, line.inspection, line.way_out)] for line in lines]
    everything = np.concatenate([skin, *(part for parts in paths for part in parts), *rules])
    low, high = everything.min(axis=0), everything.max(axis=0)
    scale = float(min((np.array(_SIZE) - 2 * _MARGIN) / np.maximum(high - low, 1e-6)))
    left = (np.array(_SIZE) - scale * (high - low)) / 2

    def pixels(points: Floats) -> list[tuple[float, float]]:
        at = left + scale * (points - low)
        return [(float(x), float(_SIZE[1] - y)) for x, y in at]

    image = Image.new("RGB", _SIZE, "white")
    draw, font = ImageDraw.Draw(image), ImageFont.load_default(22)
    _skin(draw, pixels(skin), structure.triangles)
    for rule in rules:
        draw.line(pixels(np.concatenate([rule, rule[:1]])), fill=_RULE, width=3)
    for at, (way_in, inspection, way_out) in enumerate(paths):
        colour = _SORTIES[at % len(_SORTIES)]
        for way in (way_in, way_out):
            draw.line(pixels(way), fill=_WAY, width=2)
        draw.line(pixels(inspection), fill=colour, width=3)
        _label(draw, pixels(inspection[:1])[0], str(at + 1), colour, font)
    home = pixels(paths[0][0][:1])[0]
    draw.rectangle([home[0] - 5, home[1] - 5, home[0] + 5, home[1] + 5], fill="black")
    draw.text((home[0] + 9, home[1] - 13), "H", fill="black", font=font)
    _scale_bar(draw, scale, font)
    if north:
        draw.line([(30, 70), (30, 22)], fill="black", width=3)
        draw.polygon([(30, 12), (23, 28), (37, 28)], fill="black")
        draw.text((25, 74), "N", fill="black", font=font)
    else:
        for height in (float(low[1]), float(high[1])):
            level = _SIZE[1] - (left[1] + scale * (height - low[1]))
            draw.line([(8, level), (_SIZE[0] - 8, level)], fill=_EDGE, width=1)
            draw.text((10, level - 27), f"z {height:.1f} m", fill="black", font=font)
    buffer = io.BytesIO()
    image.save(buffer, "PNG", optimize=True)
    return buffer.getvalue()


def _skin(draw: ImageDraw.ImageDraw, at: list[tuple[float, float]], triangles: Ints) -> None:
    if len(triangles) == 0:
        draw.point(at, fill=_EDGE)
        return
    for triangle in triangles.tolist():
        draw.polygon([at[corner] for corner in triangle], fill=_SKIN, outline=_SKIN)


def _label(draw: ImageDraw.ImageDraw, at: tuple[float, float], text: str, colour: str, font: object) -> None:
    x, y = at
    draw.ellipse([x - 14, y - 14, x + 14, y + 14], fill=colour, outline="white")
    draw.text((x, y), text, fill="white", anchor="mm", font=font)  # type: ignore[arg-type]


def _scale_bar(draw: ImageDraw.ImageDraw, scale: float, font: object) -> None:
    metres = max([each for each in _SCALES_M if each * scale < 220] or [_SCALES_M[0]])
    x, y = _SIZE[0] - 30 - metres * scale, _SIZE[1] - 18
    draw.line([(x, y), (x + metres * scale, y)], fill="black", width=4)
    draw.text((x, y - 30), f"{metres} m", fill="black", font=font)  # type: ignore[arg-type]


def _corners(low: Floats, high: Floats) -> Floats:
    return np.array([[low[0], low[1]], [high[0], low[1]], [high[0], high[1]], [low[0], high[1]]])

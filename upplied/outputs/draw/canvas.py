"""Pictures by casting rays: a shaded surface with tubes in front of it and, faintly, behind it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
from scipy.ndimage import map_coordinates

from upplied.geometry.discs import Discs
from upplied.geometry.scene import Scene
from upplied.outputs.colours import BACKGROUND, CLASSES, STATES, SURFACE, rgb
from upplied.outputs.display import Neighbourhood
from upplied.outputs.draw.shade import corner_normals, lit, open_sky, smooth_normals
from upplied.outputs.draw.tubes import Tubes
from upplied.outputs.draw.views import Frame
from upplied.records import Bools, Floats, Ints, Structure, SurfaceStates

_BEHIND = 0.20  # opacity of a tube behind the surface
_FINE = ((-0.125, -0.375), (0.375, -0.125), (0.125, 0.375), (-0.375, 0.125))  # rays of a pixel at an edge
_CONTRAST = 0.03  # from which a pixel counts as an edge
_COARSE = 2  # the sky is sampled at every second pixel
_WHITE = np.array(rgb(BACKGROUND))


@dataclass
class Solid:
    """A structure ready to be drawn, with its surface coloured by state or class where that is known."""

    vertices: Floats
    triangles: Ints
    states: SurfaceStates | None = None
    label: Ints | None = None  # (T,) index into `CLASSES`
    scene: Scene = field(init=False)
    normals: Floats = field(init=False)
    _near: Neighbourhood | None = field(init=False, default=None)

    def __post_init__(self) -> None:
        self.scene = Scene(self.vertices, self.triangles)
        self.normals = corner_normals(self.vertices, self.triangles)
        if self.states is not None and len(self.states.points):
            self._near = Neighbourhood(self.states, self.size_m)

    @property
    def size_m(self) -> float:
        """Diagonal of the bounding box, m."""
        return float(np.linalg.norm(np.ptp(self.vertices, axis=0)))

    def colours(self, points: Floats, normals: Floats) -> Floats:
        """Colour (N, 3) of the surface at points (N, 3) with normals towards the eye (N, 3)."""
        if self.label is not None:
            return _palette(CLASSES)[self.label[self.scene.closest(points)[1]]]
        if self._near is None:
            return np.broadcast_to(rgb(SURFACE), points.shape)
        return _palette(STATES.values())[self._near.states(points, normals)]


def _palette(colours: Iterable[str]) -> Floats:
    return np.array([rgb(colour) for colour in colours])


def solid(structure: Structure, states: SurfaceStates | None = None, label: Ints | None = None) -> Solid:
    """The structure's mesh, or discs for a point cloud, coloured by state or by the class of each piece."""
    mesh = structure.vertices, structure.triangles
    if not len(structure.triangles):
        mesh = Discs.of(structure.vertices, structure.normals).mesh()
    if label is not None:
        label = np.repeat(label, len(mesh[1]) // max(len(label), 1))
    return Solid(*mesh, states, label)


def picture(body: Solid, lines: Tubes, frame: Frame) -> np.ndarray:
    """The picture, uint8 (height, width, 3): one ray a pixel, and more where neighbours differ.

    Where only a tube ends, the surface behind it needs no more rays: each has its own edges.
    """
    painter, size = _Painter(body, lines, frame), (frame.height, frame.width)
    rows, columns = (each.ravel() for each in np.indices(size, np.float64) + 0.5)
    surface, reach = painter.surface(columns, rows)
    rough = _edges(surface.reshape(*size, 3)).ravel()
    image = painter.with_lines(surface, reach, columns, rows)
    edge = _edges(image.reshape(*size, 3)).ravel() | rough
    total, fine = np.zeros((np.count_nonzero(edge), 3)), rough[edge]
    for right, down in _FINE:
        x, y = columns[edge] + right, rows[edge] + down
        behind, far = surface[edge], reach[edge]
        behind[fine], far[fine] = painter.surface(x[fine], y[fine])
        total += painter.with_lines(behind, far, x, y)
    image[edge] = total / len(_FINE)
    return np.round(255 * image).astype(np.uint8).reshape(*size, 3)


def _edges(image: Floats) -> Bools:
    """Pixels (H, W) of an image (H, W, 3) that differ from a neighbour."""
    down, right = ((np.abs(np.diff(image, axis=axis)) > _CONTRAST).any(axis=2) for axis in (0, 1))
    edge = np.zeros(image.shape[:2], bool)
    edge[1:] |= down
    edge[:-1] |= down
    edge[:, 1:] |= right
    edge[:, :-1] |= right
    return edge


class _Painter:
    """Colours of single rays; the open sky is looked up in a coarse grid made once."""

    def __init__(self, body: Solid, lines: Tubes, frame: Frame) -> None:
        self.body, self.lines, self.frame = body, lines, frame
        self.line_scene = Scene(lines.vertices, lines.triangles) if len(lines.triangles) else None
        self._sky = self._ambient_of_grid()

    def surface(self, x: Floats, y: Floats) -> tuple[Floats, Floats]:
        """Colour (N, 3) in 0 .. 1 and distance (N,), m, of the surface at picture points x, y (N,), px."""
        reach, points, normals, hit = self._surface(*self.frame.rays(x, y))
        out = np.tile(_WHITE, (len(x), 1))
        at = np.flatnonzero(hit)
        if len(at):
            grid = np.stack([y[at], x[at]]) / _COARSE - 0.5
            sky = map_coordinates(self._sky, grid, order=1, mode="nearest")
            paint = self.body.colours(points[at], normals[at])
            out[at] = lit(paint, normals[at], self.frame.back, self.frame.up, sky)
        return out, reach

    def with_lines(self, colours: Floats, reach: Floats, x: Floats, y: Floats) -> Floats:
        """The colours (N, 3) of surfaces at `reach` (N,), m, with the tubes over them."""
        if self.line_scene is None:
            return colours
        _, directions = rays = self.frame.rays(x, y)
        line_reach, triangle, face = self.line_scene.cast(*rays)
        at = np.flatnonzero(triangle >= 0)
        facing = np.abs(np.einsum("ij,ij->i", face[at], directions[at]))
        colour = self.lines.colours[triangle[at]] * (0.72 + 0.28 * facing)[:, None]
        opacity = np.where(line_reach[at] < reach[at], 1.0, _BEHIND)[:, None]
        out = colours.copy()
        out[at] = opacity * colour + (1 - opacity) * out[at]
        return out

    def _surface(self, origins: Floats, directions: Floats) -> tuple[Floats, Floats, Floats, np.ndarray]:
        reach, triangle, face = self.body.scene.cast(origins, directions)
        hit = triangle >= 0
        points, normals = np.zeros_like(face), np.zeros_like(face)
        points[hit] = origins[hit] + reach[hit, None] * directions[hit]
        mixed = smooth_normals(
            self.body.vertices, self.body.triangles, self.body.normals, triangle[hit], points[hit]
        )
        away = np.einsum("ij,ij->i", face[hit], directions[hit]) > 0
        same = np.einsum("ij,ij->i", mixed, face[hit]) > 0
        normals[hit] = np.where((away == same)[:, None], -mixed, mixed)
        return reach, points, normals, hit

    def _ambient_of_grid(self) -> Floats:
        """Open sky (rows, columns) at every second picture point; all of it where nothing is hit."""
        x, y = np.meshgrid(
            *(np.arange(0, side, _COARSE) + _COARSE / 2 for side in (self.frame.width, self.frame.height))
        )
        _, points, normals, hit = self._surface(*self.frame.rays(x.ravel(), y.ravel()))
        sky, size = np.ones(len(hit)), self.body.size_m
        sky[hit] = open_sky(self.body.scene, points[hit], normals[hit], 0.25 * size, 2e-3 * size)
        return sky.reshape(x.shape)

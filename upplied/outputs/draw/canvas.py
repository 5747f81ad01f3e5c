"""Pictures by casting rays: a shaded surface with tubes in front of it and, faintly, behind it."""

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
from scipy.ndimage import map_coordinates

from upplied.geometry.discs import Discs
from upplied.geometry.scene import Scene
from upplied.geometry.vectors import area_vectors, sphere
from upplied.outputs.colours import BACKGROUND, CLASSES, STATES, SURFACE, rgb
from upplied.outputs.display import Neighbourhood
from upplied.outputs.draw.tubes import Tubes
from upplied.outputs.draw.views import Frame
from upplied.records import Bools, Floats, Ints, Structure, SurfaceStates

_BEHIND = 0.20  # opacity of a tube behind the surface
_FINE = ((-0.125, -0.375), (0.375, -0.125), (0.125, 0.375), (-0.375, 0.125))  # rays of a pixel at an edge
_CONTRAST = 0.03  # from which a pixel counts as an edge
_COARSE = 2  # the sky is sampled at every second pixel
_WHITE = np.array(rgb(BACKGROUND))
_CREASE_COS = np.cos(np.radians(40.0))  # sharper edges stay edges
_SMOOTHED_TRIANGLES = 150_000  # finer meshes look smooth without
_AMBIENT_RAYS = 16


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
        # Open sky (rows, columns) at every second picture point; all of it where nothing is hit.
        sides = frame.width, frame.height
        x, y = np.meshgrid(*(np.arange(0, side, _COARSE) + _COARSE / 2 for side in sides))
        _, points, normals, hit = self._surface(*frame.rays(x.ravel(), y.ravel()))
        sky, size = np.ones(len(hit)), body.size_m
        sky[hit] = open_sky(body.scene, points[hit], normals[hit], 0.25 * size, 2e-3 * size)
        self._sky = sky.reshape(x.shape)

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
        mesh = self.body.vertices, self.body.triangles, self.body.normals
        mixed = smooth_normals(*mesh, triangle[hit], points[hit])
        away = np.einsum("ij,ij->i", face[hit], directions[hit]) > 0
        same = np.einsum("ij,ij->i", mixed, face[hit]) > 0
        normals[hit] = np.where((away == same)[:, None], -mixed, mixed)
        return reach, points, normals, hit


def corner_normals(vertices: Floats, triangles: Ints) -> Floats:
    """A normal (T, 3, 3) for each corner: the mean of the faces around it that meet without a crease.

    The winding may be inconsistent, as in half of real meshes: a neighbour counts with the sign that agrees
    with the face itself.
    """
    edges = vertices[triangles]
    weighted = area_vectors(edges)
    area = np.linalg.norm(weighted, axis=1, keepdims=True)
    face = weighted / np.maximum(area, 1e-300)
    if not 0 < len(triangles) <= _SMOOTHED_TRIANGLES:
        return np.repeat(face[:, None], 3, axis=1)
    _, place = np.unique(np.round(vertices, 5), axis=0, return_inverse=True)
    first, second = _pairs_sharing(place.reshape(-1)[triangles].reshape(-1))
    agree = np.einsum("ij,ij->i", face[first // 3], face[second // 3])
    smooth = np.abs(agree) > _CREASE_COS
    first, second, sign = first[smooth], second[smooth], np.sign(agree[smooth])
    contribution = weighted[second // 3] * sign[:, None]
    count = 3 * len(triangles)
    total = np.stack([np.bincount(first, part, minlength=count) for part in contribution.T], axis=1)
    length = np.linalg.norm(total, axis=1, keepdims=True)
    own = np.repeat(face, 3, axis=0)
    return np.where(length > 1e-300, total / np.maximum(length, 1e-300), own).reshape(-1, 3, 3)


def _pairs_sharing(place: Ints, most: int = 24) -> tuple[Ints, Ints]:
    """All ordered pairs of corners at the same place; at a crowded place each meets its next `most`."""
    order = np.argsort(place, kind="stable")
    ranked = place[order]
    count = np.bincount(ranked)
    begin = np.concatenate([[0], np.cumsum(count)[:-1]])
    degree = count[ranked]
    reach = np.minimum(degree, most)
    first = np.repeat(np.arange(len(order)), reach)
    step = np.arange(len(first)) - np.repeat(np.cumsum(reach) - reach, reach)
    start = begin[ranked[first]]
    second = start + (first - start + step) % degree[first]
    return order[first], order[second]


def smooth_normals(vertices: Floats, triangles: Ints, normals: Floats, hit: Ints, points: Floats) -> Floats:
    """Normals (N, 3) at points (N, 3) on the triangles `hit` (N,), interpolated from the corners."""
    a, b, c = (vertices[triangles[hit, corner]] for corner in range(3))
    to_b, to_c, to_p = b - a, c - a, points - a
    bb, bc, cc = (np.einsum("ij,ij->i", x, y) for x, y in ((to_b, to_b), (to_b, to_c), (to_c, to_c)))
    pb, pc = (np.einsum("ij,ij->i", to_p, y) for y in (to_b, to_c))
    area = np.maximum(bb * cc - bc * bc, 1e-300)
    v, w = (cc * pb - bc * pc) / area, (bb * pc - bc * pb) / area
    weights = np.clip(np.stack([1 - v - w, v, w], axis=1), 0, 1)
    mixed = np.einsum("nk,nkj->nj", weights, normals[hit])
    return mixed / np.maximum(np.linalg.norm(mixed, axis=1, keepdims=True), 1e-12)


def lit(colours: Floats, normals: Floats, towards_eye: Floats, up: Floats, ambient: Floats) -> Floats:
    """Colours (N, 3) under a sun above the viewer's left shoulder and a bright sky.

    Normals (N, 3) point to the viewer's side; `ambient` (N,) is the share of the sky that is open, 0 .. 1.
    """
    sun = towards_eye + 0.9 * up + 0.7 * np.cross(towards_eye, up)
    sun /= np.linalg.norm(sun)
    direct = np.clip(normals @ sun, 0, 1)
    sky = 0.5 + 0.5 * normals[:, 2]
    strength = (0.34 + 0.24 * sky) * (0.35 + 0.65 * ambient) + 0.50 * direct * (0.6 + 0.4 * ambient)
    return np.clip(colours * strength[:, None], 0, 1)


def open_sky(scene: Scene, points: Floats, normals: Floats, reach_m: float, lift_m: float) -> Floats:
    """Share (N,) of the directions around each normal in which nothing stands within reach.

    The same directions serve every point, so that the result carries no noise.
    """
    blocked, weight = np.zeros(len(points)), np.zeros(len(points))
    for direction in sphere(2 * _AMBIENT_RAYS):
        cosine = normals @ direction
        above = np.flatnonzero(cosine > 0.1)
        starts = points[above] + lift_m * normals[above]
        weight[above] += cosine[above]
        blocked[above] += cosine[above] * scene.occluded(starts, starts + reach_m * direction, slack=0.0)
    return 1 - blocked / np.maximum(weight, 1e-12)

"""The one door to Open3D: rays, distances and mesh files, with numpy on this side.

Open3D is imported on first use, so that the command's help, catalog queries and exports
never load it. Embree works in single precision: every scene subtracts the centre of its bounding
box first, which keeps millimetres for structures far from their origin.
"""

import ctypes
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache, partial
from importlib import import_module
from types import ModuleType
from typing import Any

import numpy as np

from upplied.extras import extra
from upplied.geometry import reconstruction
from upplied.geometry.discs import DiscCells, Discs, hexagons
from upplied.geometry.vectors import area_vectors
from upplied.records import Bools, Floats, Ints, Structure
from upplied.threads import ray_threads


@cache
def open3d() -> Any:
    """The open3d module; a bare system's missing libusb is supplied from the package index's copy."""
    try:
        ctypes.CDLL("libusb-1.0.so.0")
    except OSError:
        with extra("plan"):
            import libusb_package
        path = libusb_package.get_library_path()
        if path is not None:
            ctypes.CDLL(str(path), mode=ctypes.RTLD_GLOBAL)
    with extra("plan"), _plots_deferred():
        import open3d as module

    module.utility.set_verbosity_level(module.utility.VerbosityLevel.Error)
    return module


_PLOTS = "open3d.visualization.draw_plotly"


@contextmanager
def _plots_deferred() -> Iterator[None]:
    """While Open3D loads, let its plots in a browser wait until somebody asks for one."""
    # It imports Dash for them, with Plotly, pydantic and Flask: most of what it takes to load, and no switch
    # leaves them out.
    if "open3d" in sys.modules:
        yield
        return
    waiting = ModuleType(_PLOTS)
    waiting.__getattr__ = lambda name: partial(_plot, name)  # type: ignore[method-assign]
    sys.modules[_PLOTS] = waiting
    try:
        yield
    finally:
        del sys.modules[_PLOTS]


def _plot(name: str, *args: Any, **kwargs: Any) -> Any:
    """Call a function of Open3D's plots, which are loaded now, as if they had been from the start."""
    plots, package = import_module(_PLOTS), sys.modules["open3d.visualization"]
    for public in ("get_plotly_fig", "draw_plotly", "draw_plotly_server"):
        setattr(package, public, getattr(plots, public))
    return getattr(plots, name)(*args, **kwargs)


class Scene:
    """A triangle mesh that answers questions about rays and distances.

    Parameters
    ----------
    vertices : array, shape (V, 3), m
    triangles : array, shape (T, 3), vertex indices
    threads : int
        Of each call; 0: as many as `threads.cast_rays_on` states, else as the library chooses.
        Results do not depend on it.
    grain_m : float
        How coarsely the triangles stand for the surface: 0 for a mesh, the discs' radius for a
        sampled cloud. A sight line that comes this near to its target has arrived.
    error_m : float
        How much nearer the surface may be than its triangles, as stated, or see `Discs.error_m` and
        `reconstruction.held`: `distance` and `closest` take it to be so.
    thin_m, thin_error_m : float
        Where the triangles are nearer than that to those across, `thin_error_m` stands for `error_m`.
    cells : DiscCells, optional
        The discs that the triangles stand for, in its order, from which distances are taken. Triangles
        are numbered in the order that the discs had before.
    """

    def __init__(
        self, vertices: Floats, triangles: Ints, threads: int = 0, grain_m: float = 0.0, error_m: float = 0.0,
        cells: DiscCells | None = None, thin_m: float = 0.0, thin_error_m: float = 0.0,
    ) -> None:  # fmt: skip
        self.box = vertices.min(axis=0), vertices.max(axis=0)
        self.origin = (self.box[0] + self.box[1]) / 2
        self.threads = threads or ray_threads()
        self.grain_m, self.error_m, self._cells = grain_m, error_m, cells
        self._scene = open3d().t.geometry.RaycastingScene(nthreads=self.threads)
        mesh = (vertices - self.origin).astype(np.float32), triangles.astype(np.uint32)
        self._scene.add_triangles(*(open3d().core.Tensor(np.ascontiguousarray(each)) for each in mesh))
        self.thin_m, self.thin_error_m = thin_m, thin_error_m
        self._thin = np.empty(0, np.int64)
        if thin_m:  # the surface across, on either side, is nearer than that
            corners = vertices[triangles] - self.origin
            normals = area_vectors(corners)
            across = thin_m * normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
            rays = (np.hstack([corners.mean(axis=1) + 1e-3 * way, way]) for way in (-across, across))
            self._thin = np.flatnonzero(np.logical_or(*(self.blocked(each, slack=0.0) for each in rays)))
        if len(self._thin):
            self._ends = Scene(vertices, triangles[self._thin], self.threads, error_m=thin_error_m)

    def occluded(self, origins: Floats, targets: Floats, slack: float = 1e-3) -> Bools:
        """Whether something stands between each origin and its target (N, 3), m.

        A target usually lies on the surface itself: hits in the last share `slack` of a ray do not count.
        """
        starts = np.asarray(origins - self.origin, np.float32)
        ends = np.asarray(targets - self.origin, np.float32)
        return self.blocked(np.concatenate([starts, ends - starts], axis=1), slack)

    def blocked(self, rays: np.ndarray, slack: float = 1e-3) -> Bools:
        """`occluded` for given rays: no copy, for callers that cast millions.

        Rays (N, 6), single precision, m, are the start, relative to `origin`, and the vector to the target.
        """
        ends = {"tnear": 0.0, "tfar": 1.0 - slack, "nthreads": self.threads}
        return np.asarray(self._scene.test_occlusions(self._tensor(rays), **ends).numpy(), bool)

    def cast(self, origins: Floats, directions: Floats) -> tuple[Floats, Ints, Floats]:
        """The first hit of each ray: how far it is, which triangle, and its unit normal (N, 3), as wound.

        The first (N,) is in units of each direction's length, inf where nothing is hit; the second -1 there.
        """
        hit = self._scene.cast_rays(self._rays(origins, directions), self.threads)
        triangle = hit["primitive_ids"].numpy().astype(np.int64)
        triangle[triangle == self._scene.INVALID_ID] = -1
        if self._cells is not None:
            disc, part = np.divmod(triangle, Discs.TRIANGLES)
            triangle = np.where(triangle < 0, -1, Discs.TRIANGLES * self._cells.index[disc] + part)
        reach, normal = (hit[name].numpy().astype(float) for name in ("t_hit", "primitive_normals"))
        return reach, triangle, normal

    def hits(self, origins: Floats, directions: Floats) -> Ints:
        """How many surfaces each ray crosses, (N,)."""
        rays = self._rays(origins, directions)
        return self._scene.count_intersections(rays, self.threads).numpy().astype(np.int64)

    def distance(self, points: Floats) -> Floats:
        """Unsigned distance (N,) of each point (N, 3) from the surface, m, less what that may be off."""
        away = self.apart(points)
        if self.error_m:
            away = np.maximum(away - self.error_m, 0.0)
        return np.minimum(away, self._ends.distance(points)) if len(self._thin) else away

    def apart(self, points: Floats) -> Floats:
        """Unsigned distance (N,) of each point (N, 3) from the triangles, m, as though they were exact."""
        if self._cells is not None:
            return self._cells.distance(points)
        local = self._tensor(np.reshape(points, (-1, 3)) - self.origin)
        return self._scene.compute_distance(local, self.threads).numpy().astype(float)

    def nearer_supposed(self, points: Floats) -> Bools:
        """Which points (N, 3) are nearer to surface that is supposed than to what is known: none here."""
        return np.zeros(len(points), bool)

    def closest(self, points: Floats) -> tuple[Floats, Ints]:
        """Closest place (N, 3), m, that the surface may reach, and its triangle (N,)."""
        points = np.reshape(points, (-1, 3))
        if self._cells is not None:
            places, disc = self._cells.closest(points)
            triangle = Discs.TRIANGLES * disc
        else:
            nearest = self._scene.compute_closest_points(self._tensor(points - self.origin), self.threads)
            places = nearest["points"].numpy().astype(float) + self.origin
            triangle = nearest["primitive_ids"].numpy().astype(np.int64)
        if self.error_m:
            away = points - places
            length = np.maximum(np.linalg.norm(away, axis=1, keepdims=True), 1e-12)
            places = places + away * np.minimum(self.error_m / length, 1.0)
        if len(self._thin):
            others, end = self._ends.closest(points)
            nearer = np.linalg.norm(others - points, axis=1) < np.linalg.norm(places - points, axis=1)
            places = np.where(nearer[:, None], others, places)
            triangle = np.where(nearer, self._thin[end], triangle)
        return places, triangle

    def _rays(self, origins: Floats, directions: Floats) -> Any:
        starts = np.asarray(origins - self.origin, np.float32)
        return self._tensor(np.concatenate([starts, np.asarray(directions, np.float32)], axis=1))

    @staticmethod
    def _tensor(array: np.ndarray) -> Any:
        return open3d().core.Tensor.from_numpy(np.ascontiguousarray(array, np.float32))


def scene_of(structure: Structure, threads: int = 0) -> Scene:
    """The scene of a structure's mesh, or of the oriented discs of a point cloud; kept with its record."""
    return structure.derived("scene", lambda: _new_scene(structure, threads))


def surface_error_m(structure: Structure) -> float:
    """How far the surface may lie from where a structure has it, m: as stated, or as its form tells."""
    if len(structure.triangles):
        return reconstruction.held(structure).error_m
    stated = structure.surface_error_m
    return discs_of(structure).error_m() if stated is None else stated


def _new_scene(structure: Structure, threads: int) -> Scene:
    if len(structure.triangles):
        of = reconstruction.held(structure)
        own = structure.vertices, structure.triangles, threads
        return Scene(*own, error_m=of.error_m, thin_m=of.thin_m, thin_error_m=of.thin_error_m)
    discs, error_m = discs_of(structure), surface_error_m(structure)
    cells = DiscCells.of(discs.points, discs.normals, discs.radius_m)
    # In the order of the cells: what lies together in space does so in memory, and the tree is sooner made.
    mesh = hexagons(cells.points, cells.normals, cells.radius_m)
    return Scene(*mesh, threads, discs.grain_m, error_m, cells)


def discs_of(structure: Structure) -> Discs:
    """The oriented discs that stand for a point cloud, of some of its points; kept with its record."""
    return structure.derived("discs", lambda: Discs.of(*_few(structure.vertices, structure.normals)))


# Fifteen for each sample of a surface. All of 100 000 points state two thirds of the error that these do
# (0.12 m instead of 0.18), and take a tenth more CPU of the plan.
_MOST_DISCS = 60_000


def _few(points: Floats, normals: Floats | None) -> tuple[Floats, Floats | None]:
    """A cloud of at most so many points that rays can be cast at their discs in bounded time and memory."""
    if len(points) <= _MOST_DISCS:
        return points, normals
    chosen = np.sort(np.random.default_rng(0).choice(len(points), _MOST_DISCS, replace=False))
    return points[chosen], None if normals is None else normals[chosen]


def simplified(vertices: Floats, triangles: Ints, count: int) -> tuple[Floats, Ints]:
    """A coarser mesh of about `count` triangles, by quadric error; smaller meshes stay as they are."""
    if len(triangles) <= count:
        return vertices, triangles
    origin = vertices.mean(axis=0)
    of = open3d().utility
    corners, faces = of.Vector3dVector(vertices - origin), of.Vector3iVector(triangles.astype(np.int32))
    mesh = open3d().geometry.TriangleMesh(corners, faces)
    mesh.remove_duplicated_vertices()
    mesh.remove_degenerate_triangles()
    mesh.remove_duplicated_triangles()
    coarse = mesh.simplify_quadric_decimation(count)
    if len(coarse.triangles) > 1.2 * count:  # it stalls on non-manifold edges, and then tears the shape
        coarse = mesh.remove_non_manifold_edges().simplify_quadric_decimation(count)
    coarse.remove_unreferenced_vertices()
    return np.asarray(coarse.vertices) + origin, np.asarray(coarse.triangles).astype(np.int64)

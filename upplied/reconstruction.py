"""Whether a mesh was made from a scan rather than drawn, and how far the surface may lie from one that was.

A program that makes a mesh from a scan spreads triangles of like size and form over the surface, whatever
the surface is. A mesh that was drawn has flat faces, and repeats what is mirrored, extruded or placed twice.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from upplied.records import Floats, Ints, Record, Structure
from upplied.vectors import area_vectors

_FEWEST = 1000  # triangles: fewer stand for no scan
_ASKED = 4000  # places, spread evenly by area, at which it is asked what a mesh is like
_SLIVER = 1e-6  # area of a triangle, over its longest edge squared, that has no form
_SAME = (
    1e-4  # how far edges of congruent triangles differ at most, of their length: single precision holds it
)
_FLAT = 2e-4  # sine of the angle between triangles of one plane: 0.01 deg
# From here a mesh is as even as scans are, and drawn ones are only where nothing of them is irregular, as a
# cube or ball of even triangles: of 54 drawn meshes those had a share of 1.00, others were no more even than
# 0.68; of 106 reconstructions (seeds 31 to 33) the share was 0.97 at most.
_EVEN, _WHOLLY = 0.7, 0.99
_FOLD = np.cos(np.pi / 6)  # between the normals of triangles that a fold parts
_WIDE = 95  # percentile over the folds
# Poisson at depth 8 to 10 and 10 000 to 200 000 triangles, ball pivoting, and marching cubes, of structures
# of seeds 31 to 35: the clean surface came nearer than the mesh by 0.8 grains in the median of 83 and by 2.4
# at most.
_LOST = 2.5
# Half of the real meshes, made anew, with and without noise (28): 11 keep 2.5 grains at every place, 22 where
# it is 6 at what is thinner than 2; with 4 grains everywhere, which is as much in the mean, 18.
_THIN, _LOST_THIN = 2.0, 6.0


@dataclass(frozen=True, eq=False, repr=False)
class _Faces(Record):
    """The triangles of a mesh that have a form, and the pairs of them that share an edge."""

    edges_m: Floats  # (T, 3)
    area_m2: Floats  # (T,)
    normals: Floats  # (T, 3) unit, as wound
    pairs: Ints  # (P, 2)
    along_m: Floats  # (P,) length of the edge that a pair shares

    @classmethod
    def of(cls, structure: Structure) -> _Faces:
        corners = structure.vertices[structure.triangles]
        edges = np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=2)
        twice = area_vectors(corners)
        area = np.linalg.norm(twice, axis=1) / 2
        formed = area > _SLIVER * edges.max(axis=1, initial=0.0) ** 2
        triangles, edges, area = structure.triangles[formed], edges[formed], area[formed]
        ends = np.sort(np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=2), axis=2).reshape(-1, 2)
        name = ends[:, 0] * len(structure.vertices) + ends[:, 1]
        order = np.argsort(name, kind="stable")
        shared = np.flatnonzero(name[order[1:]] == name[order[:-1]])
        one, other = order[shared], order[shared + 1]
        normals = twice[formed] / (2 * area[:, None])
        return cls(edges, area, normals, np.column_stack([one, other]) // 3, edges.reshape(-1)[one])

    def exact(self) -> float:
        """Share of the area on triangles in one plane with a neighbour, or congruent to another."""
        from scipy.spatial import cKDTree

        across = np.linalg.norm(np.cross(*self._paired()), axis=1)
        plane = np.zeros(len(self.area_m2), bool)
        plane[self.pairs[(across < _FLAT) & (self._cosine() > 0)]] = True
        cumulated = np.cumsum(self.area_m2)
        at = np.searchsorted(cumulated, (np.arange(_ASKED) + 0.5) / _ASKED * cumulated[-1])
        asked, which = np.unique(np.minimum(at, len(cumulated) - 1), return_inverse=True)
        form = np.log(np.sort(self.edges_m, axis=1))
        alike = cKDTree(form).query(form[asked], k=2)[0][:, 1] < _SAME
        return float((alike | plane[asked])[which].mean())

    def even(self) -> float:
        """How near triangles are to equilateral, mean by area: 1 where all are, 0.87 half squares."""
        form = 4 * np.sqrt(3) * self.area_m2 / (self.edges_m**2).sum(axis=1)
        return float((form * self.area_m2).sum() / self.area_m2.sum())

    def grain_m(self) -> float:
        """How wide triangles are across the folds of a mesh, the widest left out: what is thinner is lost."""
        width = 2 * self.area_m2[self.pairs].min(axis=1) / self.along_m
        folded = self._cosine() < _FOLD
        return float(np.percentile(width[folded] if folded.any() else width, _WIDE))

    def _paired(self) -> tuple[Floats, Floats]:
        return self.normals[self.pairs[:, 0]], self.normals[self.pairs[:, 1]]

    def _cosine(self) -> Floats:
        return np.asarray(np.einsum("pi,pi->p", *self._paired()))


@dataclass(frozen=True, eq=False, repr=False)
class Held(Record):
    """What a mesh holds of the surface that it stands for; nothing is lost of one that was drawn."""

    error_m: float = 0.0  # how far the surface may lie outside of it
    thin_m: float = 0.0  # what is thinner may be left out as a whole
    thin_error_m: float = 0.0  # how far the surface may lie outside of what is left of it


def held(structure: Structure) -> Held:
    """What a mesh holds of its surface.

    What was scanned and is thinner than the grain of a reconstruction is rounded off: tips, trailing edges,
    parapets. Its own folds, the sharpest that it could hold, tell the grain. Where it is itself no thicker
    than two grains, more may be lost: of a strut, a mast or a plate that ends there, the rest.
    Nothing is known of what was never scanned, or left out as a whole.

    Parameters
    ----------
    structure : Structure
        A mesh.

    Returns
    -------
    Held
    """
    if len(structure.triangles) < _FEWEST:
        return Held()
    faces = _Faces.of(structure)
    if len(faces.area_m2) < _FEWEST or not len(faces.pairs):
        return Held()
    even = faces.even()
    if faces.exact() >= (even if even < _EVEN else _WHOLLY):
        return Held()
    grain_m = faces.grain_m()
    return Held(_LOST * grain_m, _THIN * grain_m, _LOST_THIN * grain_m)


def error_m(structure: Structure) -> float:
    """How far the surface may lie outside of a mesh, m: 0 for one that was drawn, which is exact."""
    return held(structure).error_m

"""How far the true surface may lie from a mesh: of a scan by its grain, of a drawn one by its roughness.

Whether a mesh is a scan is declared (`Structure.is_scan`), never inferred. A mesh that looks like the
reconstruction of a scan is warned of: triangles of like form spread over the surface, whatever it is.
"""

from dataclasses import dataclass

import numpy as np

from upplied.geometry.vectors import area_vectors
from upplied.records import Floats, Ints, Record, Structure

_SLIVER = 1e-6  # area of a triangle, over its longest edge squared, that has no form
_FOLD = np.cos(np.pi / 6)  # between the normals of triangles that a fold parts
_WIDE = 95  # percentile over the folds
# Poisson at depth 8 to 10 and 10 000 to 200 000 triangles, ball pivoting, and marching cubes, of structures
# of seeds 31 to 35: the clean surface came nearer than the mesh by 0.8 grains in the median of 83 and by 2.4
# at most.
_LOST = 2.5
# Half of the real meshes, made anew, with and without noise (28): 11 keep 2.5 grains at every place, 22 where
# it is 6 at what is thinner than 2; with 4 grains everywhere, which is as much in the mean, 18.
_THIN, _LOST_THIN = 2.0, 6.0
# The smoothest tenth of the edges tells how exact a mesh is: in a drawn one as many lie within faces. Of 106
# drawn meshes, 80 of them real, the error is 2.3 mm at most and 0.02 mm at the 95th percentile; with vertices
# moved by up to 1 mm along each axis 0.9 to 7.4 mm, 2.2 in the median; rounded to 1 cm 13.6 mm at most.
_SMOOTH, _ROUGH = 10, 12.0
_FEWEST = 1000  # triangles: fewer stand for no scan
_FLAT_DEG = 1.0  # between triangles of one face
# Of 106 drawn meshes none is above 0.65, and 1 mm of noise takes none there; of reconstructions at Poisson's
# depth 8 all of 54 are above 0.72, decimated to 20 000 triangles 48, to 5 000 triangles 34.
_LOOKS_SCANNED = 0.68


@dataclass(frozen=True, eq=False, repr=False)
class _Faces(Record):
    """The triangles of a mesh that have a form, and the pairs of them that alone share an edge."""

    edges_m: Floats  # (T, 3)
    area_m2: Floats  # (T,)
    pairs: Ints  # (P, 2)
    along_m: Floats  # (P,) length of the edge that a pair shares
    cosine: Floats  # (P,) between the normals of a pair, as wound
    bend_m: Floats  # (P,) how far the four corners of a pair must move, root of the squares, to share a plane

    @classmethod
    def of(cls, structure: Structure) -> "_Faces":
        corners = structure.vertices[structure.triangles]
        edges = np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=2)
        twice = area_vectors(corners)
        area = np.linalg.norm(twice, axis=1) / 2
        formed = area > _SLIVER * edges.max(axis=1, initial=0.0) ** 2
        triangles, edges, area = structure.triangles[formed], edges[formed], area[formed]
        normals = twice[formed] / (2 * area[:, None])
        ends = np.sort(np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=2), axis=2).reshape(-1, 2)
        name = ends[:, 0] * len(structure.vertices) + ends[:, 1]
        order = np.argsort(name, kind="stable")
        _, first, count = np.unique(name[order], return_index=True, return_counts=True)
        shared = first[count == 2]  # of three and more, which two were a pair would depend on their order
        one, other = order[shared], order[shared + 1]
        across = np.roll(triangles, -2, axis=1).reshape(-1)  # the corner that faces each edge
        # Of the four corners, how far they are from one plane: the volume over its gradient.
        corners = structure.vertices[np.column_stack([ends[one], across[one], across[other]])]
        volume = np.abs(np.linalg.det(corners[:, 1:] - corners[:, :1]))
        squared = sum((area_vectors(np.delete(corners, at, axis=1)) ** 2).sum(axis=1) for at in range(4))
        bend = np.asarray(volume / np.sqrt(np.maximum(squared, 1e-60)))
        pairs = np.column_stack([one, other]) // 3
        cosine = np.einsum("pi,pi->p", normals[pairs[:, 0]], normals[pairs[:, 1]])
        return cls(edges, area, pairs, edges.reshape(-1)[one], cosine, bend)

    def grain_m(self) -> float:
        """How wide triangles are across the folds of a mesh, the widest left out: what is thinner is lost."""
        if not len(self.pairs):
            return float(np.percentile(2 * self.area_m2 / self.edges_m.max(axis=1), _WIDE))
        width = 2 * self.area_m2[self.pairs].min(axis=1) / self.along_m
        folded = self.cosine < _FOLD
        return float(np.percentile(width[folded] if folded.any() else width, _WIDE))

    def even(self) -> float:
        """How near triangles are to equilateral, by area or by number: 1 where all are, 0.87 half squares."""
        form = 4 * np.sqrt(3) * self.area_m2 / (self.edges_m**2).sum(axis=1)
        return float(min(np.average(form, weights=self.area_m2), form.mean()))

    def flat(self) -> float:
        """Share of the area on both sides of edges that lie within a face."""
        angle = np.degrees(np.arccos(np.clip(np.abs(self.cosine), 0.0, 1.0))) / _FLAT_DEG
        return float(np.average(1 / (1 + angle**2), weights=self.area_m2[self.pairs].sum(axis=1)))


@dataclass(frozen=True, eq=False, repr=False)
class Held(Record):
    """What a mesh holds of the surface that it stands for."""

    error_m: float = 0.0  # how far the surface may lie outside of it
    thin_m: float = 0.0  # what is thinner may be left out as a whole
    thin_error_m: float = 0.0  # how far the surface may lie outside of what is left of it


def held(structure: Structure) -> Held:
    """What a mesh holds of its surface: as stated, else by whether it was drawn or scanned.

    What was scanned and is thinner than the grain of a reconstruction is rounded off: tips, trailing edges,
    parapets. Its own folds, the sharpest that it could hold, tell the grain. Where it is itself no thicker
    than two grains, more may be lost: of a strut, a mast or a plate that ends there, the rest.
    Nothing is known of what was never scanned, or left out as a whole.

    What is declared to be drawn is exact. Of what nobody declared, the error is what its triangles can hide
    by how rough they are where they are smoothest: next to nothing where faces are flat, some millimetres
    where each vertex was moved by one.
    """
    if structure.surface_error_m is not None:
        return Held(structure.surface_error_m)
    if structure.surface == "drawn":
        return Held()
    faces = _Faces.of(structure)
    if not len(faces.area_m2):
        return Held()
    if structure.is_scan:
        grain_m = faces.grain_m()
        return Held(_LOST * grain_m, _THIN * grain_m, _LOST_THIN * grain_m)
    return Held(_ROUGH * float(np.percentile(faces.bend_m, _SMOOTH)) if len(faces.pairs) else 0.0)


def likeness_to_scans(structure: Structure) -> float:
    """How like triangles are to those of a reconstruction, even and on no flat faces; 0 to 1, of few 0."""
    if len(structure.triangles) < _FEWEST:
        return 0.0
    faces = _Faces.of(structure)
    return faces.even() * min(1.0, 5 * (1 - faces.flat())) if len(faces.pairs) else 0.0


def looks_scanned(structure: Structure) -> bool:
    """Whether a mesh of which nobody declared how it was made looks like the reconstruction of a scan."""
    return structure.surface is None and structure.derived(
        "looks scanned", lambda: likeness_to_scans(structure) > _LOOKS_SCANNED
    )

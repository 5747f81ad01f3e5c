"""Labels of the faces of meshes: ``labels/<sha256>.parquet``, which zones refer to by their hash."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from upplied.errors import SettingsError
from upplied.records import Bools, Ints, Record, Structure


@dataclass(frozen=True, eq=False, repr=False)
class FaceLabels(Record):
    """What each face of one mesh is labelled."""

    triangles_sha256: str  # of the faces of that mesh, in their order
    names_json: str  # the different labels, in the order of their numbers
    number: Ints  # (T,) which of them each face has; small numbers

    def faces(self, structure: Structure, label: str) -> Bools:
        """Which faces (T,) of a structure have a label.

        Raises
        ------
        SettingsError
            If its mesh is not the one that was labelled, or no face has that label.
        """
        if triangles_sha256(structure) != self.triangles_sha256:
            found = f"are of another mesh of {structure.structure_id} than it has now"
            remedy = "label the mesh, and require the zone again"
            raise SettingsError("the labels of a zone", found, "", remedy)
        names = json.loads(self.names_json)
        if label not in names:
            raise SettingsError(f"label {label[:64]!r}", "no face has it", f"such as {', '.join(names[:8])}")
        return np.asarray(self.number == names.index(label), bool)


def labelled(structure: Structure, labels: Sequence[str]) -> FaceLabels:
    """The labels of the faces of a structure, one each."""
    if len(labels) != len(structure.triangles):
        found = f"are {len(labels)}, the mesh has {len(structure.triangles)} faces"
        raise SettingsError(f"labels of {structure.structure_id}", found, "one for each face")
    names = sorted(set(labels))
    at = {name: number for number, name in enumerate(names)}
    number = np.array([at[label] for label in labels], np.int64)
    return FaceLabels(triangles_sha256(structure), json.dumps(names), number)


def triangles_sha256(structure: Structure) -> str:
    """Hash of the faces of a mesh in their order: what labels of faces are good for."""
    faces = np.ascontiguousarray(structure.triangles, "<i8")
    return hashlib.sha256(faces.tobytes()).hexdigest()

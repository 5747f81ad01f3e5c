"""Records kept once by their content, never changed: ``<folder>/<sha256>.parquet`` in the catalog.

And the memo: any record of arrays and scalars as one Parquet file, found by stage and key. The key holds all
that a result depends on; a file that does not match its stage, key and hash is computed again.
"""

import contextlib
import hashlib
import json
import logging
import os
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, Generic, NamedTuple, TypeVar

import numpy as np

from upplied import records
from upplied.catalog.schema.codec import decode, encode, sha256_of
from upplied.catalog.store.files import FileStore, explained
from upplied.checks import check_id
from upplied.errors import CatalogError, SettingsError
from upplied.files import replace_file
from upplied.records import Bools, Floats, Ints, Record, Structure, SurfaceStates

log = logging.getLogger(__name__)
R = TypeVar("R")


@dataclass(frozen=True, eq=False, repr=False)
class Samples(Record):
    """Where a target's surface was sampled."""

    points: Floats  # (N, 3) m, target frame
    normals: Floats | None = None  # (N, 3) unit, outward


@dataclass(frozen=True, eq=False, repr=False)
class States(Record):
    """What became of each sample, as a plan sees it; the samples, a hundred times as large, are shared."""

    samples_sha256: str
    state: Ints  # (N,) index into SURFACE_STATES, as small numbers


@dataclass(frozen=True, eq=False, repr=False)
class StoredLooks(Record):
    """The nearest look of one flight at each patch, a sample of its structure's surface, that it saw."""

    samples_sha256: str  # where the patches are, as of surfaces
    patch: Ints  # (K,) rising; small numbers
    distance_m: Floats  # (K,) single precision, as are the others
    incidence_deg: Floats  # (K,)
    speed_mps: Floats  # (K,)
    t_s: Floats  # (K,) from the first pose
    pictures: Ints | None = None  # (K,) that show it; None: not counted then
    # Of the most frontal look; None: not told then.
    frontal_distance_m: Floats | None = field(default=None, metadata={"later": True})  # (K,)
    frontal_incidence_deg: Floats | None = field(default=None, metadata={"later": True})  # (K,)
    # 1 where it was seen only if the correction of the log is right; None: nothing was corrected.
    assumed: Ints | None = field(default=None, metadata={"later": True})  # (K,)
    # 1 where it was looked at as its plan asks, and where it was if the correction is right.
    inspected: Ints | None = field(default=None, metadata={"later": True})  # (K,) None: not asked then
    inspected_if_corrected: Ints | None = field(default=None, metadata={"later": True})  # None: not corrected

    @property
    def as_asked(self) -> Ints:
        """The patches that were certainly looked at as the plan asks; where that is not known, all seen."""
        certain = self.certain
        return certain.patch if certain.inspected is None else certain.patch[certain.inspected > 0]

    @property
    def certain(self) -> "StoredLooks":
        """The looks that do not depend on a correction of the log."""
        if self.assumed is None:
            return self
        names = [item.name for item in fields(self) if item.name not in ("samples_sha256", "assumed")]
        known = {name: getattr(self, name) for name in names if getattr(self, name) is not None}
        return replace(self, assumed=None, **{name: it[self.assumed == 0] for name, it in known.items()})


@dataclass(frozen=True, eq=False, repr=False)
class FaceLabels(Record):
    """What each face of one mesh is labelled."""

    triangles_sha256: str  # of the faces of that mesh, in their order
    names_json: str  # the different labels, in the order of their numbers
    number: Ints  # (T,) which of them each face has; small numbers

    def faces(self, structure: Structure, label: str) -> Bools:
        """Which faces (T,) of a structure have a label; one of another mesh, or no such face, is an error."""
        if triangles_sha256(structure) != self.triangles_sha256:
            fault = f"are of another mesh of {structure.structure_id} than it has now"
            remedy = "label the mesh, and require the zone again"
            raise SettingsError("the labels of a zone", fault, "", remedy)
        names = json.loads(self.names_json)
        if label not in names:
            raise SettingsError(f"label {label[:64]!r}", "no face has it", f"such as {', '.join(names[:8])}")
        return np.asarray(self.number == names.index(label), bool)


def labelled(structure: Structure, labels: Sequence[str]) -> FaceLabels:
    """The labels of the faces of a structure, one each."""
    if len(labels) != len(structure.triangles):
        fault = f"are {len(labels)}, the mesh has {len(structure.triangles)} faces"
        raise SettingsError(f"labels of {structure.structure_id}", fault, "one for each face")
    names, number = np.unique(np.array(labels, object), return_inverse=True)
    return FaceLabels(triangles_sha256(structure), json.dumps(names.tolist()), number.astype(np.int64))


def triangles_sha256(structure: Structure) -> str:
    """Hash of the faces of a mesh in their order: what labels of faces are good for."""
    return hashlib.sha256(np.ascontiguousarray(structure.triangles, "<i8").tobytes()).hexdigest()


class Content(NamedTuple):
    """What lies in one folder."""

    record_type: type[Any]
    remedy: str  # what a person does where one is damaged
    columns: tuple[tuple[str, str], ...] = ()  # tables and columns that name it by its hash
    of_plans: bool = False  # what planners that were stopped leave is removed


def _columns(names: str, tables: str = "transfers") -> tuple[tuple[str, str], ...]:
    return tuple((table, f"{name}_sha256") for table in tables.split() for name in names.split())


_PLANNED = "take it from a backup, or plan it again"
#: By folder.
CONTENTS = {
    "meshes": Content(Structure, "delete it and add the structure again", _columns("mesh", "structures")),
    "surfaces": Content(States, _PLANNED, _columns("surface inspected"), True),
    "samples": Content(Samples, _PLANNED),
    "supposed": Content(records.SupposedSurface, _PLANNED, _columns("supposed", "transfers decisions"), True),
    "photos": Content(records.Photos, _PLANNED, _columns("photos"), True),
    "flown": Content(records.Trajectory, "fly the plan again", _columns("flight", "flights")),
    "looks": Content(StoredLooks, "add the flight again", _columns("looks", "flights")),
    "labels": Content(FaceLabels, "require the zones again"),
}
#: What rows name by its hash: the folder, the table, the column.
NAMED_CONTENTS = [(name, *each) for name, content in CONTENTS.items() for each in content.columns]


class ContentStore(Generic[R]):
    """The records of one kind, a folder of `CONTENTS`, in the catalog at a root."""

    def __init__(self, root: str, folder: str) -> None:
        self.files = FileStore(f"{root.rstrip('/')}/{folder}")
        self.about = CONTENTS[folder]
        self._stored: set[str] = set()  # by this process: a surface's samples serve many plans

    def put(self, record: R) -> str:
        """Keep a record; returns its hash."""
        sha256 = sha256_of(record)
        if sha256 in self._stored:
            return sha256
        name, path = file_name(sha256), self.path(sha256)
        if not explained(path, lambda: self.files.touched(name), doing="written"):
            explained(path, lambda: self.files.write(name, encode(record)), doing="written")
        self._stored.add(sha256)
        return sha256

    def get(self, sha256: str) -> R:
        """The record of a hash; one that is not there, or is damaged, is an error."""
        path = self.path(sha256)
        content = explained(path, lambda: self.files.read(file_name(sha256)), doing="read")
        try:
            return decode(content, self.about.record_type, sha256)
        except CatalogError:
            raise CatalogError(path, "is damaged", "", self.about.remedy) from None

    def path(self, sha256: str) -> str:
        """Where a record lies."""
        return self.files.path(file_name(sha256))


def file_name(sha256: str) -> str:
    """The name of the file of a record; what is no hash is refused."""
    if not re.fullmatch(r"[0-9a-f]{64}", sha256):
        raise CatalogError(f"content {sha256[:80]!r}", "is no hash", "64 hexadecimal digits")
    return f"{sha256}.parquet"


class SurfaceStore:
    """What the plans of a catalog see of their targets, and the samples that many share."""

    def __init__(self, states: ContentStore[States], samples: ContentStore[Samples]) -> None:
        self.states, self.samples = states, samples
        self._samples = lru_cache(4)(samples.get)

    def put(self, surface: SurfaceStates) -> str:
        """Keep a surface; returns the hash of its states, which name their samples."""
        samples, state = self.samples.put(Samples(surface.points, surface.normals)), np.asarray(surface.state)
        small: Any = state.astype(np.int8)
        return self.states.put(States(samples, small if np.array_equal(small, state) else state))

    def points(self, samples_sha256: str) -> Floats:
        """Where samples are, (N, 3), m."""
        return self._samples(samples_sha256).points

    def get(self, sha256: str) -> SurfaceStates:
        """The surface of a hash; one that is not there, or is damaged, is an error."""
        states = self.states.get(sha256)
        samples = self._samples(states.samples_sha256)
        return SurfaceStates(samples.points, states.state.astype(np.int64), samples.normals)


class Cache:
    """Remembers records by content, in a folder that is made when the first is kept.

    Examples
    --------
    >>> cache = Cache("cache")                                                    # doctest: +SKIP
    >>> cache("clouds", Cloud, key, lambda: voxel_cloud(structure, settings))     # doctest: +SKIP
    """

    def __init__(self, folder: str | os.PathLike[str]) -> None:
        self.folder = Path(folder)

    def __call__(self, stage: str, record_type: type[R], key: str, compute: Callable[[], R]) -> R:
        """The remembered record of this stage and key, or the computed one, which is then remembered."""
        if (record := self.get(stage, record_type, key)) is None:
            record = compute()
            self.put(stage, key, record)
        return record

    def get(self, stage: str, record_type: type[R], key: str, nameless: bool = False) -> R | None:
        """The remembered record; None where none can be believed. Version 0.1.0 wrote `nameless` ones."""
        path = self.path(stage, key)
        try:
            record = decode(path.read_bytes(), record_type, name="" if nameless else f"{stage}/{key}")
        except FileNotFoundError:
            return None
        except (OSError, CatalogError) as error:
            log.warning("cache entry %s is not believed and will be computed again: %s", path, error)
            return None
        with contextlib.suppress(OSError):  # read-only: the entry only looks older to `prune` than it is
            os.utime(path)
        return record

    def put(self, stage: str, key: str, record: object) -> None:
        """Remember a record; where that is impossible (disk full, read-only) only time is lost."""
        path = self.path(stage, key)
        try:  # an entry that a power cut tore is noticed
            replace_file(path, encode(record, f"{stage}/{key}"), lasting=False)
        except OSError as error:
            log.warning("cannot remember %s: %s", path, error)

    def path(self, stage: str, key: str) -> Path:
        """Where the record of this stage and key lies."""
        name = check_id(key, "cache key")
        return self.folder / check_id(stage, "cache stage") / name[:2] / f"{name}.parquet"

    def entries(self) -> list[tuple[float, int, Path]]:
        """When each entry was last used (s since 1970), its size in bytes and its path; oldest first."""
        uses = []
        for path in self.folder.glob("*/*/*.parquet"):
            with contextlib.suppress(FileNotFoundError):  # pruned by somebody else meanwhile
                known = path.stat()
                uses.append((known.st_mtime, known.st_size, path))
        return sorted(uses)

    def prune(self, max_bytes: int) -> int:
        """Forget the records unused for longest until at most `max_bytes` remain; bytes freed."""
        entries, freed = self.entries(), 0
        excess = sum(size for _, size, _ in entries) - max_bytes
        for _, size, path in entries:
            if freed < excess:
                path.unlink(missing_ok=True)
                freed += size
        return freed

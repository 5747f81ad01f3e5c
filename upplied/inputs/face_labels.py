"""Labels of the faces of a mesh, one each, as a file gives them: numbers or words."""

from __future__ import annotations

import csv
import io
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from upplied.errors import InputError
from upplied.inputs.files import read_regular

SUFFIXES = (".npy", ".csv", ".txt", ".parquet")
MAX_BYTES = 256 << 20  # 30 million faces as whole numbers
_LONGEST = 64  # letters of a label
_MOST = 1000  # different ones
_RULE = "one label for each face of the mesh, a whole number or a word without spaces or commas"


def read_face_labels(path: Path, faces: int, what: str) -> list[str]:
    """The label of each face of the mesh that `what` names, as text.

    Of ``.npy`` of one dimension; ``.csv`` or ``.parquet`` with a column ``label``, in the order of the faces
    or with their numbers from 0 in a column ``face``; ``.txt`` of one label a line.

    Raises InputError if the file cannot be read, is too large, or does not have one label for each face.
    """
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise InputError(str(path), f"has the suffix {suffix!r}", f"one of {', '.join(SUFFIXES)}")
    data = read_regular(path, MAX_BYTES)
    readers = {".npy": _npy, ".csv": _csv, ".txt": _lines, ".parquet": _parquet}
    try:
        labels = [_label(value) for value in readers[suffix](data, faces)]
    except InputError as error:
        raise InputError(str(path), str(error), _RULE) from None
    except (ValueError, TypeError, EOFError, KeyError, csv.Error, OSError, pa.ArrowException) as error:
        raise InputError(str(path), f"cannot be read: {str(error)[:200]}", _RULE) from None
    if len(labels) != faces:
        remedy = "write the mesh as it is kept, and label that: upplied zones ID --mesh FILE.ply"
        raise InputError(str(path), f"has {len(labels)} labels, {what} has {faces} faces", _RULE, remedy)
    if len(found := set(labels)) > _MOST:
        raise InputError(str(path), f"has {len(found)} different labels", f"at most {_MOST}")
    return labels


def _npy(data: bytes, faces: int) -> list[Any]:
    array = np.load(io.BytesIO(data), allow_pickle=False)
    if not isinstance(array, np.ndarray) or array.ndim != 1 or array.dtype.kind not in "biuU":
        raise ValueError("is no array of one dimension of whole numbers or words")
    return list((array.astype(np.int64) if array.dtype.kind == "b" else array).tolist())


def _lines(data: bytes, faces: int) -> list[Any]:
    return data.decode("utf-8-sig").split()


def _csv(data: bytes, faces: int) -> list[Any]:
    rows = csv.DictReader(io.StringIO(data.decode("utf-8-sig")), strict=True, skipinitialspace=True)
    if "label" not in (rows.fieldnames or ()):
        raise ValueError("has no column 'label'")
    read = list(rows)
    numbers = [row["face"] for row in read] if "face" in (rows.fieldnames or ()) else None
    return _in_order([row["label"] for row in read], numbers, faces)


def _parquet(data: bytes, faces: int) -> list[Any]:
    file = pq.ParquetFile(io.BytesIO(data))
    if file.metadata.num_rows != faces:  # before anything is unpacked
        return [0] * min(file.metadata.num_rows, 2 * faces + 1)
    names = file.schema_arrow.names
    if "label" not in names:
        raise ValueError("has no column 'label'")
    table = file.read([name for name in ("face", "label") if name in names])
    numbers = table["face"].to_pylist() if "face" in names else None
    return _in_order(table["label"].to_pylist(), numbers, faces)


def _in_order(labels: list[Any], numbers: list[Any] | None, faces: int) -> list[Any]:
    """The labels in the order of the faces; each face stands once."""
    if numbers is None or len(labels) != faces:
        return labels
    order = [int(number) for number in numbers]
    if sorted(order) != list(range(faces)):
        raise ValueError(f"its column 'face' does not name each of 0 to {faces - 1} once")
    placed = dict(zip(order, labels, strict=True))
    return [placed[face] for face in range(faces)]


def _label(value: Any) -> str:
    text = str(value).strip() if isinstance(value, str | int) and not isinstance(value, bool) else ""
    if not 0 < len(text) <= _LONGEST or any(sign.isspace() or sign == "," for sign in text):
        raise InputError("label", f"is {str(value)[:40]!r}", _RULE)
    return text

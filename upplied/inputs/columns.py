"""Columns that people give in a file of their own: labels of the faces of a mesh, and times of photos."""

import csv
import io
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from upplied.errors import InputError
from upplied.inputs.files import read_regular
from upplied.records import Ints

SUFFIXES = (".npy", ".csv", ".txt", ".parquet")
MAX_BYTES = 256 << 20  # 30 million faces as whole numbers
_LONGEST = 64  # letters of a label
_MOST = 1000  # different ones
_MOST_PHOTOS = 1_000_000
_RULE = "one label for each face of the mesh, a whole number or a word without spaces or commas"


def read_face_labels(path: Path, faces: int, what: str) -> list[str]:
    """The label of each face of the mesh that `what` names, as text; InputError if the file has others.

    Of ``.npy`` of one dimension; ``.csv`` or ``.parquet`` with a column ``label``, in the order of the faces
    or with their numbers from 0 in a column ``face``; ``.txt`` of one label a line.
    """
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise InputError(str(path), f"has the suffix {suffix!r}", f"one of {', '.join(SUFFIXES)}")
    try:
        columns = _columns(suffix, read_regular(path, MAX_BYTES), faces)
        if "label" not in columns:
            raise ValueError("has no column 'label'")
        if "face" in columns:
            numbers = [int(number) for number in columns["face"]]
            if sorted(numbers) != list(range(len(numbers))):
                raise ValueError(f"its column 'face' does not name each of 0 to {len(numbers) - 1} once")
            columns = columns.iloc[np.argsort(numbers)]
        labels = [_label(value) for value in columns["label"].tolist()]
    except (ValueError, TypeError, EOFError, KeyError, OSError, pa.ArrowException) as error:
        raise InputError(str(path), f"cannot be read: {str(error)[:200]}", _RULE) from None
    if len(labels) != faces:
        remedy = "write the stored mesh, and label that: upplied zones ID --mesh FILE.ply"
        raise InputError(str(path), f"has {len(labels)} labels, {what} has {faces} faces", _RULE, remedy)
    if (count := len(set(labels))) > _MOST:
        raise InputError(str(path), f"has {count} different labels", f"at most {_MOST}")
    return labels


def _columns(suffix: str, data: bytes, faces: int) -> pd.DataFrame:
    """The columns ``label`` and, where the file has it, ``face``; as many rows as the file, or too many."""
    if suffix == ".txt":
        return pd.DataFrame({"label": data.decode("utf-8-sig").split()})
    stream = io.BytesIO(data)
    if suffix == ".npy":
        array = np.load(stream, allow_pickle=False)
        if not isinstance(array, np.ndarray) or array.ndim != 1 or array.dtype.kind not in "biuU":
            raise ValueError("is no array of one dimension of whole numbers or words")
        return pd.DataFrame({"label": array.astype(np.int64) if array.dtype.kind == "b" else array})
    if suffix == ".csv":
        return pd.read_csv(stream, dtype=str, keep_default_na=False, skipinitialspace=True)
    file = pq.ParquetFile(stream)
    if (rows := file.metadata.num_rows) != faces:  # before anything is unpacked
        return pd.DataFrame({"label": np.zeros(min(rows, 2 * faces + 1), np.int64)})
    names = [name for name in ("face", "label") if name in file.schema_arrow.names]
    return file.read(names).to_pandas(integer_object_nulls=True)


def _label(value: Any) -> str:
    text = str(value).strip() if isinstance(value, str | int) and not isinstance(value, bool) else ""
    if not 0 < len(text) <= _LONGEST or any(sign.isspace() or sign == "," for sign in text):
        raise ValueError(f"label {str(value)[:40]!r}")
    return text


def photo_times(path: str | Path) -> Ints:
    """Times of photos, ns of the log's clock, rising, of a file of one a line, or with a column ``t_ns``."""
    rule = "whole numbers, ns of the log's clock, one a line or in a column t_ns"
    text = read_regular(path, MAX_BYTES).decode("utf-8", "replace")
    try:
        lines = [line for line in csv.reader(io.StringIO(text)) if line and line[0].strip()]
        at, head = 0, [name.strip() for name in lines[0]] if lines else []
        if "t_ns" in head:
            at, lines = head.index("t_ns"), lines[1:]
        times = np.array([int(line[at]) for line in lines], np.int64)
    except (csv.Error, ValueError, IndexError, OverflowError) as error:
        raise InputError(str(path), f"holds what is no time: {error}", rule) from None
    if not 0 < len(times) <= _MOST_PHOTOS:
        raise InputError(str(path), f"holds {len(times)} times", f"1 to {_MOST_PHOTOS}")
    return np.sort(times)

"""Any record of arrays and scalars as a Parquet file of one row, and back.

Each array is a column, with its shape in the field's metadata; the rest is JSON in the file's metadata,
beside the hash of the whole content.
"""

import hashlib
import json
import math
import types
from collections.abc import Mapping
from dataclasses import MISSING, Field, fields, is_dataclass
from functools import lru_cache
from io import BytesIO
from itertools import chain, repeat
from typing import Any, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from upplied.errors import CatalogError

R = TypeVar("R")
Array = NDArray[Any]

_FILE_SHA256 = b"file_sha256"  # hash of the file's bytes as they would be with `_UNKNOWN` here
_UNKNOWN = b"0" * 64
_MAX_BYTES = 4 << 30  # of one decoded array: a broken file must not make us allocate more


def encode(record: Any, name: str = "") -> bytes:
    """The bytes of a Parquet file, under a name that they carry; equal records and names, equal bytes."""
    plain, arrays = _parts(record)
    sha256 = content_sha256(plain, arrays).encode()
    metadata = {b"record": plain.encode(), b"sha256": sha256, _FILE_SHA256: _UNKNOWN}
    if name:
        metadata[b"name"] = name.encode()
    schema_fields, columns = list[pa.Field](), list[pa.Array]()
    for name, array in arrays.items():
        flat = np.ascontiguousarray(array).reshape(-1)
        if array.dtype.kind == "b":
            column = pa.array([np.packbits(flat).tobytes()], pa.large_binary())
        else:
            column = pa.LargeListArray.from_arrays(pa.array([0, len(flat)], pa.int64()), pa.array(flat))
        columns.append(column)
        form = {"shape": json.dumps(array.shape), "dtype": array.dtype.str}
        schema_fields.append(pa.field(name, column.type, metadata=form))
    table = pa.table(columns, schema=pa.schema(schema_fields, metadata=metadata))
    sink, packed = BytesIO(), {"compression": "zstd", "compression_level": 1}
    pq.write_table(table, sink, use_dictionary=False, write_statistics=False, **packed)
    content = sink.getvalue()
    return content.replace(_UNKNOWN, hashlib.sha256(content).hexdigest().encode(), 1)


def is_as_written(content: bytes) -> bool:
    """Whether no byte was changed since `encode`; nobody can tell of what an older program wrote."""
    try:
        file = pq.ParquetFile(BytesIO(content))
        stated, declared = file.metadata.metadata.get(_FILE_SHA256, b""), file.schema_arrow.metadata or {}
    except (pa.ArrowException, OSError, ValueError, AttributeError):
        return False
    if not stated:
        return _FILE_SHA256 not in declared
    return hashlib.sha256(content.replace(stated, _UNKNOWN, 1)).hexdigest().encode() == stated


def decode(content: bytes, record_type: type[R], sha256: str | None = None, name: str = "") -> R:
    """The record of bytes from `encode`, of this hash and name; all else is a `CatalogError`."""
    try:
        with pq.ParquetFile(pa.BufferReader(content)) as file:
            table = file.read(use_threads=False)
        metadata = table.schema.metadata or {}
        if name and metadata.get(b"name", b"").decode() != name:
            raise CatalogError(record_type.__name__, "the stored content is that of another name")
        plain = metadata[b"record"].decode()
        arrays = {field.name: _array(table.column(field.name), field) for field in table.schema}
        if content_sha256(plain, arrays) != (sha256 or metadata[b"sha256"].decode()):
            raise CatalogError(record_type.__name__, "the stored content does not match its hash")
        record: R = _record(json.loads(plain), record_type, arrays)
    except (pa.ArrowException, OSError, KeyError, ValueError, TypeError, UnicodeDecodeError) as error:
        raise CatalogError(record_type.__name__, f"the stored content is damaged: {error}") from None
    return record


def sha256_of(record: Any) -> str:
    """Hash of all that a record holds, as `encode` writes it beside the content."""
    return content_sha256(*_parts(record))


def _parts(record: Any) -> tuple[str, dict[str, Array]]:
    arrays: dict[str, Array] = {}
    return json.dumps(_plain(record, "", arrays), sort_keys=True), arrays


def content_sha256(plain: str, arrays: Mapping[str, Array]) -> str:
    """Hash of all that a record holds, the same on every machine."""
    hashed = hashlib.sha256(plain.encode())
    for name, array in arrays.items():
        values = _little_endian(array)
        hashed.update(f"\0{name}\0{values.dtype.str}\0{values.shape}\0".encode())
        hashed.update(np.ascontiguousarray(values).data)
    return hashed.hexdigest()


def _plain(value: Any, path: str, arrays: dict[str, Array]) -> Any:
    """JSON of a value; arrays are set aside under their path."""
    if isinstance(value, np.ndarray):
        if value.dtype.kind not in "biuf":
            raise TypeError(f"{path}: an array of {value.dtype} cannot be kept")
        arrays[name := path.removeprefix(".")] = _little_endian(value)
        return {"array": name}
    if isinstance(value, np.generic):
        return _plain(value.item(), path, arrays)
    if is_dataclass(value) and not isinstance(value, type):
        known = {f.name: getattr(value, f.name) for f in fields(value) if not _left_out(f, value)}
        inner = {name: _plain(item, f"{path}.{name}", arrays) for name, item in known.items()}
        return {"fields": inner, "type": type(value).__name__}
    if isinstance(value, tuple | list):
        return {"items": [_plain(item, f"{path}.{i}", arrays) for i, item in enumerate(value)]}
    if isinstance(value, Mapping):
        return {"map": [[key, _plain(item, f"{path}.{key}", arrays)] for key, item in value.items()]}
    if isinstance(value, float) and not math.isfinite(value):
        return {"float": str(value)}
    if value is None or isinstance(value, bool | int | float | str):
        return value
    raise TypeError(f"{path}: a {type(value).__name__} cannot be kept")


def _left_out(field: Field, record: Any) -> bool:
    """Whether a field that came later says nothing: so records of before keep their hash."""
    if not field.metadata.get("later"):
        return False
    value: Any = getattr(record, field.name)
    factory: Any = field.default_factory
    default: Any = field.default if factory is MISSING else factory()
    return value is default or np.array_equal(value, default)


def _record(plain: Any, hint: Any, arrays: Mapping[str, Array]) -> Any:
    """The value of JSON from `_plain`, of the type that the record declares."""
    if not isinstance(plain, dict):
        return plain
    if "array" in plain:
        return arrays[plain["array"]]
    if "float" in plain:
        return float(plain["float"])
    if "items" in plain:
        of = [one for one in get_args(hint) if one is not Ellipsis] or [None]
        hinted = zip(plain["items"], chain(of, repeat(of[-1])), strict=False)
        each = [_record(item, one, arrays) for item, one in hinted]
        return each if get_origin(hint) is list or hint is list else tuple(each)
    if "map" in plain:
        inner_hint = (*get_args(hint), None, None)[1]
        return {key: _record(item, inner_hint, arrays) for key, item in plain["map"]}
    options = get_args(hint) if get_origin(hint) in (Union, types.UnionType) else (hint,)
    allowed = {one.__name__: one for one in options if isinstance(one, type) and is_dataclass(one)}
    if plain["type"] not in allowed:  # no class is ever made but those that the declaration allows
        raise ValueError(f"holds a {plain['type']}, wanted {hint}")
    hints, values = _hints(allowed[plain["type"]]), plain["fields"].items()
    return allowed[plain["type"]](**{name: _record(item, hints[name], arrays) for name, item in values})


_hints = lru_cache(maxsize=64)(get_type_hints)


def _little_endian(array: Array) -> Array:
    return array.astype(array.dtype.newbyteorder("<"), copy=False)


def _array(column: pa.ChunkedArray, field: pa.Field) -> Array:
    shape = tuple(json.loads(field.metadata[b"shape"]))
    dtype = np.dtype(field.metadata[b"dtype"].decode())
    count = math.prod(shape)
    if dtype.kind not in "biuf" or count * dtype.itemsize > _MAX_BYTES or min(shape, default=0) < 0:
        raise ValueError(f"{field.name} has shape {shape} of {dtype}")
    value = column.combine_chunks()
    if dtype.kind == "b":
        bits = np.frombuffer(value[0].as_py(), np.uint8)
        return np.unpackbits(bits, count=count).astype(bool).reshape(shape)
    # A copy, since Arrow's memory is read-only and compiled code is specialised on that.
    return np.array(value.flatten().to_numpy(zero_copy_only=False), dtype).reshape(shape)

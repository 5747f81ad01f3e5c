"""Messages as columns: ROS by `rosbags`, protobuf by `mcap-protobuf-support`, JSON.

A value that a message does not hold becomes NaN; a path that no message holds gives no column.
Paths may lead into one sequence of messages (``transforms[].rotation.w``): a row is an element then.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from operator import attrgetter
from typing import Any

import numpy as np
from google.protobuf.message import Message
from mcap.records import Schema
from mcap_protobuf.decoder import DecoderFactory

from upplied.inputs.mcap.rosmsg import DefinitionError, ros_decoder
from upplied.inputs.tables import Channel
from upplied.records import Ints

Columns = dict[str, Any]

MAX_TEXT = 200  # characters of a name that are kept
# The same word in the three worlds: ROS 2, protobuf and JSON.
_ALIASES = {"sec": ("sec", "seconds", "secs"), "nanosec": ("nanosec", "nanos", "nsec", "nsecs")}
_MAX_WIDTH = 64  # numbers in one value; a calibration has 12


class Decoder:
    """Reads columns from the payloads of one channel, by the schema in the log.

    Attributes
    ----------
    paths : frozenset of str, or None
        Every path that a column can have, where the schema tells.

    Raises
    ------
    DefinitionError
        If encoding and schema do not allow to decode it.
    """

    def __init__(self, channel: Channel) -> None:
        name, text = channel.schema_name, channel.schema.decode("utf-8", "replace")
        self.paths: frozenset[str] | None = None
        self._decode: Callable[[bytes], Any] = json.loads
        match channel.encoding, channel.schema_encoding:
            case ("cdr", "ros2msg") | ("ros1", "ros1msg"):
                self._decode, self.paths = ros_decoder(name, text, channel.encoding == "cdr")
            case "protobuf", "protobuf":
                self._decode = _protobuf(name, channel.schema)
            case other if other[0] != "json":
                encoding, schema = (word or "no" for word in other)
                raise DefinitionError(f"messages in {encoding} encoding, schema in {schema} encoding")

    def columns(
        self, payloads: Sequence[bytes], wanted: Iterable[str], most: int = 10**9
    ) -> tuple[Columns, Ints, int]:
        """The wanted values of many payloads.

        Parameters
        ----------
        payloads : sequence of bytes
        wanted : iterable of str
            Paths such as ``header.stamp.sec`` or ``transforms[].transform.rotation.w``.
        most : int, optional
            Rows after which nothing more is read.

        Returns
        -------
        columns : dict of str to array, shape (R,) or (R, k)
        row : array, shape (R,)
            Which payload each value is from, increasing.
        unreadable : int
            Payloads that do not fit the definition.
        """
        known = [path for path in wanted if self.paths is None or path in self.paths]
        many = next((path.split("[]")[0] for path in known if "[]" in path), "")
        plain = [path for path in known if "[]" not in path]
        inner = [path for path in known if many and path.startswith(f"{many}[].")]
        get, get_inner = self._getter(plain), self._getter([path[len(many) + 3 :] for path in inner])
        get_elements = self._getter([many])
        rows: list[int] = []
        values: list[tuple[Any, ...]] = []
        unreadable = 0
        for row, payload in enumerate(payloads):
            try:
                message = self._decode(payload)
                found = [get(message)]
                if many:
                    found = [found[0] + get_inner(element) for element in get_elements(message)[0] or ()]
            except Exception:  # whatever the bytes of one message do to a library
                unreadable += 1
                continue
            rows += [row] * len(found)
            values += found
            if len(values) > most:
                break
        paths = plain + inner
        parts = zip(paths, zip(*values, strict=True) if values else [()] * len(paths), strict=True)
        columns = {path: column for path, part in parts if (column := _column(part)) is not None}
        return columns, np.array(rows, np.int64), unreadable

    def _getter(self, paths: Sequence[str]) -> Callable[[Any], tuple[Any, ...]]:
        """Takes what these paths lead to, as a tuple; at once where the schema says that it is there."""
        if self.paths is not None and len(paths) > 1:
            return attrgetter(*paths)
        steps = [[_ALIASES.get(step, (step,)) for step in path.split(".")] for path in paths]
        return lambda message: tuple([_walk(message, way) for way in steps])


def _protobuf(name: str, schema: bytes) -> Callable[[bytes], Any]:
    try:
        record = Schema(id=1, name=name, encoding="protobuf", data=schema)
        decode = DecoderFactory().decoder_for("protobuf", record)
        if decode is not None and decode(b"") is not None:
            return decode
    except Exception as error:  # the descriptor library raises many kinds on hostile bytes
        raise DefinitionError(f"its descriptors cannot be used ({type(error).__name__})") from None
    raise DefinitionError("its descriptors cannot be used")


def _walk(value: Any, steps: list[tuple[str, ...]]) -> Any:
    """The part of a message at the end of these steps; None where it does not hold it."""
    for names in steps:
        if isinstance(value, dict):
            value = next((value[name] for name in names if name in value), None)
        elif isinstance(value, Message):
            fields = value.DESCRIPTOR.fields_by_name
            field = next((fields[name] for name in names if name in fields), None)
            if field is None or (field.has_presence and not value.HasField(field.name)):
                return None
            value = getattr(value, field.name)
        else:
            value = getattr(value, names[0], None)
    return value


def _column(values: Sequence[Any]) -> Any:
    """A column of numbers, of lists of numbers, or of text; None where there is nothing."""
    if all(isinstance(value, float) for value in values):
        return np.array(values)
    present = [value for value in values if value is not None]
    if not present:
        return None
    if all(isinstance(value, int | float) for value in present):
        whole = len(present) == len(values) and all(type(value) is int for value in values)
        column = np.array(values) if whole else None
        fits = column is not None and column.dtype.kind in "iu"
        return column if fits else np.array([_float(value) for value in values])
    if all(isinstance(value, np.ndarray) for value in values):
        return np.stack(values)
    rows = [_row(value) for value in values]
    if any(row is None for row in rows):
        return np.array(["" if value is None else str(value)[:MAX_TEXT] for value in values], object)
    width = Counter(len(row) for row in rows if row).most_common(1)
    if not width or width[0][0] > _MAX_WIDTH:
        return None
    nothing = [np.nan] * width[0][0]
    return np.array([row if row and len(row) == len(nothing) else nothing for row in rows])


def _row(value: Any) -> list[float] | None:
    """A list of numbers; empty where there is none, None where it is anything else."""
    if value is None:
        return []
    if isinstance(value, str | bytes | dict | int | float):
        return None
    try:
        items = list(value)
    except TypeError:
        return None
    return [_float(item) for item in items] if all(isinstance(item, int | float) for item in items) else None


def _float(value: Any) -> float:
    try:
        return float(value)
    except (TypeError, OverflowError):
        return float("nan")

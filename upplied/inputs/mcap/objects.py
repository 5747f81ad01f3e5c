"""Protobuf and JSON messages to columns, with the same paths as the ROS decoder.

A value that a message does not hold becomes NaN; a path that no message holds gives no column.
Paths either all lead into one sequence of messages (``transforms[].rotation.w``) or none does.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from operator import attrgetter
from typing import Any

import numpy as np
from google.protobuf.descriptor import Descriptor
from google.protobuf.message import DecodeError
from mcap.records import Schema
from mcap_protobuf.decoder import DecoderFactory

from upplied.inputs.mcap.definitions import DefinitionError
from upplied.inputs.mcap.rosmsg import MAX_TEXT, Columns
from upplied.records import Ints

# The same word in the three worlds: ROS 2, protobuf and JSON.
_ALIASES = {"sec": ("sec", "seconds", "secs"), "nanosec": ("nanosec", "nanos", "nsec", "nsecs")}
_MAX_WIDTH = 64  # numbers in one value; a calibration has 12


class JsonDecoder:
    """Reads columns from JSON objects."""

    def columns(self, payloads: Sequence[bytes], wanted: Iterable[str]) -> tuple[Columns, Ints, int]:
        """See `upplied.inputs.mcap.rosmsg.RosDecoder.columns`."""
        many, paths = _split(wanted)
        steps = [[_ALIASES.get(step, (step,)) for step in path.split(".")] for path in paths]
        rows: list[int] = []
        values: list[list[Any]] = []
        unreadable = 0
        for row, payload in enumerate(payloads):
            try:
                message = json.loads(payload)
            except (ValueError, RecursionError):
                unreadable += 1
                continue
            elements = message.get(many) if many and isinstance(message, dict) else [message]
            for element in elements if isinstance(elements, list) else []:
                rows.append(row)
                values.append([_walk(element, path) for path in steps])
        return _columns(wanted, values), np.array(rows, np.int64), unreadable


class ProtobufDecoder:
    """Reads columns from protobuf by the descriptors stored in the log."""

    def __init__(self, name: str, schema: bytes) -> None:
        try:
            record = Schema(id=1, name=name, encoding="protobuf", data=schema)
            decode = DecoderFactory().decoder_for("protobuf", record)
            self._descriptor: Descriptor = decode(b"").DESCRIPTOR if decode else None
        except Exception as error:  # the descriptor library raises many kinds on hostile bytes
            raise DefinitionError(f"its descriptors cannot be used ({type(error).__name__})") from None
        if decode is None:
            raise DefinitionError("its descriptors cannot be used")
        self._decode: Callable[[bytes], Any] = decode

    def columns(self, payloads: Sequence[bytes], wanted: Iterable[str]) -> tuple[Columns, Ints, int]:
        """See `upplied.inputs.mcap.rosmsg.RosDecoder.columns`."""
        many, paths = _split(wanted)
        names, guards = self._resolved(many, list(zip(wanted, paths, strict=True)))
        if not names:
            return {}, np.arange(len(payloads)), 0
        get, present = _getter(list(names.values())), [_getter_of_presence(guard) for guard in guards]
        rows: list[int] = []
        values: list[Any] = []
        flags: list[list[bool]] = []
        unreadable = 0
        for row, payload in enumerate(payloads):
            try:
                message = self._decode(payload)
            except (DecodeError, ValueError, RecursionError):
                unreadable += 1
                continue
            for element in getattr(message, many) if many else (message,):
                rows.append(row)
                values.append(get(element))
                flags.append([there(element) for there in present])
        columns = _columns(names, values)
        there = np.array(flags, bool).reshape(len(values), len(guards))
        for path, column in columns.items():
            holes = ~there[:, [names[path].startswith(guard) for guard in guards]].all(axis=1)
            if holes.any():
                columns[path] = _blanked(column, holes)
        return columns, np.array(rows, np.int64), unreadable

    def _resolved(self, many: str, paths: list[tuple[str, str]]) -> tuple[dict[str, str], list[str]]:
        """The fields' own names for the paths that exist, and which fields may be absent."""
        root = self._descriptor
        if many:
            field = root.fields_by_name.get(many)
            if field is None or not field.is_repeated or field.message_type is None:
                return {}, []
            if field.message_type.GetOptions().map_entry:
                return {}, []
            root = field.message_type
        names, guards = {}, set()
        for wanted, path in paths:
            descriptor, found = root, []
            for step in path.split("."):
                known = descriptor.fields_by_name if descriptor else {}
                name = next((name for name in _ALIASES.get(step, (step,)) if name in known), None)
                if name is None:
                    break
                found.append(name)
                if known[name].has_presence:
                    guards.add(".".join(found))
                descriptor = None if known[name].is_repeated else known[name].message_type
            else:
                names[wanted] = ".".join(found)
        return names, sorted(guards)


def _split(wanted: Iterable[str]) -> tuple[str, list[str]]:
    """The sequence that the paths lead into, if any, and the paths from there on."""
    paths = list(wanted)
    many = next((path.split("[]")[0] for path in paths if "[]" in path), "")
    return many, [path.removeprefix(f"{many}[].") for path in paths]


def _walk(value: Any, steps: list[tuple[str, ...]]) -> Any:
    for names in steps:
        for name in names:
            try:
                value = value[name]
                break
            except (KeyError, TypeError, IndexError):
                continue
        else:
            return None
    return value


def _getter(names: list[str]) -> Callable[[Any], tuple[Any, ...]]:
    get = attrgetter(*names)
    return get if len(names) > 1 else lambda message: (get(message),)


def _getter_of_presence(guard: str) -> Callable[[Any], bool]:
    parent, _, name = guard.rpartition(".")
    if not parent:
        return lambda message: bool(message.HasField(name))
    get = attrgetter(parent)
    return lambda message: bool(get(message).HasField(name))


def _blanked(column: Any, holes: Any) -> Any:
    if column.dtype == object:
        return np.where(holes, "", column)
    column = column.astype(float)
    column[holes] = np.nan
    return column


def _columns(paths: Iterable[str], values: list[Any]) -> Columns:
    if not values:
        return {}
    parts = zip(paths, zip(*values, strict=True), strict=True)
    return {path: column for path, part in parts if (column := _column(part)) is not None}


def _column(values: Sequence[Any]) -> Any:
    """A column of numbers, of lists of numbers, or of text; None where there is nothing."""
    present = [value for value in values if value is not None]
    if not present:
        return None
    if all(isinstance(value, int | float) for value in present):
        if len(present) == len(values) and all(type(value) is int and abs(value) < 2**63 for value in values):
            return np.array(values, np.int64)
        return np.array([_float(value) for value in values])
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

"""Protobuf and JSON messages to columns, with the same paths as the ROS decoder."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
from google.protobuf.message import DecodeError
from mcap.records import Schema
from mcap_protobuf.decoder import DecoderFactory

from upplied.inputs.mcap.rosmsg import DefinitionError

# The same word in the three worlds: ROS 2, protobuf and JSON.
_ALIASES = {"sec": ("seconds",), "nanosec": ("nanos", "nsec")}
_MISSING = object()


class JsonDecoder:
    """Reads columns from JSON; a value that is absent or no number is NaN."""

    def columns(self, payloads: list[bytes], wanted: Iterable[str]) -> tuple[dict[str, Any], np.ndarray, int]:
        """See `upplied.inputs.mcap.rosmsg.RosDecoder.columns`."""
        return _columns(payloads, tuple(wanted), _parse_json, _item)


class ProtobufDecoder:
    """Reads columns from protobuf by the descriptors stored in the log."""

    def __init__(self, name: str, schema: bytes) -> None:
        try:
            record = Schema(id=1, name=name, encoding="protobuf", data=schema)
            decode = DecoderFactory().decoder_for("protobuf", record)
        except Exception as error:  # the descriptor library raises many kinds on hostile bytes
            raise DefinitionError(
                f"its protobuf descriptors cannot be used ({type(error).__name__})"
            ) from None
        if decode is None:
            raise DefinitionError("its protobuf descriptors cannot be used")
        self._decode = decode

    def columns(self, payloads: list[bytes], wanted: Iterable[str]) -> tuple[dict[str, Any], np.ndarray, int]:
        """See `upplied.inputs.mcap.rosmsg.RosDecoder.columns`."""
        return _columns(payloads, tuple(wanted), self._decode, _attribute)


def _parse_json(payload: bytes) -> Any:
    value = json.loads(payload)
    if not isinstance(value, dict):
        raise ValueError("no object")
    return value


def _item(value: Any, name: str) -> Any:
    return value.get(name, _MISSING) if isinstance(value, dict) else _MISSING


def _attribute(value: Any, name: str) -> Any:
    return getattr(value, name, _MISSING)


def _columns(
    payloads: list[bytes],
    wanted: tuple[str, ...],
    parse: Callable[[bytes], Any],
    get: Callable[[Any, str], Any],
) -> tuple[dict[str, Any], np.ndarray, int]:
    steps = {path: path.split(".") for path in wanted}
    many = sorted({path.split("[]")[0] for path in wanted if "[]" in path})
    rows: list[int] = []
    values: dict[str, list[Any]] = {path: [] for path in wanted}
    unreadable = 0
    for row, payload in enumerate(payloads):
        try:
            message = parse(payload)
        except (ValueError, DecodeError, RecursionError):
            unreadable += 1
            continue
        count = len(_elements(message, many[0], get)) if many else 1
        rows += [row] * count
        for path in wanted:
            found = _leaves(message, steps[path], get)
            values[path] += found if "[]" in path else found * count
    columns = {path: column for path in wanted if (column := _array(values[path])) is not None}
    return columns, np.array(rows, np.int64), unreadable


def _elements(message: Any, path: str, get: Callable[[Any, str], Any]) -> list[Any]:
    found = _step(message, path, get)
    return (
        [] if found is _MISSING or isinstance(found, str | bytes | dict | int | float) else list(found or [])
    )


def _leaves(message: Any, steps: list[str], get: Callable[[Any, str], Any]) -> list[Any]:
    values = [message]
    for step in steps:
        if step.endswith("[]"):
            values = [item for value in values for item in _elements(value, step[:-2], get)]
        else:
            values = [_step(value, step, get) for value in values]
    return values


def _step(value: Any, name: str, get: Callable[[Any, str], Any]) -> Any:
    found = get(value, name)
    for alias in _ALIASES.get(name, ()):
        if found is _MISSING:
            found = get(value, alias)
    return found


def _array(values: list[Any]) -> np.ndarray | None:
    """A column of text, of numbers or of lists of numbers; None where the field does not exist."""
    present = [value for value in values if value is not _MISSING and value is not None]
    if not present:
        return None
    if all(isinstance(value, str) for value in present):
        return np.array([value if isinstance(value, str) else "" for value in values], dtype=str)
    if all(isinstance(value, bool | int | float) for value in present):
        return _numbers([value if isinstance(value, int | float) else np.nan for value in values])
    return _lists(values)


def _numbers(values: list[Any]) -> np.ndarray:
    if all(isinstance(value, int) and abs(value) < 2**63 for value in values):
        return np.array(values, np.int64)
    return np.array([_float(value) for value in values])


def _lists(values: list[Any]) -> np.ndarray | None:
    rows = [_row(value) for value in values]
    sizes = Counter(len(row) for row in rows if row)
    if not sizes:
        return None
    width = sizes.most_common(1)[0][0]
    return np.array([row if len(row) == width else [np.nan] * width for row in rows])


def _row(value: Any) -> list[float]:
    if isinstance(value, str | bytes | dict | int | float) or value is _MISSING or value is None:
        return []
    try:
        return [_float(item) for item in value]
    except TypeError:
        return []


def _float(value: Any) -> float:
    if not isinstance(value, int | float):
        return float("nan")
    try:
        return float(value)
    except OverflowError:
        return float("nan")

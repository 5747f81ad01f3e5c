"""Columns read by the definition in the log equal what the stock decoders of MCAP make of it."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
import pytest
from cases import slow_after
from hypothesis import given, settings
from hypothesis import strategies as st
from made_logs import ROS2, flight, message
from mcap.records import Schema
from mcap_ros1._vendor.genpy import dynamic
from mcap_ros1.decoder import DecoderFactory as StockRos1
from mcap_ros2._dynamic import serialize_dynamic
from mcap_ros2.decoder import DecoderFactory as StockRos2
from rosbags.typesys import get_types_from_msg
from rosbags.typesys.store import Typestore

from upplied.inputs.mcap.decoders import Decoder
from upplied.inputs.mcap.rosmsg import DefinitionError
from upplied.inputs.tables import Channel

RANGES = {
    "bool": st.booleans(),
    "int8": st.integers(-(2**7), 2**7 - 1),
    "uint8": st.integers(0, 2**8 - 1),
    "int16": st.integers(-(2**15), 2**15 - 1),
    "uint32": st.integers(0, 2**32 - 1),
    "int64": st.integers(-(2**63), 2**63 - 1),
    "uint64": st.integers(0, 2**64 - 1),
    "float32": st.floats(width=32, allow_nan=False),
    "float64": st.floats(allow_nan=False),
    "string": st.text(st.characters(codec="ascii", exclude_characters="\0"), max_size=9),
}
KINDS = st.sampled_from(sorted(RANGES))
ARRAYS = st.sampled_from(["", "", "", "[3]", "[]", "[<=4]"])
FIELDS = st.lists(st.tuples(KINDS, ARRAYS), min_size=1, max_size=5)


def ros(name: str, text: str, cdr: bool) -> Decoder:
    """The decoder of a ROS message with this definition."""
    kinds = ("cdr", "ros2msg") if cdr else ("ros1", "ros1msg")
    return Decoder(Channel(1, "/a", kinds[0], name, kinds[1], text.encode()))


@st.composite
def conversations(draw: st.DrawFn) -> tuple[str, list[dict[str, Any]]]:
    """A definition with a nested message, and messages of it."""
    outer, inner = draw(FIELDS), draw(FIELDS)
    nested = draw(st.sampled_from(["p/Inner", "p/Inner[2]", "p/Inner[]"]))
    place = draw(st.integers(0, len(outer)))
    lines = [f"{kind}{array} f{i}" for i, (kind, array) in enumerate(outer)]
    lines.insert(place, f"{nested} inner")
    text = "\n".join(
        [*lines, "=" * 80, "MSG: p/Inner", *(f"{k}{a} g{i} # {k}" for i, (k, a) in enumerate(inner))]
    )

    def values(fields: list[tuple[str, str]], letter: str) -> dict[str, Any]:
        return {f"{letter}{i}": draw(value(kind, array)) for i, (kind, array) in enumerate(fields)}

    def value(kind: str, array: str) -> st.SearchStrategy[Any]:
        if not array:
            return RANGES[kind]
        sizes = (3, 3) if array == "[3]" else (0, 4)
        return st.lists(RANGES[kind], min_size=sizes[0], max_size=sizes[1])

    messages = []
    for _ in range(draw(st.integers(1, 6))):
        count = {"p/Inner": 1, "p/Inner[2]": 2}.get(nested) or draw(st.integers(0, 3))
        inners = [values(inner, "g") for _ in range(count)]
        messages.append(values(outer, "f") | {"inner": inners[0] if nested == "p/Inner" else inners})
    return text, messages


@pytest.mark.ci
@settings(max_examples=150, deadline=None)
@given(conversations())
def test_columns_equal_the_stock_decoder(conversation: tuple[str, list[dict[str, Any]]]) -> None:
    text, messages = conversation
    encode = serialize_dynamic("p/msg/Outer", text)["p/msg/Outer"]
    payloads = [encode(content) for content in messages]
    stock = StockRos2().decoder_for(
        "cdr", Schema(id=1, name="p/msg/Outer", encoding="ros2msg", data=text.encode())
    )
    decoded = [stock(payload) for payload in payloads]
    decoder = ros("p/msg/Outer", text, cdr=True)
    plain = [path for path in decoder.paths if "[]" not in path]
    assert compare(decoder, payloads, plain, decoded, lambda message: [message]) == len(plain) * len(messages)
    many = [path for path in decoder.paths if "[]" in path]
    if many:
        inner = sum(len(message.inner) for message in decoded)
        assert compare(decoder, payloads, many, decoded, lambda message: message.inner) == len(many) * inner


def compare(
    decoder: Decoder, payloads: list[bytes], paths: list[str], decoded: list[Any], elements: Any
) -> int:
    """Each column against the attributes of the stock decoder's objects; how many values are the same."""
    columns, row, unreadable = decoder.columns(payloads, paths)
    assert unreadable == 0
    owners = [(i, element) for i, message in enumerate(decoded) for element in elements(message)]
    assert row.tolist() == [i for i, _ in owners]
    same = 0
    for path in paths:
        names = path.split("[].")[-1].split(".")
        for value, (_, owner) in zip(columns[path], owners, strict=True):
            expected = owner
            for name in names:
                expected = getattr(expected, name)
            if isinstance(expected, list | tuple | bytes | np.ndarray):
                assert np.array_equal(np.asarray(value), np.asarray(list(expected)))
            else:
                assert value == expected
            same += 1
    return same


@pytest.mark.parametrize("end", ["little", "big"])
@pytest.mark.parametrize(
    "schema", slow_after(2, sorted(name for name in ROS2 if "geometry_msgs" in name or "nav" in name)[::-1])
)
def test_the_families_equal_the_stock_decoder(schema: str, end: str) -> None:
    """Also with frames of changing length, and in both orders of bytes."""
    flown = flight(60)
    encode = serialize_dynamic(schema, ROS2[schema])[schema]
    payloads = [
        encode(message(schema, int(t), p, q, "map" + "x" * (i % 5), "base" * (i % 3)))
        for i, (t, p, q) in enumerate(zip(flown.t_ns, flown.positions, flown.quat_xyzw, strict=True))
    ]
    stock = StockRos2().decoder_for(
        "cdr", Schema(id=1, name=schema, encoding="ros2msg", data=ROS2[schema].encode())
    )
    decoder = ros(schema, ROS2[schema], cdr=True)
    paths = [path for path in decoder.paths if "[]" not in path]
    if end == "big":
        payloads = [swapped(schema, payload) for payload in payloads]
    same = compare(decoder, payloads, paths, [stock(payload) for payload in payloads], lambda each: [each])
    assert same == len(paths) * len(payloads) >= 60 * 10


def swapped(schema: str, payload: bytes) -> bytes:
    """The payload in the other order of bytes."""
    store = Typestore()
    store.register(get_types_from_msg(ROS2[schema].lstrip("\n"), schema))
    return bytes(store.serialize_cdr(store.deserialize_cdr(payload, schema), schema, little_endian=False))


def test_ros1_equals_the_stock_decoder() -> None:
    line = "=" * 80
    text = (
        "Header header\nint8[] some\nInner[2] inner\nfloat64 last\n"
        f"{line}\nMSG: std_msgs/Header\nuint32 seq\ntime stamp\nstring frame_id\n"
        f"{line}\nMSG: p/Inner\nstring name\nfloat32[2] pair\nduration lasts\n"
    )
    kind = dynamic.generate_dynamic("p/Outer", text)["p/Outer"]
    payloads = []
    for i in range(20):
        message = kind()
        message.header.seq, message.header.frame_id, message.last = i, "f" * (i % 4), i / 7
        message.header.stamp.secs, message.header.stamp.nsecs = 1_700_000_000 + i, i
        message.some = list(range(i % 3))
        for j, inner in enumerate(message.inner or []):
            inner.name, inner.pair = "n" * j, [i, j]
        buffer = io.BytesIO()
        message.serialize(buffer)
        payloads.append(buffer.getvalue())
    stock = StockRos1().decoder_for(
        "ros1", Schema(id=1, name="p/Outer", encoding="ros1msg", data=text.encode())
    )
    decoder = ros("p/Outer", text, cdr=False)
    columns, _, _ = decoder.columns(payloads, decoder.paths)
    for i, message in enumerate(map(stock, payloads)):
        assert columns["last"][2 * i] == message.last
        assert columns["header.frame_id"][2 * i] == message.header.frame_id
        assert columns["header.stamp.sec"][2 * i] == message.header.stamp.secs
        assert columns["inner[].name"][2 * i + 1] == message.inner[1].name
        assert columns["inner[].pair"][2 * i + 1].tolist() == list(message.inner[1].pair)


@settings(max_examples=200, deadline=None)
@given(st.binary(max_size=200), st.sampled_from(sorted(ROS2)))
def test_any_bytes_are_a_message_or_unreadable(payload: bytes, schema: str) -> None:
    decoder = ros(schema, ROS2[schema], cdr=True)
    columns, row, unreadable = decoder.columns([b"\0\1\0\0" + payload, payload], decoder.paths)
    assert unreadable + len(set(row.tolist())) <= 2
    assert all(len(column) == len(row) for column in columns.values())


@pytest.mark.parametrize(
    "text",
    ["", "p/Other x", "Outer x", "float64", "float64[9999999999] x\n", "=" * 80, "\0\0"],
    ids=["empty", "unknown", "endless", "no name", "huge", "separator", "binary"],
)
def test_a_bad_definition_is_refused_or_harmless(text: str) -> None:
    try:
        decoder = ros("p/msg/Outer", text, cdr=True)
        columns, row, unreadable = decoder.columns([b"\0\1\0\0" + bytes(64)] * 3, decoder.paths)
    except DefinitionError:
        return
    assert unreadable == 3 and not len(row) and all(len(column) == 0 for column in columns.values())


def test_a_definition_that_would_walk_for_ever_is_stopped() -> None:
    """Each message holds two of the next, and the last holds nothing: 2^30 steps over no bytes."""
    parts = [f"MSG: p/M{i}\nM{i + 1}[2] a\n" for i in range(14)] + ["MSG: p/M14\nuint8[0] none\n"]
    text = "M0 first\n" + "".join("=" * 80 + "\n" + part for part in parts)
    with pytest.raises(DefinitionError):
        ros("p/msg/Outer", text, cdr=True)

"""ROS 1 bags and ROS 2 bags in SQLite: the same messages and rules as in MCAP.

A bag of ROS 1 is opened by `rosbags`; one of ROS 2 is two tables of SQLite, the messages in one of them.
Before ROS Iron it tells no definitions: the names of types are then what `rosbags` knows by them.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

from rosbags.rosbag1 import Reader
from rosbags.typesys import Stores, get_typestore

from upplied.errors import InputError
from upplied.inputs.mcap.messages import read_tables
from upplied.inputs.mcap.recording import MAX_UNPACKED, Recording, Sink
from upplied.inputs.sources.source import Fields, Source
from upplied.inputs.tables import Channel

_BATCH = 10_000  # messages that are decoded together


def read(path: Path, fields: Fields) -> Source:
    """The tables of a bag."""
    kind = Bag1 if path.open("rb").read(7) == b"#ROSBAG" else Bag2
    bag = kind(path, path.stat().st_size)
    tables = read_tables(bag, lambda channel: fields.get(channel.schema_short, ()))
    return Source(tables, losses=bag.losses, listed=bag.listed())


def siblings(path: Path) -> list[Path]:
    """The files of a ROS 2 bag that was split while it was recorded, in their order."""
    split = sorted(path.parent.glob("*.db3")) if (path.parent / "metadata.yaml").is_file() else []
    return split if path in split else [path]


class _Bag(Recording):
    """A bag as `read_tables` asks for it."""

    def channel(self, channel_id: int) -> Channel | None:
        return self.channels.get(channel_id)

    def _messages(self, wanted: set[int]) -> Iterator[tuple[int, int, bytes]]:
        """Channel, time, ns, and payload of each message."""
        raise NotImplementedError

    def read(self, sink_of: Callable[[Channel], Sink | None]) -> Iterator[None]:
        sinks = {number: sink_of(channel) for number, channel in self.channels.items()}
        waiting = unpacked = 0
        for number, t_ns, payload in self._messages({key for key, sink in sinks.items() if sink is not None}):
            sink = sinks[number]
            if sink is not None:
                sink.append((t_ns, t_ns, payload))
                waiting, unpacked = waiting + 1, unpacked + len(payload)
            if waiting >= _BATCH:
                self.check(unpacked, MAX_UNPACKED, "bytes of messages")
                waiting = 0
                yield
        yield


class Bag1(_Bag):
    """A bag of ROS 1."""

    def __init__(self, path: Path, size: int) -> None:
        super().__init__(path, size, read_to=size)
        self._reader = Reader(path)
        try:
            self._reader.open()
        except Exception as error:
            raise InputError(
                str(path), f"cannot be read as a ROS 1 bag ({error})", "a bag that was closed",
                "repair it: rosbag reindex, or copy it again",
            ) from None  # fmt: skip
        for each in self._reader.connections:
            package, name = each.msgtype.split("/")[0], each.msgtype.split("/")[-1]
            text = getattr(each.msgdef, "data", each.msgdef)
            self.channels[each.id] = Channel(
                each.id, each.topic, "ros1", f"{package}/{name}", "ros1msg", str(text).encode()
            )

    def _messages(self, wanted: set[int]) -> Iterator[tuple[int, int, bytes]]:
        with closing(self._reader):
            some = [each for each in self._reader.connections if each.id in wanted]
            try:
                for connection, t_ns, payload in self._reader.messages(some) if some else ():
                    yield connection.id, t_ns, bytes(payload)
            except Exception as error:  # a chunk that is damaged ends it
                self.losses.append(f"the bag is damaged ({type(error).__name__}); what follows is lost")


class Bag2(_Bag):
    """A bag of ROS 2 in SQLite, with the files that it was split into."""

    def __init__(self, path: Path, size: int) -> None:
        super().__init__(path, size, read_to=size)
        self._files = siblings(path)
        self._numbers: list[dict[int, int]] = []
        texts: dict[str, str] = {}
        names: dict[tuple[str, str], int] = {}
        for file in self._files:
            with _opened(file) as database:
                topics = list(database.execute("SELECT id, name, type, serialization_format FROM topics"))
                if _has(database, "message_definitions"):
                    texts |= dict(
                        database.execute(
                            "SELECT topic_type, encoded_message_definition FROM message_definitions"
                        )
                    )
            self._numbers.append({})
            for number, name, kind, encoding in topics[:5000]:
                at = names.setdefault((name, kind), len(names))
                self._numbers[-1][number] = at
                text = texts.get(kind) or _known(kind)
                self.channels[at] = Channel(at, name, encoding, kind, "ros2msg", text.encode())

    def _messages(self, wanted: set[int]) -> Iterator[tuple[int, int, bytes]]:
        query = "SELECT topic_id, timestamp, data FROM messages WHERE topic_id IN ({}) ORDER BY timestamp, id"
        for file, numbers in zip(self._files, self._numbers, strict=True):
            some = [number for number, at in numbers.items() if at in wanted]
            with _opened(file) as database:
                try:
                    for topic, t_ns, payload in database.execute(
                        query.format(",".join("?" * len(some))), some
                    ):
                        yield numbers[topic], int(t_ns), bytes(payload)
                except sqlite3.DatabaseError as error:
                    self.losses.append(f"{file.name} is damaged ({error}); what follows is lost")


def _opened(path: Path) -> Any:
    return closing(sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro&immutable=1", uri=True))


def _has(database: sqlite3.Connection, name: str) -> bool:
    return (
        database.execute("SELECT 1 FROM sqlite_master WHERE type='table' AND name=?", [name]).fetchone()
        is not None
    )


def _known(kind: str) -> str:
    """The definition of a type that a bag names and does not tell; empty where nobody knows it."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    if kind not in store.fielddefs:
        return ""
    return store.generate_msgdef(kind, ros_version=2)[0]

"""Logs of messages: MCAP, ROS 1 bags by `rosbags`, and ROS 2 bags in SQLite (types by name before Iron)."""

import sqlite3
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rosbags.rosbag1 import Reader
from rosbags.typesys import Stores, get_typestore

from upplied.inputs.mcap.decoders import read_tables
from upplied.inputs.mcap.recording import MAGIC, MAX_UNPACKED, Recording, Sink, open_recording
from upplied.inputs.sources.source import Fields, Source, refusal
from upplied.inputs.tables import Channel

_BATCH = 10_000  # messages that are decoded together
_MAX_TOPICS = 5000


def read(path: Path, fields: Fields) -> Source:
    """The tables of a log."""
    with path.open("rb") as stream:
        head = stream.read(8)
    bag = _ros1 if head.startswith(b"#ROSBAG") else _ros2
    log = open_recording(path) if head == MAGIC else bag(path, path.stat().st_size)
    tables = read_tables(log, lambda channel: fields.get(channel.schema_short, ()))
    return Source(tables, log.metadata, log.losses, log.listed(), log.read_pct)


def siblings(path: Path) -> list[Path]:
    """The files of a ROS 2 bag that was split while it was recorded, in their order."""
    split = sorted(path.parent.glob("*.db3")) if (path.parent / "metadata.yaml").is_file() else []
    return split if path in split else [path]


@dataclass
class _Bag(Recording):
    #: Channel, time, ns, and payload of each message of the wanted channels.
    messages: Callable[[set[int]], Iterator[tuple[int, int, bytes]]] = lambda links: iter(())

    def channel(self, channel_id: int) -> Channel | None:
        return self.channels.get(channel_id)

    def read(self, sink_of: Callable[[Channel], Sink | None]) -> Iterator[None]:
        sinks = {number: sink_of(channel) for number, channel in self.channels.items()}
        links = {number: sink for number, sink in sinks.items() if sink is not None}
        waiting = unpacked = 0
        for number, t_ns, payload in self.messages(set(links)):
            links[number].append((t_ns, t_ns, payload))
            waiting, unpacked = waiting + 1, unpacked + len(payload)
            if waiting >= _BATCH:
                self.check(unpacked, MAX_UNPACKED, "bytes of messages")
                waiting = 0
                yield
        yield


def _ros1(path: Path, size: int) -> _Bag:
    reader = Reader(path)
    try:
        reader.open()
    except Exception as error:  # the library has no class of its own for many kinds of damage
        finding, remedy = f"cannot be read as a ROS 1 bag ({error})", "rosbag reindex, or copy it again"
        raise refusal(finding, "a bag that was closed", remedy) from None
    bag = _Bag(path, size, read_to=size)
    for each in reader.connections:
        package, name = each.msgtype.split("/")[0], each.msgtype.split("/")[-1]
        text = str(getattr(each.msgdef, "data", each.msgdef)).encode()
        bag.channels[each.id] = Channel(each.id, each.topic, "ros1", f"{package}/{name}", "ros1msg", text)

    def messages(links: set[int]) -> Iterator[tuple[int, int, bytes]]:
        with closing(reader):
            some = [each for each in reader.connections if each.id in links]
            try:
                for connection, t_ns, payload in reader.messages(some) if some else ():
                    yield connection.id, t_ns, bytes(payload)
            except Exception as error:  # a chunk that is damaged ends it
                bag.losses.append(f"the bag is damaged ({type(error).__name__}); what follows is lost")

    bag.messages = messages
    return bag


def _ros2(path: Path, size: int) -> _Bag:
    bag = _Bag(path, size, read_to=size)
    files: list[tuple[Path, dict[int, int]]] = []  # each with the channels of its topics
    texts, channels = dict[str, str](), dict[tuple[str, str], int]()
    known = get_typestore(Stores.ROS2_HUMBLE)  # types that a bag names without their definition
    for file in siblings(path):
        files.append((file, numbers := {}))
        with _opened(file) as database:
            topics = database.execute("SELECT id, name, type, serialization_format FROM topics").fetchall()
            tables = database.execute("SELECT name FROM sqlite_master WHERE type='table'")
            if "message_definitions" in {name for (name,) in tables}:
                query = "SELECT topic_type, encoded_message_definition FROM message_definitions"
                texts |= dict(database.execute(query))
        for number, name, kind, encoding in topics[:_MAX_TOPICS]:
            at = numbers[number] = channels.setdefault((name, kind), len(channels))
            text = texts.get(kind) or (
                known.generate_msgdef(kind, ros_version=2)[0] if kind in known.fielddefs else ""
            )
            bag.channels[at] = Channel(at, name, encoding, kind, "ros2msg", text.encode())

    def messages(links: set[int]) -> Iterator[tuple[int, int, bytes]]:
        query = "SELECT topic_id, timestamp, data FROM messages WHERE topic_id IN ({}) ORDER BY timestamp, id"
        for file, numbers in files:
            some = [number for number, at in numbers.items() if at in links]
            with _opened(file) as database:
                try:
                    rows = database.execute(query.format(",".join("?" * len(some))), some)
                    yield from ((numbers[topic], int(t_ns), bytes(payload)) for topic, t_ns, payload in rows)
                except sqlite3.DatabaseError as error:
                    bag.losses.append(f"{file.name} is damaged ({error}); what follows is lost")

    bag.messages = messages
    return bag


def _opened(path: Path) -> Any:
    return closing(sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro&immutable=1", uri=True))

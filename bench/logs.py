"""Poses out of a log full of images: ours, the stock decoder and rosbags, against plain reading.

    python bench/logs.py                     a log of 500 MB
    python bench/logs.py --megabytes 2000    a log of 2 GB

The limit is to read and decompress every chunk and look at nothing. Each contender runs in a
process of its own, twice, and the better run counts; the log stays in the page cache.
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

MOST, LEAST_BYTES = 2.0, 200e6  # times the best of the others; of smaller logs the start counts as well
RATE_HZ, IMAGE_HZ, IMAGE_BYTES = 100, 10, 200_000
TOPIC = "/camera/pose"
TIME = "\n" + "=" * 80 + "\nMSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"
HEADER = "\n" + "=" * 80 + "\nMSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n" + TIME
FLOATS = "\n" + "=" * 80 + "\nMSG: geometry_msgs/{}\n{}\n"
POSE = (
    "std_msgs/Header header\ngeometry_msgs/Pose pose\n"
    + HEADER
    + FLOATS.format("Pose", "geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation")
    + FLOATS.format("Point", "float64 x\nfloat64 y\nfloat64 z")
    + FLOATS.format("Quaternion", "float64 x\nfloat64 y\nfloat64 z\nfloat64 w")
)
IMAGE = "std_msgs/Header header\nstring format\nuint8[] data\n" + HEADER


def make_log(path: Path, megabytes: int) -> None:
    """A log as a recorder writes it: images that do not compress, and poses between them."""
    from mcap.writer import CompressionType, Writer
    from mcap_ros2._dynamic import serialize_dynamic

    encode = serialize_dynamic("geometry_msgs/msg/PoseStamped", POSE)["geometry_msgs/msg/PoseStamped"]
    noise = np.random.default_rng(0).bytes(64 * IMAGE_BYTES)
    with path.open("wb") as stream:
        writer = Writer(stream, compression=CompressionType.ZSTD, chunk_size=2**20)
        writer.start("ros2", "bench")
        pose_schema = writer.register_schema("geometry_msgs/msg/PoseStamped", "ros2msg", POSE.encode())
        image_schema = writer.register_schema("sensor_msgs/msg/CompressedImage", "ros2msg", IMAGE.encode())
        poses = writer.register_channel(TOPIC, "cdr", pose_schema)
        images = writer.register_channel("/camera/image", "cdr", image_schema)
        for index in range(megabytes * 1_000_000 // IMAGE_BYTES * RATE_HZ // IMAGE_HZ):
            t_ns = 1_700_000_000_000_000_000 + index * 10**9 // RATE_HZ
            angle = index / RATE_HZ * 0.05
            content = {
                "header": {"stamp": {"sec": t_ns // 10**9, "nanosec": t_ns % 10**9}, "frame_id": "map"},
                "pose": {
                    "position": {"x": 10 * np.cos(angle), "y": 10 * np.sin(angle), "z": 5.0},
                    "orientation": {"x": 0.0, "y": 0.0, "z": np.sin(angle / 2), "w": np.cos(angle / 2)},
                },
            }
            writer.add_message(poses, t_ns, encode(content), t_ns)
            if index % (RATE_HZ // IMAGE_HZ) == 0:
                start = index * IMAGE_HZ // RATE_HZ % 64 * IMAGE_BYTES
                writer.add_message(images, t_ns, bytes(60) + noise[start : start + IMAGE_BYTES], t_ns)
        writer.add_metadata("inspection", {"structure_id": "bench", "body_frame": "camera"})
        writer.finish()


def limit(path: Path) -> np.ndarray:
    """Read and decompress every chunk."""
    import zstandard
    from mcap.reader import make_reader

    decompressor, size = zstandard.ZstdDecompressor(), 0
    with path.open("rb") as stream:
        chunks = make_reader(stream).get_summary().chunk_indexes
    with path.open("rb", buffering=0) as stream:
        for index in chunks:
            stream.seek(index.chunk_start_offset + 9)
            content = memoryview(stream.read(index.chunk_length - 9))
            size += len(decompressor.decompress(content[-index.compressed_size :]))
    return np.empty((0, 7)) if size else np.empty((1, 7))


def ours(path: Path) -> np.ndarray:
    """Our poses, every chunk checked against its CRC."""
    from upplied.inputs.logs import FIELDS
    from upplied.inputs.mcap.decoders import read_tables
    from upplied.inputs.mcap.recording import open_recording
    from upplied.inputs.schemas import ros
    from upplied.inputs.sidecar import LogOptions

    tables = read_tables(open_recording(path), lambda channel: FIELDS.get(channel.schema_short, ()))
    track = ros.samples(tables[0], tables, LogOptions())
    return np.column_stack([track.positions, track.quat_xyzw])


def ours_whole(path: Path) -> np.ndarray:
    """`read_demonstration`: besides the poses every check, and the SHA-256 of the file."""
    from upplied.inputs.logs import read_demonstration

    flight = read_demonstration(path)
    return np.column_stack([flight.positions, flight.quat_xyzw])


def stock(path: Path) -> np.ndarray:
    """The decoder of the mcap packages, with CRCs."""
    from mcap.reader import make_reader
    from mcap_ros2.decoder import DecoderFactory

    rows = []
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
        for _, _, _, message in reader.iter_decoded_messages(topics=[TOPIC]):
            p, q = message.pose.position, message.pose.orientation
            rows.append((p.x, p.y, p.z, q.x, q.y, q.z, q.w))
    return np.array(rows)


def rosbags(path: Path) -> np.ndarray:
    """The reader of the rosbags package."""
    from rosbags.highlevel import AnyReader

    rows = []
    with AnyReader([path]) as reader:
        chosen = [connection for connection in reader.connections if connection.topic == TOPIC]
        for connection, _, raw in reader.messages(connections=chosen):
            message = reader.deserialize(raw, connection.msgtype)
            p, q = message.pose.position, message.pose.orientation
            rows.append((p.x, p.y, p.z, q.x, q.y, q.z, q.w))
    return np.array(rows)


CONTENDERS: dict[str, tuple[str, Callable[[Path], np.ndarray]]] = {
    "limit": ("read and decompress (the limit)", limit),
    "ours": ("ours: poses", ours),
    "whole": ("ours: read_demonstration, with SHA-256", ours_whole),
    "stock": ("mcap, mcap-ros2-support", stock),
    "rosbags": ("rosbags", rosbags),
}


def measured(name: str, path: Path) -> dict[str, float]:
    """One run in a process of its own."""
    command = [sys.executable, __file__, "--run", name, "--log", str(path)]
    process = subprocess.run(command, capture_output=True, text=True, check=True)
    return json.loads(process.stdout.splitlines()[-1])


def run(name: str, path: Path) -> None:
    """Print what one run took, as JSON; the imports are not counted."""
    _warm(name)
    wall, cpu = time.perf_counter(), time.process_time()
    rows = CONTENDERS[name][1](path)
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1000
    total = float(rows[:, :3].sum() + np.abs(rows[:, 3:]).sum())  # q and -q are one rotation
    print(json.dumps({"wall": wall, "cpu": cpu, "rss": peak, "poses": len(rows), "sum": total}))


def _warm(name: str) -> None:
    with tempfile.TemporaryDirectory() as folder:
        small = Path(folder) / "small.mcap"
        make_log(small, 20)
        CONTENDERS[name][1](small)


def main() -> None:
    """Make the log, run every contender on it and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--megabytes", type=int, default=500)
    parser.add_argument("--repeats", type=int, default=2)
    parser.add_argument("--run", choices=sorted(CONTENDERS), help=argparse.SUPPRESS)
    parser.add_argument("--log", type=Path, help="use this log instead of making one")
    arguments = parser.parse_args()
    if arguments.run:
        run(arguments.run, arguments.log)
        return
    with tempfile.TemporaryDirectory() as folder:
        path = arguments.log or Path(folder) / "flight.mcap"
        if arguments.log is None:
            make_log(path, arguments.megabytes)
        print(
            f"log of {path.stat().st_size / 1e6:.0f} MB, images at {IMAGE_HZ} Hz, poses at {RATE_HZ} Hz, zstd"
        )
        print(f"{'':42s} {'CPU s':>7s} {'wall s':>7s} {'MB':>6s} {'poses':>8s} {'CPU / limit':>12s}")
        base, poses, cost = None, set(), {}
        for name, (title, _) in CONTENDERS.items():
            fastest = min((measured(name, path) for _ in range(arguments.repeats)), key=lambda m: m["cpu"])
            base = base or fastest["cpu"]
            ratio, cost[name] = fastest["cpu"] / base, fastest["cpu"]
            if name != "limit":
                poses.add((fastest["poses"], round(fastest["sum"], 6)))
            print(
                f"{title:42s} {fastest['cpu']:7.2f} {fastest['wall']:7.2f} {fastest['rss']:6.0f} "
                f"{fastest['poses']:8.0f} {ratio:12.2f}"
            )
        if len(poses) != 1:
            sys.exit("the readers do not agree on the poses")
        times = cost["ours"] / min(cost["stock"], cost["rosbags"])
        print(f"ours costs {times:.2f} times what the best of the others does (at most {MOST:g} is the goal)")
        if times > MOST and path.stat().st_size > LEAST_BYTES:
            sys.exit("ours costs too much")


if __name__ == "__main__":
    main()

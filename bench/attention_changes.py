"""Changes of a flight or a mesh that should not change what the flight was about, for bench/attention.py."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from upplied.records import Bools, Cloud, Demonstration, Floats, Structure

Truth = Callable[[Cloud], tuple[Bools, Bools]]


@dataclass(frozen=True)
class Row:
    """A flight, and which samples it was meant for: strictly, and with what is attached."""

    title: str
    inspection: str
    structure: Structure
    flight: Demonstration
    truth: Truth


def changed(row: Row) -> Iterator[tuple[str, Row, int, Demonstration | None]]:
    """The same flight with something changed: name, row, sampling seed, and pictures that recall asks of."""
    flight = row.flight
    for reach in (30.0, 100.0):
        camera = replace(flight.camera, max_range_m=reach)
        yield f"reach {reach:.0f} m", replace(row, flight=replace(flight, camera=camera)), 0, flight
    yield "half rate", replace(row, flight=_part(flight, slice(None, None, 2))), 0, flight
    yield "double rate", replace(row, flight=_doubled(flight)), 0, flight
    rng = np.random.default_rng(zlib.crc32(row.title.encode()))
    noisy = flight.positions + rng.normal(0, 0.05, flight.positions.shape)
    yield "5 cm noise", replace(row, flight=replace(flight, positions=noisy)), 0, flight
    for share, seconds in ((0.3, 120.0), (0.7, 60.0)):
        yield (
            f"hover {seconds:.0f} s",
            replace(row, flight=_hovering(flight, share, seconds)),
            0,
            flight,
        )
    yield "transits", replace(row, flight=_with_transits(flight, row.structure)), 0, flight
    yield "unwelded", replace(row, structure=_unwelded(row.structure)), 0, None
    for seed in (1, 2):
        yield f"seed {seed}", row, seed, None


def _part(flight: Demonstration, part: slice) -> Demonstration:
    return replace(
        flight,
        t_ns=flight.t_ns[part],
        positions=flight.positions[part],
        quat_xyzw=flight.quat_xyzw[part],
        breaks=np.empty(0, np.int64),
    )


def _doubled(flight: Demonstration) -> Demonstration:
    from upplied.geometry.poses import interpolate

    path = flight.trajectory
    times = np.sort(np.concatenate([path.t_s, (path.t_s[1:] + path.t_s[:-1]) / 2]))
    return _of(flight, times, interpolate(path, times).positions, interpolate(path, times).quat_xyzw)


def _of(flight: Demonstration, times: Floats, positions: Floats, quats: Floats) -> Demonstration:
    return replace(flight, t_ns=np.round(times * 1e9).astype(np.int64), positions=positions, quat_xyzw=quats)


def _hovering(flight: Demonstration, share: float, seconds: float) -> Demonstration:
    at = int(share * len(flight))
    path, count = flight.trajectory, int(10 * seconds)
    pause = path.t_s[at] + np.arange(1, count + 1) / 10
    return _of(
        flight,
        np.concatenate([path.t_s[: at + 1], pause, path.t_s[at + 1 :] + seconds]),
        np.concatenate(
            [path.positions[: at + 1], np.tile(path.positions[at], (count, 1)), path.positions[at + 1 :]]
        ),
        np.concatenate(
            [path.quat_xyzw[: at + 1], np.tile(path.quat_xyzw[at], (count, 1)), path.quat_xyzw[at + 1 :]]
        ),
    )


def _with_transits(flight: Demonstration, structure: Structure) -> Demonstration:
    """30 s of way there and back at 3 m/s from outside, the camera looking ahead along the first picture."""
    path, seconds = flight.trajectory, 30.0
    middle = (structure.vertices.min(axis=0) + structure.vertices.max(axis=0)) / 2
    count = int(10 * seconds)

    def away(at: Floats) -> Floats:
        out = at - middle
        out[2] = max(out[2], 0.3 * np.linalg.norm(out[:2]))
        return out / np.linalg.norm(out)

    going = (np.arange(count) / 10)[:, None]
    there = path.positions[0] + (seconds - going) * 3.0 * away(path.positions[0])
    back = path.positions[-1] + (going + 0.1) * 3.0 * away(path.positions[-1])
    return _of(
        flight,
        np.concatenate([going[:, 0], path.t_s + seconds, path.t_s[-1] + seconds + 0.1 + going[:, 0]]),
        np.concatenate([there, path.positions, back]),
        np.concatenate(
            [
                np.tile(path.quat_xyzw[0], (count, 1)),
                path.quat_xyzw,
                np.tile(path.quat_xyzw[-1], (count, 1)),
            ]
        ),
    )


@cache
def _unwelded(structure: Structure) -> Structure:
    """Every triangle with corners of its own, moved by a millionth of the diagonal: no two of them meet."""
    corners = structure.vertices[structure.triangles.reshape(-1)]
    rng = np.random.default_rng(0)
    moved = corners + rng.uniform(-1e-6, 1e-6, corners.shape) * structure.diagonal_m
    return replace(structure, vertices=moved, triangles=np.arange(len(corners)).reshape(-1, 3))

"""A simulated pilot who flies the paper's inspections round any structure of a kind."""

from __future__ import annotations

import hashlib
import zlib

import numpy as np

from upplied.geometry.poses import normalised
from upplied.geometry.scene import scene_of
from upplied.records import Camera, Demonstration, Floats, Structure
from upplied.samples.hand import Hand, fly_route
from upplied.samples.inspections import route_of

_FIRST_DAY_NS = 1_767_600_000_000_000_000  # 5 January 2026, 08:00 UTC
_HOUR_NS = 3_600_000_000_000


def fly(
    structure: Structure,
    inspection: str,
    seed: int = 0,
    camera: Camera | None = None,
) -> Demonstration:
    """Demonstrate an inspection.

    The pilot knows only the surface: fuselage, wings, engine, tower or piers are located on it, so that real
    meshes can be flown as well as the samples.

    Parameters
    ----------
    structure : Structure
        In metres, Z up, nose, bow, hub or road along +X.
    inspection : {"fuselage", "wings", "engine_left", "tower", "hull", "sides", "piers"}
    seed : int
        Of the hand; the same seed gives the same flight.
    camera : Camera, optional
        By default the paper's.

    Returns
    -------
    Demonstration
        Named after structure and inspection, e.g. ``a320-fuselage-v1``. The whole path stays 2 m from
        the surface and 1 m from the ground.

    Raises
    ------
    RefusedError
        If the structure lacks the inspected part, or there is no room to fly.
    """
    scene = scene_of(structure)
    floor = structure.floor_z_m
    name = _named(structure.structure_id, inspection)
    rng = np.random.default_rng([seed, zlib.crc32(name.encode())])
    flown = fly_route(route_of(structure, inspection, scene, floor), scene, floor, Hand(), rng)
    quats = normalised(flown.quat_xyzw)
    jitter = rng.integers(-1_500_000, 1_500_000, len(flown))
    start = _FIRST_DAY_NS + (seed % 1000) * _HOUR_NS
    return Demonstration(
        demonstration_id=name,
        structure_id=structure.structure_id,
        t_ns=start + np.round(flown.t_s * 1e9).astype(np.int64) + jitter,
        positions=flown.positions,
        quat_xyzw=quats,
        camera=camera or Camera(width_px=1440, height_px=1440),
        operator="simulated pilot",
        site=structure.site,
        sha256=_hash(flown.positions, quats),
        clock="header",
        notes=f"{inspection.replace('_', ' ')} inspection, simulated",
    )


def _hash(positions: Floats, quats: Floats) -> str:
    """Identity of a flight that was never logged: its poses, to 1e-7."""
    poses = np.round(np.column_stack([positions, quats]) * 1e7).astype("<i8")
    return hashlib.sha256(poses.tobytes()).hexdigest()


def _named(structure_id: str, inspection: str) -> str:
    stem, dash, version = structure_id.rpartition("-")
    word = inspection.replace("_", "-")
    if dash and version[:1] == "v" and version[1:].isdigit():
        return f"{stem}-{word}-{version}"[:64]
    return f"{structure_id}-{word}"[:64]

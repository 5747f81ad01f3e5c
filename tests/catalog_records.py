"""Records to keep in a catalog: small, random, complete in every field, the same for a seed."""

from __future__ import annotations

import hashlib
import shutil
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from upplied.catalog import Catalog, open_catalog
from upplied.records import (
    Camera,
    Counterpart,
    Demonstration,
    Measures,
    Placement,
    Plan,
    Registration,
    Structure,
    SurfaceStates,
    Surroundings,
    Trajectory,
)


def key_of(*parts: object) -> str:
    """A key as planning makes them: 64 hexadecimal digits."""
    return hashlib.sha256(repr(parts).encode()).hexdigest()


def quaternions(rng: np.random.Generator, count: int) -> np.ndarray:
    quats = rng.normal(size=(count, 4))
    quats /= np.linalg.norm(quats, axis=1, keepdims=True)
    return np.where(quats[:, 3:] < 0, -quats, quats)


def copied(begun: Catalog, place: Path) -> Catalog:
    """A catalog of a test's own, which begins as one that its module made once."""
    return open_catalog(shutil.copytree(begun.location, place, dirs_exist_ok=True))


def structure(name: str = "boxy", seed: int = 0, **changes: Any) -> Structure:
    """A structure with every field said."""
    rng = np.random.default_rng(seed)
    record = Structure(
        name,
        "box",
        rng.normal(size=(60, 3)) * 10,
        rng.integers(0, 60, (40, 3)),
        site="hangar 3, Zürich",
        sha256=key_of("mesh", name, seed),
        placement=Placement(47.3, 8.5, 430.0, 271.5, "amsl"),
        surroundings=Surroundings(-0.1, rng.normal(size=(2, 2, 3)), rng.normal(size=(5, 2)), 120.0),
        landmarks={"nose": (1.0, 2.0, 0.1 + 0.2), "tail": (-1.0, 0.0, 3.0)},
        symmetric=True,
        notes='said "so" | <b>',
    )
    return replace(record, **changes)


def demonstration(name: str = "flight", seed: int = 0, count: int = 50, **changes: Any) -> Demonstration:
    """A demonstration with every field said."""
    rng = np.random.default_rng(seed)
    record = Demonstration(
        name,
        "boxy",
        np.cumsum(rng.integers(1, 10**9, count)) + 1_700_000_000_000_000_000,
        rng.normal(size=(count, 3)) * 20,
        quaternions(rng, count),
        camera=Camera(80.0, 60.0, 1.5, 40.0, 1920, 1080, "dji-phantom-4-rtk", 0.002, 2.5, 1.0, 8.8, 2.8),
        stills=True,
        operator="Ada",
        site="hangar 3",
        sha256=key_of("log", name, seed),
        breaks=np.array([10, 20]),
        degraded=True,
        dropped={"not finite": 3, "time goes back": 1},
        clock="header",
        topic="/drone/pose",
        notes="last chunk lost",
    )
    return replace(record, **changes)


def plan(
    target: str = "target", seed: int = 0, count: int = 60, status: str = "ok", preset: str = "recommended"
) -> Plan:
    """A plan with every field said; refused and failed ones have no trajectory."""
    rng = np.random.default_rng(seed)
    numbers = {item.name: float(rng.random()) for item in fields(Measures)}
    record = Plan(
        "flight",
        "boxy",
        target,
        "box",
        preset,
        status,
        registration=Registration(
            rng.random(3), np.eye(3), rng.normal(size=3), 0.25, status == "ok", "", 0.1, 0.2, 0.4, "tried 3"
        ),
        measures=Measures(**numbers),
        counterpart_summary="2 parts of 2",
        counterparts=(
            Counterpart("part_1 (left)", 98.5, 1, 4, ("part_2 (left)",), ("part_3: why",), "sure?"),
        ),
        warnings=("wind", 'a "quote"'),
    )
    if status != "ok":
        return replace(record, reason="does not fit: 0.9 > 0.5", measures=Measures())
    path = Trajectory(np.cumsum(rng.random(count)), rng.normal(size=(count, 3)), quaternions(rng, count))
    surface = SurfaceStates(rng.normal(size=(30, 3)), rng.integers(0, 5, 30))
    return replace(record, trajectory=path, is_viewpoint=rng.random(count) < 0.3, surface=surface)


def differences(left: Any, right: Any, path: str = "") -> list[str]:
    """Where two records differ, field by field and bit by bit (NaN equals NaN)."""
    if is_dataclass(left) and is_dataclass(right):
        return [
            each
            for item in fields(left)
            for each in differences(
                getattr(left, item.name), getattr(right, item.name), f"{path}.{item.name}"
            )
        ]
    if isinstance(left, np.ndarray) and isinstance(right, np.ndarray):
        alike = left.dtype == right.dtype and np.array_equal(left, right, equal_nan=left.dtype.kind == "f")
        return [] if alike else [path]
    if isinstance(left, tuple) and isinstance(right, tuple) and len(left) == len(right):
        pairs = enumerate(zip(left, right, strict=True))
        return [each for at, (one, other) in pairs for each in differences(one, other, f"{path}[{at}]")]
    both_nan = isinstance(left, float) and isinstance(right, float) and left != left and right != right
    return [] if both_nan or (type(left) is type(right) and left == right) else [path]

"""COLMAP's sparse models, as text and as binary: images from the world to the camera, centres, lenses."""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from upplied.errors import InputError
from upplied.inputs.files import read_regular
from upplied.inputs.sources.projects import Size, reconstructed
from upplied.inputs.sources.source import Fields, Source

MAX_BYTES = 2 << 30
# Parameters of each model in the order of its number, and whether x and y have a focal length each.
_MODELS = (
    ("SIMPLE_PINHOLE", 3), ("PINHOLE", 4), ("SIMPLE_RADIAL", 4), ("RADIAL", 5), ("OPENCV", 8),
    ("OPENCV_FISHEYE", 8), ("FULL_OPENCV", 12), ("FOV", 5), ("SIMPLE_RADIAL_FISHEYE", 4),
    ("RADIAL_FISHEYE", 5), ("THIN_PRISM_FISHEYE", 12), ("RAD_TAN_THIN_PRISM_FISHEYE", 16),
)  # fmt: skip
_IMAGE = struct.Struct("<I7dI")
_CAMERA = struct.Struct("<IiQQ")

Image = tuple[str, tuple[float, ...], int]  # name, quaternion w x y z and shift, camera


def read(path: Path, fields: Fields) -> Source:
    """The images of a model; `path` is its file of images, that of its cameras lies beside it."""
    data = read_regular(path, MAX_BYTES)
    beside = path.with_name(f"cameras{path.suffix}")
    lenses = _lenses(read_regular(beside, MAX_BYTES), beside) if beside.is_file() else {}
    found = sorted(_binary(data, path) if path.suffix == ".bin" else _text(data.decode("utf-8")))
    values = np.array([pose for _, pose, _ in found]).reshape(-1, 7)
    turns = Rotation.from_quat(values[:, [1, 2, 3, 0]]) if len(found) else Rotation.identity(0)
    nothing: Size = (math.nan, math.nan, math.nan)
    sizes = [lenses.get(camera, nothing) for _, _, camera in found]
    centres = -turns.inv().apply(values[:, 4:]) if len(found) else np.empty((0, 3))
    return reconstructed(path, turns.inv().as_matrix(), centres, sizes=sizes)


def _text(text: str) -> Iterator[Image]:
    lines = [line for line in text.split("\n") if not line.startswith("#")]
    for line in lines[::2]:  # every other line lists points
        words = line.split(maxsplit=9)
        if len(words) == 10:
            yield words[9].strip(), tuple(float(word) for word in words[1:8]), int(words[8])


def _binary(data: bytes, path: Path) -> Iterator[Image]:
    (count,) = struct.unpack_from("<Q", data)
    if count > len(data) // _IMAGE.size:
        raise InputError(
            str(path),
            f"says it has {count} images, in {len(data)} bytes",
            "a complete file",
            "export it again",
        )
    at = 8
    for _ in range(count):
        _, *pose, camera = _IMAGE.unpack_from(data, at)
        end = data.index(b"\0", at + _IMAGE.size)
        name = data[at + _IMAGE.size : end].decode("utf-8", "replace")
        at = end + 9 + 24 * struct.unpack_from("<Q", data, end + 1)[0]
        yield name, tuple(pose), camera


def _lenses(data: bytes, path: Path) -> dict[int, Size]:
    if path.suffix != ".bin":
        rows = [line.split() for line in data.decode("utf-8").split("\n") if line.strip() and line[0] != "#"]
        return {int(row[0]): (float(row[2]), float(row[3]), float(row[4])) for row in rows}
    (count,) = struct.unpack_from("<Q", data)
    found, at = {}, 8
    for _ in range(min(count, len(data) // _CAMERA.size)):
        number, model, width, height = _CAMERA.unpack_from(data, at)
        if not 0 <= model < len(_MODELS):
            raise InputError(
                str(path), f"has a camera of the unknown model {model}", "a model of COLMAP", "export as text"
            )
        found[number] = float(width), float(height), struct.unpack_from("<d", data, at + _CAMERA.size)[0]
        at += _CAMERA.size + 8 * _MODELS[model][1]
    return found

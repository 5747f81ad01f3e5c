"""COLMAP's sparse models, as text and as binary: images from the world to the camera, centres, lenses."""

import struct
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from upplied.inputs.files import read_regular
from upplied.inputs.sources.projects import NO_SIZE, Size, reconstructed
from upplied.inputs.sources.source import Fields, Source, refusal
from upplied.records import Lens

MAX_BYTES = 2 << 30
# Camera models in the order of their numbers, and how many parameters each has: focal lengths, where the axis
# meets the picture, and coefficients.
_MODELS = {
    "SIMPLE_PINHOLE": 3, "PINHOLE": 4, "SIMPLE_RADIAL": 4, "RADIAL": 5, "OPENCV": 8, "OPENCV_FISHEYE": 8,
    "FULL_OPENCV": 12, "FOV": 5, "SIMPLE_RADIAL_FISHEYE": 4, "RADIAL_FISHEYE": 5, "THIN_PRISM_FISHEYE": 12,
    "RAD_TAN_THIN_PRISM_FISHEYE": 16,
}  # fmt: skip
_OTHERS = ("FOV", "THIN_PRISM_FISHEYE", "RAD_TAN_THIN_PRISM_FISHEYE")  # than OpenCV's
_IMAGE, _CAMERA = struct.Struct("<I7dI"), struct.Struct("<IiQQ")
Image = tuple[str, tuple[float, ...], int]  # name, quaternion w x y z and shift, camera


def read(path: Path, fields: Fields) -> Source:
    """The images of a model; `path` is its file of images, that of its cameras lies beside it."""
    data, beside = read_regular(path, MAX_BYTES), path.with_name(f"cameras{path.suffix}")
    lenses = _lenses(read_regular(beside, MAX_BYTES), path.suffix) if beside.is_file() else {}
    lines = [] if path.suffix == ".bin" else data.decode("utf-8").split("\n")
    lines = [line for line in lines if not line.startswith("#")]
    rows = [line.split(maxsplit=9) for line in lines[::2]]  # every other line lists points
    texts = [(row[9].strip(), tuple(map(float, row[1:8])), int(row[8])) for row in rows if len(row) == 10]
    images = sorted(texts or (_binary(data) if path.suffix == ".bin" else []))
    values = np.array([pose for _, pose, _ in images]).reshape(-1, 7)
    turns = Rotation.from_quat(values[:, [1, 2, 3, 0]]).inv() if len(images) else Rotation.identity(0)
    centres = -turns.apply(values[:, 4:]) if len(images) else np.empty((0, 3))
    sizes = [lenses.get(camera, NO_SIZE) for _, _, camera in images]
    return reconstructed(turns.as_matrix(), centres, sizes=sizes)


def _binary(data: bytes) -> Iterator[Image]:
    (count,) = struct.unpack_from("<Q", data)
    if count > len(data) // _IMAGE.size:
        raise refusal(f"declares {count} images in {len(data)} bytes", "a complete file", "export it again")
    at = 8
    for _ in range(count):
        _, *pose, camera = _IMAGE.unpack_from(data, at)
        end = data.index(b"\0", at + _IMAGE.size)
        name = data[at + _IMAGE.size : end].decode("utf-8", "replace")
        at = end + 9 + 24 * struct.unpack_from("<Q", data, end + 1)[0]
        yield name, tuple(pose), camera


def _lenses(data: bytes, suffix: str) -> dict[int, Size]:
    if suffix != ".bin":
        rows = [line.split() for line in data.decode("utf-8").split("\n") if line.strip() and line[0] != "#"]
        return {int(row[0]): _size(row[1], *map(float, row[2:])) for row in rows}
    (count,) = struct.unpack_from("<Q", data)
    lenses, at = {}, 8
    for _ in range(min(count, len(data) // _CAMERA.size)):
        number, model, width, height = _CAMERA.unpack_from(data, at)
        if not 0 <= model < len(_MODELS):
            raise refusal(f"has a camera of the unknown model {model}", "a model of COLMAP", "export as text")
        name, parameters = tuple(_MODELS.items())[model]
        values = struct.unpack_from(f"<{parameters}d", data, at + _CAMERA.size)
        lenses[number] = _size(name, float(width), float(height), *values)
        at += _CAMERA.size + 8 * parameters
    return lenses


def _size(model: str, width: float, height: float, focal: float, *more: float) -> Size:
    one = model.startswith(("SIMPLE", "RADIAL"))  # focal length
    across, down, *values = more if one else more[1:]
    if model in _OTHERS or model not in _MODELS:
        return width, height, focal, None
    if model in ("SIMPLE_RADIAL", "RADIAL", "SIMPLE_PINHOLE", "PINHOLE"):
        values = [*values, 0.0, 0.0][:2]
    lens = Lens("fisheye" if "FISHEYE" in model else "brown", tuple(values), (across / width, down / height))
    return width, height, focal, lens

"""Poses as research writes them: TUM, EuRoC and KITTI, a pose a line."""

import re
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from upplied.inputs.files import read_regular
from upplied.inputs.sources.source import MAX_BYTES, Fields, Source, numbered, poses, refusal
from upplied.records import Ints

_SPLIT = re.compile(rb"[,;\s]+")
WIDTHS = (8, 17, 12)  # numbers in a line of TUM, EuRoC and KITTI
_NANOSECONDS = 1e15  # a stamp beyond is no second
# KITTI's world is the first camera's: x right, y down, z forward. Here x forward, y left, z up.
_UPRIGHT = Rotation.from_matrix([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]])


def width_of(line: bytes) -> int:
    """How many numbers a line holds; 0 where it holds something else."""
    try:
        return len([float(part) for part in _SPLIT.split(line.strip()) if part])
    except ValueError:
        return 0


def read(path: Path, fields: Fields) -> Source:
    """The poses of a file."""
    words = _words(path)
    rows = np.array([[float(word) for word in line] for line in words])
    stamps = [line[0] for line in words]
    if rows.shape[1] == WIDTHS[2]:
        return _kitti(path, rows.reshape(-1, 3, 4))
    if rows[0, 0] > _NANOSECONDS:
        times = np.array([int(float(stamp)) if b"." in stamp else int(stamp) for stamp in stamps])
        table = poses("/pose", times, rows[:, 1:4], rows[:, [5, 6, 7, 4]], "world")
        return Source([table], notes=["EuRoC: poses of the inertial unit, quaternions w x y z"])
    return Source([poses("/pose", _nanoseconds(stamps), rows[:, 1:4], rows[:, 4:8], "world")])


def times_beside(path: Path) -> list[Path]:
    """The files that may hold the times of KITTI's poses, the first that exists counts."""
    return [path.with_name(f"{path.stem}_times.txt"), path.with_name("times.txt")]


def _kitti(path: Path, matrices: np.ndarray) -> Source:
    notes = ["KITTI: the first camera's axes, turned until z points up"]
    listed = next((_words(name) for name in times_beside(path) if name.is_file()), [])
    times = 1_000_000_000 + _nanoseconds([line[0] for line in listed])
    timed = len(times) == len(matrices)
    if not timed:
        times = numbered(len(matrices))
        notes.append("no times beside it: one pose every 2 s")
    if (np.abs(np.linalg.det(matrices[:, :, :3]) - 1) > 1e-2).any():
        raise refusal("holds matrices that are no rotations", "three rows of [R t] a line")
    quats = (_UPRIGHT * Rotation.from_matrix(matrices[:, :, :3])).as_quat()
    table = poses("/poses", times, _UPRIGHT.apply(matrices[:, :, 3]), quats, "kitti")
    return Source([table], notes=notes, defaults={"body_frame": "optical"}, timed=timed)


def _words(path: Path) -> list[list[bytes]]:
    """The numbers of each line, as they are written; the last line may be cut off."""
    lines = [line for line in read_regular(path, MAX_BYTES).splitlines() if width_of(line)]
    words = [[word for word in _SPLIT.split(line.strip()) if word] for line in lines]
    if len(words) > 1 and len(words[-1]) < len(words[0]):
        words.pop()
    odd = sum(len(each) != len(words[0]) for each in words)
    if not words or odd:
        raise refusal(f"{odd} of {len(words)} lines hold another count of numbers", "one pose a line")
    return words


def _nanoseconds(seconds: list[bytes]) -> Ints:
    """Seconds as nanoseconds, digit by digit where they are written so."""
    stamps = []
    for text in seconds:
        whole, _, rest = text.partition(b".")
        exact = whole.isdigit() and (not rest or rest.isdigit())
        stamps.append(int(whole) * 10**9 + int((rest + b"0" * 9)[:9]) if exact else round(float(text) * 1e9))
    return np.array(stamps, np.int64)

"""PLY files are read again as they were written, by our reader and by another one."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pytest
import trimesh

from upplied.inputs.formats.reader import read_raw
from upplied.outputs.display import ply_bytes


@pytest.mark.parametrize("normals", [False, True])
def test_a_mesh_and_a_cloud_come_back(tmp_path: Path, normals: bool) -> None:
    rng = np.random.default_rng(0)
    points = rng.normal(0, 1e6, (20, 3))
    triangles = np.empty((0, 3), np.int64) if normals else rng.integers(0, 20, (7, 3))
    facing = points / np.linalg.norm(points, axis=1, keepdims=True) if normals else None
    content = ply_bytes(points, triangles, facing)
    (tmp_path / "of.ply").write_bytes(content)
    raw, _ = read_raw(tmp_path / "of.ply")
    assert np.array_equal(raw.vertices, points) and np.array_equal(raw.triangles, triangles)
    if facing is not None:
        assert np.array_equal(raw.normals, facing)
    else:
        other = trimesh.load(io.BytesIO(content), file_type="ply", process=False)
        assert np.array_equal(other.vertices, points) and np.array_equal(other.faces, triangles)

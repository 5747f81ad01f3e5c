"""Small JPEG pictures from the camera of a flight."""

from __future__ import annotations

import io

import numpy as np

from upplied.extras import extra
from upplied.geometry.poses import matrices
from upplied.geometry.scene import Scene, scene_of
from upplied.records import Camera, Floats, Structure, Trajectory

_SIDE_PX = 192
_SKY, _GROUND, _PAINT = np.array([188, 214, 240]), np.array([168, 184, 150]), np.array([226, 228, 232])
_SUN = np.array([0.45, -0.35, 0.82])


def camera_pictures(structure: Structure | None, poses: Trajectory, camera: Camera) -> list[bytes]:
    """One JPEG per pose; grey noise where no structure is given."""
    rays = _rays(camera)
    scene = scene_of(structure) if structure is not None else None
    turns = matrices(poses.quat_xyzw)
    rng = np.random.default_rng(len(poses))
    return [
        _jpeg(_noise(rng, len(rays)) if scene is None else _shaded(scene, position, rays @ turn.T))
        for position, turn in zip(poses.positions, turns, strict=True)
    ]


def _rays(camera: Camera) -> Floats:
    """Unit directions (px * px, 3) in the camera frame, row by row from the upper left."""
    across, down = np.tan(np.radians(np.minimum([camera.hfov_deg, camera.vfov_deg], 150.0)) / 2)
    y, z = np.meshgrid(np.linspace(across, -across, _SIDE_PX), np.linspace(down, -down, _SIDE_PX))
    rays = np.stack([np.ones_like(y), y, z], axis=-1).reshape(-1, 3)
    return rays / np.linalg.norm(rays, axis=1, keepdims=True)


def _shaded(scene: Scene, position: Floats, rays: Floats) -> Floats:
    reach, triangle, normal = scene.cast(np.broadcast_to(position, rays.shape), rays)
    facing = np.einsum("ij,ij->i", normal, rays)
    normal = np.where(facing[:, None] > 0, -normal, normal)
    light = 0.35 + 0.4 * np.clip(normal @ _SUN, 0, 1) + 0.25 * np.abs(facing)
    background = np.where(rays[:, 2:] < 0, _GROUND, _SKY)
    hazed = light[:, None] * _PAINT * np.exp(-np.where(np.isfinite(reach), reach, 0) / 400)[:, None]
    return np.where(triangle[:, None] >= 0, hazed, background)


def _noise(rng: np.random.Generator, pixels: int) -> Floats:
    return np.repeat(rng.integers(0, 256, (pixels, 1)).astype(float), 3, axis=1)


def _jpeg(pixels: Floats) -> bytes:
    with extra("export"):
        from PIL import Image
    image = Image.fromarray(np.clip(pixels, 0, 255).astype(np.uint8).reshape(_SIDE_PX, _SIDE_PX, 3))
    stream = io.BytesIO()
    image.save(stream, "JPEG", quality=80)
    return stream.getvalue()

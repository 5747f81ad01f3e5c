"""The plan as MCAP for Foxglove and ROS 2, in the structure frame: path, camera, frusta and surface."""

import io
from typing import Any

import numpy as np
from mcap_ros2.writer import Writer

from upplied.errors import RefusedError
from upplied.outputs.colours import PRESETS, STATES, SURFACE, rgb
from upplied.outputs.display import display_mesh, display_states
from upplied.outputs.draw.tubes import frustum_corners
from upplied.outputs.logs import CAMERA_INFO, camera_info, header, pose, registered, transform
from upplied.records import Camera, Floats, Plan, Structure, Trajectory

FRAME, CAMERA_FRAME = "structure", "planned_camera"
_LINE_LIST, _POINTS, _TRIANGLE_LIST = 5, 8, 11
_POSE, _LINKS, _LINE = "geometry_msgs/msg/PoseStamped", "tf2_msgs/msg/TFMessage", "nav_msgs/msg/Path"
_MARKERS = "visualization_msgs/msg/MarkerArray"


def mcap_bytes(
    plan: Plan, structure: Structure, camera: Camera | None = None, notes: tuple[str, ...] = ()
) -> bytes:
    """The plan as MCAP; times are those of the plan, from 0. The notes are in its metadata.

    Needs no place on the Earth: everything is in the structure frame, metres.
    """
    path, camera = plan.trajectory, camera or Camera()
    if path is None:
        fault = f"the plan is {plan.status}: {plan.reason}"
        raise RefusedError(plan.target_id, fault, "only a plan that is ok")
    buffer = io.BytesIO()
    writer = Writer(buffer)
    schemas = registered(writer, (_POSE, _LINKS, _LINE, _MARKERS))
    facts = {"structure_id": structure.structure_id, "frame": "structure: metres, Z up, +X forward"}
    facts |= {"demonstration_id": plan.demonstration_id, "preset": plan.preset}
    writer.add_metadata("plan", facts | ({"notes": "; ".join(notes)} if notes else {}))

    def write(topic: str, schema: str, message: dict[str, Any], at_ns: int = 0) -> None:
        writer.write_message(topic, schemas[schema], message, log_time=at_ns, publish_time=at_ns)

    stamps = np.round(path.t_s * 1e9).astype(np.int64).tolist()
    stamped = [
        {"header": header(at, FRAME), "pose": pose(position, quat)}
        for at, position, quat in zip(stamps, path.positions, path.quat_xyzw, strict=True)
    ]
    write("/structure", _MARKERS, {"markers": [_surface(plan, structure)]})
    write("/plan/frusta", _MARKERS, {"markers": [_frusta(plan, path, camera)]})
    write("/plan/path", _LINE, {"header": header(0, FRAME), "poses": stamped})
    for at, message, position, quat in zip(stamps, stamped, path.positions, path.quat_xyzw, strict=True):
        write("/tf", _LINKS, {"transforms": [transform(at, FRAME, CAMERA_FRAME, position, quat)]}, at)
        write("/plan/camera", _POSE, message, at)
    if path.fov_deg is not None:
        schemas |= registered(writer, (CAMERA_INFO,))
        for at, each in zip(stamps, camera.zoomed(path.fov_deg), strict=True):
            write("/plan/camera_info", CAMERA_INFO, camera_info(each, header(at, CAMERA_FRAME)), at)
    writer.finish()
    return buffer.getvalue()


def _surface(plan: Plan, structure: Structure) -> dict[str, Any]:
    mesh = display_mesh(structure)
    vertices, triangles = mesh.vertices, mesh.triangles
    if len(triangles):
        marker = _marker("structure", _TRIANGLE_LIST, vertices[triangles].reshape(-1, 3), SURFACE, 1.0)
    else:
        marker = _marker("structure", _POINTS, vertices, SURFACE, structure.diagonal_m / 300)
    if plan.surface is not None:
        palette = [_colour(colour) for colour in STATES.values()]
        code = display_states(mesh, plan.surface)
        marker["colors"] = [palette[each] for each in np.repeat(code, 3 if len(triangles) else 1)]
    return marker


def _frusta(plan: Plan, path: Trajectory, camera: Camera) -> dict[str, Any]:
    shown = path if plan.is_viewpoint is None else path.take(np.flatnonzero(plan.is_viewpoint))
    depth = 0.04 * float(np.linalg.norm(np.ptp(path.positions, axis=0))) + 0.2
    positions, quats = shown.positions, shown.quat_xyzw
    rim = frustum_corners(positions, quats, camera, depth)
    if shown.fov_deg is not None:
        each = zip(positions[:, None], quats[:, None], camera.zoomed(shown.fov_deg), strict=True)
        rim = np.concatenate([frustum_corners(*one, depth) for one in each])
    apex = np.repeat(positions[:, None], 4, axis=1)
    ends = np.stack([apex, rim, rim, np.roll(rim, -1, axis=1)], axis=2)
    colour = PRESETS.get(plan.preset, PRESETS["recommended"])
    return _marker("frusta", _LINE_LIST, ends.reshape(-1, 3), colour, depth / 40)


def _marker(name: str, kind: int, points: Floats, colour: str, size: float) -> dict[str, Any]:
    """A marker in the structure's frame; the writer fills the other fields with zeros."""
    own, places = header(0, FRAME), [dict(zip("xyz", point, strict=True)) for point in points.tolist()]
    marker: dict[str, Any] = {"header": own, "ns": name, "type": kind, "scale": dict.fromkeys("xyz", size)}
    marker |= {"pose": pose(np.zeros(3), np.array([0.0, 0.0, 0.0, 1.0])), "color": _colour(colour)}
    return marker | {"frame_locked": True, "points": places, "texture": {"header": own}}


def _colour(colour: str) -> dict[str, float]:
    return dict(zip("rgba", (*rgb(colour), 1.0), strict=True))

"""The plan as MCAP for Foxglove and ROS 2, in the structure frame: path, camera, frusta and surface."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
from mcap_ros2.writer import Writer

from upplied.errors import RefusedError
from upplied.outputs import ros2_schemas
from upplied.outputs.colours import PRESETS, STATES, SURFACE, rgb
from upplied.outputs.display import display_mesh, display_states
from upplied.outputs.draw.tubes import frustum_corners
from upplied.outputs.ros2_schemas import camera_info
from upplied.records import Camera, Floats, Plan, Structure, Trajectory

FRAME, CAMERA_FRAME = "structure", "planned_camera"
_RULE = "=" * 80
_LINE_LIST, _POINTS, _TRIANGLE_LIST = 5, 8, 11
_PATH = (
    f"std_msgs/Header header\ngeometry_msgs/PoseStamped[] poses\n{_RULE}\nMSG: geometry_msgs/PoseStamped\n"
)
_PATH += ros2_schemas.POSE_STAMPED
_MARKERS = f"""visualization_msgs/Marker[] markers
{_RULE}
MSG: visualization_msgs/Marker
std_msgs/Header header
string ns
int32 id
int32 type
int32 action
geometry_msgs/Pose pose
geometry_msgs/Vector3 scale
std_msgs/ColorRGBA color
builtin_interfaces/Duration lifetime
bool frame_locked
geometry_msgs/Point[] points
std_msgs/ColorRGBA[] colors
string texture_resource
sensor_msgs/CompressedImage texture
visualization_msgs/UVCoordinate[] uv_coordinates
string text
string mesh_resource
visualization_msgs/MeshFile mesh_file
bool mesh_use_embedded_materials
{_RULE}
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
{_RULE}
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
{_RULE}
MSG: builtin_interfaces/Duration
int32 sec
uint32 nanosec
{_RULE}
MSG: geometry_msgs/Pose
geometry_msgs/Point position
geometry_msgs/Quaternion orientation
{_RULE}
MSG: geometry_msgs/Point
float64 x
float64 y
float64 z
{_RULE}
MSG: geometry_msgs/Quaternion
float64 x
float64 y
float64 z
float64 w
{_RULE}
MSG: geometry_msgs/Vector3
float64 x
float64 y
float64 z
{_RULE}
MSG: std_msgs/ColorRGBA
float32 r
float32 g
float32 b
float32 a
{_RULE}
MSG: sensor_msgs/CompressedImage
std_msgs/Header header
string format
uint8[] data
{_RULE}
MSG: visualization_msgs/UVCoordinate
float32 u
float32 v
{_RULE}
MSG: visualization_msgs/MeshFile
string filename
uint8[] data
"""


def mcap_bytes(
    plan: Plan | Trajectory,
    structure: Structure,
    camera: Camera | None = None,
    notes: tuple[str, ...] = (),
) -> bytes:
    """The plan as MCAP; time is that of the plan, from 0. The notes stand in its metadata.

    Needs no place on the Earth: everything is in the structure frame, metres.
    """
    path = plan if isinstance(plan, Trajectory) else plan.trajectory
    if path is None:
        assert isinstance(plan, Plan)
        raise RefusedError(
            plan.target_id, f"the plan is {plan.status}: {plan.reason}", "only a plan that is ok"
        )
    buffer = io.BytesIO()
    writer = Writer(buffer)
    poses = writer.register_msgdef("geometry_msgs/msg/PoseStamped", ros2_schemas.POSE_STAMPED)
    frames = writer.register_msgdef("tf2_msgs/msg/TFMessage", ros2_schemas.TF)
    line = writer.register_msgdef("nav_msgs/msg/Path", _PATH)
    markers = writer.register_msgdef("visualization_msgs/msg/MarkerArray", _MARKERS)
    facts = {"structure_id": structure.structure_id, "frame": "structure: metres, Z up, +X forward"}
    if isinstance(plan, Plan):
        facts |= {"demonstration_id": plan.demonstration_id, "preset": plan.preset}
    if notes:
        facts["notes"] = "; ".join(notes)
    writer.add_metadata("plan", facts)

    def write(topic: str, schema: Any, message: dict[str, Any], at_ns: int = 0) -> None:
        writer.write_message(topic, schema, message, log_time=at_ns, publish_time=at_ns)

    stamps = np.round(path.t_s * 1e9).astype(np.int64).tolist()
    stamped = [
        {"header": _header(at), "pose": _pose(position, quat)}
        for at, position, quat in zip(stamps, path.positions, path.quat_xyzw, strict=True)
    ]
    write("/structure", markers, {"markers": [_surface(plan, structure)]})
    write("/plan/frusta", markers, {"markers": [_frusta(plan, path, camera or Camera())]})
    write("/plan/path", line, {"header": _header(0), "poses": stamped})
    for at, pose in zip(stamps, stamped, strict=True):
        transform = {"translation": pose["pose"]["position"], "rotation": pose["pose"]["orientation"]}
        link = {"header": _header(at), "child_frame_id": CAMERA_FRAME, "transform": transform}
        write("/tf", frames, {"transforms": [link]}, at)
        write("/plan/camera", poses, pose, at)
    if path.fov_deg is not None:
        info = writer.register_msgdef("sensor_msgs/msg/CameraInfo", ros2_schemas.CAMERA_INFO)
        for at, each in zip(stamps, (camera or Camera()).zoomed(path.fov_deg), strict=True):
            write("/plan/camera_info", info, camera_info(each, _header(at) | {"frame_id": CAMERA_FRAME}), at)
    writer.finish()
    return buffer.getvalue()


def _surface(plan: Plan | Trajectory, structure: Structure) -> dict[str, Any]:
    mesh = display_mesh(structure)
    vertices, triangles = mesh.vertices, mesh.triangles
    kind, points = (
        (_TRIANGLE_LIST, vertices[triangles].reshape(-1, 3)) if len(triangles) else (_POINTS, vertices)
    )
    size = 1.0 if len(triangles) else structure.diagonal_m / 300
    marker = _marker("structure", kind, points, SURFACE, size)
    states = plan.surface if isinstance(plan, Plan) else None
    if states is not None:
        palette = [_colour(colour) for colour in STATES.values()]
        code = display_states(mesh, states)
        marker["colors"] = [palette[each] for each in np.repeat(code, 3 if len(triangles) else 1)]
    return marker


def _frusta(plan: Plan | Trajectory, path: Trajectory, camera: Camera) -> dict[str, Any]:
    chosen = np.arange(len(path))
    if isinstance(plan, Plan) and plan.is_viewpoint is not None:
        chosen = np.flatnonzero(plan.is_viewpoint)
    depth = 0.04 * float(np.linalg.norm(np.ptp(path.positions, axis=0))) + 0.2
    positions = path.positions[chosen]
    quats, fov_deg = path.quat_xyzw[chosen], path.fov_deg
    rim = frustum_corners(positions, quats, camera, depth)
    if fov_deg is not None:
        cameras = camera.zoomed(fov_deg[chosen])
        each = zip(positions[:, None], quats[:, None], cameras, strict=True)
        rim = np.concatenate([frustum_corners(*one, depth) for one in each])
    apex = np.repeat(positions[:, None], 4, axis=1)
    ends = np.stack([apex, rim, rim, np.roll(rim, -1, axis=1)], axis=2)
    preset = plan.preset if isinstance(plan, Plan) else "recommended"
    colour = PRESETS.get(preset, PRESETS["recommended"])
    return _marker("frusta", _LINE_LIST, ends.reshape(-1, 3), colour, depth / 40)


def _marker(name: str, kind: int, points: Floats, colour: str, size: float) -> dict[str, Any]:
    scale = {"x": size, "y": size, "z": size}
    empty_image = {"header": _header(0), "format": "", "data": b""}
    return {
        "header": _header(0),
        "ns": name,
        "id": 0,
        "type": kind,
        "action": 0,
        "pose": _pose(np.zeros(3), np.array([0.0, 0.0, 0.0, 1.0])),
        "scale": scale,
        "color": _colour(colour),
        "lifetime": {"sec": 0, "nanosec": 0},
        "frame_locked": True,
        "points": [dict(zip("xyz", point, strict=True)) for point in points.tolist()],
        "colors": [],
        "texture_resource": "",
        "texture": empty_image,
        "uv_coordinates": [],
        "text": "",
        "mesh_resource": "",
        "mesh_file": {"filename": "", "data": b""},
        "mesh_use_embedded_materials": False,
    }


def _colour(colour: str) -> dict[str, float]:
    return dict(zip("rgba", (*rgb(colour), 1.0), strict=True))


def _header(at_ns: int) -> dict[str, Any]:
    return {"stamp": {"sec": at_ns // 10**9, "nanosec": at_ns % 10**9}, "frame_id": FRAME}


def _pose(position: Floats, quat: Floats) -> dict[str, Any]:
    return {
        "position": dict(zip("xyz", position.tolist(), strict=True)),
        "orientation": dict(zip("xyzw", quat.tolist(), strict=True)),
    }

"""Field of view from the calibration in a log: ROS CameraInfo and Foxglove CameraCalibration."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from upplied.cameras import completed, known_camera, unverified
from upplied.errors import InputError
from upplied.inputs.flight.tracks import Track, fields_of, names, source_times
from upplied.inputs.sidecar import LogOptions
from upplied.inputs.tables import Table
from upplied.records import Camera, Floats, Ints, Lens

_SCHEMAS = fields_of("cameras")
_KNOWN = 0.5  # of the poses that come after the first calibration: fewer, and the clocks are two
ZOOM_UNHEARD = "against a calibration in the log that changes"
NO_CALIBRATION = "no camera calibration in the log"
UNVERIFIED = " not verified"  # how a note of figures of the list of cameras ends
_OPTICS = ("width_px", "height_px", "exposure_s", "trigger_s", "focus_m", "focal_mm", "f_number")
_FISHEYE = ("equidistant", "fisheye", "kannala_brandt", "fisheye62")
_BROWN = ("", "plumb_bob", "rational_polynomial", "pinhole", "brown")
_CENTRED_PX = 1.0  # from the middle of the picture, as where conventions of pixels differ by


@dataclass(frozen=True)
class Zoom:
    """The field of view in time: from each of these stamps on, horizontal and vertical, deg."""

    t_ns: Ints  # (K,) by the clock of the calibration
    log_ns: Ints  # (K,) when the recorder received it
    hfov_deg: Floats  # (K,)
    vfov_deg: Floats  # (K,)

    def at(self, track: Track) -> Floats | None:
        """Fields of view (N, 2), deg, of poses, early ones by the first known; None without a common clock.

        The source's clock counts where it is that of the poses and never stepped, else the recorder's.
        """
        for times, known in ((track.t_ns, self.t_ns), (track.log_ns, self.log_ns)):
            if times is track.t_ns and track.clock_steps:
                continue
            order = np.argsort(known, kind="stable")
            index = np.searchsorted(known[order], times, side="right") - 1
            if len(times) and np.mean(index >= 0) >= _KNOWN:
                index = order[np.maximum(index, 0)]
                return np.column_stack([self.hfov_deg[index], self.vfov_deg[index]])
        return None

    @property
    def spread_pct(self) -> float:
        return float(100 * (self.hfov_deg.max() / self.hfov_deg.min() - 1)) if len(self.t_ns) else 0.0


def calibrated(table: Table) -> tuple[Camera, str, Zoom, str] | None:
    """Camera, name of its optical frame, its field of view in time, and a note; None: it is not calibrated.

    The pinhole model gives ``fov = 2 atan(w / 2 f)``, the fisheye models ``w / f``.
    """
    matrix = table.vectors("k" if "k" in table else "K", 9)
    values = np.column_stack([table.stack("width", "height"), matrix[:, [0, 4]]])
    if not (good := ((values > 1e-3) & (values < 1e7)).all(axis=1)).any():
        return None
    model = str(names(table, "distortion_model")[good][0]).lower()
    frame, t_ns = "frame_id" if "frame_id" in table else "header.frame_id", source_times(table)[0][good]
    share = values[good, :2] / values[good, 2:]  # of the sides over the focal length
    fields = np.degrees(share if model.startswith(_FISHEYE) else 2 * np.arctan(share / 2))
    fields = np.minimum(fields, [360.0, 180.0])
    shown = table.columns.get("d", table.columns.get("D"))
    if shown is None or shown.dtype == object or shown.ndim != 2:
        shown = np.empty((len(table), 0))
    size, middle_px = np.median(values[good, :2], axis=0), np.median(matrix[good][:, [2, 5]], axis=0)
    lens, note = lens_of(model, np.median(shown[good], axis=0), middle_px, size)
    hfov_deg, vfov_deg = np.median(fields, axis=0).tolist()
    width_px, height_px = map(int, np.minimum(size, 1e6))
    camera = Camera(hfov_deg=hfov_deg, vfov_deg=vfov_deg, width_px=width_px, height_px=height_px, lens=lens)
    return camera, str(names(table, frame)[good][0]), Zoom(t_ns, table.log_ns[good], *fields.T), note


def lens_of(model: str, values: Floats, middle_px: Floats, size: Floats) -> tuple[Lens | None, str]:
    """The lens of a calibration, None of a pinhole, and a note on what of it cannot be used.

    The model is as ROS, Foxglove and OpenCV name it, its coefficients (K,) are in the order of OpenCV. The
    axis meets the picture of a size (2,), px, in its middle (2,) where the one given lies in no picture.
    """
    fisheye, note = model.startswith(_FISHEYE), ""
    count = int(np.flatnonzero(values)[-1]) + 1 if values.any() else 0
    known = model in (_FISHEYE[:3] if fisheye else _BROWN)
    if count > (4 if fisheye else 8) or (count and not (known and np.isfinite(values).all())):
        note = f"distortion of the camera is not used: {count} coefficients of the model {model[:40]!r}"
        count = 0
    if not ((middle_px > 0) & (middle_px < size)).all() or (abs(middle_px - size / 2) <= _CENTRED_PX).all():
        middle_px = size / 2
    if not (count or fisheye) and (middle_px == size / 2).all():
        return None, note
    middle = tuple((middle_px / size).tolist())
    return Lens("fisheye" if fisheye else "brown", tuple(map(float, values[:count])), middle), note


def camera_of(
    tables: Sequence[Table], facts: LogOptions, what: str
) -> tuple[Camera, str, list[str], Zoom | None]:
    """The camera of a flight by log, facts and defaults, its optical frame, notes, and its view in time.

    Raises InputError if the log holds several cameras and nothing says which.
    """
    known = [(table.channel.topic, calibrated(table)) for table in tables if table.schema in _SCHEMAS]
    by_topic = {topic: each for topic, each in known if each is not None}
    if facts.camera_frame_id:
        frame = facts.camera_frame_id.lstrip("/")
        by_topic = {topic: each for topic, each in by_topic.items() if each[1] == frame}
    if len({(cam.hfov_deg, cam.vfov_deg, frame) for cam, frame, *_ in by_topic.values()}) > 1:
        named = (f"{topic} (frame {of[1]}, {of[0].hfov_deg:.0f} deg)" for topic, of in by_topic.items())
        finding = f"holds several cameras: {', '.join(named)}"
        raise InputError(what, finding, "one camera", "give camera_frame_id")
    camera, frame, zoom, note = next(iter(by_topic.values()), (Camera(), "", None, NO_CALIBRATION))
    notes = [note] if note else []
    names = ("hfov_deg", "vfov_deg", "min_range_m", "max_range_m", *_OPTICS)
    stated = ((name, getattr(facts, f"camera_{name}")) for name in names)
    declared: dict[str, Any] = {
        name: int(value) if name.endswith("_px") else value for name, value in stated if value is not None
    }
    if facts.camera_model:
        model = known_camera(facts.camera_model, facts.camera_file_format or "jpeg")
        camera = completed(camera, model) if by_topic else model
        notes += filter(None, [unverified(facts.camera_model, [*declared, *["hfov_deg"] * bool(by_topic)])])
    camera = replace(camera, **declared)
    if facts.camera_distortion is not None:
        size = np.array([camera.width_px, camera.height_px], float)
        if facts.camera_middle_px is not None and not size.all():
            rule = "camera_width_px, camera_height_px"
            raise InputError(f"{what}, camera_middle_px", "has no size of the picture", rule)
        values, size = np.array(facts.camera_distortion, float), np.where(size > 0, size, 1.0)
        middle = np.array(facts.camera_middle_px or size / 2, float)
        lens, note = lens_of(facts.camera_distortion_model, values, middle, size)
        if note:
            raise InputError(f"{what}, camera_distortion", note, "at most 8 numbers, of a fisheye 4")
        camera = replace(camera, lens=lens)
    if camera.focus_m > camera.min_range_m and facts.camera_min_range_m is None:
        camera = replace(camera, min_range_m=camera.focus_m)
    if camera.min_range_m >= camera.max_range_m:
        finding = f"got {camera.min_range_m} to {camera.max_range_m} m"
        raise InputError(f"{what}, camera range", finding, "the least range below the greatest")
    if facts.camera_hfov_deg is not None and zoom is not None and zoom.spread_pct > facts.passport.zoom_pct:
        changes = f"from {zoom.hfov_deg.max():.1f} to {zoom.hfov_deg.min():.1f} deg"
        notes.append(f"{ZOOM_UNHEARD} {changes}: {camera.hfov_deg:g} deg all the time, as declared")
    return camera, facts.camera_frame_id.lstrip("/") or frame, notes, zoom


def lens_ratio(zoom: Zoom | None, facts: LogOptions) -> float:
    """The declared field of view over that of the log's calibration; NaN where one of them is missing."""
    if zoom is None or facts.camera_hfov_deg is None or not len(zoom.hfov_deg):
        return float("nan")
    nearest = np.clip(facts.camera_hfov_deg, zoom.hfov_deg.min(), zoom.hfov_deg.max())
    return facts.camera_hfov_deg / float(nearest)


def through(
    camera: Camera, zoom: Zoom | None, track: Track, facts: LogOptions, what: str
) -> tuple[Camera, Floats | None]:
    """The camera of the flight that was chosen, and the field of view (N, 2), deg, of poses where it zooms.

    The camera is the narrowest there was: whoever looks at nothing else claims only what was seen.
    Raises InputError if the view changes, but no clock says at which pose, unless `zoom-untimed` is allowed.
    """
    if zoom is None or facts.camera_hfov_deg is not None or not len(track):
        return camera, None
    if (fov_deg := zoom.at(track)) is None:
        if zoom.spread_pct > facts.passport.zoom_pct and "zoom-untimed" not in facts.allow:
            change = f"from {zoom.hfov_deg.max():.1f} to {zoom.hfov_deg.min():.1f} deg"
            finding = f"zoom-untimed: the field of view changes {change}, by another clock than the poses"
            rule = f"one field of view, within {facts.passport.zoom_pct:g} %, or one clock"
            remedy = "record with one clock, or --allow zoom-untimed: the narrowest then counts"
            raise InputError(what, finding, rule, remedy)
        fov_deg = np.column_stack([zoom.hfov_deg, zoom.vfov_deg])
    if facts.camera_vfov_deg is not None:
        fov_deg = np.column_stack([fov_deg[:, 0], np.full(len(fov_deg), camera.vfov_deg)])
    narrow = fov_deg[np.argmin(fov_deg[:, 0])]
    camera = replace(camera, hfov_deg=float(narrow[0]), vfov_deg=float(narrow[1]))
    widest = narrow[0] * (1 + facts.passport.zoom_pct / 100)
    return camera, fov_deg if len(fov_deg) == len(track) and fov_deg[:, 0].max() > widest else None

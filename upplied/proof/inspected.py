"""Which samples a flight inspected as planned: as finely, and by a look that is sharp and frontal.

The terms are those by which plans are measured (`planning.measures.fidelity`, `visibility.pictures`): the
ground sample distance of the finest sharp look, with the obliquity of the patch in it. A plan requires of a
patch its own finest look at it.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from upplied.config import InspectionSettings, VisibilitySettings, focal_px
from upplied.geometry.poses import interpolate
from upplied.geometry.scene import Scene
from upplied.planning.measures.fidelity import AS_FINE
from upplied.planning.visibility.line_of_sight import coarseness, visible
from upplied.planning.visibility.looks import Looks, sharp_looks
from upplied.planning.visibility.observations import TRULY, Moments, Views, moments, views
from upplied.records import Bools, Camera, Cloud, Floats, Ints, Record, Trajectory

#: Inside the rim of a picture and the largest incidence, a look is sure: noise of 2 cm turns one from 8 m by
#: as much. A path that was corrected is off by more.
RIM_DEG, CORRECTED_RIM_DEG = 0.15, 0.3
_HALF_S, _INNER = 0.5, 5  # over which poses are averaged on both sides of a photo, and how many of them


@dataclass(frozen=True, eq=False, repr=False)
class PlannedLooks(Record):
    """The finest look of a plan at each of N samples, which a flight of it is to match."""

    sampled_m: Floats  # (N,) what a pixel covers, times the pixels of a focal length; inf: any look will do
    by_rule: Bools  # (N,) that look is sharp and frontal by the rule; where it is not, none needs to be
    camera: Camera
    rule: InspectionSettings
    rim_deg: float = RIM_DEG

    def matched(self, shown: Views, steps: Moments, surface: Cloud, camera: Camera) -> Bools:
        """Which samples (N,) a flight looks at as finely, and where the rule holds as sharply and frontally.

        A look counts where it would if its pose were a little off. The views are what the flight truly sees,
        and the moments those of its looks. Pixels that are known of one camera alone are taken for both's.
        """
        mine, planned = (
            focal_px(one.width_px or other.width_px or self.rule.width_px, one.hfov_deg)
            for one, other in ((camera, self.camera), (self.camera, camera))
        )
        coarsest_m = AS_FINE * self.sampled_m * mine / planned
        sure = replace(self.rule, max_incidence_deg=self.rule.max_incidence_deg - self.rim_deg)
        inner = _well_inside(shown, surface, camera, self.rim_deg)
        strict, any_look = (_finest(steps, inner, surface, camera, rule) for rule in (sure, None))
        finest_m = np.where(self.by_rule, strict.sampled_m, any_look.sampled_m)
        return np.asarray(np.isfinite(finest_m) & (finest_m <= coarsest_m), bool)


def planned_looks(
    plan: Trajectory, surface: Cloud, camera: Camera, scene: Scene, rule: InspectionSettings,
    photo_s: Floats | None = None,
) -> PlannedLooks:  # fmt: skip
    """What a plan requires of a look at each sample of a surface, by the rule when one is sharp and frontal.

    Where only photos count, they are taken at moments `photo_s` (K,) of the plan, s; what those do not show
    is required as finely as the plan sees it on its way.
    """
    steps = moments(plan)
    shown = views(plan, surface, camera, TRULY, scene)
    strict, any_look = (_finest(steps, shown, surface, camera, one) for one in (rule, None))
    by_rule = np.isfinite(strict.sampled_m)
    sampled = np.where(by_rule, strict.sampled_m, any_look.sampled_m)
    if photo_s is not None and len(photo_s):
        taken = looks_at(plan, photo_s)
        shots = views_from(taken.poses, surface, camera, scene)
        shot = _finest(taken, shots, surface, camera, rule).sampled_m
        sampled = np.where(by_rule & np.isfinite(shot), shot, sampled)
    return PlannedLooks(sampled, by_rule, camera, rule)


def pictured(
    path: Trajectory, cloud: Cloud, camera: Camera, scene: Scene, rule: InspectionSettings
) -> dict[str, Floats]:
    """Ground sample distance, mm, motion blur, px, and time in sharp view, s, of each sample (N,); NaN: none.

    Distance and blur are those of the finest look that is sharp by the rule.
    """
    steps = moments(path)
    shown = _finest(steps, views(path, cloud, camera, TRULY, scene), cloud, camera, rule)
    focal = focal_px(camera.width_px or rule.width_px, camera.hfov_deg)
    return {
        "gsd_mm": np.where(np.isfinite(shown.sampled_m), 1e3 * shown.sampled_m / focal, np.nan),
        "blur_px": shown.moved * focal * (camera.exposure_s or rule.exposure_s),
        "sharp_s": np.where(shown.number > 0, shown.number * float(steps.step_s.mean()), np.nan),
    }


def looks_at(path: Trajectory, moments_s: Floats, breaks: Ints | None = None) -> Moments:
    """A path at moments (K,), s, each with its motion from the half second before it to that after it.

    `breaks` begin after gaps, across which nothing is known.
    """
    cuts = np.zeros(1, np.int64) if breaks is None else np.unique(np.append(0, breaks))
    piece = np.clip(np.searchsorted(path.t_s[cuts], moments_s, side="right") - 1, 0, None)
    first, last = path.t_s[cuts][piece], path.t_s[np.append(cuts[1:], len(path)) - 1][piece]
    inner = (np.arange(_INNER) + 0.5) / _INNER * _HALF_S
    ends = []
    for offsets in (-inner, inner):
        times = np.clip(moments_s[:, None] + offsets, first[:, None], last[:, None])
        fine = interpolate(path, times.ravel())
        turns = fine.quat_xyzw.reshape(*times.shape, 4)
        turns = np.where((turns * turns[:, :1]).sum(axis=2, keepdims=True) < 0, -turns, turns).mean(axis=1)
        mean = fine.positions.reshape(*times.shape, 3).mean(axis=1)
        ends.append((times.mean(axis=1), mean, Rotation.from_quat(turns)))
    (before_s, before, was), (after_s, after, then) = ends
    span = np.maximum(after_s - before_s, 1e-9)[:, None]
    turn = (then * was.inv()).as_rotvec() / span
    return Moments(interpolate(path, moments_s), np.zeros(len(moments_s)), (after - before) / span, turn)


def views_from(poses: Trajectory, surface: Cloud, camera: Camera, scene: Scene) -> Views:
    """What poses truly see of some samples, through the field of view that each had."""
    where = poses.positions, poses.quat_xyzw
    seen = visible(*where, surface, camera, TRULY, scene, fov_deg=poses.fov_deg).seen
    return Views(poses, seen, coarseness(camera, poses.fov_deg))


def _well_inside(shown: Views, surface: Cloud, camera: Camera, rim_deg: float) -> Views:
    """The views without what lies so near the rim of a picture that it may lie outside."""
    poses, fov_deg = shown.stations, shown.stations.fov_deg
    frustum = Cloud(surface.points), narrowed(camera, rim_deg), VisibilitySettings(occlusion=False)
    zoomed = None if fov_deg is None else _narrower(fov_deg, rim_deg)
    inside = visible(poses.positions, poses.quat_xyzw, *frustum, fov_deg=zoomed).seen
    return replace(shown, seen=shown.seen & inside)


def narrowed(camera: Camera, rim_deg: float) -> Camera:
    """A camera that loses so much of its picture at each rim, or half of it."""
    hfov_deg, vfov_deg = _narrower(np.array([camera.hfov_deg, camera.vfov_deg]), rim_deg).tolist()
    return replace(camera, hfov_deg=hfov_deg, vfov_deg=vfov_deg)


def _narrower(fov_deg: Floats, rim_deg: float) -> Floats:
    return np.asarray(np.maximum(fov_deg - 2 * rim_deg, fov_deg / 2))


def _finest(
    steps: Moments, shown: Views, surface: Cloud, camera: Camera, rule: InspectionSettings | None
) -> Looks:
    """The finest look at each sample that is sharp and frontal by a rule; by none, the finest of all."""
    if rule is None:
        return sharp_looks(steps, shown, surface, camera, np.inf, 0.0)
    sharp_radps = rule.sharp_radps(camera.hfov_deg, camera.width_px, camera.exposure_s)
    least_cosine = float(np.cos(np.radians(rule.max_incidence_deg)))
    return sharp_looks(steps, shown, surface, camera, sharp_radps, least_cosine)

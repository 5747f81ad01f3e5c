"""Whether a zone of a structure was shown as required: met, missed or unattainable, and why."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from upplied.config import focal_px
from upplied.records import Bools, Camera, Floats, Ints, Record


@dataclass(frozen=True)
class Demand:
    """A zone that must be seen, and how."""

    zone: str  # its name
    where: str  # landmarks, part_0, or "box X Y Z X Y Z" (m), separated by commas
    on: str = ""  # the structure that the place is on, and is carried from; empty: each structure itself
    looks: int = 1  # pictures that show each patch, at least; all other limits hold for one of them
    gsd_mm: float | None = None  # a pixel covers this much of the surface at most
    incidence_deg: float | None = None  # from the normal, at most
    max_age_days: float | None = None  # of a look, at most


@dataclass(frozen=True, eq=False, repr=False)
class Looked(Record):
    """How each of N patches was seen at one time; NaN where it was not."""

    distance_m: Floats  # (N,)
    incidence_deg: Floats  # (N,)
    age_days: float  # of the looks; 0 for what is planned
    camera: Camera
    pictures: Ints | None = None  # (N,) that show it; None: one where it was seen, more are not known
    more: tuple[tuple[Floats, Floats], ...] = ()  # distance and incidence (N,) of other looks then

    @property
    def each(self) -> list[tuple[Floats, Floats]]:
        """Distance and incidence of every look that is known."""
        return [(self.distance_m, self.incidence_deg), *self.more]


@dataclass(frozen=True)
class ZoneVerdict:
    """What became of a zone."""

    status: str  # "met", "missed" or "unattainable"
    shown_pct: float  # of what could be seen of it; NaN where nothing could
    why: str  # empty where it is met


def judged(demand: Demand, zone: Bools, attainable: Bools, looks: Sequence[Looked]) -> ZoneVerdict:
    """Judge a zone (N,) by all looks at it; each patch must be shown by one look within every limit.

    Where more than one look is required, as many pictures that are young enough must show it. Patches that no
    safe camera can see at all, which are not `attainable` (N,), are reported and do not count.
    """
    required = zone & attainable
    if not zone.any():
        return ZoneVerdict("unattainable", float("nan"), "it has no counterpart here")
    if not required.any():
        return ZoneVerdict("unattainable", float("nan"), "no safe viewpoint shows any of it")
    beyond = 100 * float((zone & ~attainable).sum() / zone.sum())
    words = _words(demand, looks)
    passed = _steps(demand, len(zone), looks)
    share = 100 * float(passed[-1][required].mean())
    before = (np.ones(len(zone), bool), *passed)
    lost = [required & was & ~now for was, now in zip(before, passed, strict=False)]
    parts = [f"{100 * one.sum() / required.sum():.1f} % {why}" for why, one in zip(words, lost, strict=True)
             if one.any()]  # fmt: skip
    rest = f"{beyond:.1f} % of it no safe camera can see" if beyond else ""
    why = "; ".join(filter(None, (", ".join(parts), rest)))
    return ZoneVerdict("missed" if parts else "met", share, why)


def shown_as_required(demand: Demand, count: int, looks: Sequence[Looked]) -> Bools:
    """Which of a surface's patches (N,), of which there are `count`, looks showed within every limit."""
    return _steps(demand, count, looks)[-1]


def _steps(demand: Demand, count: int, looks: Sequence[Looked]) -> list[Bools]:
    """Patches (N,) seen; near enough; frontal as well; so by a young look; and in pictures enough."""
    (seen, fine, frontal, young), pictures = np.zeros((4, count), bool), np.zeros(count, np.int64)
    for look in looks:
        there = np.isfinite(look.distance_m)
        near, level = np.zeros(count, bool), np.zeros(count, bool)
        for distance, incidence in look.each:
            frontal_m = distance / np.maximum(np.cos(np.radians(incidence)), 1e-9)
            close = np.isfinite(distance) & _fine(demand, look.camera, frontal_m)
            near |= close
            level |= close & (demand.incidence_deg is None or incidence <= demand.incidence_deg)
        seen, fine, frontal = seen | there, fine | near, frontal | level
        if demand.max_age_days is None or look.age_days <= demand.max_age_days:
            young |= level
            pictures += there if look.pictures is None else np.where(there, np.maximum(look.pictures, 1), 0)
    return [seen, fine, frontal, young, young & (pictures >= demand.looks)]


def _fine(demand: Demand, camera: Camera, distance_m: Floats) -> Bools:
    """Patches (N,) of which a known pixel covers little enough; distances (N,) are over the cosine, m."""
    if demand.gsd_mm is None:
        return np.ones(len(distance_m), bool)
    if not camera.width_px:
        return np.zeros(len(distance_m), bool)
    return np.asarray(distance_m <= 1e-3 * demand.gsd_mm * focal_px(camera.width_px, camera.hfov_deg), bool)


def _words(demand: Demand, looks: Sequence[Looked]) -> tuple[str, ...]:
    """Why a patch fails each of `_steps`, of those that pass all before it."""
    coarse = f"was seen from too far for {demand.gsd_mm or 0:g} mm a pixel"
    if any(not look.camera.width_px for look in looks):
        coarse = "was seen by a camera of unknown resolution"
    return (
        "was not seen",
        coarse,
        f"was seen more obliquely than {demand.incidence_deg or 0:g} deg",
        f"was seen longer ago than {demand.max_age_days or 0:g} days",
        f"was seen in fewer than {demand.looks} pictures",
    )

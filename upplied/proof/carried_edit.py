"""What a person changed of a plan, stored by places, so that it can be applied to a plan made later.

A changed viewpoint is matched with the viewpoint of the new plan nearest to where it was, no farther than
viewpoints of that plan are from each other, that looks the same way.
"""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from upplied.errors import InputError
from upplied.geometry.polylines import leg_lengths
from upplied.geometry.poses import from_yaw_pitch, optical_axis
from upplied.proof.edit import SAME_M, AirspaceLimits, Edit, Viewpoint, apart_m, viewpoints_of
from upplied.records import Bools, Floats, Trajectory

_TURNED_DEG = 30.0  # less than half of what usual cameras see: the same surface is in the picture
_RULE = "a change in the form that the program stores"


@dataclass(frozen=True)
class ViewpointChange:
    """A viewpoint that a person changed: where it was, and where it is wanted; None: left out."""

    was: Viewpoint
    wanted: Viewpoint | None


@dataclass(frozen=True)
class StoredEdit:
    """A change of a plan that is carried over to plans made later."""

    touched: tuple[ViewpointChange, ...] = ()
    airspace: AirspaceLimits = field(default_factory=AirspaceLimits)
    replanned: bool = False  # the rest was planned anew in that airspace


def stored_edit(
    before: Sequence[Viewpoint], edit: Edit, airspace: AirspaceLimits, replanned: bool
) -> StoredEdit:
    """A change by places in the place of numbers; `before` are the viewpoints that it counts."""
    changes = {**dict.fromkeys(edit.deleted), **{at: edit.changed[at] for at in sorted(edit.changed)}}
    touched = (ViewpointChange(before[at], new) for at, new in changes.items())
    return StoredEdit(tuple(touched), airspace, replanned)


def combined(earlier: StoredEdit, later: StoredEdit) -> StoredEdit:
    """Two changes, the later one of the plan that the earlier one made, as one."""
    new = list(later.touched)
    touched = []
    for one in earlier.touched:
        again = [each for each in new if one.wanted and apart_m(each.was, one.wanted) < SAME_M]
        touched.append(ViewpointChange(one.was, again[0].wanted) if again else one)
        new = [each for each in new if each not in again]
    both = earlier.airspace, later.airspace
    clearance = max((each.clearance_m for each in both if each.clearance_m is not None), default=None)
    boxes = tuple(dict.fromkeys(box for each in both for box in each.boxes))
    replanned = earlier.replanned or later.replanned
    return StoredEdit((*touched, *new), AirspaceLimits(boxes, clearance), replanned)


def matched_edit(stored: StoredEdit, viewpoints: Sequence[Viewpoint]) -> tuple[Edit, tuple[str, ...]]:
    """The change in the numbers of another plan's viewpoints, and what of it has no place there, in words."""
    if not stored.touched:
        return Edit(), ()
    places = np.array([v.position for v in viewpoints])
    gaps, axes = leg_lengths(places), _axes(viewpoints)
    near = float(np.median(gaps[gaps > 0])) if gaps.any() else 0.0
    changes: dict[int, Viewpoint | None] = {}
    lost: list[str] = []
    for one in stored.touched:
        off = np.linalg.norm(places - one.was.position, axis=1)
        turned = np.degrees(np.arccos(np.clip(axes @ _axes([one.was])[0], -1, 1)))
        fits = (off <= near) & (turned <= _TURNED_DEG) & ~np.isin(np.arange(len(places)), list(changes))
        if fits.any():
            changes[int(np.where(fits, off, np.inf).argmin())] = one.wanted
            continue
        where = ", ".join(f"{value:.1f}" for value in one.was.position)
        lost.append(f"no viewpoint corresponds to that at ({where}) m: the nearest is {off.min():.1f} m off")
    return _edit(changes), tuple(lost)


def _edit(changes: dict[int, Viewpoint | None]) -> Edit:
    """What becomes of viewpoints by their numbers; None: left out."""
    changed = {at: view for at, view in changes.items() if view is not None}
    return Edit(tuple(sorted(set(changes) - set(changed))), changed)


def restored(stored: StoredEdit, path: Trajectory, is_viewpoint: Bools) -> tuple[Bools, Edit]:
    """Which poses of a plan made anew are viewpoints, so that each that is wanted is one, and the change.

    A wanted viewpoint without a match takes the place of the nearest pose of the path that was none; one
    that was left out and has no match is left out already.
    """
    edit, _ = matched_edit(stored, viewpoints_of(path, is_viewpoint))
    index, flags = np.flatnonzero(is_viewpoint), np.array(is_viewpoint, bool)
    both = *dict.fromkeys(edit.deleted).items(), *edit.changed.items()
    changes = {int(index[at]): view for at, view in both}
    for view in (one.wanted for one in stored.touched):
        if view is not None and view not in changes.values():
            off = np.linalg.norm(path.positions - view.position, axis=1)
            at = int(np.where(flags, np.inf, off).argmin())
            flags[at], changes[at] = True, view
    number = np.cumsum(flags) - 1
    return flags, _edit({int(number[at]): changes[at] for at in sorted(changes)})


def edit_json(stored: StoredEdit) -> str:
    """A change as JSON."""
    document = asdict(stored)
    document["asked"] = document.pop("airspace")  # as catalogs have it
    return json.dumps(document, separators=(",", ":"), sort_keys=True)


def edit_from_json(text: str) -> StoredEdit:
    """A change as `edit_json` writes it; an InputError if it is none."""
    try:
        document = json.loads(text)
        pairs = ((each["was"], each["wanted"]) for each in document["touched"])
        touched = tuple(
            ViewpointChange(_viewpoint(was), None if new is None else _viewpoint(new)) for was, new in pairs
        )
        boxes = tuple(tuple(float(value) for value in box) for box in document["asked"]["boxes"])
        clearance = document["asked"]["clearance_m"]
        airspace = AirspaceLimits(boxes, None if clearance is None else float(clearance))
        return StoredEdit(touched, airspace, bool(document["replanned"]))
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise InputError("a change of a plan", f"cannot be read: {error}"[:200], _RULE) from None


def _viewpoint(document: Any) -> Viewpoint:
    x, y, z = (float(value) for value in document["position"])
    return Viewpoint((x, y, z), float(document["yaw_deg"]), float(document["pitch_deg"]))


def _axes(viewpoints: Sequence[Viewpoint]) -> Floats:
    angles = np.radians([(v.yaw_deg, v.pitch_deg) for v in viewpoints])
    return optical_axis(from_yaw_pitch(angles[:, 0], angles[:, 1]))

"""What a person changed of a plan, kept by places, so that it is found again in a plan made later.

A viewpoint is found again as the one of the new plan that is nearest to where it was, no farther than
viewpoints of that plan are from each other, and looks the same way.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from upplied.errors import InputError
from upplied.geometry.polylines import leg_lengths
from upplied.geometry.poses import from_yaw_pitch, optical_axis
from upplied.proof.edit import Asked, Edit, Viewpoint, viewpoints_of
from upplied.records import Bools, Floats, Trajectory

_SAME_M = 1e-3  # as the steps of a plan are kept
_TURNED_DEG = 30.0  # less than half of what usual cameras see: the same surface is in the picture
_RULE = "as the program keeps a change"


@dataclass(frozen=True)
class Touched:
    """A viewpoint that a person changed: where it was, and where it is wanted; None: left out."""

    was: Viewpoint
    wanted: Viewpoint | None


@dataclass(frozen=True)
class KeptEdit:
    """A change of a plan that is carried over to plans made later."""

    touched: tuple[Touched, ...] = ()
    asked: Asked = field(default_factory=Asked)
    replanned: bool = False  # the rest was planned anew in the airspace that is asked for


def kept_edit(before: Sequence[Viewpoint], edit: Edit, asked: Asked, replanned: bool) -> KeptEdit:
    """A change by places in the place of numbers; `before` are the viewpoints that it counts."""
    touched = [Touched(before[number], None) for number in edit.deleted]
    touched += [Touched(before[number], edit.changed[number]) for number in sorted(edit.changed)]
    return KeptEdit(tuple(touched), asked, replanned)


def together(earlier: KeptEdit, later: KeptEdit) -> KeptEdit:
    """Two changes, the later one of the plan that the earlier one made, as one."""
    new = list(later.touched)
    touched = []
    for one in earlier.touched:
        again = [each for each in new if one.wanted is not None and _same_place(each.was, one.wanted)]
        touched.append(Touched(one.was, again[0].wanted) if again else one)
        new = [each for each in new if each not in again]
    wanted = (earlier.asked.clearance_m, later.asked.clearance_m)
    clearance = max((value for value in wanted if value is not None), default=None)
    boxes = tuple(dict.fromkeys((*earlier.asked.boxes, *later.asked.boxes)))
    replanned = earlier.replanned or later.replanned
    return KeptEdit((*touched, *new), Asked(boxes, clearance), replanned)


def _same_place(one: Viewpoint, other: Viewpoint) -> bool:
    return bool(np.linalg.norm(np.subtract(one.position, other.position)) < _SAME_M)


def found_again(kept: KeptEdit, viewpoints: Sequence[Viewpoint]) -> tuple[Edit, tuple[str, ...]]:
    """The change in the numbers of another plan's viewpoints, and what of it has no place there, in words."""
    if not kept.touched:
        return Edit(), ()
    places = np.array([v.position for v in viewpoints])
    axes = _axes(viewpoints)
    near = _usual_gap(places)
    deleted: list[int] = []
    changed: dict[int, Viewpoint] = {}
    lost: list[str] = []
    for one in kept.touched:
        off = np.linalg.norm(places - one.was.position, axis=1)
        turned = np.degrees(np.arccos(np.clip(axes @ _axes([one.was])[0], -1, 1)))
        taken = np.isin(np.arange(len(places)), [*deleted, *changed])
        fits = (off <= near) & (turned <= _TURNED_DEG) & ~taken
        where = ", ".join(f"{value:.1f}" for value in one.was.position)
        if not fits.any():
            lost.append(f"the viewpoint at ({where}) m has no like: the nearest is {off.min():.1f} m off")
            continue
        number = int(np.flatnonzero(fits)[off[fits].argmin()])
        if one.wanted is None:
            deleted.append(number)
        else:
            changed[number] = one.wanted
    return Edit(tuple(sorted(deleted)), changed), tuple(lost)


def put_back(kept: KeptEdit, path: Trajectory, is_viewpoint: Bools) -> tuple[Bools, Edit]:
    """Which poses of a plan made anew are viewpoints, so that each that is wanted is one, and the change.

    A wanted viewpoint that has no like takes the place of the nearest pose of the path that was none; one
    that was left out and has no like is left out already.
    """
    viewpoints = viewpoints_of(path, is_viewpoint)
    edit, _ = found_again(kept, viewpoints)
    index, flags = np.flatnonzero(is_viewpoint), np.array(is_viewpoint, bool)
    left_out = [int(index[number]) for number in edit.deleted]
    wanted = {int(index[number]): view for number, view in edit.changed.items()}
    for view in (one.wanted for one in kept.touched):
        if view is not None and view not in wanted.values():
            off = np.linalg.norm(path.positions - view.position, axis=1)
            at = int(np.where(flags, np.inf, off).argmin())
            flags[at], wanted[at] = True, view
    number = np.cumsum(flags) - 1
    changed = {int(number[at]): wanted[at] for at in sorted(wanted)}
    return flags, Edit(tuple(int(number[at]) for at in sorted(left_out)), changed)


def edit_json(kept: KeptEdit) -> str:
    """A change as JSON."""
    return json.dumps(asdict(kept), separators=(",", ":"), sort_keys=True)


def edit_from_json(text: str) -> KeptEdit:
    """A change as `edit_json` writes it.

    Raises
    ------
    InputError
        If it is none.
    """
    try:
        said = json.loads(text)
        touched = tuple(Touched(_viewpoint(t["was"]), _viewpoint(t["wanted"])) for t in said["touched"])
        if any(each.was is None for each in touched):
            raise ValueError("a viewpoint that was nowhere")
        boxes = tuple(tuple(float(value) for value in box) for box in said["asked"]["boxes"])
        clearance = said["asked"]["clearance_m"]
        asked = Asked(boxes, None if clearance is None else float(clearance))
        return KeptEdit(touched, asked, bool(said["replanned"]))
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise InputError("a change of a plan", f"cannot be read: {error}"[:200], _RULE) from None


def _viewpoint(said: Any) -> Any:
    if said is None:
        return None
    x, y, z = (float(value) for value in said["position"])
    return Viewpoint((x, y, z), float(said["yaw_deg"]), float(said["pitch_deg"]))


def _axes(viewpoints: Sequence[Viewpoint]) -> Floats:
    angles = np.radians([(v.yaw_deg, v.pitch_deg) for v in viewpoints])
    return optical_axis(from_yaw_pitch(angles[:, 0], angles[:, 1]))


def _usual_gap(places: Floats) -> float:
    """How far viewpoints that follow each other are apart, in the median, m."""
    gaps = leg_lengths(places)
    gaps = gaps[gaps > 0]
    return float(np.median(gaps)) if len(gaps) else 0.0

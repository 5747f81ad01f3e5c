"""Surface that must be seen comes before what the demonstration was about, where its flight comes by.

A flight is asked for those samples of a zone that it can show from within two of its stand-offs: from the
path that is carried to the target with its camera turned anywhere, or from a place beside it. What lies
elsewhere is for another flight, and does not make this one worse."""

from dataclasses import replace

import numpy as np

from upplied.config import focal_px
from upplied.geometry.polylines import chosen_evenly
from upplied.planning.airspace.rules import Airspace
from upplied.planning.geometry.clouds import nearest_facing, spacing
from upplied.planning.trajectory.state import Flown
from upplied.planning.trajectory.view import View, places_beside
from upplied.records import Bools, Cloud
from upplied.records.plans import RequiredSurface

_STATIONS = 160  # of the path, that are asked what they could show
_WITHIN = 2.0  # stand-offs, in which a flight comes by a patch: from further off another shows it better


def required_first(
    view: View, required: RequiredSurface, path: Flown, airspace: Airspace, usual_m: float, times: float
) -> View:
    """The view with the zones that the path can come to show needed before all else, as they ask for it.

    Parameters
    ----------
    view : View
        What the demonstration asks for.
    required : RequiredSurface
        In the frame of the view.
    path : Flown
        As it is carried to the target, before it is optimised.
    airspace : Airspace
        Whose rules the places beside it keep.
    usual_m : float
        The stand-off.
    times : float
        What was inspected counts a square metre of a zone.
    """
    # The required sample that is nearest to each of the view's, on its side of a thin plate.
    known = Cloud(required.points, required.normals)
    mine = nearest_facing(view.cloud, known, 2 * spacing(view.cloud))[1]
    zone = np.flatnonzero(required.zone[mine])
    if not len(zone):
        return view
    camera = view.camera
    farthest, cosine = view.farthest_m.copy(), np.zeros(len(mine))
    if camera.width_px:
        wanted_m = required.gsd_m[mine[zone]] * focal_px(camera.width_px, camera.hfov_deg)
        farthest[zone] = np.minimum(farthest[zone], wanted_m)
    cosine[zone] = np.cos(np.radians(required.incidence_deg[mine[zone]]))
    asking = replace(view, farthest_m=farthest, least_cosine=cosine)
    # Which of them the path, or a place beside it, would show with its camera turned.
    within = replace(asking, farthest_m=np.minimum(asking.farthest_m, _WITHIN * usual_m))
    station = chosen_evenly(len(path), _STATIONS)
    reached: Bools = np.asarray(within.reach(path.positions[station], zone, station=station).any(axis=0))
    if (left := np.flatnonzero(~reached)).size:
        at, off = places_beside(path, usual_m)
        places = path.positions[at] + off
        free = airspace.allowed(places)
        if free.any():
            reached[left] = within.reach(places[free], zone[left], station=at[free]).any(axis=0)
    near = zone[reached]
    if not len(near):
        return view
    strict = np.zeros(len(mine), bool)
    strict[near] = True
    # How much of the need falls on a square metre of what was inspected; of all, where nothing was.
    part = view.inspected if view.need[view.inspected].sum() > 0 else view.need > 0
    area = float(view.cloud.areas[part].sum())
    per_m2 = float(view.need[part].sum()) / area if area > 0 else 1.0
    need = view.need + times * per_m2 * np.where(strict, view.cloud.areas, 0.0)
    return replace(
        view,
        need=need / need.sum(),
        farthest_m=np.where(strict, farthest, view.farthest_m),
        inspected=view.inspected | strict,
        least_cosine=np.where(strict, cosine, 0.0),
    )

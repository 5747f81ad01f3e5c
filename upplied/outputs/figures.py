"""PNG figures of structures and plans, without a display, OpenGL or a GPU: rays of `geometry.scene` draw."""

from collections.abc import Sequence

import numpy as np

from upplied.errors import SettingsError
from upplied.geometry.polylines import chosen_evenly, leg_lengths
from upplied.outputs.colours import CLASSES, DEMONSTRATED, PRESETS, STATES, rgb
from upplied.outputs.display import DisplayMesh
from upplied.outputs.draw import tubes
from upplied.outputs.draw.canvas import Solid, picture, solid
from upplied.outputs.draw.sheet import Panel, padded, png, sheet_png
from upplied.outputs.draw.views import View, facing, fitted, named_view, proportion
from upplied.outputs.labels import LABELS
from upplied.records import Camera, Demonstration, Floats, Ints, Plan, Structure, SurfaceStates, Trajectory

_Line = tuple[Floats, tuple[float, float, float]]  # positions and colour of a path
_Cameras = tuple[Floats, Floats, Camera, tuple[float, float, float]]  # positions and quaternions likewise
_Box = tuple[int, int, int, int]  # left, top, width and height of a panel, px
_WIDTH = 1400  # px of a figure
_THUMBNAIL = 128, 88  # px
_FRUSTA = 24  # at most so many along a path


def structure_png(
    structure: Structure,
    views: Sequence[str | View] = ("three-quarter", "side", "top"),
    *,
    states: SurfaceStates | None = None,
    trajectories: Sequence[tuple[str, Trajectory | Demonstration, str]] = (),
    title: str = "",
    width: int = _WIDTH,
) -> bytes:
    """A structure from several sides, as a PNG; equal input gives equal bytes.

    Parameters
    ----------
    views : sequence of view names or View
        See `upplied.outputs.draw.views.VIEWS`; the first is drawn large. `states` colour the surface.
    trajectories : sequence of (name, trajectory or demonstration, colour)
        Drawn as tubes; a colour is ``#rrggbb``.
    title, width : str, int
        Default: id, kind and size; width of the picture, px.
    """
    if not views:
        raise SettingsError("views", "none given", "at least one")
    body = solid(structure, states)
    lines = [(path.positions, rgb(colour)) for _, path, colour in trajectories]
    size = " × ".join(f"{side:.1f}" for side in np.ptp(structure.vertices, axis=0))
    head = title or f"{structure.structure_id} · {structure.kind} · {size} m"
    panels = [
        _panel(body, lines, [], named_view(view), box, view if isinstance(view, str) else "")
        for view, box in zip(views, _layout(len(views), width), strict=True)
    ]
    legend = [(name, colour, "line") for name, _, colour in trajectories] + _state_legend([states])
    return sheet_png(panels, legend, head)


def separation_png(structure: Structure, label: Ints, names: Sequence[str], cleaned: Structure) -> bytes:
    """A scan with its surroundings in colours, and the structure alone.

    `label` has the class of each triangle (T,), or of each point of a cloud (N,); the first is the structure.
    """
    before, after = solid(structure, label=label), solid(cleaned)
    boxes = [(0, at * (_WIDTH * 2 // 5), _WIDTH, _WIDTH * 2 // 5) for at in (0, 1)]
    panels = [
        _panel(body, (), (), named_view("three-quarter"), box, caption)
        for body, box, caption in zip((before, after), boxes, ("before", "after"), strict=True)
    ]
    legend = [(name, CLASSES[at], "patch") for at, name in enumerate(names) if (label == at).any()]
    return sheet_png(panels, legend, structure.structure_id)


def transfer_png(
    source: Structure,
    target: Structure,
    demonstration: Demonstration,
    plan: Plan,
    *,
    view: str | View | None = None,
    width: int = _WIDTH,
) -> bytes:
    """Two panels: the demonstration on its structure, and the plan on the target.

    They are coloured by ``plan.inspected`` and ``plan.surface``, if known; of a refused plan only the target
    is drawn, with the reason. Both have the same view, by default from the side of the flight.
    """
    chosen, half = _chosen(view, source, demonstration), width // 2
    left = _demonstrated(source, demonstration, plan.inspected, chosen, half)
    high = max(len(left.image), _height(chosen, _content(target, [plan.trajectory]), half))
    lines, cameras = _plan_lines(plan, demonstration.camera)
    note = f"{plan.preset} plan for {target.structure_id}"
    right = _panel(solid(target, plan.surface), lines, cameras, chosen, (half, 0, half, high), note)
    legend = [("demonstrated path", DEMONSTRATED, "line")]
    if plan.trajectory is not None:
        legend.append((f"planned path ({plan.preset})", PRESETS.get(plan.preset, DEMONSTRATED), "line"))
    legend += _state_legend([plan.inspected, plan.surface])
    title = f"{demonstration.demonstration_id} → {target.structure_id}"
    return sheet_png([padded(left, high), right], legend, title, figures(plan))


def _demonstrated(
    source: Structure, demonstration: Demonstration, states: SurfaceStates | None, view: View, width: int
) -> Panel:
    shown = chosen_evenly(len(demonstration), _FRUSTA)
    flown = (demonstration.positions[shown], demonstration.quat_xyzw[shown])
    return _panel(
        solid(source, states),
        [(demonstration.positions, rgb(DEMONSTRATED))],
        [(*flown, demonstration.camera, rgb(DEMONSTRATED))],
        view,
        (0, 0, width, _height(view, _content(source, [demonstration.trajectory]), width)),
        f"demonstrated on {source.structure_id}",
    )


def thumbnail_png(mesh: DisplayMesh) -> bytes:
    """A small PNG of a structure as pages show it, from the three-quarter view."""
    structure = Structure("thumbnail", "thumbnail", mesh.vertices, mesh.triangles)
    frame = fitted(named_view("three-quarter"), mesh.vertices, *_THUMBNAIL, margin=0.03)
    return png(picture(solid(structure), tubes.joined([]), frame))


def demonstration_png(
    source: Structure, demonstration: Demonstration, states: SurfaceStates | None = None
) -> bytes:
    """PNG of a demonstration round its structure, with cameras and the inspected surface, if known."""
    panel = _demonstrated(source, demonstration, states, _chosen(None, source, demonstration), _WIDTH)
    legend = [("demonstrated path", DEMONSTRATED, "line"), *_state_legend([states])]
    return sheet_png([panel], legend, demonstration.demonstration_id)


def comparison_png(
    target: Structure, plans: Sequence[Plan], *, view: str | View | None = None, width: int = _WIDTH
) -> bytes:
    """Several plans for one target side by side, for instance the presets, in the same frame."""
    if not plans:
        raise SettingsError("plans", "none given", "at least one")
    wide = width // len(plans)
    paths = [plan.trajectory for plan in plans]
    everything = _content(target, paths)
    flown = next((path.positions for path in paths if path is not None), target.vertices)
    chosen = facing(target.vertices, flown) if view is None else named_view(view)
    high = _height(chosen, everything, wide)
    body = solid(target) if all(plan.surface is None for plan in plans) else None
    panels = []
    for at, plan in enumerate(plans):
        label, drawn = f"{plan.preset}: {figures(plan)}", body or solid(target, plan.surface)
        box = (at * wide, 0, wide, high)
        panels.append(_panel(drawn, _plan_lines(plan)[0], [], chosen, box, label, everything))
    legend = [(plan.preset, PRESETS.get(plan.preset, DEMONSTRATED), "line") for plan in plans]
    legend += _state_legend([plan.surface for plan in plans])
    return sheet_png(panels, legend, f"{plans[0].demonstration_id} → {target.structure_id}")


def figures(plan: Plan) -> str:
    """The measures of a plan in one line, or why there is none."""
    if plan.status != "ok":
        return f"{plan.status}: {plan.reason}"
    values = vars(plan.measures)
    known = [(*label, values[name]) for name, label in LABELS["picture"].items() if np.isfinite(values[name])]
    return " · ".join(f"{words} {form.format(value)}" for words, form, value in known)


def _plan_lines(plan: Plan, camera: Camera | None = None) -> tuple[list[_Line], list[_Cameras]]:
    if plan.trajectory is None:
        return [], []
    path, colour = plan.trajectory, rgb(PRESETS.get(plan.preset, DEMONSTRATED))
    chosen = np.arange(len(path)) if plan.is_viewpoint is None else np.flatnonzero(plan.is_viewpoint)
    chosen = chosen[chosen_evenly(len(chosen), _FRUSTA)]
    cameras = [(path.positions[chosen], path.quat_xyzw[chosen], camera, colour)] if camera else []
    return [(path.positions, colour)], cameras


def _panel(
    body: Solid,
    lines: Sequence[_Line],
    cameras: Sequence[_Cameras],
    view: View,
    box: _Box,
    label: str,
    shown: Floats | None = None,
) -> Panel:
    """One picture: first the frame, then tubes of a width that suits it."""
    x, y, wide, high = box
    everything = [body.vertices, *(positions for positions, _ in lines)] if shown is None else [shown]
    frame = fitted(view, np.concatenate(everything), wide, high)
    radius, depth = 1.5 / frame.metre_px, 26 / frame.metre_px
    parts = [tubes.path(positions, radius, colour) for positions, colour in lines]
    for positions, quats, camera, colour in cameras:
        along = leg_lengths(positions).sum()
        chosen = chosen_evenly(len(positions), max(2, int(along / (1.5 * depth))))  # so that they stand apart
        parts.append(tubes.frusta(positions[chosen], quats[chosen], camera, depth, radius / 2.2, colour))
    return Panel(picture(body, tubes.joined(parts), frame), x, y, label, frame)


def _content(structure: Structure, paths: Sequence[Trajectory | None]) -> Floats:
    return np.concatenate([structure.vertices, *(path.positions for path in paths if path is not None)])


def _chosen(view: str | View | None, source: Structure, demonstration: Demonstration) -> View:
    return facing(source.vertices, demonstration.positions) if view is None else named_view(view)


def _height(view: View, content: Floats, wide: int) -> int:
    """Of a panel that suits its content, with room for a label and a scale bar, px; even."""
    return 2 * round(wide * float(np.clip(proportion(view, content), 0.35, 1.0)) / 2) + 50


def _layout(count: int, width: int) -> list[_Box]:
    """The first view large on the left, the others stacked on its right."""
    if count == 1:
        return [(0, 0, width, round(width * 0.6))]
    left = round(width * 0.62)
    high = round(left * 0.72)
    each = high // (count - 1)
    return [(0, 0, left, high)] + [(left, at * each, width - left, each) for at in range(count - 1)]


def _state_legend(states: Sequence[SurfaceStates | None]) -> list[tuple[str, str, str]]:
    present = {int(code) for each in states if each is not None for code in np.unique(each.state)} - {0}
    return [(name, colour, "patch") for code, (name, colour) in enumerate(STATES.items()) if code in present]

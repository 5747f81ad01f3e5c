"""One row: a variant of a pair planned, and what a ruler of our own says of the path."""

from __future__ import annotations

import base64
import time
from collections.abc import Callable, Iterator
from dataclasses import fields, replace
from typing import Any

import numpy as np
from scipy.spatial import cKDTree
from stability_pairs import Pair, demonstration, structure
from stability_variants import varied

from upplied.config import Settings, settings_for
from upplied.errors import RefusedError, SettingsError
from upplied.geometry.poses import optical_axis
from upplied.geometry.scene import open3d
from upplied.planning.plan import plan_transfer
from upplied.records import SURFACE_STATES, Floats, Plan, Structure, SurfaceStates, Trajectory
from upplied.samples.fleet import member
from upplied.samples.pilot import fly

#: Gates that are opened to see what a refused plan would have shown; settings that are gone are skipped.
OPEN: dict[str, dict[str, Any]] = {
    "refine": {"deviation": 10.0},
    "registration": {"least_probability": 0.0},
    "correspondence": {"least_probability": 0.0},
    "verdict": {"enforce": False},
}
_STEP_M = 0.05  # between the places of a path whose distance is measured
_ON_SOURCE = ("no counterpart", "hardly inspected", "partly inspected", "inspected")
_ON_TARGET = ("shown", "missed", "unattainable")


def rows_of(pair: Pair, variants: list[str]) -> Iterator[dict[str, Any]]:
    """A row for each variant; an exception is a row of status ``crash``.

    The first is planned with nothing known (`cold`), the others with what was learned about the flight.
    """
    memo = Memory()
    for variant in variants:
        row: dict[str, Any] = {
            "pair": pair.name,
            "kind": pair.flight.part,
            "half": pair.half,
            "generated": pair.generated,
            "stranger": pair.stranger,
            "variant": variant,
            "cold": not memo.results,
        }
        try:
            row |= _row(pair, variant, memo)
        except RefusedError as refusal:  # of the pilot
            row |= {"status": "not flown", "reason": str(refusal)[:300]}
        except Exception as error:  # one row's fault is no other's
            row |= {"status": "crash", "reason": f"{type(error).__name__}: {error}"[:300]}
        yield row


def all_rows_of(pair: Pair, variants: list[str]) -> list[dict[str, Any]]:
    """The same as a list, for another process to send."""
    return list(rows_of(pair, variants))


class Memory:
    """Remembers in memory what planning finds out."""

    def __init__(self) -> None:
        self.results: dict[tuple[str, str], Any] = {}

    def __call__(self, stage: str, record_type: type, key: str, compute: Callable[[], Any]) -> Any:
        if (stage, key) not in self.results:
            self.results[stage, key] = compute()
        return self.results[stage, key]


def warm_up() -> None:
    """Plan once, so that no row pays for loading libraries and compiled functions."""
    cube, cuboid = member("cube-v1").structure, member("cuboid-v1").structure
    plan_transfer(fly(cube, "sides"), cube, cuboid, settings_for("recommended"))


def opened(seed: int) -> Settings:
    """`recommended` with its gates open."""
    changes: dict[str, dict[str, Any]] = {"clouds": {"seed": seed}}
    for stage, values in OPEN.items():
        for name, value in values.items():
            try:
                settings_for("recommended", **{stage: {name: value}})
            except SettingsError:
                continue
            changes.setdefault(stage, {})[name] = value
    return settings_for("recommended", **changes)


def _row(pair: Pair, variant: str, memo: Memory) -> dict[str, Any]:
    source, target = structure(pair.flight.source), structure(pair.target)
    # A stranger is declared to be of the kind: the geometry alone is asked.
    inputs = varied(demonstration(pair.flight), source, replace(target, kind=source.kind), variant)
    records = inputs.demonstration, inputs.source, inputs.target
    settings = settings_for("recommended", clouds={"seed": inputs.seed})
    began = time.process_time()
    plan = plan_transfer(*records, settings, memo)
    row: dict[str, Any] = {"cpu_s": round(time.process_time() - began, 3)}
    row |= {"status": plan.status, "reason": plan.reason[:300], "warnings": len(plan.warnings)}
    forced = plan
    if plan.status != "ok" and not pair.stranger:
        settings = opened(inputs.seed)
        forced = plan_transfer(*records, settings, memo)
        row |= {"open_status": forced.status, "open_reason": forced.reason[:300]}
    row["measures"] = _plain(forced)
    if variant == "given" and not pair.stranger:
        baseline = plan_transfer(*records, settings_for("baseline"), memo)
        row["box_inspected_pct"] = _number(baseline.measures.coverage_inspected_pct)
    if forced.trajectory is not None:
        row |= _ruled(forced, inputs.source, inputs.target, inputs.demonstration.trajectory, settings)
    return row


def _plain(plan: Plan) -> dict[str, float | None]:
    values = {item.name: getattr(plan.measures, item.name) for item in fields(plan.measures)}
    return {name: _number(value) for name, value in values.items()}


def _number(value: float) -> float | None:
    return round(float(value), 4) if np.isfinite(value) else None


def _ruled(
    plan: Plan, source: Structure, target: Structure, flown: Trajectory, settings: Settings
) -> dict[str, Any]:
    """Clearance, stand-off, where the camera points, and the path."""
    path = plan.trajectory
    assert path is not None
    dense = resampled(path.positions, _STEP_M, 2, 1_000_000)
    ground = target.surroundings.ground_z_m
    row_values: dict[str, Any] = {
        "clearance_m": _number(clearance(target, dense)),
        "promised_m": settings.route.clearance_m,
        "above_ground_m": None if ground is None else _number(dense[:, 2].min() - ground),
        "promised_above_ground_m": settings.route.ground_clearance_m,
        "axis_demonstration": axis_share(source, flown, plan.inspected, _ON_SOURCE),
        "axis_plan": axis_share(target, path, plan.surface, _ON_TARGET),
        "path": packed(resampled(path.positions, 1.0, 200, 600)),
    }
    if plan.surface is not None and len(part := _part(plan.surface, _ON_TARGET)):
        row_values["standoff_m"] = _number(np.median(cKDTree(part).query(path.positions)[0]))
    return row_values


def _scene(one: Structure) -> tuple[Any, Floats]:
    """Open3D's own scene of the mesh, about its middle, so that single precision is enough."""
    o3d = open3d()
    middle = one.vertices.mean(axis=0)
    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(
        o3d.core.Tensor((one.vertices - middle).astype(np.float32)),
        o3d.core.Tensor(one.triangles.astype(np.uint32)),
    )
    return scene, middle


def clearance(one: Structure, places: Floats) -> float:
    """Least distance of the places (N, 3) from the mesh as it is given, m."""
    scene, middle = _scene(one)
    queries = open3d().core.Tensor((places - middle).astype(np.float32))
    return float(scene.compute_distance(queries).numpy().min())


def axis_share(
    one: Structure, path: Trajectory, states: SurfaceStates | None, names: tuple[str, ...]
) -> float | None:
    """Share of the time in which the optical axis meets surface whose nearest sample has such a state."""
    if states is None or not np.isin(states.state, _indices(names)).any():
        return None
    scene, middle = _scene(one)
    axis = optical_axis(path.quat_xyzw)
    rays = np.column_stack([path.positions - middle, axis]).astype(np.float32)
    depth = scene.cast_rays(open3d().core.Tensor(rays))["t_hit"].numpy().astype(float)
    met = np.isfinite(depth)
    hit = path.positions[met] + depth[met, None] * axis[met]
    on = np.zeros(len(path), bool)
    on[met] = np.isin(states.state, _indices(names))[cKDTree(states.points).query(hit)[1]]
    step = np.minimum(np.diff(path.t_s), 1.0)  # a gap of the log counts as a second
    weight = np.convolve(step, [0.5, 0.5])
    return _number(weight[on].sum() / max(weight.sum(), 1e-9))


def _indices(names: tuple[str, ...]) -> list[int]:
    return [SURFACE_STATES.index(name) for name in names if name in SURFACE_STATES]


def _part(states: SurfaceStates, names: tuple[str, ...]) -> Floats:
    return states.points[np.isin(states.state, _indices(names))]


def resampled(path: Floats, step_m: float, least: int, most: int) -> Floats:
    """Places along a polyline at even steps, its ends among them."""
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    number = int(np.clip(along[-1] / step_m + 1, least, most))
    at = np.linspace(0, along[-1], number)
    if number > 600:  # the vertices too, where nothing may be missed
        at = np.union1d(at, along)
    return np.column_stack([np.interp(at, along, axis) for axis in path.T])


def packed(path: Floats) -> str:
    """A path as text."""
    return base64.b64encode(path.astype("<f4").tobytes()).decode()


def unpacked(text: str) -> Floats:
    """The path again."""
    return np.frombuffer(base64.b64decode(text), "<f4").reshape(-1, 3).astype(float)

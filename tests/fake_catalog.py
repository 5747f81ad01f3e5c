"""A catalog in memory, for tests of what reads one: boxes of a few sizes, orbited."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pandas as pd

from upplied.catalog import Catalog
from upplied.geometry.poses import look_at
from upplied.records import (
    Demonstration,
    Measures,
    Plan,
    Structure,
    SupposedSurface,
    SurfaceStates,
    Trajectory,
)


def box_structure(name: str, size: tuple[float, float, float]) -> Structure:
    """A box on the ground, every face in two triangles, wound outwards."""
    corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (0, 1)]) * size
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    triangles = np.array([tri for a, b, c, d in quads for tri in ((a, b, c), (a, c, d))])
    return Structure(name, "cube", corners, triangles, sha256=f"{name}-{size}")


def orbit(structure: Structure, away: float = 6.0, count: int = 40) -> Trajectory:
    """Once around, looking at the middle; the first pose on the side of +X."""
    angle = np.linspace(0, 2 * np.pi, count)
    half = np.ptp(structure.vertices, axis=0) / 2
    radius = np.hypot(half[0], half[1]) + away
    middle = np.array([0, 0, half[2]])
    positions = middle + radius * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    return Trajectory(2 * angle, positions, look_at(positions, np.broadcast_to(middle, positions.shape)))


class FakeCatalog(Catalog):
    """One demonstration on a cube, transferred to boxes: planned, refused and failed; of all else nothing."""

    def __init__(self, targets: int = 3) -> None:
        self._place = TemporaryDirectory()
        super().__init__(Path(self._place.name, "catalog"))
        self.create()
        self._structures = {"cube": box_structure("cube", (8, 8, 8))}
        self.rows: list[dict] = []
        self.plans: dict[str, Plan] = {}
        self.flight: dict | None = None
        self.path: Trajectory | None = None
        flown = orbit(self._structures["cube"])
        self._demonstration = Demonstration(
            "orbit-1", "cube", (flown.t_s * 1e9).astype(np.int64), flown.positions, flown.quat_xyzw,
            operator="A <b>pilot</b>", notes="</script><script>document.title='broken'</script>",
        )  # fmt: skip
        for at in range(targets):
            name = f"cuboid-{at}"
            self._structures[name] = box_structure(name, (10 + at, 8, 6 + at))
            for preset in ("recommended", "paper", "baseline"):
                plan = self.planned(name, preset, 95.0 - at - 5 * (preset == "baseline"))
                warnings = ("mind the mast",) if (name, preset) == ("cuboid-1", "recommended") else ()
                self.add(replace(plan, warnings=warnings))
        refused = self.planned("cuboid-0", "recommended", 0.0)
        self._structures["odd"] = box_structure("odd", (3, 3, 40))
        reason = 'registration score 0.9 m² above gamma <img src=x onerror="document.title=1">'
        self.add(replace(refused, target_id="odd", status="refused", reason=reason, trajectory=None,
                         surface=None, is_viewpoint=None, measures=Measures()))  # fmt: skip

    def planned(self, target_id: str, preset: str, coverage: float) -> Plan:
        """An orbit round the target, every fifth pose a viewpoint, half of the surface seen."""
        target = self._structures[target_id]
        path = orbit(target, 5.0 + len(preset) / 4)
        points = np.random.default_rng(0).uniform(-1, 1, (400, 3)) * np.ptp(target.vertices, axis=0)
        surface = SurfaceStates(points, (points[:, 0] > 0) + 1)
        measures = Measures(coverage_paper_pct=coverage, coverage_seen_pct=coverage - 3, min_clearance_m=4.0)
        return Plan("orbit-1", "cube", target_id, "cube", preset, "ok", trajectory=path, measures=measures,
                    is_viewpoint=np.arange(len(path)) % 5 == 0, surface=surface)  # fmt: skip

    def add(self, plan: Plan, planned_at: str = "2026-11-20T02:00:00Z") -> str:
        """Append a plan as a row."""
        key = f"t{len(self.rows):04d}"
        self.plans[key] = plan
        self.rows.append(
            {"transfer_id": key, "demonstration_id": plan.demonstration_id, "source_id": plan.source_id,
             "target_id": plan.target_id, "kind": plan.kind, "preset": plan.preset, "status": plan.status,
             "reason": plan.reason, "planned_at": pd.Timestamp(planned_at), "run_id": "run",
             "code_version": "0", "warnings": json.dumps(plan.warnings), "purpose": "",
             "source_sha256": "s", "target_sha256": "t", "state": "", "state_at": pd.NaT, "flyable": None,
             "not_flyable": "", **asdict(plan.measures)}
        )  # fmt: skip
        return key

    def fly(self, transfer_id: str) -> dict:
        """A flight of a plan, half a metre beside it, kept as reports look for it."""
        path = self.plans[transfer_id].trajectory
        assert path is not None
        beside = Trajectory(path.t_s * 1.02, path.positions + 0.5, path.quat_xyzw)
        measures = Measures(min_clearance_m=3.25, coverage_seen_pct=90.0, duration_s=float(beside.t_s[-1]))
        self.path = beside
        self.flight = {"flight_id": "f", "kind": "simulated", "transfer_id": transfer_id, "wind_mps": 6.0,
                       "towards_deg": 60.0, "gusts": True, "seed": 0, **asdict(measures)}  # fmt: skip
        return self.flight

    def flights(self, transfer_id=None, *, structure=None, kind=None) -> pd.DataFrame:
        rows = super().flights(transfer_id, structure=structure, kind=kind)
        shown = self.flight is not None and kind in (None, "simulated")
        return pd.DataFrame([dict.fromkeys(rows, "") | self.flight]) if shown else rows

    def flown(self, flight_sha256: str) -> Trajectory:
        return self.path

    def plan(self, transfer_id: str) -> Plan:
        return self.plans[transfer_id]

    def transfers(
        self, *, every=False, demonstration=None, structure=None, ids=None, columns=None
    ) -> pd.DataFrame:
        rows = pd.DataFrame(self.rows) if self.rows else super().transfers(every=True)
        for name, value in (("demonstration_id", demonstration), ("target_id", structure)):
            rows = rows if value is None else rows[rows[name] == value]
        rows = rows if ids is None else rows[rows["transfer_id"].isin(ids)]
        pair = ["demonstration_id", "target_id", "preset"]
        rows = rows if every else rows.drop_duplicates(pair, keep="last")
        return rows if columns is None else rows[[name for name in columns if name in rows]]

    def structures(self) -> pd.DataFrame:
        return pd.DataFrame(
            [{"structure_id": name, "sha256": each.sha256} for name, each in self._structures.items()]
        )

    def demonstrations(self) -> pd.DataFrame:
        return pd.DataFrame(
            [
                {
                    "demonstration_id": self._demonstration.demonstration_id,
                    "structure_id": "cube",
                    "sha256": "d",
                }
            ]
        )

    def waypoints(self, transfer_id: str) -> pd.DataFrame:
        plan = self.plans[transfer_id]
        path = plan.trajectory
        if path is None:
            return pd.DataFrame(columns=["t_s", "x_m", "y_m", "z_m", "qx", "qy", "qz", "qw", "is_viewpoint"])
        columns = dict(zip(["x_m", "y_m", "z_m"], path.positions.T, strict=True))
        columns |= dict(zip(["qx", "qy", "qz", "qw"], path.quat_xyzw.T, strict=True))
        return pd.DataFrame({"t_s": path.t_s, **columns, "is_viewpoint": plan.is_viewpoint})

    def surface(self, transfer_id: str) -> SurfaceStates | None:
        return self.plans[transfer_id].surface

    def supposed(self, transfer_id: str) -> SupposedSurface | None:
        return self.plans[transfer_id].supposed

    def inspected(self, transfer_id: str) -> SurfaceStates | None:
        return self.plans[transfer_id].inspected

    def structure(self, structure_id: str) -> Structure:
        return self._structures[structure_id]

    def demonstration(self, demonstration_id: str) -> Demonstration:
        assert demonstration_id == self._demonstration.demonstration_id
        return self._demonstration

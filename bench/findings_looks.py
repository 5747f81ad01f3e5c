"""`findings.py` looks: which photos show a place, against rays from the true poses."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np
from findings_cases import CAMERA, ERRORS, catalog_of, demonstration_of, grounds, path_round, spots_on
from scipy.spatial.transform import Rotation

from upplied.config import digest
from upplied.findings.adding import on_surface
from upplied.findings.looks import Spot, looks_at_spot
from upplied.findings.place import _WITHIN_3D
from upplied.findings.rays import pixels_of
from upplied.geometry.poses import interpolate
from upplied.geometry.scene import Scene, scene_of
from upplied.records import Trajectory

_SPOTS = 20  # on each structure


def looks(seed: int, real: int) -> None:
    """Which photos show a place, by told poses and by true ones, against rays from the true poses."""
    rng = np.random.default_rng(seed)
    totals: Counter[str] = Counter()
    reasons: Counter[str] = Counter()
    for name, truth, known in grounds(seed + 200, real):
        scene, path = scene_of(truth), path_round(truth)
        times = np.arange(0.0, path.t_s[-1], 2.0)
        shots = interpolate(path, times)
        wobble = Rotation.from_rotvec(rng.normal(0, np.radians(ERRORS.attitude_deg), (len(path), 3)))
        logged = replace(
            path,
            positions=path.positions + rng.normal(0, ERRORS.pose_m / _WITHIN_3D, 3),
            quat_xyzw=(Rotation.from_quat(path.quat_xyzw) * wobble).as_quat(),
        )
        spots = spots_on(truth, _SPOTS, rng)
        shown = [set(rendered(scene, shots, spot)) for spot in spots]
        ground = "scans" if known is not truth else "drawn"
        for poses, flown in (("exact poses", path), ("told poses", logged)):
            catalog = catalog_of([known], [demonstration_of(known, flown)])
            rows = [{"photo_id": digest([name, at]), "flight_id": "flight", "target_id": known.structure_id,
                     "name": f"{at}", "path": f"{at}", "sha256": digest(at), "t_s": float(t)}
                    for at, t in enumerate(times)]  # fmt: skip
            catalog.add_flight_photos(rows)
            places, normals = on_surface(scene_of(known), np.array([spot.place for spot in spots]))
            near = [replace(spot, place=places[at], normal=normals[at]) for at, spot in enumerate(spots)]
            for spot, truly in zip(near, shown, strict=True):
                listed = {int(look.row["photo"]): look.row for look in looks_at_spot(catalog, spot)}
                sure = {at for at, row in listed.items() if not row["doubt"]}
                likely = {at for at, row in listed.items() if row["probability"] >= 0.5}
                for key in (f"{poses}, {ground}", f"{poses}, all"):
                    _count(totals, key, sure, truly, set(listed) - sure)
                _count(totals, f"{poses}, without the third state", likely, truly, set())
                if flown is logged:
                    by_rays = set(rendered(scene_of(known), interpolate(logged, times), spot))
                    _count(totals, "rays from told poses", by_rays, truly, set())
                    reasons.update(listed[at]["doubt"] or "certain" for at in likely - truly)
                    reasons.update(
                        listed[at]["doubt"] if at in listed else "unlisted" for at in truly - likely
                    )
    for key in dict.fromkeys(name.split(":")[0] for name in totals):
        hit, sure, missed, doubtful, right = (totals[f"{key}:{name}"] for name in _COUNTS)
        share, right_pct = (100 * a / max(b, 1) for a, b in ((doubtful, sure + doubtful), (hit, sure)))
        print(f"looks {key:38}F1 {2 * hit / max(hit + sure + missed, 1):.4f}, certain {sure}, right "
              f"{right_pct:.2f} %, missed without a word {missed}, "
              f"doubtful {doubtful} ({share:.0f} %, {right} shown)", flush=True)  # fmt: skip
    print(f"looks wrong by told poses if there were no doubt: {dict(reasons)}")


_COUNTS = ("hit", "sure", "missed", "doubtful", "right")


def _count(totals: Counter[str], key: str, sure: set[int], truly: set[int], doubtful: set[int]) -> None:
    sizes = len(sure & truly), len(sure), len(truly - sure - doubtful), len(doubtful), len(doubtful & truly)
    totals.update({f"{key}:{name}": size for name, size in zip(_COUNTS, sizes, strict=True)})


def rendered(scene: Scene, shots: Trajectory, spot: Spot) -> list[int]:
    """The photos in whose picture the first thing hit in the direction of a spot is the spot."""
    ray = spot.place - shots.positions
    away = np.linalg.norm(ray, axis=1)
    reach = scene.cast(shots.positions, ray / away[:, None])[0]
    facing = -(ray @ spot.normal) / away >= np.cos(np.radians(75.0))
    shown = []
    for at in np.flatnonzero(facing & (np.abs(reach - away) < 2e-3 * away) & (away <= CAMERA.max_range_m)):
        pixel = pixels_of(CAMERA, shots.positions[at], shots.quat_xyzw[at], spot.place[None])[0]
        if (pixel >= 0).all() and (pixel <= [CAMERA.width_px, CAMERA.height_px]).all():
            shown.append(int(at))
    return shown

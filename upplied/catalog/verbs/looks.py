"""The history of a patch: when it was seen, from how near and how frontally, flight by flight."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
import pyarrow.compute as pc

from upplied.catalog.schema import rows
from upplied.catalog.store.contents import StoredLooks
from upplied.errors import SettingsError
from upplied.records import Bools, Floats, Ints

if TYPE_CHECKING:
    from upplied.catalog.reading import Reading

_FLIGHT = ["flight_id", "transfer_id", "kind", "flown_at", "operator"]
_LOOK = ["distance_m", "incidence_deg", "speed_mps", "t_s"]


def put_looks(
    catalog: Reading,
    points: Floats,
    normals: Floats | None,
    seen: Bools,
    values: dict[str, Floats],
    pictures: Ints | None = None,
    assumed: Bools | None = None,
    inspected: Bools | None = None,
    inspected_if_corrected: Bools | None = None,
) -> str:
    """Keep how a flight saw the samples (N, 3) of a surface, all else (N,); returns the hash.

    `values` are `distance_m`, `incidence_deg`, `speed_mps`, `t_s`, and distance and incidence of the most
    frontal look; `assumed` was seen besides if the correction of the log is right; `inspected`: looked at
    as the plan asks.
    """
    samples = catalog.surfaces.put_samples(points, normals)
    besides = np.zeros(len(seen), bool) if assumed is None else assumed
    patch = np.flatnonzero(seen | besides)
    small: Any = {name: value[patch].astype(np.float32) for name, value in values.items()}
    number: Any = patch.astype(np.int32)
    count: Any = None if pictures is None else np.minimum(pictures[patch], 65535).astype(np.uint16)
    doubt: Any = besides[patch].astype(np.uint8) if besides.any() else None
    flags = {"inspected": inspected, "inspected_if_corrected": inspected_if_corrected}
    verdict: Any = {k: None if flag is None else flag[patch].astype(np.uint8) for k, flag in flags.items()}
    return catalog.looks.put(StoredLooks(samples, number, **small, pictures=count, assumed=doubt, **verdict))


def looks_at(catalog: Reading, structure_id: str, place_m: Sequence[float], kind: str = "") -> pd.DataFrame:
    """How each flight round a structure saw the patch nearest to a place; see `Catalog.looks_at`."""
    place = np.asarray(place_m, float)
    if place.shape != (3,) or not np.isfinite(place).all():
        raise SettingsError("place", f"is {place_m}", "three coordinates, m, structure frame")
    columns = [*_FLIGHT, "looks_sha256", "commit_version"]
    table = catalog.tables["flights"].read(pc.field("target_id") == structure_id, columns)
    nearest: dict[str, tuple[int, float]] = {}
    flights = []
    for row in sorted(rows.rows_of(table), key=lambda row: row["commit_version"]):
        if not row["looks_sha256"] or kind not in ("", row["kind"]):
            continue
        looks = catalog.looks.get(row["looks_sha256"]).certain
        if looks.samples_sha256 not in nearest:
            gap = np.linalg.norm(catalog.surfaces.points(looks.samples_sha256) - place, axis=1)
            nearest[looks.samples_sha256] = int(gap.argmin()), float(gap.min())
        patch, off = nearest[looks.samples_sha256]
        at = int(np.searchsorted(looks.patch, patch))
        seen = at < len(looks.patch) and looks.patch[at] == patch
        values = {name: row[name] for name in _FLIGHT}
        values |= {"seen": bool(seen), "patch": patch, "patch_off_m": off}
        values |= {name: float(getattr(looks, name)[at]) if seen else float("nan") for name in _LOOK}
        flights.append(values)
    columns = [*_FLIGHT, "seen", *_LOOK, "patch", "patch_off_m"]
    return (
        pd.DataFrame(flights, columns=columns).sort_values("flown_at", kind="stable").reset_index(drop=True)
    )

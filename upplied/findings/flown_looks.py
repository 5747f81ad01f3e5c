"""How flights saw places of their structures: the stored looks of many flights, read a hundred at a time."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import pandas as pd

from upplied.catalog import Catalog
from upplied.planning.correspondence.memo import content_key
from upplied.records import Floats, Ints, Record

_FLIGHTS = 100  # whose looks are read at once; in the order they were added: only the last group grows


@dataclass(frozen=True, eq=False, repr=False)
class _Looks(Record):
    """The finest look that is certain at each sample of some flights, one flight after the other."""

    first: Ints  # (F + 1,) sample of each flight
    spot: Floats  # (N, 6) place, m, and normal of each sample; single precision, as all of it
    sampled_m: Floats  # (N,) distance over the cosine of the incidence; NaN where it was not seen
    incidence_deg: Floats  # (N,)


def flown_looks(
    catalog: Catalog, spots: Mapping[int, tuple[str, Floats]]
) -> Iterator[tuple[int, dict[str, Any]]]:
    """The finest look of each flown flight at places of its structure.

    Parameters
    ----------
    catalog : Catalog
    spots : mapping
        By a number, a structure and a place on it, m, with the normal there, (6,).

    Yields
    ------
    tuple
        The number of the place, and the look: `looked_at`, `flight_id`, `demonstration_id`, `sampled_m` and
        `incidence_deg`.
    """
    numbers: dict[str, list[int]] = {}
    for number, (name, _) in spots.items():
        numbers.setdefault(name, []).append(number)
    columns = ["target_id", "flown_at", "flight_id", "demonstration_id"]
    for some in _groups(catalog):
        if not some["target_id"].isin(list(numbers)).any():
            continue
        looks = _remembered(catalog, some["looks_sha256"].tolist())
        for at, row in enumerate(some[columns].to_dict("records")):
            for number in numbers.get(row["target_id"], ()):
                part, spot = slice(looks.first[at], looks.first[at + 1]), spots[number][1]
                away = np.linalg.norm(looks.spot[part, :3] - spot[:3], axis=1)
                facing = looks.spot[part, 3:] @ spot[3:] > 0
                nearest = part.start + int(np.where(facing | ~facing.any(), away, np.inf).argmin())
                if np.isfinite(looks.sampled_m[nearest]):
                    yield (
                        number,
                        {
                            "looked_at": row["flown_at"],
                            "flight_id": row["flight_id"],
                            "demonstration_id": row["demonstration_id"],
                            "sampled_m": float(looks.sampled_m[nearest]),
                            "incidence_deg": float(looks.incidence_deg[nearest]),
                        },
                    )


def remember_looks(catalog: Catalog) -> None:
    """Remember the looks of all flown flights as they are read."""
    for some in _groups(catalog):
        _remembered(catalog, some["looks_sha256"].tolist())


def _groups(catalog: Catalog) -> list[pd.DataFrame]:
    """The flown flights, in the order they were added, as their looks are read at once."""
    flights = catalog.flights(kind="flown").drop_duplicates("flight_id", keep="last")
    flights = flights[flights["looks_sha256"] != ""].sort_values("commit_version", kind="stable")
    return [flights.iloc[start : start + _FLIGHTS] for start in range(0, len(flights), _FLIGHTS)]


def _remembered(catalog: Catalog, hashes: list[str]) -> _Looks:
    key = content_key("flown-looks", hashes)
    return catalog.cache("flown-looks", _Looks, key, lambda: _read(catalog, hashes))


def _read(catalog: Catalog, hashes: list[str]) -> _Looks:
    """The stored looks of these hashes, each with the samples that it is of."""
    spots, looks, samples_of = [], [], cache(catalog.surfaces.samples.get)
    for sha256 in hashes:
        stored = catalog.looks.get(sha256).certain
        samples = samples_of(stored.samples_sha256)
        normals = np.zeros_like(samples.points) if samples.normals is None else samples.normals
        ways = [(stored.distance_m, stored.incidence_deg)]
        if stored.frontal_distance_m is not None and stored.frontal_incidence_deg is not None:
            ways.append((stored.frontal_distance_m, stored.frontal_incidence_deg))
        each = [(far / np.maximum(np.cos(np.radians(aslant)), 1e-6), aslant) for far, aslant in ways]
        sampled, aslant = (np.array(column, np.float32) for column in zip(*each, strict=True))
        finest, at = sampled.argmin(axis=0), np.arange(len(stored.patch))
        values = np.full((len(samples.points), 2), np.nan, np.float32)
        values[stored.patch, 0], values[stored.patch, 1] = sampled[finest, at], aslant[finest, at]
        spots.append(np.hstack([samples.points, normals]).astype(np.float32))
        looks.append(values)
    first = np.cumsum([0, *map(len, looks)])
    sampled_m, incidence_deg = np.concatenate(looks).T
    return _Looks(first, np.concatenate(spots), sampled_m, incidence_deg)

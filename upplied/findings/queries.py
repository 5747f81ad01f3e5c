"""Questions over the whole fleet: where a place was photographed, and findings by place on one structure."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
import pandas as pd

from upplied.catalog import Catalog
from upplied.catalog.schema.rows import camera_of
from upplied.catalog.verbs.queries import When, moment
from upplied.errors import CatalogError
from upplied.findings.carried import Carrying
from upplied.findings.counterparts import Counterparts
from upplied.findings.looks import Spot, looks_at_spot, looks_frame, spot_of
from upplied.findings.rays import focal_of
from upplied.planning.correspondence.memo import content_key
from upplied.records import Floats, Ints, Record

_STRUCTURES = 20  # whose findings are carried and read at once
_OF_FLIGHT, _OF_LOOK = ("flight_id", "demonstration_id"), ("sampled_m", "incidence_deg")
_FLIGHTS = 100  # whose looks are read at once; in the order they were added: only the last group grows


def photographed(
    catalog: Catalog, of: Spot | dict[str, Any], to: str = "kind", mm_px: float = np.inf,
    since: When | None = None, every: bool = False, carrying: Carrying | None = None,
) -> pd.DataFrame:  # fmt: skip
    """How a place was last seen on each structure of a kind, by demonstrations and flights really flown.

    Parameters
    ----------
    of : Spot or dict
        The place on one of them, or a row of `findings`.
    to : str
        ``kind``, or ids with commas; the spot's own structure is listed first with ``kind``.
    mm_px : float
        The largest ground sample distance of a look that counts.
    since : datetime or str, optional
        Looks before that moment do not count.
    every : bool
        Each part of a structure that is like the place's own as well: a row each.

    Returns
    -------
    DataFrame
        One row a structure: `structure_id`, `part`, the place (`x_m`, `y_m`, `z_m`), `probability`,
        `error_m`, `doubt`, `looked_at` (the last look that counts, NaT for none), its `flight_id`, `mm_px`
        and `incidence_deg`, and `looks`, how many flights have one.
    """
    carrying = carrying or Carrying(catalog)
    spot = of if isinstance(of, Spot) else spot_of(of)
    own_error = 0.0 if isinstance(of, Spot) else float(of["place_error_m"] or 0.0)
    names = carrying.targets(spot.structure_id, to)
    names = [spot.structure_id, *names] if to == "kind" else names
    if every:
        places = [(name, there) for name in names for there in carrying.instances(spot, name)]
    else:
        places = list(zip(names, carrying.everywhere([spot], names), strict=True))
    earliest = pd.Timestamp.min.tz_localize("UTC") if since is None else moment(since)
    looks = _looks(catalog, places)
    rows = []
    for at, (name, there) in enumerate(places):
        there = replace(there, error_m=np.hypot(there.error_m, own_error))
        row = {"structure_id": name, "part": int(there.part[0])}
        row |= dict(zip(("x_m", "y_m", "z_m"), there.place[0], strict=True))
        row |= {"probability": there.probability[0], "error_m": there.error_m[0], "doubt": there.doubt(0)}
        count = [look for look in looks[at] if look["mm_px"] <= mm_px and not look["looked_at"] < earliest]
        last: dict[str, Any] = max(count, key=lambda one: one["looked_at"], default={})
        none = {"looked_at": pd.NaT, "flight_id": "", "mm_px": np.nan, "incidence_deg": np.nan}
        rows.append(row | none | last | {"looks": len(count)})
    frame = pd.DataFrame(rows)
    frame["looked_at"] = pd.to_datetime(frame["looked_at"], utc=True)
    return frame


def _looks(catalog: Catalog, places: Sequence[tuple[str, Counterparts]]) -> list[list[dict[str, Any]]]:
    """The finest look of each demonstration and each flown flight at a counterpart on each structure."""
    demonstrations = catalog.demonstrations(every=True)
    focal = {str(row["demonstration_id"]): focal_of(camera_of({str(k): v for k, v in row.items()}))[0]
             for row in demonstrations.to_dict("records")}  # fmt: skip
    demonstrated = set(catalog.demonstrations()["structure_id"])
    known = {at: (name, there.spots[0]) for at, (name, there) in enumerate(places)
             if np.isfinite(there.place[0, 0])}  # fmt: skip
    looks: list[list[dict[str, Any]]] = [[] for _ in places]
    for at, look in flown_looks(catalog, known):
        pixels = focal.get(str(look.pop("demonstration_id")), np.nan)
        looks[at].append(look | {"mm_px": 1e3 * look.pop("sampled_m") / pixels})
    for at, (name, spot) in known.items():
        if name in demonstrated:
            there = Spot(name, spot[:3], spot[3:], places[at][1].place)
            finest = looks_frame(looks_at_spot(catalog, there, ("demonstration",)))
            finest = finest[finest["doubt"] == ""].drop_duplicates("flight_id")
            finest = finest.rename(columns={"taken_at": "looked_at"})
            looks[at] += finest[["looked_at", "flight_id", "mm_px", "incidence_deg"]].to_dict("records")
    return looks


def by_reference(
    catalog: Catalog, reference_id: str, *, class_name: str | None = None, state: str | None = None,
    carrying: Carrying | None = None,
) -> pd.DataFrame:  # fmt: skip
    """The findings of a kind with their places on one structure of it, the map for all.

    They are as `Catalog.findings`, with `reference_x_m`, `reference_y_m`, `reference_z_m` (NaN where there is
    no counterpart), `reference_probability`, `reference_error_m` and `reference_doubtful`.
    """
    carrying = carrying or Carrying(catalog)
    if reference_id not in carrying.kinds:
        raise CatalogError(f"structure {reference_id}", "is not in the catalog")
    rows = catalog.findings(kind=carrying.kinds[reference_id])
    own = rows.groupby("target_id").indices
    names = [name for name in carrying.kinds if name in own]
    values = np.full((len(rows), 5), np.nan)
    doubtful = np.ones(len(rows), bool)
    for start in range(0, len(names), _STRUCTURES):
        some = {name: rows.iloc[own[name]] for name in names[start : start + _STRUCTURES]}
        there = _on_reference(carrying, reference_id, some)
        at = np.concatenate([own[name] for name in some])
        values[at] = np.column_stack([there.place, there.probability, there.error_m])
        doubtful[at] = there.doubtful
    columns = [f"reference_{name}" for name in ("x_m", "y_m", "z_m", "probability", "error_m")]
    rows[columns], rows["reference_doubtful"] = values, doubtful
    for column, value in (("class", class_name), ("state", state)):
        rows = rows if value is None else rows[rows[column] == value]
    return rows.reset_index(drop=True)


def _on_reference(carrying: Carrying, reference_id: str, rows: Mapping[str, pd.DataFrame]) -> Counterparts:
    """The places on a reference of the findings of some structures, one structure after the other."""
    entries = [each["entry_id"].tolist() for each in rows.values()]
    key = [reference_id, [carrying.pair_key(name, reference_id) for name in rows], entries]

    def placed() -> Counterparts:
        spots = ([spot_of({str(key): value for key, value in row.items()}) for row in each.to_dict("records")]
                 for each in rows.values())  # fmt: skip
        return Counterparts.stacked([carrying.to(some, reference_id) for some in spots])

    return carrying.remembered("findings-on-reference", Counterparts, key, placed)


def kind_map(catalog: Catalog, kind: str) -> tuple[str, pd.DataFrame]:
    """The structure of a kind that is the map for all, and the kind's findings `by_reference` there."""
    carrying = Carrying(catalog)
    reference = carrying.reference(kind)
    return reference, by_reference(catalog, reference, carrying=carrying)


def study_kinds(catalog: Catalog) -> list[str]:
    """Remember what questions need about each kind that has findings; what could not be, in words."""
    carrying, problems = Carrying(catalog), list[str]()
    for kind in sorted(set(catalog.findings()["kind"]).intersection(carrying.kinds.values())):
        problems += carrying.study(kind)
        by_reference(catalog, carrying.reference(kind), carrying=carrying)
    for some in _groups(catalog):
        _remembered(catalog, some["looks_sha256"].tolist())
    return problems


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
    """The finest look of each flown flight at places of its structure, with the number of the place.

    Spots are by a number: a structure and a place on it, m, with the normal there, (6,). A look has
    `looked_at`, `flight_id`, `demonstration_id`, `sampled_m` and `incidence_deg`.
    """
    numbers: dict[str, list[int]] = {}
    for number, (name, _) in spots.items():
        numbers.setdefault(name, []).append(number)
    columns = ["target_id", "flown_at", *_OF_FLIGHT]
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
                    flight = {name: row[name] for name in _OF_FLIGHT}
                    look = {name: float(getattr(looks, name)[nearest]) for name in _OF_LOOK}
                    yield number, {"looked_at": row["flown_at"], **flight, **look}


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

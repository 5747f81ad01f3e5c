"""Questions over the whole fleet: where a place was photographed, and findings by place on one structure."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from upplied.catalog import Catalog
from upplied.catalog.schema.rows import camera_of
from upplied.catalog.verbs.queries import When, moment
from upplied.errors import CatalogError
from upplied.findings.carried import Carrying, Counterparts
from upplied.findings.looks import Spot, looks_at_spot, looks_frame, spot_of
from upplied.findings.rays import focal_of


def photographed(
    catalog: Catalog,
    of: Spot | dict[str, Any],
    to: str = "kind",
    mm_px: float = np.inf,
    since: When | None = None,
    every: bool = False,
    carrying: Carrying | None = None,
) -> pd.DataFrame:
    """How a place was last seen on each structure of a kind, by demonstrations and flights really flown.

    Parameters
    ----------
    catalog : Catalog
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
    carrying : Carrying, optional

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
    flights = catalog.flights(kind="flown").drop_duplicates("flight_id", keep="last")
    flights = flights[(flights["looks_sha256"] != "") & flights["target_id"].isin(set(names))]
    earliest = pd.Timestamp.min.tz_localize("UTC") if since is None else moment(since)
    flights = flights[~(flights["flown_at"] < earliest)]
    demonstrated = set(catalog.demonstrations()["structure_id"])
    focal = _focals(catalog)
    own: dict[str, list[dict[Any, Any]]] = {}
    columns = ["target_id", "flight_id", "demonstration_id", "flown_at", "looks_sha256"]
    for each in flights[columns].to_dict("records"):
        own.setdefault(each["target_id"], []).append(each)
    rows = []
    if every:
        places = [(name, there) for name in names for there in carrying.instances(spot, name)]
    else:
        places = list(zip(names, carrying.everywhere([spot], names), strict=True))
    for name, there in places:
        place, error = there.place[0], float(np.hypot(there.error_m[0], own_error))
        row = {"structure_id": name, "part": int(there.part[0])}
        row |= dict(zip(("x_m", "y_m", "z_m"), place, strict=True))
        row |= {"probability": there.probability[0], "error_m": error, "doubt": there.doubt(0)}
        flown = own.get(name, ()) if np.isfinite(place[0]) else ()
        looks = [_seen(catalog, each, place, there.normal[0], focal) for each in flown]
        if name in demonstrated and np.isfinite(place[0]):
            looks += _demonstrated(catalog, Spot(name, place, there.normal[0], there.place))
        count = [
            look for look in looks if look and look["mm_px"] <= mm_px and not look["looked_at"] < earliest
        ]
        last: dict[str, Any] = max(count, key=lambda one: one["looked_at"], default={})
        none = {"looked_at": pd.NaT, "flight_id": "", "mm_px": np.nan, "incidence_deg": np.nan}
        rows.append(row | none | last | {"looks": len(count)})
    frame = pd.DataFrame(rows)
    frame["looked_at"] = pd.to_datetime(frame["looked_at"], utc=True)
    return frame


def by_reference(
    catalog: Catalog,
    reference_id: str,
    *,
    class_name: str | None = None,
    state: str | None = None,
    carrying: Carrying | None = None,
) -> pd.DataFrame:
    """The findings of a kind with their places on one structure of it, the map for all.

    Parameters
    ----------
    catalog : Catalog
    reference_id : str
    class_name, state : str, optional
    carrying : Carrying, optional

    Returns
    -------
    DataFrame
        As `Catalog.findings`, with `reference_x_m`, `reference_y_m`, `reference_z_m` (NaN where there is no
        counterpart), `reference_probability`, `reference_error_m` and `reference_doubtful`.
    """
    carrying = carrying or Carrying(catalog)
    if reference_id not in carrying.kinds:
        raise CatalogError(f"structure {reference_id}", "is not in the catalog")
    rows = catalog.findings(kind=carrying.kinds[reference_id], class_name=class_name, state=state)
    columns = [f"reference_{name}" for name in ("x_m", "y_m", "z_m", "probability", "error_m", "doubtful")]
    if rows.empty:
        return rows.reindex(columns=[*rows.columns, *columns])
    own: dict[str, list[int]] = {}
    for at, name in enumerate(rows["target_id"]):
        own.setdefault(name, []).append(at)
    order, every = np.concatenate([*own.values()]), rows.to_dict("records")
    key = [reference_id, [carrying.pair_key(name, reference_id) for name in own], rows["entry_id"].tolist()]

    def placed() -> Counterparts:
        spots = ([spot_of({str(key): value for key, value in every[at].items()}) for at in some]
                 for some in own.values())  # fmt: skip
        return Counterparts.stacked([carrying.to(some, reference_id) for some in spots])

    there = carrying.remembered("findings-on-reference", Counterparts, key, placed).rows(np.argsort(order))
    values = np.column_stack([there.place, there.probability, there.error_m])
    rows[columns[:5]], rows[columns[5]] = values, there.doubtful
    return rows


def kind_map(catalog: Catalog, kind: str) -> tuple[str, pd.DataFrame]:
    """The structure of a kind that is the map for all, and the kind's findings `by_reference` there."""
    carrying = Carrying(catalog)
    reference = carrying.reference(kind)
    return reference, by_reference(catalog, reference, carrying=carrying)


def study_kinds(catalog: Catalog) -> list[str]:
    """Remember what questions need about each kind that has findings; what could not be, in words."""
    carrying = Carrying(catalog)
    kinds = sorted(set(catalog.findings()["kind"]).intersection(carrying.kinds.values()))
    return [problem for kind in kinds for problem in carrying.study(kind)]


def _seen(
    catalog: Catalog, flight: dict[Any, Any], place: Any, normal: Any, focal: dict[str, float]
) -> dict[str, Any] | None:
    """The look of a flight at the patch nearest to a place; None where it did not see it for certain."""
    looks = catalog.looks.get(flight["looks_sha256"]).certain
    patch = catalog.surfaces.nearest(looks.samples_sha256, place, normal)
    at = int(np.searchsorted(looks.patch, patch))
    if at == len(looks.patch) or looks.patch[at] != patch:
        return None
    ways = [(looks.distance_m[at], looks.incidence_deg[at])]
    if looks.frontal_distance_m is not None and looks.frontal_incidence_deg is not None:
        ways.append((looks.frontal_distance_m[at], looks.frontal_incidence_deg[at]))
    pixels = focal.get(str(flight["demonstration_id"]), np.nan)
    fine = [(1e3 * far / max(np.cos(np.radians(aslant)), 1e-6) / pixels, aslant) for far, aslant in ways]
    finest, aslant = min(fine)
    about = {"looked_at": flight["flown_at"], "flight_id": flight["flight_id"]}
    return about | {"mm_px": float(finest), "incidence_deg": float(aslant)}


def _demonstrated(catalog: Catalog, spot: Spot) -> list[dict[str, Any] | None]:
    """The finest look of each demonstration at a spot."""
    finest = looks_frame(looks_at_spot(catalog, spot, ("demonstration",))).drop_duplicates("flight_id")
    about = {"taken_at": "looked_at", **{name: name for name in ("flight_id", "mm_px", "incidence_deg")}}
    return [{about[name]: row[name] for name in about} for row in finest.to_dict("records")]


def _focals(catalog: Catalog) -> dict[str, float]:
    """Pixels per radian of the camera of each demonstration."""
    rows = catalog.demonstrations(every=True).to_dict("records")
    return {str(row["demonstration_id"]): focal_of(camera_of(row))[0] for row in rows}

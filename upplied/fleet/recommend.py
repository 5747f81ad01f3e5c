"""Which demonstration of the catalog fits a structure best, and why, without planning any.

Shapes are compared by their cached features, thousands at once; the few structures most alike are
registered for real, and what was inspected on them is foreseen on the target. Everything found is
remembered by content in the catalog's cache, where plans find clouds and registrations again.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pandas as pd

from upplied.catalog import Catalog
from upplied.checks import check_id
from upplied.config import Settings, settings_for
from upplied.errors import InputError
from upplied.fleet.shapes import Shapes
from upplied.planning.features import unlikeness
from upplied.planning.foresee import (
    Agreement,
    Foreseen,
    Inspected,
    agreement,
    diagonal_m,
    foresee,
    inspected,
)
from upplied.planning.measure import TRULY, Views, views
from upplied.planning.pair import content_key, registration_key
from upplied.planning.register import register
from upplied.records import Camera, Registration
from upplied.scene import scene_of

# Misfit and unlikeness together, of at most about one each where structures correspond. Boxes made equal
# let a cooling tower lie well on a ship: where only one of the two is small, somebody should look first.
_SURE = 1.5
_SOURCES, _FLIGHTS = 6, 60  # structures registered for real, flights on them that are foreseen


@dataclass(frozen=True)
class Recommendation:
    """One demonstration, and what is expected of carrying it to the structure asked for."""

    rank: int
    demonstration_id: str
    source_id: str
    kind: str  # as declared of the source; it has no say in the rank
    verdict: str  # "own", "fits", "doubtful" or "refused", as planning would refuse it
    misfit: float  # of the structures, lower is better; the gate is `RegistrationSettings.acceptance`
    predicted_seen_pct: float  # `coverage_seen_pct` that a plan should reach at least; NaN: nothing to see
    without_pct: float  # of what was inspected, without a counterpart on the structure asked for
    inspected_pct: float  # of the source's surface
    unlikeness: float  # of the shapes, by which the candidates were chosen
    why: str


def recommend(catalog: Catalog, structure_id: str, most: int = 10) -> list[Recommendation]:
    """The demonstrations that would transfer best to a structure, best first.

    Flights over the structure itself come first where there are any: they need no transfer.
    Declared kinds are reported, never used.

    Parameters
    ----------
    catalog : Catalog
    structure_id : str
    most : int
        How many are returned at most; more are never looked at than the flights over the few
        structures most alike.

    Raises
    ------
    InputError
        If the catalog does not hold the structure, or no demonstration whose structure it holds.
    """
    check_id(structure_id, "structure id")
    structures = catalog.structures().set_index("structure_id")
    if structure_id not in structures.index:
        some = ", ".join(sorted(structures.index)[:10]) or "none"
        raise InputError(f"structure {structure_id!r}", "is not in the catalog", f"known: {some}")
    flights = catalog.demonstrations()
    flights = flights[flights["structure_id"].isin(structures.index)]
    if not len(flights):
        raise InputError(
            f"catalog {catalog.location}",
            "holds no demonstration of any of its structures",
            remedy="add logs first: upplied demonstrations add",
        )
    candidates = _candidates(catalog, structure_id, structures, flights)
    pairs = _Pairs(catalog, structure_id, structures)
    found = [pairs.judge(row, unlike) for row, unlike in candidates]
    found.sort(key=_order)
    return [_ranked(one, place) for place, one in enumerate(found[:most], 1)]


def _candidates(
    catalog: Catalog, structure_id: str, structures: pd.DataFrame, flights: pd.DataFrame
) -> list[tuple[pd.Series, float]]:
    """The flights over the structures most alike, with how unlike those are."""
    sources = sorted(set(flights["structure_id"]))
    shapes = Shapes(catalog)
    library = shapes.library(structures.loc[sources, "sha256"].to_dict())
    mine = shapes.features(structure_id, structures.loc[structure_id, "sha256"])
    unlike = unlikeness(mine, library)
    nearest = np.argsort(unlike, kind="stable")[:_SOURCES]
    by_source = flights[flights["structure_id"].isin([sources[index] for index in nearest])]
    by_source = by_source.sort_values("demonstration_id").groupby("structure_id")
    each = {sources[index]: float(unlike[index]) for index in nearest}
    share = math.ceil(_FLIGHTS / len(each))
    return [(row, each[name]) for name in each for _, row in by_source.get_group(name).head(share).iterrows()]


@dataclass(frozen=True)
class _Judged:
    """A flight and what was found out about it."""

    row: pd.Series
    kind: str
    unlike: float
    own: bool
    registration: Registration
    agreement: Agreement
    seen: Inspected
    foreseen: Foreseen
    size: float  # diagonal of the structure asked for over that of the source


class _Pairs:
    """What is known of one structure as the target of others, remembered by content."""

    def __init__(self, catalog: Catalog, target_id: str, structures: pd.DataFrame) -> None:
        self.catalog, self.target_id, self.structures = catalog, target_id, structures
        self.settings: Settings = settings_for("recommended")
        self.shapes = Shapes(catalog)
        self.target_sha256 = str(structures.loc[target_id, "sha256"])
        self.target = self.shapes.cloud(target_id, self.target_sha256)

    def judge(self, row: pd.Series, unlike: float) -> _Judged:
        """One flight: registration, parts, what was inspected, and what is foreseen of it."""
        source_id = str(row["structure_id"])
        source_sha256 = str(self.structures.loc[source_id, "sha256"])
        source = self.shapes.cloud(source_id, source_sha256)
        cache, clouds, rules = self.catalog.cache, self.settings.clouds, self.settings.registration
        facts = (source_sha256, self.target_sha256, clouds, rules)
        registration = cache(
            "registration",
            Registration,
            registration_key("surface", *facts),
            lambda: register(source, self.target, rules),
        )
        matched = cache(
            "agreement",
            Agreement,
            content_key("agreement", *facts),
            lambda: agreement(source, self.target, registration),
        )
        seen = self._inspected(row, source_id, source_sha256)
        camera = self._camera(row)
        foreseen = cache(
            "foreseen",
            Foreseen,
            content_key("foreseen", row["sha256"], *facts),
            lambda: foresee(diagonal_m(source), self.target, registration, seen, camera),
        )
        return _Judged(
            row=row,
            kind=str(self.structures.loc[source_id, "kind"]),
            unlike=unlike,
            own=source_id == self.target_id,
            registration=registration,
            agreement=matched,
            seen=seen,
            foreseen=foreseen,
            size=diagonal_m(self.target) / diagonal_m(source),
        )

    def _inspected(self, row: pd.Series, source_id: str, source_sha256: str) -> Inspected:
        clouds = self.settings.clouds
        facts = (row["sha256"], source_sha256, clouds)

        def compute() -> Inspected:
            flight = self.catalog.demonstration(str(row["demonstration_id"]))
            structure = self.catalog.structure(source_id)
            cloud = self.shapes.cloud(source_id, source_sha256)
            path = flight.trajectory
            seen = self.catalog.cache(
                "views",
                Views,
                content_key("truly", *facts),
                lambda: views(path, cloud, flight.camera, TRULY, scene_of(structure)),
            )
            return inspected(cloud, seen)

        return self.catalog.cache("inspected", Inspected, content_key("inspected", *facts), compute)

    @staticmethod
    def _camera(row: pd.Series) -> Camera:
        return Camera(
            float(row["hfov_deg"]),
            float(row["vfov_deg"]),
            float(row["min_range_m"]),
            float(row["max_range_m"]),
        )


def _verdict(one: _Judged) -> str:
    if one.own:
        return "own"
    if not one.registration.accepted:
        return "refused"
    return "fits" if one.registration.acceptance + one.unlike < _SURE else "doubtful"


def _order(one: _Judged) -> tuple[int, float, float, str]:
    """What fits comes first, by what should be seen again and how surely; the rest by likeness."""
    verdict = _verdict(one)
    again = float(np.nan_to_num(one.foreseen.coverage_seen_pct)) * (1 - one.foreseen.without_pct / 100) / 100
    sure = math.exp(-one.registration.acceptance - one.unlike)
    place = {"own": 0, "fits": 1}.get(verdict, 2)
    return place, -again * sure if place == 1 else one.unlike, -again, str(one.row["demonstration_id"])


def _ranked(one: _Judged, place: int) -> Recommendation:
    return Recommendation(
        rank=place,
        demonstration_id=str(one.row["demonstration_id"]),
        source_id=str(one.row["structure_id"]),
        kind=one.kind,
        verdict=_verdict(one),
        misfit=one.registration.acceptance,
        predicted_seen_pct=one.foreseen.coverage_seen_pct,
        without_pct=one.foreseen.without_pct,
        inspected_pct=100 * one.seen.share,
        unlikeness=one.unlike,
        why=_why(one),
    )


def _why(one: _Judged) -> str:
    if one.own:
        return f"flown on this very structure; {one.seen.summary}"
    if not one.registration.accepted:
        return one.registration.reason
    parts = one.agreement
    said = [
        f"the structures fit (misfit {one.registration.acceptance:.2f})",
        f"{parts.parts_matched} of {parts.parts} parts match ({100 * parts.area_matched:.0f} % of it)",
        f"{one.size:.2f} times its size",
        one.seen.summary,
    ]
    if one.foreseen.without_pct > 0.5:
        said.append(f"{one.foreseen.without_pct:.0f} % of that has no counterpart here")
    if _verdict(one) == "doubtful":
        said.append(f"but their shapes are unlike ({one.unlike:.2f}): look at both before flying")
    return "; ".join(said)
